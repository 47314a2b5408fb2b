"""What is left of an axis log after the search: on which variable it depends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.fit import AxisFit, LogFitter
from mjsim.estimation.axis_logs.likelihood import independent_count
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings

#: Cells of a variable, each with the mean of the residual in it.
_CELLS = 24
#: Least share of the rest that a variable must explain to be named (assumed).
_SHARE = 0.25
#: Screw turns per wave that are looked for, in orders of the motor.
_ORDERS = np.concatenate([np.arange(0.25, 4.01, 0.05), np.arange(5.0, 13.0, 1.0)])
#: Share of the rest that one wave over the position must explain to be its period.
_WAVE = 0.1


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

    @property
    def is_beyond(self) -> bool:
        """Whether more is left than a sound machine leaves, more probably than not."""
        return self.probability >= 0.5


def unexplained_rest(
    fitter: LogFitter, fit: AxisFit, gear: float, settings: DiagnosisSettings = DIAGNOSIS
) -> UnexplainedRest | None:
    """What the final model leaves on one axis, and the variable that explains most of it.

    Nothing where it is no more than a sound machine leaves, and no variable explains it better than chance.
    """
    data = fitter.data
    noisy = [float(np.sqrt(m)) > 3.0 * d.noise.rms for m, d in zip(fit.mean_squares, data, strict=True)]
    assert fit.discrepancy is not None
    beyond = fit.discrepancy.probability >= 0.5
    if not any(noisy) and not beyond:
        return None
    residual = [r / max(float(np.sqrt(r @ r / len(r))), 1e-30) for r in fit.residual]
    total = sum(r @ r for r in residual)
    count = sum(independent_count(r, d.memory / (d.step * d.block)) for r, d in zip(residual, data, strict=True))
    columns = [_variables(d, fitter.motion(fit.model, fit.model.vector, k)) for k, d in enumerate(data)]
    best: tuple[float, str, list[np.ndarray]] | None = None
    for name in columns[0]:
        parts = _cell_means([c[name] for c in columns], [c["direction"] for c in columns], residual)
        share = 1.0 - sum((r - p) @ (r - p) for r, p in zip(residual, parts, strict=True)) / total
        cells = 2 if name == "direction" else 2 * _CELLS
        gain = -count * float(np.log(max(1.0 - share, 1e-9))) - settings.parameter_penalty * cells
        if gain > settings.likelihood_ratio and (best is None or gain > best[0]):
            best = (gain, name, parts)
    wave = _wave(data, residual, gear)
    if wave is not None and (best is None or wave[0] * count > best[0]):
        share, period, parts = wave
        return _described(fitter, fit, "position", period, share, parts)
    if best is not None:
        _, name, parts = best
        share = 1.0 - sum((r - p) @ (r - p) for r, p in zip(residual, parts, strict=True)) / total
        if share > _SHARE:
            return _described(fitter, fit, name, None, float(share), parts)
    return _described(fitter, fit, "", None, 1.0, residual) if beyond else None


def _described(fitter, fit: AxisFit, variable: str, period: float | None, share: float, parts) -> UnexplainedRest:
    sizes = np.array([np.sqrt(m * np.mean(p**2)) for m, p in zip(fit.mean_squares, parts, strict=True)])
    tests = tuple(d.name for d, s in zip(fitter.data, sizes, strict=True) if s > 0.5 * sizes.max())
    rms, at = float(np.sqrt(np.mean(sizes**2))), fit.discrepancy
    assert at is not None
    k = int(np.argmax(np.array(at.left) / at.allowed))
    sized, d = (at.left[k], at.allowed[k], at.probability), fitter.data[k]
    block = int(np.argmax(np.abs(fit.residual[k])))
    worst = d.name, float(d.means(d.time)[block]), float(d.means(d.record.actual)[block])
    return UnexplainedRest(fit.model.axis, variable, period, rms, float(share), tests, *sized, worst)


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


def _cell_means(values: list[np.ndarray], direction: list[np.ndarray], residual: list[np.ndarray]) -> list[np.ndarray]:
    """Mean of the residual in cells of a variable, by direction, common to all recordings."""
    v, way, r = (np.concatenate(x) for x in (values, direction, residual))
    edges = np.unique(np.quantile(v, np.linspace(0.0, 1.0, _CELLS + 1)[1:-1]))
    cell = np.searchsorted(edges, v) * 2 + (way > 0)
    sums, counts = np.bincount(cell, r, 2 * _CELLS + 2), np.bincount(cell, minlength=2 * _CELLS + 2)
    mean = (sums / np.maximum(counts, 1))[cell]
    return np.split(mean, np.cumsum([len(x) for x in residual])[:-1])


def _wave(data, residual: list[np.ndarray], gear: float) -> tuple[float, float, list[np.ndarray]] | None:
    """Share, period and parts of the strongest wave over the position; its phase is each set-up's own."""
    total = sum(r @ r for r in residual)
    best: tuple[float, float, list[np.ndarray]] | None = None
    for order in _ORDERS:
        parts = []
        for d, r in zip(data, residual, strict=True):
            angle = order * gear * d.means(d.record.actual)
            if np.ptp(angle) < 4.0 * np.pi:
                parts.append(np.zeros(len(r)))
                continue
            design = np.column_stack([np.cos(angle), np.sin(angle)])
            parts.append(design @ np.linalg.lstsq(design, r, rcond=None)[0])
        share = sum(p @ p for p in parts) / total
        if share > _WAVE and (best is None or share > best[0]):
            best = (float(share), float(2.0 * np.pi / (order * gear)), parts)
    return best
