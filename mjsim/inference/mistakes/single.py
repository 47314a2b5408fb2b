"""Mistakes of single tests, or of two whose traces are exchanged: every guess is tried, and one that stands out is
named.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mjsim.inference.mistakes.evidence import Variant, level
from mjsim.inference.mistakes.mistakes import Mistake, unit_of
from mjsim.inference.mistakes.state import Part, State
from mjsim.instruments.ball_bar.program import Program


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
