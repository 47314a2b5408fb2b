"""Long traces made ready for drawing: broken at missing stretches, thinned without losing a glitch."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Samples that are drawn per full turn at most; a printed circle of 10 cm has some 1 850 dots of 1/150 inch.
PER_TURN = 2500


def broken(
    angle_deg: ArrayLike, value: ArrayLike, largest_gap_deg: float = 1.5
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same series with a NaN pair wherever neighbours lie apart, so that no line is drawn across a missing stretch.

    Args:
        angle_deg: (n,) angles in the order of recording [deg].
        value: (n,) values.
        largest_gap_deg: neighbours this far apart, and eight times as far as is usual in this series, are not joined
            [deg].

    Raises:
        ValueError: the two differ in shape.
    """
    angle, value = np.asarray(angle_deg, dtype=float), np.asarray(value, dtype=float)
    if angle.ndim != 1 or angle.shape != value.shape:
        raise ValueError(
            f"angle and value must be vectors of one length, not of shapes {angle.shape} and {value.shape}"
        )
    if angle.size < 3:
        return angle, value
    step = np.abs(np.diff(angle))
    usual = np.nanmedian(step)
    cut = np.flatnonzero(step > max(largest_gap_deg, 8.0 * usual)) + 1
    return np.insert(angle, cut, np.nan), np.insert(value, cut, np.nan)


def thinned(
    angle_deg: NDArray[np.float64], value: NDArray[np.float64], per_turn: int = PER_TURN
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most about ``per_turn`` samples per 360°: of each stretch the smallest and the largest value, in their order.

    Every peak and every step keeps its height. NaN (breaks) stay. Series that are short enough come back as they are.
    """
    finite = np.isfinite(angle_deg) & np.isfinite(value)
    if not finite.any():
        return angle_deg, value
    turns = max(np.ptp(angle_deg[finite]) / 360.0, 1e-3)
    stretch = int(angle_deg.size / (turns * per_turn) * 2.0)
    if stretch < 3:
        return angle_deg, value
    whole = -(-angle_deg.size // stretch) * stretch - angle_deg.size
    keep = ~finite
    keep[[0, -1]] = True
    for blank, farthest in ((np.inf, np.argmin), (-np.inf, np.argmax)):
        table = np.pad(np.where(finite, value, blank), (0, whole), constant_values=blank).reshape(-1, stretch)
        keep[farthest(table, axis=1) + np.arange(len(table)) * stretch] = True
    return angle_deg[keep], value[keep]
