"""Targets at which to measure one axis, and how well its errors are known after it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.estimation.at_rest import RestFitter
from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.planning.at_rest import planned_problem
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.positions.measurement import PositionTest
from mjsim.instruments.positions.plan import planned_test
from mjsim.machine.model import Machine
from mjsim.units import DEG, MM

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

    def to_json(self) -> dict:
        """Plain data."""
        rows = [
            {"id": i, "parameter": n, "half_width95": float(f"{after:.3g}"), "class_half_width95": float(f"{now:.3g}")}
            for (i, n), (now, after) in self.known.items()
        ]
        return {
            "test": INSTRUMENTS[self.test.instrument].test_table(self.test),
            "targets": len(self.test.targets),
            "known": rows,
        }


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
    unit = DEG if chain.is_rotary(axis) else MM
    if axis not in ends:
        if not chain.is_rotary(axis):
            raise InputError(f"no range of {axis}; allowed: --range {axis} LOW HIGH, mm")
        ends = {axis: (0.0, 360.0)}
    low, high = ends[axis]
    if not low < high:
        raise InputError(f"range of {axis}: {low:g} to {high:g}; allowed: the lower end first")
    period = 2.0 * math.pi / machine.drives[axis].gear
    test = planned_test(name, axis, f"E{axis}{axis}", chain, (low * unit, high * unit), period, count)
    known, noise = _known_after(campaign, machine, test)
    return PlannedTargets(test, known, noise / test.channel.size, test.channel.unit)


def _known_after(
    campaign: Campaign, machine: Machine, test: PositionTest
) -> tuple[dict[tuple[str, str], tuple[float, float]], float]:
    """Half widths of what a test tells, and its noise in SI."""
    problem = planned_problem(campaign, test)
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
    return known, problem.noise.rms
