"""What is left of an axis log after the search: on which variable it depends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.inference.axis_logs.data import AxisData
from mjsim.inference.axis_logs.discrepancy import discrepancy_of
from mjsim.inference.axis_logs.entries import AxisModel, Entry
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.search import LEAST

#: Cells of a variable, each with the mean of the residual in it.
_CELLS = 24
#: Waves over the position that are looked for, in orders of the motor.
_ORDERS = np.concatenate([np.arange(0.25, 4.01, 0.05), np.arange(5.0, 13.0, 1.0)])


@dataclass(frozen=True)
class UnexplainedRest:
    """Something that no cause of the catalogue explains.

    Attributes:
        axis: Letter.
        variable: On which it depends; empty where it depends on none of those that are looked at.
        period: Of a wave over the position, axis units; nothing where it is none.
        rms: Of the part that depends on it, axis units; of all that is left where it depends on nothing.
        share: Of the mean square of the rest.
        tests: Where it shows.
        left: RMS of all that is left beside the noise, in the recording that shows most of it, axis units.
        allowed: RMS that a sound machine may leave there.
        probability: That more than this is left.
        worst: Test, time, s, and position of the largest residual, axis units.
        between: Whether it is left of the difference of two encoders.
    """

    axis: str
    variable: str
    period: float | None
    rms: float
    share: float
    tests: tuple[str, ...]
    left: float
    allowed: float
    probability: float
    worst: tuple[str, float, float]
    between: bool = False


def unexplained_rest(fitter: LogFitter, fit: AxisFit, gear: float) -> UnexplainedRest | None:
    """What the final model leaves on one axis, and the variable on which it depends by the largest log evidence.

    Nothing where it is, more probably than not, no more than a sound machine leaves.
    """
    data = fitter.data
    if fit.discrepancy.probability < 0.5:
        return None
    n = len(data)  # of the positions
    fit = replace(fit, residual=fit.residual[:n], design=fit.design[:n], noise=fit.noise[:n], allowed=fit.allowed[:n])
    none, _ = _explained(fitter, fit, [np.zeros((len(r), 0)) for r in fit.residual])
    motions = [fitter.motion(fit.model, fit.model.vector, k) for k in range(len(data))]
    variables = [_variables(d, motion) for d, motion in zip(data, motions, strict=True)]
    period, wave = _wave(data, fit.residual, gear)
    ways = [v["direction"] for v in variables]
    rows = [(name, None, 1, _cells([v[name] for v in variables], ways)) for name in variables[0]]
    best, said = none + LEAST, ("", None, fit.residual)
    for name, length, choices, columns in (*rows, ("position", period, len(_ORDERS), wave)):
        evidence, parts = _explained(fitter, fit, columns)
        evidence -= math.log(choices * (len(rows) + 1))
        if evidence > best:
            best, said = evidence, (name, length, parts)
    return _described(fitter, fit, *said)


def _explained(fitter: LogFitter, fit: AxisFit, columns: list[np.ndarray]) -> tuple[float, list[np.ndarray]]:
    """Log evidence of what a fit leaves where it depends on some columns, each recording in its own size, and the part
    of every recording that depends on them.
    """
    design = [m * c for m, c in zip(np.sqrt(fit.mean_squares), columns, strict=True)]
    entries = tuple(Entry("rest", str(i), 0.0, deviation=1.0) for i in range(columns[0].shape[1]))
    found = discrepancy_of(AxisModel(fitter.machine, fit.model.axis, entries), fit.residual, design, fit.noise, ())
    return found.evidence, [d @ found.step for d in design]


def _described(
    fitter: LogFitter, fit: AxisFit, variable: str, period: float | None, parts: Sequence[np.ndarray]
) -> UnexplainedRest:
    """The rest with the part of every recording that depends on a variable."""
    sizes = np.array([np.sqrt(np.mean(p**2)) for p in parts])
    tests = tuple(d.name for d, s in zip(fitter.data, sizes, strict=True) if s > 0.5 * sizes.max())
    rms, at = float(np.sqrt(np.mean(sizes**2))), fit.discrepancy
    k = int(np.argmax(np.array(at.left) / at.allowed))
    sized, d = (at.left[k], at.allowed[k], at.probability), fitter.data[k]
    block = int(np.argmax(np.abs(fit.residual[k])))
    worst = d.name, float(d.means(d.time)[block]), float(d.means(d.record.actual)[block])
    left = [float((r - p) @ (r - p) / (r @ r)) for r, p in zip(fit.residual, parts, strict=True)]
    share = 1.0 - sum(left) / len(left)
    if share <= 0.0:  # it explains what is fast, and makes the whole no smaller
        return _described(fitter, fit, "", None, fit.residual)
    return UnexplainedRest(fit.model.axis, variable, period, rms, share, tests, *sized, worst)


def _variables(d: AxisData, motion) -> dict[str, np.ndarray]:
    """Variables of the blocks of one recording."""
    velocity = np.interp(d.time, motion.time, motion.velocity)
    torque = np.interp(d.time, motion.time, motion.torque)
    n = max(1, int(0.005 / d.step))
    smooth = np.convolve(velocity, np.ones(n) / n, "same")
    acceleration = np.gradient(smooth, d.time)
    turned = np.flatnonzero(np.diff(np.sign(smooth)) != 0)
    last = np.zeros(len(d.time))
    last[turned + 1] = d.time[turned + 1]
    since = d.time - np.maximum.accumulate(last)
    means = {
        "position": d.record.actual,
        "velocity": velocity,
        "acceleration": acceleration,
        "torque": torque,
        "time_since_reversal": np.log(since + 1e-3),
        "clock_time": d.time,
    }
    return {k: d.means(v) for k, v in means.items()} | {"direction": np.sign(d.means(velocity))}


def _cells(values: list[np.ndarray], direction: list[np.ndarray]) -> list[np.ndarray]:
    """Columns, one of every cell of a variable and direction, common to all recordings."""
    v, way = np.concatenate(values), np.concatenate(direction)
    edges = np.unique(np.quantile(v, np.linspace(0.0, 1.0, _CELLS + 1)[1:-1]))
    _, cell = np.unique(np.searchsorted(edges, v) * 2 + (way > 0), return_inverse=True)
    columns = np.eye(int(cell.max()) + 1)[cell]
    return np.split(columns, np.cumsum([len(x) for x in values])[:-1])


def _wave(data: Sequence[AxisData], residual: Sequence[np.ndarray], gear: float) -> tuple[float, list[np.ndarray]]:
    """Period and columns of the strongest wave over the position; its phase is each set-up's own."""
    setups = list(dict.fromkeys(d.test.setup for d in data))

    def columns(order: float) -> list[np.ndarray]:
        out = []
        for d, r in zip(data, residual, strict=True):
            angle, i = order * gear * d.means(d.record.actual), 2 * setups.index(d.test.setup)
            out.append(np.zeros((len(r), 2 * len(setups))))
            if np.ptp(angle) >= 4.0 * np.pi:
                out[-1][:, i : i + 2] = np.column_stack([np.cos(angle), np.sin(angle)])
        return out

    def explained(order: float) -> float:
        rows = zip(columns(order), residual, strict=True)
        return sum(float(np.sum((c.T @ r) ** 2) / (len(r) * (r @ r))) for c, r in rows)

    best = max(_ORDERS, key=explained)
    return float(2.0 * np.pi / (best * gear)), columns(best)
