"""Built-in programs: pieces that machines are judged by, as tool paths on the workpiece.

The tool's tip and direction are given in the workpiece; the machine's axes follow from its chain.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import Chain
from mjsim.machine.inverse import aim
from mjsim.machine.kinematics import rotation
from mjsim.units import DEG, MM

#: Points per block, m of path.
_STEP = 0.25 * MM
_FEED = 1000.0 * MM / 60.0

Path = tuple[np.ndarray, np.ndarray]


def _closed(tips: np.ndarray, tools: np.ndarray) -> Path:
    return tips, tools / np.linalg.norm(tools, axis=1)[:, None]


def cone() -> Path:
    """Flank of a cone frustum, once round at its base: half apex angle 15°, inclined by 10°, diameter 80 mm
    (ISO 10791-7, test piece M3; NAS 979).
    """
    theta, beta, radius = 15.0 * DEG, 10.0 * DEG, 40.0 * MM
    phi = np.linspace(-10.0 * DEG, 370.0 * DEG, 1100)
    base = radius * np.column_stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)])
    apex = np.array([0.0, 0.0, radius / np.tan(theta)])
    turn = rotation(1, beta)
    return _closed(base @ turn.T, (apex - base) @ turn.T)


def s_shape() -> Path:
    """Flank of an S-shaped ruled surface between two curves 40 mm apart in height, as the S-shaped test piece of ISO
    10791-7 has it. The curves are this project's own: a tool that leans up to 17°, to both sides.
    """
    u = np.linspace(-1.0, 1.0, 1600)
    low = np.column_stack([60.0 * MM * u, 35.0 * MM * np.sin(np.pi * u), np.zeros_like(u)])
    lean = 12.0 * MM * np.column_stack([np.sin(1.5 * np.pi * u), np.cos(0.5 * np.pi * u), np.zeros_like(u)])
    return _closed(low, lean + np.array([0.0, 0.0, 40.0 * MM]))


def sphere() -> Path:
    """Spiral on the upper half of a sphere of radius 30 mm, the tool halfway between its normal and the vertical."""
    turns, radius = 5, 30.0 * MM
    polar = np.linspace(8.0 * DEG, 75.0 * DEG, 7200)
    about = 2.0 * np.pi * turns * (polar - polar[0]) / np.ptp(polar)
    normal = np.column_stack([np.sin(polar) * np.cos(about), np.sin(polar) * np.sin(about), np.cos(polar)])
    return _closed(radius * normal, normal + np.array([0.0, 0.0, 1.0]))


def boss() -> Path:
    """Square boss with a side of 80 mm and corners of radius 10 mm, then a circle of diameter 60 mm; three axes."""
    half, corner = 40.0 * MM, 10.0 * MM
    pieces = [np.array([[0.0, -half]])]
    for k in range(4):
        a = -90.0 * DEG + 90.0 * DEG * k + np.linspace(0.0, 90.0 * DEG, 64)
        centre = (half - corner) * np.array([np.sign(np.cos(a[32])), np.sign(np.sin(a[32]))])
        pieces.append(centre + corner * np.column_stack([np.cos(a), np.sin(a)]))
    pieces.append(np.array([[0.0, -half]]))
    phi = np.linspace(-90.0 * DEG, 270.0 * DEG, 720)
    pieces.append(30.0 * MM * np.column_stack([np.cos(phi), np.sin(phi)]))
    return _flat(_even(np.vstack(pieces)))


def pocket() -> Path:
    """Square pocket of 60 mm by 40 mm with sharp corners, twice round, once each way; three axes."""
    a, b = 30.0 * MM, 20.0 * MM
    ring = np.array([[0.0, -b], [a, -b], [a, b], [-a, b], [-a, -b], [0.0, -b]])
    return _flat(_even(np.vstack([ring, ring[::-1]])))


def _even(corners: np.ndarray) -> np.ndarray:
    """Points about ``_STEP`` apart on straight lines between corners (n, 2)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    keep = np.concatenate([[True], np.diff(length) > 1e-9])
    corners, length = corners[keep], length[keep]
    counts = np.maximum(1, np.ceil(np.diff(length) / _STEP)).astype(int)
    pieces = [np.linspace(a, b, n + 1)[1:] for (a, b), n in zip(pairwise(length), counts, strict=True)]
    at = np.concatenate([length[:1], *pieces])
    return np.column_stack([np.interp(at, length, c) for c in corners.T])


def _flat(points: np.ndarray) -> Path:
    tips = np.column_stack([points, np.zeros(len(points))])
    return tips, np.tile([0.0, 0.0, 1.0], (len(tips), 1))


PARTS: dict[str, tuple[Callable[[], Path], str]] = {
    "cone": (cone, "cone frustum (NAS 979, ISO 10791-7)"),
    "s-shape": (s_shape, "S-shaped piece"),
    "sphere": (sphere, "sphere"),
    "boss": (boss, "square boss and circle"),
    "pocket": (pocket, "square pocket with sharp corners"),
}


def part(name: str, chain: Chain, place: np.ndarray, feed: float = _FEED) -> Commanded:
    """A built-in program as a commanded motion.

    Args:
        name: One of :data:`PARTS`.
        chain: The machine's axes.
        place: Zero point of the part in the work frame, (3,) m.
        feed: Of the tool's tip on the workpiece, m/s.

    Raises:
        InputError: there is no such part, or the machine cannot turn its tool that way.
    """
    if name not in PARTS:
        raise InputError(f"unknown part {name!r}; allowed: {', '.join(PARTS)}, or an NC file")
    tips, tools = PARTS[name][0]()
    points = aim(chain, tools)
    points[:, chain.linear_columns] = tips + place
    seconds = np.linalg.norm(np.diff(tips, axis=0), axis=1) / feed
    return Commanded(seconds, points, True, chain)
