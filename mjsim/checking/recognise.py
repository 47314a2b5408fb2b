"""Recognise a wrong sign, unit or direction, and exchanged traces, from the data.

Each test is compared with what the machine as given would have measured, and with what it would have measured had the mistake been
made. A mistake is named only where the files as they are do not fit at all and the corrected ones do, so that no fault of the machine
passes for one: such a fault leaves most reversals as they are, or does not make another reading fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.checking.evidence import Spikes, Variant, disagreement, level, spikes
from mjsim.checking.mistakes import Mistake, turned, unit_of
from mjsim.engine.plant import build
from mjsim.inference.problem import Problem
from mjsim.inference.samples import Samples, make_samples
from mjsim.machine.model import Machine
from mjsim.nc.program import Program
from mjsim.threads import one_blas_thread

#: Agreement of the spikes that a corrected test must reach, and by how much it must be better than as given (chosen on the tuning half
#: of the generator's campaigns: the page on mistakes has the figures).
_FITS, _BETTER = 0.5, 0.5
#: A test that fits so much better as given contradicts a mistake of all tests.
_CONTRADICTS = 0.2
#: So much agreement still says something of sign and size; sizes that differ by more than this factor are not of the same mistake.
_LEANS, _SAME_SIZE = 0.15, 4.0
#: A set-up whose tests disagree by more than this, m, and by less than this share of it when one test is corrected, has a mistake in
#: it; corrected, they must agree to the last figure, m.
_DISAGREE, _SHARE, _AGREE = 3e-6, 0.2, 3e-6
#: The runner-up must leave so many times more.
_RUNNER_UP = 2.0
#: A test without spikes whose noise is so many times less than the others' is in another unit.
_NOISE = 12.0
#: Programs whose measured parts begin and end within this of each other can have each other's trace, s.
_SAME_SPAN = 0.5


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


@dataclass(frozen=True)
class _Guess:
    """One way in which one test, or two, may have been run or recorded: per test its variant, trace and factor."""

    kind: str
    parts: dict[int, tuple[Variant, Samples, float]]
    factor: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class _Judged:
    """A guess, how far it goes beyond what is asked of it (1: just enough), why, and whether only the set-up speaks for it."""

    guess: _Guess
    merit: float
    evidence: str = ""
    by_setup: bool = False

    def mistake(self, state: _State, rivals: list[_Judged]) -> Mistake:
        """The same as a mistake; with rivals, one of several tests has it."""
        members = {k for j in (self, *rivals) for k in j.guess.parts}
        names = tuple(state.variants[k].test.name for k in sorted(members))
        return Mistake(self.guess.kind, names, self.evidence, factor=self.guess.factor, unit=self.guess.unit, either=bool(rivals))


@dataclass
class _State:
    """The tests as they are believed to be."""

    variants: list[Variant]
    traces: list[Samples]
    factors: list[float]
    _known: dict = field(default_factory=dict)

    def part(self, k: int) -> tuple[Variant, Samples, float]:
        return self.variants[k], self.traces[k], self.factors[k]

    def seen(self, variant: Variant, s: Samples, factor: float = 1.0) -> Spikes:
        key = (id(variant), id(s))
        if key not in self._known:
            self._known[key] = spikes(variant, s)
        found = self._known[key]
        return replace(found, factor=factor * found.factor, agreement=float(np.sign(factor)) * found.agreement)

    def fit(self, part: tuple[Variant, Samples, float]) -> float | None:
        """Agreement of a test's spikes, zero where their size is no machine's; ``None`` where there are none to see."""
        found = self.seen(*part)
        if not found.visible:
            return None
        known = unit_of(found.factor)
        return found.agreement if known is not None and not known[1] else 0.0


@one_blas_thread
def recognise(campaign: Campaign, machine: Machine, threads: int = 2) -> Findings:
    """Look for mistakes in a measured campaign.

    Args:
        campaign: with at least one measured test. machine: the model as given; what is wrong with the machine may be missing in it.
    """
    return look(Problem(campaign, machine, threads, outliers=False), machine)


def look(problem: Problem, machine: Machine) -> Findings:
    """The same for a problem whose samples are as given."""
    plant = build(machine)
    readings = problem.readings(plant)
    variants = [Variant(t, readings[k], problem.sensitivity[k]) for k, t in enumerate(problem.tests)]
    traces = make_samples(problem.tests, problem.campaign.traces)
    state = _State(variants, traces, [1.0] * len(traces))
    given = [state.seen(v, s) for v, s in zip(variants, traces, strict=True)]
    tests = tuple(
        TestEvidence(v.test.name, f.factor if f.visible else None, f.agreement if f.visible else None)
        for v, f in zip(variants, given, strict=True)
    )
    other: dict[int, Variant] = {}

    def reversed_run(k: int) -> Variant:
        if k not in other:
            other[k] = Variant.of(turned(variants[k].test), plant)
        return other[k]

    everywhere = _everywhere(state, given, reversed_run)
    mistakes = (everywhere,) if everywhere else tuple(_one_by_one(state, reversed_run))
    return Findings(mistakes, tests)


def _everywhere(state: _State, given: list[Spikes], reversed_run: Callable[[int], Variant]) -> Mistake | None:
    """A mistake that all tests share: some show it, none contradicts."""
    names = tuple(v.test.name for v in state.variants)
    seen = [k for k, g in enumerate(given) if g.visible]
    fits = {k: state.fit(state.part(k)) or 0.0 for k in seen}
    if not seen:
        return None
    strong = {k: known for k in seen if abs(given[k].agreement) >= _FITS and (known := unit_of(given[k].factor))}
    if strong and max(fits.values()) < _FITS - 0.1 and len(set(strong.values())) == 1:
        factor, unit = next(iter(strong.values()))
        weak = [given[k].factor for k in seen if k not in strong and abs(given[k].agreement) > _LEANS]
        typical = float(np.median([given[k].factor for k in strong]))
        if any(not 1 / _SAME_SIZE < f / typical < _SAME_SIZE for f in weak):
            return None
        kind = "sign" if not unit else "unit" if factor > 0 else "sign_and_unit"
        where = f"{len(strong)} test{'s' if len(strong) > 1 else ''}"
        evidence = f"at the axes' reversals in {where} the readings are {typical:.3g} times what friction leaves there"
        return Mistake(kind, names, evidence, every=True, factor=factor, unit=unit)
    runs = [k for k in seen if state.variants[k].test.kind != "rotary"]
    if len(runs) < 2 or all(fits[k] >= _FITS for k in runs):
        return None
    after = {k: state.fit((reversed_run(k), state.traces[k], 1.0)) or 0.0 for k in runs}
    better = [k for k in runs if after[k] >= _FITS and after[k] - fits[k] >= _BETTER]
    if len(better) < 2 or any(fits[k] >= _FITS and fits[k] - after[k] >= _CONTRADICTS for k in runs):
        return None
    evidence = (
        f"the axes' reversals in {len(better)} tests agree with the other direction, correlation "
        f"{np.median([after[k] for k in better]):.2f} instead of {np.median([fits[k] for k in better]):.2f}"
    )
    every = tuple(v.test.name for v in state.variants if v.test.kind != "rotary")
    return Mistake("direction", every, evidence, every=True)


def _one_by_one(state: _State, reversed_run: Callable[[int], Variant]) -> list[Mistake]:
    """Mistakes of single tests or pairs, the clearest first, each with the former ones put right."""
    found: list[Mistake] = []
    touched: set[int] = set()
    while len(found) < len(state.variants):
        judged = [j for k in _suspects(state, touched) if (j := _judge(state, k, reversed_run, touched))]
        if not judged:
            break
        best = max(judged, key=lambda j: j.merit)
        found.append(best.mistake(state, _rivals(state, best, judged)))
        if found[-1].either:
            touched |= {k for j in judged for k in j.guess.parts}
            continue
        touched |= best.guess.parts.keys()
        for k, (variant, trace, factor) in best.guess.parts.items():
            state.variants[k], state.traces[k], state.factors[k] = variant, trace, factor
    return found


def _rivals(state: _State, best: _Judged, judged: list[_Judged]) -> list[_Judged]:
    """Guesses about other tests of the same set-up that bring it to agree as well: which of them is wrong cannot be told."""
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


def _suspects(state: _State, touched: set[int]) -> list[int]:
    """Tests that do not fit as they are: by their spikes, their set-up, or their noise."""
    out = []
    levels = np.array([f * level(s) for f, s in zip(map(abs, state.factors), state.traces, strict=True)])
    usual = float(np.median(levels))
    for k in set(range(len(state.variants))) - touched:
        fit = state.fit(state.part(k))
        strange = 0.0 < levels[k] < usual / _NOISE
        if (fit is not None and fit < _FITS) or strange or _together(state, k, {}) > _DISAGREE:
            out.append(k)
    return out


def _together(state: _State, k: int, parts: dict[int, tuple[Variant, Samples, float]]) -> float:
    """Disagreement (m) of the set-up of test ``k`` with some tests changed; zero where the test is alone in it."""
    setup = state.variants[k].test.setup
    members = [j for j, v in enumerate(state.variants) if v.test.setup == setup]
    return disagreement([parts.get(j, state.part(j)) for j in members]) if len(members) > 1 else 0.0


def _guesses(state: _State, k: int, reversed_run: Callable[[int], Variant], touched: set[int]) -> list[_Guess]:
    variant, trace, _ = state.part(k)
    out = [_Guess("sign", {k: (variant, trace, -1.0)}, -1.0)]
    seen = state.seen(variant, trace)
    known = unit_of(seen.factor) if seen.visible and abs(seen.agreement) >= _FITS else None if seen.visible else _by_noise(state, k)
    if known and known[1]:
        factor, unit = known
        out.append(_Guess("unit" if factor > 0 else "sign_and_unit", {k: (variant, trace, factor)}, factor, unit))
    out.append(_Guess("direction", {k: (reversed_run(k), trace, 1.0)}))
    span = np.array(Program(variant.test).measured_span)
    for j, other in enumerate(state.variants):
        if j != k and j not in touched and np.abs(np.array(Program(other.test).measured_span) - span).max() < _SAME_SPAN:
            out.append(_Guess("swapped", {k: (variant, state.traces[j], 1.0), j: (other, trace, 1.0)}))
    return out


def _by_noise(state: _State, k: int) -> tuple[float, str] | None:
    """Sign and unit of a test that has no spikes, where it is quieter than the others are: a fault can only make it louder."""
    usual = float(np.median([level(s) for j, s in enumerate(state.traces) if j != k])) if len(state.traces) > 3 else 0.0
    own = level(state.traces[k])
    return unit_of(own / usual) if usual and 0.0 < own < usual / _NOISE else None


def _judge(state: _State, k: int, reversed_run: Callable[[int], Variant], touched: set[int]) -> _Judged | None:
    """What is wrong with test ``k``; ``None`` where no guess stands out."""
    judged = sorted((_merit(state, k, g) for g in _guesses(state, k, reversed_run, touched)), key=lambda j: -j.merit)
    if judged[0].merit < 1.0 or (len(judged) > 1 and judged[0].merit < _RUNNER_UP * judged[1].merit):
        return None
    return judged[0]


def _merit(state: _State, k: int, guess: _Guess) -> _Judged:
    gains, texts = [], []
    for j, part in guess.parts.items():
        before, after = state.fit(state.part(j)), state.fit(part)
        if before is None or after is None:
            continue
        if after < min(before, _FITS) - 0.1:
            return _Judged(guess, 0.0)
        if after >= _FITS:
            gains.append((after - before) / _BETTER)
            texts.append(f"{after:.2f} instead of {before:.2f}")
    before, after = _together(state, k, {}), _together(state, k, guess.parts)
    by_spikes = max(gains, default=0.0)
    if guess.kind == "swapped" and len(gains) < 2:
        by_spikes = 0.0  # either trace has to fit where it would belong
    if by_spikes >= 1.0 and after <= 1.1 * before + 0.3e-6:
        return _Judged(guess, by_spikes, f"correlation with what friction leaves at the axes' reversals {', '.join(texts)}")
    if before > _DISAGREE and after < min(_SHARE * before, _AGREE) and not (guess.kind == "swapped" and by_spikes < 0.2):
        evidence = f"the tests of its set-up then agree to {after * 1e6:.2g} µm, as given to {before * 1e6:.2g} µm"
        return _Judged(guess, _SHARE * before / max(after, 1e-9), evidence, True)
    if guess.unit and not gains and _by_noise(state, k) is not None:
        return _Judged(guess, 1.0, f"its noise is {level(state.traces[k]) * 1e6:.2g} µm, less than a bar can have")
    return _Judged(guess, 0.0)
