"""When the catalogue does not explain what is left: generic terms that say on what the rest depends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mjsim.inference.effect_file import effect_source
from mjsim.inference.fit import Fit, Fitter
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID_STEPS
from mjsim.inference.search import THRESHOLD, Search
from mjsim.inference.signatures import Projector
from mjsim.kinematics import AXES, ROTARY
from mjsim.units import DEG, UM

#: Knots of the free curve of each variable.
_KNOTS = {"position": 36, "direction": 24, "velocity": 12, "acceleration": 12, "time_since_reversal": 10, "clock_time": 12}
_PER_TURN = 24  # knots of a rotary axis' position counted over all turns


@dataclass(frozen=True)
class Unexplained:
    """Something repeatable that no catalogue effect explains.

    Attributes:
        axes, variable: on what it depends. period: in units of the variable, or ``None``. rms: m. tests: where it shows.
        summary: one sentence. curve: knots of the variable and the empirical term there (file units: mm or °, µm or °).
        source: text of an effect file in that form. effect_file: where it was written, if it was.
    """

    axes: tuple[str, ...]
    variable: str
    period: float | None
    rms: float
    tests: tuple[str, ...]
    summary: str
    curve: tuple[np.ndarray, np.ndarray]
    source: str = ""
    effect_file: str | None = None

    def to_json(self) -> dict:
        """As in the JSON of ``mjsim diagnose``."""
        return {
            "axes": list(self.axes),
            "variable": self.variable,
            "period": self.period,
            "rms_um": round(self.rms / UM, 4),
            "tests": list(self.tests),
            "summary": self.summary,
            "effect_file": self.effect_file,
        }


@dataclass
class _Term:
    axis: str
    variable: str
    knots: np.ndarray
    columns: list[np.ndarray]
    period: float | None = None
    gain: float = 0.0
    coefficients: np.ndarray | None = None

    @property
    def price(self) -> float:
        n = self.columns[0].shape[1]
        return n + 5.0 * np.sqrt(2.0 * n)


def _hats(x: np.ndarray, knots: np.ndarray, period: float | None) -> np.ndarray:
    """Piecewise-linear basis (n, len(knots)) on equally spaced ``knots``; wrapped when there is a period."""
    step = knots[1] - knots[0]
    u = (x - knots[0]) / step
    n = len(knots)
    if period:
        u = np.mod(u, n)
    else:
        u = np.clip(u, 0, n - 1)
    i = np.floor(u).astype(int)
    f = u - i
    out = np.zeros((len(x), n))
    rows = np.arange(len(x))
    out[rows, i % n] += 1 - f
    out[rows, (i + 1) % n if period else np.minimum(i + 1, n - 1)] += f
    return out


def _terms(problem: Problem, fit: Fit) -> list[_Term]:
    """Generic terms: a free curve of each variable of each axis, acting in that axis' direction."""
    loads = [m.commands[::GRID_STEPS] for m in problem.motions]
    time = [m.time[::GRID_STEPS] for m in problem.motions]
    out = []
    for i, axis in enumerate(AXES):
        if not any(np.ptp(q[:, i]) for q in loads):
            continue
        velocity = [np.gradient(q[:, i], t) for q, t in zip(loads, time, strict=True)]
        for variable, count in _KNOTS.items():
            values = [
                _values(variable, q[:, i], t, v, test.started) for q, t, v, test in zip(loads, time, velocity, problem.tests, strict=True)
            ]
            used = np.concatenate([x[_inside(t, p)] for x, t, p in zip(values, time, problem.motions, strict=True)])
            lo, hi = float(used.min()), float(used.max())
            if hi - lo < 1e-9:
                continue
            if variable in ("position", "direction") and axis in ROTARY and hi - lo > 1.9 * np.pi:
                turns = (hi - lo) / (2 * np.pi)
                out.append(_term(problem, fit, axis, variable, np.arange(count) * (2 * np.pi / count), 2 * np.pi, values, velocity))
                if variable == "position" and turns > 1.1:  # a count that is not taken modulo one turn
                    out.append(_term(problem, fit, axis, variable, np.linspace(lo, hi, int(_PER_TURN * turns)), None, values, velocity))
            else:
                out.append(_term(problem, fit, axis, variable, np.linspace(lo, hi, count), None, values, velocity))
    return out


def _values(variable: str, q: np.ndarray, t: np.ndarray, v: np.ndarray, started: float) -> np.ndarray:
    """The variable along one test, (n,)."""
    if variable in ("position", "direction"):
        return q
    if variable == "velocity":
        return v
    if variable == "acceleration":
        return np.gradient(v, t)
    return started + t if variable == "clock_time" else _since_reversal(t, v)


def _term(
    problem: Problem, fit: Fit, axis: str, variable: str, knots: np.ndarray, period: float | None, values: list, velocity: list
) -> _Term:
    i = AXES.index(axis)

    def columns(k: int) -> np.ndarray:
        basis = _hats(values[k], knots, period)
        if variable in ("direction", "time_since_reversal"):
            basis = basis * np.sign(velocity[k])[:, None]
        basis = basis * problem.sensitivity[k].axes[:, [i]] * (1e-5 if axis in ROTARY else 1e-6)
        s, shift = problem.samples[k], problem.shift(k, fit.nuisance)
        return np.column_stack([s.sample(c, shift) for c in basis.T])

    return _Term(axis, variable, knots, problem.map(columns), period)


def _inside(t: np.ndarray, motion) -> np.ndarray:
    lo, hi = motion.program.measured_span
    return (t >= lo) & (t <= hi)


def _since_reversal(t: np.ndarray, v: np.ndarray) -> np.ndarray:
    """log10 of the time since the last reversal, s (from 0.02 s on)."""
    sign = np.sign(np.where(np.abs(v) < 1e-9, 0.0, v))
    turn = np.concatenate([[0], np.flatnonzero(np.diff(sign) != 0) + 1])
    last = turn[np.searchsorted(turn, np.arange(len(t)), side="right") - 1]
    return np.log10(np.maximum(t - t[last], 0.02))


def look_for_unknown(
    problem: Problem, fitter: Fitter, search: Search, progress: Callable[[str, int, int], None]
) -> tuple[Unexplained | None, Search]:
    """What is left after the search, described by the generic term that explains most of it.

    Where a single generic term does much better than all the named effects together, these were a makeshift: they are withdrawn.
    """
    progress("looking at the rest", 0, 1)
    rest = _best(problem, search.fit)
    if rest is None:
        return None, search
    if search.found:
        named = search.start.objective - search.fit.objective
        alone = _best(problem, search.start)
        if alone is not None and alone.gain - alone.price > named + THRESHOLD and rest.gain > 0.02 * named:
            search = replace(search, fit=search.start, found=[])
            rest = alone
    return _describe(problem, search.fit, rest), search


def _best(problem: Problem, fit: Fit) -> _Term | None:
    projector = Projector(fit)
    best: _Term | None = None
    for term in _terms(problem, fit):
        white = problem.whiten(term.columns)
        matrix, score = projector.normal(white)
        matrix = matrix + np.eye(len(matrix)) * (1e-6 * np.trace(matrix) / len(matrix) + 1e-9)
        term.coefficients = np.linalg.solve(matrix, score)
        term.gain = float(score @ term.coefficients)
        if term.gain - term.price > THRESHOLD and (best is None or term.gain - term.price > best.gain - best.price):
            best = term
    return best


def _visible(problem: Problem, fit: Fit, parts: list[np.ndarray]) -> list[np.ndarray]:
    """What of a term's readings the nuisances cannot take up: block means per test, m."""
    n = len(fit.nuisance)
    taken = (fit.covariance @ (fit.design.T @ problem.whiten(parts)))[:n]
    return [d - c @ taken for d, c in zip(parts, problem.nuisance_columns(fit.readings, fit.nuisance), strict=True)]


def _describe(problem: Problem, fit: Fit, term: _Term) -> Unexplained:
    parts = _visible(problem, fit, [c @ term.coefficients for c in term.columns])
    rms = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
    shows = tuple(t.name for t, p in zip(problem.tests, parts, strict=True) if np.std(p) > 0.25 * problem.noise.rms)
    rotary = term.axis in ROTARY
    size = term.coefficients * (1e-5 if rotary else 1e-6)
    curve = (term.knots / DEG if rotary and term.variable in ("position", "direction") else term.knots, size / DEG if rotary else size / UM)
    words = {
        "time_since_reversal": "the time since its last reversal",
        "clock_time": "the clock",
        "direction": "its direction of motion and position",
    }
    summary = (
        f"Something that is not in the catalogue acts on the {term.axis} axis "
        f"and depends on {words.get(term.variable, 'its ' + term.variable)}: "
        f"{rms / UM:.2f} µm RMS in the readings, most in {max(zip(map(np.std, parts), (t.name for t in problem.tests), strict=True))[1]}."
    )
    source = effect_source(term.axis, term.variable, term.knots, size, term.period, summary, f"unexplained_{term.axis}.py")
    return Unexplained((term.axis,), term.variable, None if term.period is None else 360.0, rms, shows, summary, curve, source)
