"""The uncertainty budget of every fitted number: where its standard uncertainty comes from.

The posterior is one joint normal distribution. A block of it (set-up, instrument, data sheet, the other errors of the
machine) has as its row the variance of the number that would go if that block were known exactly (law of total
variance): Σ_nb Σ_bb⁻¹ Σ_bn. Blocks are correlated, so these rows need not add up. The total is the posterior's own.
They are of the fit as it is where the instrument has no error; what that adds (:mod:`mjsim.inference.considered`) is
the instrument's own row.

Noise and discrepancy are no parameters. Their rows are what the estimate makes of them: its weights on the readings,
C Jᵀ, on the covariance of the noise, and on that of what repeats and is in no model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from mjsim.digits import fixed
from mjsim.inference.calibration import LIMIT_DEVIATIONS, Calibrated
from mjsim.inference.considered import CHOICE, INSTRUMENT, TEMPERATURE
from mjsim.inference.data_sheet import DATA_SHEET
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.hypotheses import name_of
from mjsim.inference.nuisance import BAR_LENGTH, NEST
from mjsim.inference.posterior import beyond
from mjsim.inference.problem import Problem
from mjsim.inference.whitening import Whitening
from mjsim.machine.chain import is_rotary
from mjsim.units import unit_of

#: Rows of a budget in their order, and what makes each smaller.
REMEDIES = {
    "noise": "more revolutions or repeats of the same tests",
    "set_up": "tests with the same set-up that move the axes otherwise (`mjsim plan`), or a set-up that is measured",
    "instrument": "an instrument whose certificate states less",
    "data_sheet": "numbers of the drives from axis logs (`mjsim identify`)",
    "machine_model": "the mass of what the axis moves, which is here that of a usual machine",
    "temperature": "temperature sensors with less noise that are read more often",
    "other_errors": "tests that tell the machine's errors apart (`mjsim plan`)",
    "not_understood": "finding the cause of what repeats and is in no model",
    "choice_of_model": "a test that decides between the causes (`mjsim plan`)",
    "other_instrument": "more tests with the other instrument",
}
#: What the rows are called in sentences and tables.
NAMES = {
    "noise": "noise",
    "set_up": "set-up",
    "instrument": "instrument",
    "data_sheet": "data sheet",
    "machine_model": "model of the machine",
    "temperature": "temperature",
    "other_errors": "other errors of the machine",
    "not_understood": "what is not understood",
    "choice_of_model": "choice of the model",
    "other_instrument": "the other instrument's tests",
}
#: Probability with which ISO 14253-1 takes conformity for proven.
_SURE = 0.95


@dataclass(frozen=True)
class Budget:
    """Where the uncertainty of one number comes from, all in the number's unit.

    Attributes:
        effect_id: Of its effect.
        number: Name of the parameter; of a wave its order.
        unit: Symbol, empty for a ratio.
        value: The number.
        standard: Standard uncertainty.
        rows: Standard uncertainty of each part, by the names of :data:`REMEDIES`.
        expected: What the machine file says of it.
        limit: How far from that a machine of its class may be; ``None`` where no tolerance is stated.
        beyond: Probability that it is farther.
        remedies: What makes each row smaller.
    """

    effect_id: str
    number: str
    unit: str
    value: float
    standard: float
    rows: dict[str, float]
    expected: float = 0.0
    limit: float | None = None
    beyond: float | None = None
    remedies: Mapping[str, str] = field(default_factory=lambda: REMEDIES, repr=False)

    @property
    def decision(self) -> str:
        """``within``, ``beyond`` or ``open`` with 95 % (ISO 14253-1); empty where there is no limit."""
        if self.beyond is None:
            return ""
        return "beyond" if self.beyond >= _SURE else "within" if self.beyond <= 1.0 - _SURE else "open"

    @property
    def largest(self) -> str:
        """Name of the largest row."""
        return max(self.rows, key=self.rows.__getitem__)

    @property
    def sentence(self) -> str:
        """What most of it comes from, and what would make it smaller."""
        decimals = 1 - int(f"{self.standard or 1.0:.1e}".partition("e")[2])
        size = f"{fixed(self.rows[self.largest], decimals)} of {fixed(self.standard, decimals)} {self.unit}".rstrip()
        return f"most of it from {NAMES[self.largest]} ({size}); made smaller by {self.remedies[self.largest]}"

    def to_json(self) -> dict:
        """As one of ``budget`` in the JSON of ``mjsim diagnose``."""
        return {
            "id": self.effect_id,
            "number": self.number,
            "unit": self.unit,
            "value": self.value,
            "standard_uncertainty": self.standard,
            "expanded_uncertainty": 2.0 * self.standard,
            "parts": dict(self.rows),
            "largest": self.largest,
            "remedy": self.remedies[self.largest],
            "sentence": self.sentence,
            "expected": self.expected,
            "limit": self.limit,
            "probability_beyond": self.beyond,
            "decision": self.decision,
        }


#: Splits the variance that whitened weights of the readings (count,) make into rows: noise, what is not understood, and
#: the tests of another instrument that are rows of the same fit.
Split = Callable[[np.ndarray], dict[str, float]]


def budgets(
    fit: Fit,
    split: Split,
    stated: Mapping[str, Calibrated] = MappingProxyType({}),
    instruments: tuple[str, ...] = (BAR_LENGTH, NEST),
) -> tuple[Budget, ...]:
    """The budget of every number of the effects of a finished fit.

    Args:
        fit: With what is to be considered.
        split: Which part of the readings' errors is noise.
        stated: What the machine file states a tolerance for, by key.
        instruments: Beginnings of the names of the blocks that are an instrument's.
    """
    p, covariance, out = fit.parameters, fit.linear.covariance, []
    index, effects = np.arange(p.size), {f.block.name for f in fit.effects}
    blocks: dict[str, list[int]] = {"set_up": [], "instrument": [], "data_sheet": [], "other_errors": []}
    for block in p.blocks:
        if block.name == DATA_SHEET:
            row = "data_sheet"
        elif block.name in effects:
            row = "other_errors"
        else:
            row = "instrument" if block.name.startswith(instruments) else "set_up"
        blocks[row] += [int(i) for i in index[p[block.name]] if not p.frozen[i]]
    for f in fit.effects:
        own = index[p[f.block.name]]
        for number, unit, value, slope in _numbers(f):
            gradient = np.zeros(p.size)
            gradient[own] = slope
            moved = covariance @ gradient
            rows = split(fit.design @ fit.linear.solve(gradient))
            for row, entries in blocks.items():
                rows[row] = explained_by(covariance, moved, np.setdiff1d(entries, own).astype(int))
            # what is considered is in no block, and independent of all of them
            rows["instrument"] += _variance(gradient, fit.considered.get(INSTRUMENT))
            if TEMPERATURE in fit.considered:
                rows["temperature"] = _variance(gradient, fit.considered[TEMPERATURE])
            rows["choice_of_model"] = _variance(gradient, fit.considered.get(CHOICE))
            sizes = {row: float(np.sqrt(max(rows[row], 0.0))) for row in REMEDIES if row in rows}
            total = float(np.sqrt(max(gradient @ fit.covariance @ gradient, 0.0)))
            known = Budget(name_of(f.effect), number, unit, float(value), total, sizes)
            entries = np.flatnonzero(slope)
            out.append(_judged(known, f, entries, fit.covariance_of(f)[np.ix_(entries, entries)], stated))
    return tuple(out)


def _judged(
    known: Budget, f: EffectVector, entries: np.ndarray, covariance: np.ndarray, stated: Mapping[str, Calibrated]
) -> Budget:
    """A number with its limit and the probability that it is beyond, where a tolerance is stated for it."""
    of = stated.get(f.effect.key)
    if of is None or not len(entries):
        return known
    mean, deviation, own = of.prior_of(f)
    if not own[entries].all():
        return known
    name = "components" if f.names == ("components",) else known.number
    limit, scale = LIMIT_DEVIATIONS * float(deviation[entries[0]]), f.specs[name].scale
    at = [float(x) for x in mean[entries]]
    expected = math.hypot(*at) * scale if len(at) == 2 else float(f.specs[name].decode(at[0]))
    far = beyond((f.vector - mean)[entries], covariance, limit)
    return replace(known, expected=expected, limit=limit * scale, beyond=far)


def explained_by(covariance: np.ndarray, moved: np.ndarray, at: np.ndarray) -> float:
    """Variance of a number that goes if the entries ``at`` are known exactly; ``moved`` is its covariance with all."""
    if not len(at):
        return 0.0
    return float(moved[at] @ np.linalg.lstsq(covariance[np.ix_(at, at)], moved[at], rcond=1e-12)[0])


def _variance(gradient: np.ndarray, columns: np.ndarray | None) -> float:
    return 0.0 if columns is None else float(np.sum((gradient @ columns) ** 2))


def _numbers(f: EffectVector) -> Iterator[tuple[str, str, float, np.ndarray]]:
    """Name, unit, value and gradient by its entries (n,) of every size of an effect; phases have no row."""
    vector, i = f.vector, 0
    for n in f.names:
        p, slope = f.specs[n], np.zeros(len(vector))
        if n == "components":
            unit = "°" if is_rotary(f.effect.subject) else "µm"
            for order, amplitude, _ in f.effect.values[n]:
                slope = np.zeros(len(vector))
                slope[i : i + 2] = vector[i : i + 2] / max(float(np.hypot(*vector[i : i + 2])), 1e-12) * p.scale
                yield f"order {order:g}", unit, amplitude, slope
                i += 2
        elif f.polar and n == f.amplitude:
            slope[i : i + 2] = vector[i : i + 2] / max(float(np.hypot(*vector[i : i + 2])), 1e-12) * p.scale
            yield n, unit_of(n)[1], f.effect.values[n], slope
            i += 2
        elif not (f.polar and n == "phase_deg"):
            step = 1e-4
            slope[i] = (p.decode(vector[i] + step) - p.decode(vector[i] - step)) / (2.0 * step)
            if math.isfinite(slope[i]):  # an infinite stiffness has no uncertainty in its unit
                yield n, unit_of(n)[1], f.effect.values[n], slope
            i += 1


def split_rows(
    whitening: Whitening | None, rows: Sequence[slice], weights: np.ndarray
) -> Iterator[tuple[float, float]]:
    """Which part of a variance is the noise of each test, and which is what the whitening has beside it.

    Args:
        whitening: Of the errors beyond the campaign's noise; ``None`` where there is nothing but that.
        rows: Of each test.
        weights: On the whitened rows, (count,).
    """
    shared = weights if whitening is None else whitening.of_all(weights)
    for k, at in enumerate(rows):
        total = noise = float(weights[at] @ weights[at])
        if whitening is not None:
            noise = float(np.sum((whitening.factor[k] * whitening.of_test(k, shared[at])) ** 2))
        yield noise, total - noise


def split_of_bars(problem: Problem) -> Split:
    """How ball-bar readings split: the campaign's noise, as large as each test has it; the discrepancy and unknown
    curves, which the whitening has beside it.
    """

    def split(weights: np.ndarray) -> dict[str, float]:
        noise, beside = zip(*split_rows(problem.whitening, problem.rows, weights), strict=True)
        return {"noise": sum(noise), "not_understood": sum(beside)}

    return split
