"""Which few positions to probe a sphere at: those after which the location errors are known best.

Every point is a place of the rotary axes, a side from which it is approached and an angle of the spindle. Points are
taken one by one; each takes most from the uncertainty of the location errors, in units of what a machine of its class
may have, with set-up, probe and everything else that the class has as unknowns beside them.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.estimation.at_rest import RestFitter
from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.planning.at_rest import planned_problem
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.sphere.measurement import SphereTest
from mjsim.machine.model import Machine
from mjsim.units import DEG

#: Steps of the places that are looked at: axes that go round, and those that tilt; how far these tilt, rad.
_ROUND, _TILT, _FARTHEST = 30.0 * DEG, 15.0 * DEG, 90.0 * DEG


@dataclass(frozen=True)
class PlannedPoints:
    """A test to be measured.

    Attributes:
        test: With its positions, in the order of measuring.
        known: 95 % half width of every location error after it, in the unit of its number, by id.
        before: The same by the class alone.
        there: Whether the campaign has the test already, without positions.
        noise: Standard deviation of a centre that was reckoned with, m.
    """

    test: SphereTest
    known: dict[str, float]
    before: dict[str, float]
    noise: float
    there: bool = False

    def to_json(self) -> dict:
        """Plain data."""
        rows = [
            {"id": k, "half_width95": float(f"{v:.3g}"), "class_half_width95": float(f"{self.before[k]:.3g}")}
            for k, v in self.known.items()
        ]
        return {
            "test": INSTRUMENTS[self.test.instrument].test_table(self.test),
            "points": len(self.test.angles),
            "location_errors": rows,
        }


def plan_points(
    campaign: Campaign,
    machine: Machine,
    count: int,
    sphere: tuple[float, float, float] | None = None,
    farthest: dict[str, tuple[float, float]] | None = None,
) -> PlannedPoints:
    """Positions to measure.

    Args:
        campaign: Whose first sphere test says where the sphere is, if ``sphere`` does not.
        machine: As given.
        count: Points.
        sphere: Nominal centre in the work frame, m.
        farthest: Ends of a rotary axis' travel, rad, by letter; otherwise all round, or 90° to either side.

    Raises:
        InputError: Nobody says where the sphere is, or an axis is none that turns.
    """
    tests = [t for t in campaign.tests if isinstance(t, SphereTest)]
    if sphere is None and not tests:
        raise InputError(
            f"{campaign.folder / 'campaign.toml'}: no test with a sphere; say where it will be: --sphere X Y Z, mm in "
            "the work frame"
        )
    chain = machine.chain
    for axis in farthest or {}:
        if axis not in chain.rotary:
            raise InputError(f"axis {axis!r}; allowed: {', '.join(chain.rotary)}")
    at = sphere or tests[0].sphere
    names = {t.name for t in campaign.tests}
    blank = next((t for t in tests if t.trace is None and not t.angles and t.sphere == at), None)
    free = (n for n in itertools.chain(["sphere"], (f"sphere-{i}" for i in itertools.count(2))) if n not in names)
    name = blank.name if blank else next(free)
    same = tests[0].setup if tests and tests[0].sphere == at else name
    empty = SphereTest(name, at, same, None, tests[0].chain if tests else chain)
    every = _candidates(empty, farthest or {})
    noise, white, precision, located = _linear(campaign, machine, every)
    chosen = _greedy(white, precision, np.array([p for p, _ in located.values()]), count)
    order = sorted(
        chosen, key=lambda i: (every.approach[i][-1], *(every.approach[i][-1] * a for a in every.angles[i][::-1]))
    )
    test = replace(
        every,
        angles=tuple(every.angles[i] for i in order),
        spindle=tuple(every.spindle[i] for i in order),
        approach=tuple(every.approach[i] for i in order),
    )
    rows = white[np.concatenate([3 * i + np.arange(3) for i in chosen])]
    after = np.linalg.inv(np.diag(precision) + rows.T @ rows)
    half = {i: 1.96 * math.sqrt(after[p, p]) * unit for i, (p, unit) in located.items()}
    before = {i: 1.96 * unit / math.sqrt(precision[p]) for i, (p, unit) in located.items()}
    return PlannedPoints(test, half, before, noise, any(t.name == name for t in tests))


def _candidates(test: SphereTest, farthest: dict[str, tuple[float, float]]) -> SphereTest:
    """The test with every place, side and angle of the spindle that is looked at."""
    chain, places = test.chain, []
    for axis in chain.rotary:
        goes_round = axis in chain.round_axes and axis not in farthest
        low, high = farthest.get(axis, (0.0, 2.0 * math.pi) if goes_round else (-_FARTHEST, _FARTHEST))
        step = _ROUND if goes_round else _TILT
        n = max(2, round((high - low) / step) + 1)
        places.append(np.linspace(low, high, n)[: n - 1 if goes_round else n])
    sides = (1, -1)
    rows = [(p, s, a) for p in itertools.product(*places) for s in sides for a in (0.0, math.pi)]
    rotary = len(chain.rotary)
    return replace(
        test,
        angles=tuple(tuple(float(v) for v in p) for p, _, _ in rows),
        approach=tuple((s,) * rotary for _, s, _ in rows),
        spindle=tuple(a for _, _, a in rows),
    )


def _linear(campaign: Campaign, machine: Machine, every: SphereTest):
    """The linear problem of all candidates: noise of a centre, m; whitened columns (3n, p); prior precisions (p,);
    places and units of the location errors, by id.
    """
    problem = planned_problem(campaign, every)
    shown = [c.free for c in expected_effects(machine) if problem.shows(machine, c.free)]
    fit = RestFitter(problem, machine).fit(shown, iterations=0)
    located = {
        f.effect.id: (fit.parameters[f.block.name].start, next(iter(f.specs.values())).scale)
        for f in fit.effects
        if f.effect.kind == "axis_location"
    }
    if not located:
        raise InputError(f"{machine.name}: its [tolerance] has no axis_location, so there is nothing to plan for")
    white = fit.design @ np.eye(fit.parameters.size)
    return problem.noise.rms, white, fit.parameters.precision(), located


def _greedy(white: np.ndarray, precision: np.ndarray, places: np.ndarray, count: int) -> list[int]:
    """The points that are taken, one after the other, (count,): each place, side and spindle at most once."""
    white = white.reshape(len(white) // 3, 3, -1)
    n = len(white)
    covariance = np.diag(1.0 / precision)
    weight = precision[places]  # uncertainty in units of the class
    chosen: list[int] = []
    for _ in range(min(count, n)):
        reach = white @ covariance  # (n, 3, p)
        inner = np.eye(3) + np.einsum("nip,njp->nij", reach, white)
        part = reach[:, :, places]
        gain = np.einsum("p,nip,nij,njp->n", weight, part, np.linalg.inv(inner), part)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        covariance = covariance - reach[best].T @ np.linalg.solve(inner[best], reach[best])
    return chosen
