"""Accuracy and repeatability of positioning by ISO 230-2:2014, clause 3.

At target i, x̄_i↑ and x̄_i↓ are the mean deviations from either side, s_i↑ and s_i↓ the standard uncertainties
(estimators of the standard deviation, n − 1). B_i = x̄_i↑ − x̄_i↓, x̄_i is the mean of both. Then

    R_i↑ = 4 s_i↑                   R_i = max(2 s_i↑ + 2 s_i↓ + |B_i|, R_i↑, R_i↓)      R = max R_i
    E↑ = max x̄_i↑ − min x̄_i↑        E = max(x̄_i↑, x̄_i↓) − min(x̄_i↑, x̄_i↓)             M = max x̄_i − min x̄_i
    A↑ = max(x̄_i↑ + 2 s_i↑) − min(x̄_i↑ − 2 s_i↑)      A the same over both sides            B = max |B_i|
"""

from __future__ import annotations

import numpy as np

#: Names of the figures: accuracy, repeatability, systematic error, mean systematic error, reversal error.
ACCURACY, REPEATABILITY, SYSTEMATIC, MEAN, REVERSAL = "AREMB"
#: Words for the sides in names of figures.
SIDES = {1.0: "forward", -1.0: "backward"}


def positioning_figures(target: np.ndarray, side: np.ndarray, deviation: np.ndarray) -> dict[str, float]:
    """Figures of one test, in the unit of the deviations; those that its readings do not give are left out.

    Args:
        target: Commanded positions, (n,).
        side: Side of approach, +1 or -1, (n,).
        deviation: Actual less commanded, (n,).

    Returns:
        ``A``, ``R``, ``E``, ``M``, ``B``, ``B_mean`` (the mean of B_i, with its sign), and ``A``, ``R`` and ``E`` of
        one side with its word. ``R`` and ``A`` need every target twice from each side.
    """
    places, index = np.unique(np.round(target, 9), return_inverse=True)
    mean: dict[float, np.ndarray] = {}
    spread: dict[float, np.ndarray] = {}
    for s in SIDES:
        rows = [deviation[(index == i) & (side == s)] for i in range(len(places))]
        if all(len(r) for r in rows):
            mean[s] = np.array([r.mean() for r in rows])
            if all(len(r) > 1 for r in rows):
                spread[s] = np.array([r.std(ddof=1) for r in rows])
    out: dict[str, float] = {}
    for s, word in SIDES.items():
        if s in mean:
            out[f"{SYSTEMATIC}_{word}"] = float(np.ptp(mean[s]))
        if s in spread:
            out[f"{REPEATABILITY}_{word}"] = float(4.0 * spread[s].max())
            out[f"{ACCURACY}_{word}"] = float((mean[s] + 2.0 * spread[s]).max() - (mean[s] - 2.0 * spread[s]).min())
    if len(mean) == 2:
        up, down = mean.values()
        out[SYSTEMATIC] = float(max(up.max(), down.max()) - min(up.min(), down.min()))
        out[MEAN] = float(np.ptp(0.5 * (up + down)))
        out[REVERSAL] = float(np.abs(up - down).max())
        out[f"{REVERSAL}_mean"] = float((up - down).mean())
    if len(spread) == 2:
        (up, down), (s_up, s_down) = mean.values(), spread.values()
        both = 2.0 * s_up + 2.0 * s_down + np.abs(up - down)
        out[REPEATABILITY] = float(np.max([both, 4.0 * s_up, 4.0 * s_down]))
        high, low = np.append(up + 2.0 * s_up, down + 2.0 * s_down), np.append(up - 2.0 * s_up, down - 2.0 * s_down)
        out[ACCURACY] = float(high.max() - low.min())
    order = [
        n + w for n in (ACCURACY, REPEATABILITY, SYSTEMATIC) for w in ("", *(f"_{word}" for word in SIDES.values()))
    ]
    return {n: out[n] for n in (*order, MEAN, REVERSAL, f"{REVERSAL}_mean") if n in out}
