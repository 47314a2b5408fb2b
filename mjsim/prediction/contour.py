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


def contour(path: np.ndarray, actual: np.ndarray) -> Contour:
    """The deviation of a motion from its path.

    Args:
        path: Programmed places of the tip at even instants, (n, 3) m.
        actual: Where the tip is at these instants, (n, 3) m.
    """
    n = len(path)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    # places of the path by its length: stretches where it rests count once
    keep = np.concatenate([[True], np.diff(length) > 1e-12])
    s, points = length[keep], path[keep]
    if len(s) < 2:
        return Contour(actual - path, np.zeros(n), np.tile([1.0, 0.0, 0.0], (n, 1)))
    at, best, found = length.copy(), np.full(n, np.inf), length.copy()
    for _ in range(_STEPS):
        near, tangent = _place(points, s, at)
        off = actual - near
        size = np.einsum("ni,ni->n", off, off)
        better = size < best
        best, found = np.where(better, size, best), np.where(better, at, found)
        at = np.clip(at + np.einsum("ni,ni->n", off, tangent), s[0], s[-1])
    near, tangent = _place(points, s, found)
    off = actual - near
    beyond = np.einsum("ni,ni->n", off, tangent)  # of an end of the path; nothing elsewhere
    return Contour(off - beyond[:, None] * tangent, found - length + beyond, tangent)


def _place(points: np.ndarray, s: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of a path at lengths ``at`` (n,), and its direction there (n, 3)."""
    k = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 2)
    step = points[k + 1] - points[k]
    whole = s[k + 1] - s[k]
    tangent = step / whole[:, None]
    return points[k] + (at - s[k])[:, None] * tangent, tangent
