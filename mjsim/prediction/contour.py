"""Contour error: how far the tool's tip is from the programmed path, normal to it, and how far behind along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Newton steps to the nearest point of the path.
_STEPS = 6


@dataclass(frozen=True)
class Contour:
    """Deviation from a path at every instant.

    Attributes:
        normal: From the nearest point of the path to the tool's tip, (n, 3) m in the workpiece.
        along: Length of path between the programmed place and the nearest point, (n,) m; negative where the tip is
            behind.
        tangent: Direction of the path at the nearest point, (n, 3).
    """

    normal: np.ndarray
    along: np.ndarray
    tangent: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """Length of the normal deviation, (n,) m."""
        return np.linalg.norm(self.normal, axis=1)


def contour(
    path: np.ndarray, actual: np.ndarray, at: np.ndarray | None = None, spans: np.ndarray | None = None
) -> Contour:
    """The deviation of a motion from its path.

    Args:
        path: Programmed places of the tip, (m, 3) m, so close to each other that it is straight between them.
        actual: Where the tip is at some of these instants, (n, 3) m.
        at: Which instants these are, (n,); nothing: all.
        spans: First and last instant of the path that each of them belongs to, (n, 2); nothing: of all.
    """
    at = np.arange(len(path)) if at is None else at
    n = len(at)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    # places of the path by its length: stretches where it rests count once
    keep = np.concatenate([[True], np.diff(length) > 1e-12])
    s, points = length[keep], path[keep]
    if len(s) < 2:
        return Contour(actual - path[at], np.zeros(n), np.tile([1.0, 0.0, 0.0], (n, 1)))
    low, high = length[spans].T if spans is not None else (s[0], s[-1])
    begin = length[at]
    best, found = np.full(n, np.inf), begin.copy()
    # from the programmed place, and from as far behind it as the tip is: at a corner the two lie on different sides
    for start in (begin, begin - np.linalg.norm(actual - path[at], axis=1)):
        place = np.clip(start, low, high)
        for _ in range(_STEPS):
            near, tangent = _place(points, s, place)
            off = actual - near
            size = np.einsum("ni,ni->n", off, off)
            better = size < best
            best, found = np.where(better, size, best), np.where(better, place, found)
            place = np.clip(place + np.einsum("ni,ni->n", off, tangent), low, high)
    near, tangent = _place(points, s, found)
    off = actual - near
    beyond = np.einsum("ni,ni->n", off, tangent)  # of an end of the path; nothing elsewhere
    return Contour(off - beyond[:, None] * tangent, found - begin + beyond, tangent)


def _place(points: np.ndarray, s: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of a path at lengths ``at`` (n,), and its direction there (n, 3)."""
    k = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 2)
    step = points[k + 1] - points[k]
    whole = s[k + 1] - s[k]
    tangent = step / whole[:, None]
    return points[k] + (at - s[k])[:, None] * tangent, tangent
