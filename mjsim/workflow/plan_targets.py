"""Targets at which to measure one axis, and how well its errors are known after it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.estimation.at_rest import RestFitter, RestProblem, SampleNoise
from mjsim.estimation.calibration import expected_effects
from mjsim.instruments.positions.measurement import PositionTest, Reader
from mjsim.instruments.positions.plan import fewest_targets, targets_over
from mjsim.machine.model import Machine

#: Digits of a target, of its unit (mm or °).
_DIGITS = 3
#: A number is told where the measurement takes at least this share of its uncertainty.
_TOLD = 0.1


@dataclass(frozen=True)
class PlannedTargets:
    """A test to be measured.

    Attributes:
        test: With its targets.
        known: By id of an effect and name of its number, 95 % half widths by the class alone and after the test, in
            the unit of the number.
        noise: Standard deviation of one reading that was reckoned with, in :attr:`unit`.
        unit: As a plot labels it.
    """

    test: PositionTest
    known: dict[tuple[str, str], tuple[float, float]]
    noise: float
    unit: str

    def table(self) -> dict:
        """The ``[[test]]`` table."""
        t = self.test
        line = {} if t.rotary else {"line_mm": [0.0, 0.0, 0.0]}
        targets = [round(float(v) / t.unit, _DIGITS) for v in t.targets]
        key = "targets_deg" if t.rotary else "targets_mm"
        return {"name": t.name, "kind": t.kind, "axis": t.axis, **line, key: targets, "runs": t.runs}

    def to_json(self) -> dict:
        """Plain data."""
        rows = [
            {"id": i, "parameter": n, "half_width95": float(f"{after:.3g}"), "class_half_width95": float(f"{now:.3g}")}
            for (i, n), (now, after) in self.known.items()
        ]
        return {"test": self.table(), "targets": len(self.test.targets), "known": rows}


def plan_targets(
    campaign: Campaign,
    machine: Machine,
    axis: str,
    ends: dict[str, tuple[float, float]],
    count: int | None = None,
) -> PlannedTargets:
    """Targets of one axis.

    Args:
        campaign: For which they are.
        machine: As given.
        axis: Letter of the axis.
        ends: Range of the test by letter of the axis, mm or degrees.
        count: How many; without it as few as the standard allows.

    Raises:
        InputError: The machine has no such axis, or nobody says its range.
    """
    chain = machine.chain
    for letter in (axis, *ends):
        if letter not in chain.letters:
            raise InputError(f"axis {letter!r}; allowed: {', '.join(chain.letters)}")
    names = {t.name for t in campaign.tests}
    first = f"targets-{axis.lower()}"
    name = next(n for n in itertools.chain([first], (f"{first}-{i}" for i in itertools.count(2))) if n not in names)
    test = PositionTest(name, axis, f"E{axis}{axis}", setup=name, chain=chain)
    if axis not in ends:
        if not test.rotary:
            raise InputError(f"no range of {axis}; allowed: --range {axis} LOW HIGH, mm")
        ends = {axis: (0.0, 360.0)}
    low, high = (v * test.unit for v in ends[axis])
    if not low < high:
        raise InputError(f"range of {axis}: {ends[axis][0]:g} to {ends[axis][1]:g}; allowed: the lower end first")
    period = 2.0 * math.pi / machine.drives[axis].gear
    targets = targets_over(low, high, count or fewest_targets(test.rotary, high - low), period)
    targets = np.round(targets / test.unit, _DIGITS) * test.unit
    test = replace(test, targets=tuple(float(v) for v in targets))
    known, noise = _known_after(campaign, machine, test)
    return PlannedTargets(test, known, noise / test.channel.size, test.channel.unit)


def _known_after(
    campaign: Campaign, machine: Machine, test: PositionTest
) -> tuple[dict[tuple[str, str], tuple[float, float]], float]:
    """Half widths of what a test tells, and its noise in SI."""
    reader = campaign.instruments.get(test.instrument, Reader())
    planned = replace(campaign, tests=(test,), traces={test.name: test.planned}, instruments={test.instrument: reader})
    problem = RestProblem.of(planned)
    noise = reader.stated_noise(test)[0]
    problem = replace(problem, noise=SampleNoise(np.full(len(problem.value), noise)))
    shown = [c.free for c in expected_effects(machine) if problem.shows(machine, c.free)]
    fit = RestFitter(problem, machine).fit(shown, iterations=0)
    prior, after = fit.parameters.precision(), np.sqrt(np.diag(fit.covariance))
    known: dict[tuple[str, str], tuple[float, float]] = {}
    for f in fit.effects:
        if f.names == ("components",):
            continue
        at = fit.parameters[f.block.name]
        for name, before, then in zip(f.names, prior[at] ** -0.5, after[at], strict=True):
            if then <= (1.0 - _TOLD) * before:
                scale = f.specs[name].scale
                known[f.effect.id, name] = 1.96 * before * scale, 1.96 * then * scale
    return known, float(noise)
