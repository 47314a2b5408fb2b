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
from mjsim.inference.mistakes.evidence import Part, Spikes, State, Variant, level
from mjsim.inference.mistakes.mistakes import MISTAKES, Mistake, MistakeSettings, unit_of
from mjsim.inference.mistakes.sense import sense_mistakes
from mjsim.inference.problem import Problem
from mjsim.inference.samples import make_samples
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.model import Machine, build
from mjsim.threads import one_blas_thread


@dataclass(frozen=True)
class _Guess:
    """One way in which one test, or two, may have been run or recorded: per test its variant, trace and factor."""

    kind: str
    parts: dict[int, Part]
    factor: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class _Judged:
    """A guess, how far it goes beyond what is asked of it (1: just enough), why, and whether only the set-up speaks
    for it.
    """

    guess: _Guess
    merit: float
    evidence: str = ""
    by_setup: bool = False

    def mistake(self, state: State, competing: list[_Judged]) -> Mistake:
        """The same as a mistake; with competing models, one of several tests has it."""
        members = {k for j in (self, *competing) for k in j.guess.parts}
        names = tuple(state.variants[k].test.name for k in sorted(members))
        return Mistake(
            self.guess.kind,
            names,
            self.evidence,
            factor=self.guess.factor,
            unit=self.guess.unit,
            either=bool(competing),
        )


def single_mistakes(state: State, reversed_run: Callable[[int], Variant]) -> list[Mistake]:
    """Mistakes of single tests or pairs, the clearest first, each with the former ones put right."""
    found: list[Mistake] = []
    touched: set[int] = set()
    while len(found) < len(state.variants):
        judged = [j for k in _suspects(state, touched) if (j := _judge(state, k, reversed_run, touched))]
        if not judged:
            break
        best = max(judged, key=lambda j: j.merit)
        found.append(best.mistake(state, _equally_good(state, best, judged)))
        if found[-1].either:
            touched |= {k for j in judged for k in j.guess.parts}
            continue
        touched |= best.guess.parts.keys()
        for k, (variant, trace, factor) in best.guess.parts.items():
            state.variants[k], state.traces[k], state.factors[k] = variant, trace, factor
    return found


def _equally_good(state: State, best: _Judged, judged: list[_Judged]) -> list[_Judged]:
    """Guesses about other tests of the same set-up that bring it to agree as well: which of them is wrong cannot be
    told.
    """
    if not best.by_setup:
        return []
    setup = {state.variants[k].test.setup for k in best.guess.parts}
    return [
        j
        for j in judged
        if j is not best
        and j.by_setup
        and j.guess.kind == best.guess.kind
        and {state.variants[k].test.setup for k in j.guess.parts} == setup
        and j.guess.parts.keys() != best.guess.parts.keys()
    ]


def _suspects(state: State, touched: set[int]) -> list[int]:
    """Tests that do not fit as they are: by their spikes, their set-up, or their noise."""
    out = []
    levels = np.array([f * level(s) for f, s in zip(map(abs, state.factors), state.traces, strict=True)])
    usual = float(np.median(levels))
    for k in set(range(len(state.variants))) - touched:
        fit = state.fit(state.part(k))
        strange = 0.0 < levels[k] < usual / state.settings.noise_ratio
        if (fit is not None and fit < state.settings.agreement) or strange or state.disagrees(k):
            out.append(k)
    return out


def _guesses(state: State, k: int, reversed_run: Callable[[int], Variant], touched: set[int]) -> list[_Guess]:
    variant, trace, _ = state.part(k)
    out = [_Guess("sign", {k: (variant, trace, -1.0)}, -1.0)]
    found = state.spikes_of(variant, trace)
    if found.visible:
        known = unit_of(found.factor) if abs(found.agreement) >= state.settings.agreement else None
    else:
        known = _by_noise(state, k)
    if known and known[1]:
        factor, unit = known
        out.append(_Guess("unit" if factor > 0 else "sign_and_unit", {k: (variant, trace, factor)}, factor, unit))
    out.append(_Guess("direction", {k: (reversed_run(k), trace, 1.0)}))
    span = np.array(Program(variant.test).measured_span)
    for j, other in enumerate(state.variants):
        if (
            j != k
            and j not in touched
            and np.abs(np.array(Program(other.test).measured_span) - span).max() < state.settings.same_span
        ):
            out.append(_Guess("swapped", {k: (variant, state.traces[j], 1.0), j: (other, trace, 1.0)}))
    return out


def _by_noise(state: State, k: int) -> tuple[float, str] | None:
    """Sign and unit of a test that has no spikes, where it is quieter than the others are: a fault can only make it
    louder.
    """
    usual = float(np.median([level(s) for j, s in enumerate(state.traces) if j != k])) if len(state.traces) > 3 else 0.0
    own = level(state.traces[k])
    return unit_of(own / usual) if usual and 0.0 < own < usual / state.settings.noise_ratio else None


def _judge(state: State, k: int, reversed_run: Callable[[int], Variant], touched: set[int]) -> _Judged | None:
    """What is wrong with test ``k``; ``None`` where no guess stands out."""
    judged = sorted((_merit(state, k, g) for g in _guesses(state, k, reversed_run, touched)), key=lambda j: -j.merit)
    if judged[0].merit < 1.0 or (len(judged) > 1 and judged[0].merit < state.settings.runner_up * judged[1].merit):
        return None
    return judged[0]


def _merit(state: State, k: int, guess: _Guess) -> _Judged:
    gains, texts = [], []
    for j, part in guess.parts.items():
        before, after = state.fit(state.part(j)), state.fit(part)
        if before is None or after is None:
            continue
        if after < min(before, state.settings.agreement) - 0.1:
            return _Judged(guess, 0.0)
        if after >= state.settings.agreement:
            gains.append((after - before) / state.settings.improvement)
            texts.append(f"{after:.2f} instead of {before:.2f}")
    before, after = state.disagreement_of(k, {}), state.disagreement_of(k, guess.parts)
    by_spikes = max(gains, default=0.0)
    if guess.kind == "swapped" and len(gains) < 2:
        by_spikes = 0.0  # either trace has to fit where it would belong
    if by_spikes >= 1.0 and after <= 1.1 * before + 0.3e-6:
        return _Judged(
            guess, by_spikes, f"correlation with what friction leaves at the axes' reversals {', '.join(texts)}"
        )
    limits = state.settings
    agrees = before > limits.setup_disagrees and after < min(limits.setup_share * before, limits.setup_agrees)
    if agrees and not (guess.kind == "swapped" and by_spikes < 0.2):
        evidence = f"the tests of its set-up then agree to {after * 1e6:.2g} µm, as given to {before * 1e6:.2g} µm"
        return _Judged(guess, limits.setup_share * before / max(after, 1e-9), evidence, True)
    if guess.unit and not gains and _by_noise(state, k) is not None:
        return _Judged(guess, 1.0, f"its noise is {level(state.traces[k]) * 1e6:.2g} µm, less than a bar can have")
    return _Judged(guess, 0.0)


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
    return find_mistakes(problem, machine, problem.readings(plant), settings)


def find_mistakes(
    problem: Problem, machine: Machine, readings: list[np.ndarray], settings: MistakeSettings = MISTAKES
) -> Findings:
    """The same for a problem whose samples are as given, with the readings of the machine as given.

    Tests without a ball bar are left out: their instrument looks for its own mistakes.
    """
    plant = build(machine)
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
    senses = [] if everywhere else sense_mistakes(state, machine)
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
