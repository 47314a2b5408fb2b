"""What a test of an instrument that measures at rest would bring, before it is measured.

Everything is linear at what is known today. ``Σ`` is the covariance of the errors of the machine: what the campaign has
left open, and for what it does not show, what a machine of its class may have. ``J`` are the derivatives of the reading
by the errors, ``N`` those by the new set-up in its prior standard deviations, ``σ`` the noise:

    W = diag σ² + N Nᵀ,   V = W + J Σ Jᵀ

The reading leaves Σ' = Σ − Σ Jᵀ V⁻¹ J Σ of their covariance, and tells ½ log(det Σ / det Σ') of them, both determinants
of the rows and columns of what is open (Lindley's information, what the entropy falls by: Chaloner and Verdinelli,
Statistical Science 10, 1995). Two explanations whose readings differ by d are told apart by dᵀ V⁻¹ d, with J and Σ of
the second one: so far as it cannot adapt. This is the same deviance as that of ball-bar tests and recordings
(:mod:`mjsim.inference.planning.separation`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from mjsim.campaign.model import Campaign
from mjsim.inference.at_rest import RestProblem, SampleNoise, taken_by
from mjsim.inference.calibration import expected_effects
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.least_squares import ridge_solution
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.settings import PLAN, PlanSettings
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine

#: Largest difference of two readings, in standard deviations of the noise, that nobody sees.
_SEEN = 0.02
#: A number is told by a test that leaves at most this share of its uncertainty.
_TOLD = 0.5


@dataclass(frozen=True)
class Known:
    """How well a number of the machine is known.

    Attributes:
        effect_id: Id of its effect.
        parameter: Name of the number, with its unit.
        before: 95 % half width today, in the unit of the name.
        after: The same after the test.
    """

    effect_id: str
    parameter: str
    before: float
    after: float


@dataclass(frozen=True)
class PlannedTest:
    """What one test would do.

    Attributes:
        test: With its positions.
        minutes: Machine time with handling.
        deviance: Squared distance of two explanations in units of what the test cannot tell; 0 where there are none.
        difference: RMS of what a new set-up leaves of the difference of both readings, SI.
        bits: What it tells of the errors of the machine.
        known: Numbers that it tells, the most told first.
        settings: By which it is judged.
    """

    test: Any
    minutes: float
    deviance: float = 0.0
    difference: float = 0.0
    bits: float = 0.0
    known: tuple[Known, ...] = ()
    settings: PlanSettings = PLAN

    @property
    def decides(self) -> bool:
        """Whether it is expected to decide between two explanations."""
        return self.deviance >= self.settings.decisive

    @property
    def worth(self) -> tuple[float, float]:
        """Sort key: what decides by deviance per minute, before what does not by deviance."""
        return (1.0, min(self.deviance, self.settings.certain) / self.minutes) if self.decides else (0.0, self.deviance)


def planned_problem(campaign: Campaign, test: Any) -> RestProblem:
    """The problem of a test that was not measured yet.

    Args:
        campaign: Whose instrument it is measured with; without one of that kind, with an ordinary one.
        test: With its positions.
    """
    instrument = INSTRUMENTS[test.instrument]
    data = campaign.instruments.get(test.instrument) or instrument.usual
    planned = replace(campaign, tests=(test,), traces={test.name: test.planned}, instruments={test.instrument: data})
    problem = RestProblem.of(planned)
    noise = instrument.planned_noise(test, data)
    return replace(problem, noise=SampleNoise(np.tile(noise, len(problem.value) // len(noise))))


class RestPlanner:
    """Judges tests.

    Args:
        campaign: Whose instruments they are measured with.
        machine: As given: its class.
        settings: By which they are judged.
    """

    def __init__(self, campaign: Campaign, machine: Machine, settings: PlanSettings = PLAN) -> None:
        self.campaign, self.settings = campaign, settings
        self.expected = [c.free for c in expected_effects(machine) if c.free.effect.search.quasi_static]

    def apart(self, test: Any, first: CompetingModel, second: CompetingModel) -> PlannedTest:
        """How well a test separates two explanations.

        Args:
            test: With its positions.
            first: Is taken for true.
            second: Adapts to it.
        """
        problem = planned_problem(self.campaign, test)
        d = problem.readings(first.machine) - problem.readings(second.machine)
        if not np.abs(d / problem.noise.deviation).max() > _SEEN:
            return PlannedTest(test, self._minutes(test), settings=self.settings)
        class_ = [f for f in self.expected if f.effect.id != first.effect_id]  # that is to be told from it
        left = Open(second.machine, second.posterior, class_)
        noise = problem.noise.deviation
        may = np.hstack([problem.columns, left.columns(problem) @ left.root]) / noise[:, None]
        rest = d / noise - may @ ridge_solution(may.T @ may, may.T @ (d / noise), 1.0)
        deviance = float(max((d / noise) @ rest, 0.0))
        seen = d - problem.columns @ taken_by(problem.columns, d, noise)
        size = float(np.sqrt(np.mean(seen**2)))
        return PlannedTest(test, self._minutes(test), deviance, size, settings=self.settings)

    def told(self, test: Any, left: Open) -> PlannedTest:
        """What a test tells of what is open about a machine.

        Args:
            test: With its positions.
            left: What is open.
        """
        problem = planned_problem(self.campaign, test)
        rows = _without_set_up(problem, left.columns(problem))
        return left.after(test, self._minutes(test), rows.T @ rows)

    def _minutes(self, test: Any) -> float:
        instrument = INSTRUMENTS[test.instrument]
        time = instrument.observe(test, test.planned).time
        return (instrument.handling + float(time[-1])) / 60.0


class Open:
    """What is open about a machine.

    Args:
        machine: At the best estimate.
        posterior: What is uncertain about it; ``None`` where nothing was measured.
        expected: What a machine of its class may have; what the posterior lacks of it is as uncertain as that.
        shown: Ids of effects that count as known: nobody asks for them.
    """

    def __init__(
        self,
        machine: Machine,
        posterior: Posterior | None,
        expected: Sequence[EffectVector],
        shown: Collection[str] = (),
    ) -> None:
        self.machine = machine
        kept = [(f, at) for f, at in posterior.blocks if f.effect.search.quasi_static] if posterior is not None else []
        have = {f.effect.key for f, _ in kept}
        fresh = [f for f in expected if f.effect.key not in have]
        self.effects = [*(f for f, _ in kept), *fresh]
        known = posterior.part([i for _, at in kept for i in at]) if posterior is not None else np.zeros((0, 0))
        class_ = np.concatenate([np.zeros(0), *(f.block.deviation**2 for f in fresh)])
        self.covariance = np.array(block_diag(known, np.diag(class_)))
        values, vectors = np.linalg.eigh(0.5 * (self.covariance + self.covariance.T))
        self.root = vectors * np.sqrt(np.maximum(values, 0.0))
        self.names = [row for f in self.effects for row in _entries(f, machine.chain.is_rotary(f.effect.subject))]
        asked = [i for i, ((name, _), _) in enumerate(self.names) if name not in shown]
        self._asked = [i for i in asked if self.covariance[i, i] > 0.0]

    def columns(self, problem: RestProblem) -> np.ndarray:
        """Derivatives of the readings by the open entries, (m, p) SI per typical size."""
        out = [np.zeros((len(problem.value), 0))]
        for f in self.effects:
            there = self.machine.with_effect(f.effect)
            out.append(problem.columns_of(there, f, problem.readings(there)))
        return np.hstack(out)

    def after(self, test: Any, minutes: float, told: np.ndarray) -> PlannedTest:
        """What is known after a test.

        Args:
            test: The test.
            minutes: That it takes.
            told: Its information about the entries, the rest of it unknown, (p, p).
        """
        at, root, before = self._asked, self.root, self.covariance
        left = root @ np.linalg.inv(np.eye(len(root)) + root.T @ told @ root) @ root.T
        unit = 1.0 / np.sqrt(before.diagonal()[at])
        sizes = [np.linalg.slogdet(m[np.ix_(at, at)] * np.outer(unit, unit))[1] for m in (before, left)]
        widths: dict[tuple[str, str], tuple[float, float]] = {}  # of the waves of an effect the least known one
        for i in at:
            name, scale = self.names[i]
            now, then = (1.96 * scale * float(np.sqrt(m[i, i])) for m in (before, left))
            widths[name] = max(widths.get(name, (0.0, 0.0)), (now, then), key=lambda w: w[1])
        known = [Known(*name, *w) for name, w in widths.items() if w[1] <= _TOLD * w[0]]
        known.sort(key=lambda k: k.after / k.before)
        return PlannedTest(test, minutes, bits=0.5 * float(sizes[0] - sizes[1]) / math.log(2.0), known=tuple(known))


def _entries(f: EffectVector, rotary: bool) -> list[tuple[tuple[str, str], float]]:
    """Id, number and unit of each entry of an effect; ``rotary`` says whether its axis turns."""
    out: list[tuple[tuple[str, str], float]] = []
    for name in f.names:
        row = [((f.effect.id, name), f.specs[name].scale)]
        if name == "components":
            row = [((f.effect.id, f"amplitude_{'deg' if rotary else 'um'}"), f.specs[name].scale)]
            out += row * 2 * len(f.effect.values[name])
        elif not (f.polar and name == "phase_deg"):
            out += row * (2 if f.polar and name == f.amplitude else 1)
    return out


def _without_set_up(problem: RestProblem, rows: np.ndarray) -> np.ndarray:
    """Rows over a root of W, (m, k)."""
    noise, columns = problem.noise.deviation, problem.columns
    white, taken = rows / noise[:, None], columns / noise[:, None]
    left, sizes, _ = np.linalg.svd(taken, full_matrices=False)
    along = left.T @ white
    return white - left @ ((1.0 - 1.0 / np.sqrt(1.0 + sizes**2))[:, None] * along)
