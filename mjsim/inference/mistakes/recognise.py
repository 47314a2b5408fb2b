"""Recognise a wrong sign, unit or direction, and exchanged traces, from the data.

Each test is compared with what the machine as given would have measured, and with what it would have measured had the
mistake been made. A mistake is named only where the files as they are do not fit at all and the corrected ones do, so
that no fault of the machine passes for one: such a fault leaves most reversals as they are, or does not make another
reading fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.inference.mistakes.evidence import Spikes, Variant
from mjsim.inference.mistakes.mistakes import Mistake, unit_of
from mjsim.inference.mistakes.sense import sense_mistakes
from mjsim.inference.mistakes.settings import MISTAKES, MistakeSettings
from mjsim.inference.mistakes.single import single_mistakes
from mjsim.inference.mistakes.state import State
from mjsim.inference.problem import Problem
from mjsim.inference.samples import make_samples
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.threads import one_blas_thread


@dataclass(frozen=True)
class TestEvidence:
    """What was found about one test: ``factor`` and ``agreement`` of its spikes (``None`` where the model has none)."""

    __test__ = False

    name: str
    factor: float | None
    agreement: float | None


@dataclass(frozen=True)
class Findings:
    """Result of :func:`recognise`."""

    mistakes: tuple[Mistake, ...]
    tests: tuple[TestEvidence, ...]


@one_blas_thread
def recognise(campaign: Campaign, machine: Machine, threads: int = 2, settings: MistakeSettings = MISTAKES) -> Findings:
    """Look for mistakes in a measured campaign.

    Args:
        campaign: with at least one measured test. machine: the model as given; what is wrong with the machine may be
            missing in it.
    """
    plant = build(machine)
    problem = Problem.of(campaign, plant, threads, keep_motions=False)
    return find_mistakes(problem, plant, problem.readings(plant), settings, machine)


def find_mistakes(
    problem: Problem,
    plant: Plant,
    readings: list[np.ndarray],
    settings: MistakeSettings = MISTAKES,
    machine: Machine | None = None,
) -> Findings:
    """The same for a problem whose samples are as given, with the plant of the machine as given and its readings.

    The sense of the axes is looked at where the machine is given too. Tests without a ball bar are left out: their
    instrument looks for its own mistakes.
    """
    bars = [k for k, t in enumerate(problem.tests) if not t.component]
    if not bars:
        return Findings((), ())
    variants = [Variant(problem.tests[k], readings[k], problem.sensitivity[k]) for k in bars]
    traces = make_samples(tuple(problem.tests[k] for k in bars), problem.campaign.traces)
    state = State(variants, traces, [1.0] * len(traces), settings)
    given = [state.spikes_of(v, s) for v, s in zip(variants, traces, strict=True)]
    tests = tuple(
        TestEvidence(v.test.name, f.factor if f.visible else None, f.agreement if f.visible else None)
        for v, f in zip(variants, given, strict=True)
    )
    other: dict[int, Variant] = {}

    def reversed_run(k: int) -> Variant:
        if k not in other:
            other[k] = Variant.of(kind_of(variants[k].test).turned(variants[k].test), plant)
        return other[k]

    everywhere = _shared_mistake(state, given, reversed_run)
    senses = sense_mistakes(state, machine) if machine is not None and not everywhere else []
    mistakes = (everywhere,) if everywhere else (*senses, *_others(state, senses, reversed_run))
    return Findings(mistakes, tests)


def _others(state: State, senses: list[Mistake], reversed_run: Callable[[int], Variant]) -> list[Mistake]:
    """Mistakes of single tests, of those whose motion the sense of an axis leaves alone."""
    known = {name for m in senses for name in m.tests}
    return [m for m in single_mistakes(state, reversed_run) if not known & set(m.tests)]


def _shared_mistake(state: State, given: list[Spikes], reversed_run: Callable[[int], Variant]) -> Mistake | None:
    """A mistake that all tests share: some show it, none contradicts."""
    names = tuple(v.test.name for v in state.variants)
    seen = [k for k, g in enumerate(given) if g.visible]
    fits = {k: state.fit(state.part(k)) or 0.0 for k in seen}
    if not seen:
        return None
    strong = {
        k: known
        for k in seen
        if abs(given[k].agreement) >= state.settings.agreement and (known := unit_of(given[k].factor))
    }
    if strong and max(fits.values()) < state.settings.agreement - 0.1 and len(set(strong.values())) == 1:
        factor, unit = next(iter(strong.values()))
        weak = [
            given[k].factor for k in seen if k not in strong and abs(given[k].agreement) > state.settings.weak_agreement
        ]
        typical = float(np.median([given[k].factor for k in strong]))
        if any(not 1 / state.settings.same_size < f / typical < state.settings.same_size for f in weak):
            return None
        kind = "sign" if not unit else "unit" if factor > 0 else "sign_and_unit"
        where = f"{len(strong)} test{'s' if len(strong) > 1 else ''}"
        evidence = f"at the axes' reversals in {where} the readings are {typical:.3g} times what friction leaves there"
        return Mistake(kind, names, evidence, every=True, factor=factor, unit=unit)
    runs = [k for k in seen if kind_of(state.variants[k].test).goes_round]
    if len(runs) < 2 or all(fits[k] >= state.settings.agreement for k in runs):
        return None
    after = {k: state.fit((reversed_run(k), state.traces[k], 1.0)) or 0.0 for k in runs}
    better = [
        k for k in runs if after[k] >= state.settings.agreement and after[k] - fits[k] >= state.settings.improvement
    ]
    if len(better) < 2 or any(
        fits[k] >= state.settings.agreement and fits[k] - after[k] >= state.settings.contradiction for k in runs
    ):
        return None
    evidence = (
        f"the axes' reversals in {len(better)} tests agree with the other direction, correlation "
        f"{np.median([after[k] for k in better]):.2f} instead of {np.median([fits[k] for k in better]):.2f}"
    )
    every = tuple(v.test.name for v in state.variants if kind_of(v.test).goes_round)
    return Mistake("direction", every, evidence, every=True)
