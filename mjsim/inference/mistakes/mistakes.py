"""Mistakes in a campaign: what they are called, how they are put right, and the numbers that decide about them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import Trace
from mjsim.units import listed

#: What a unit's readings have to be multiplied with when they were taken for µm.
UNITS = {"mm": 1e3, "inch": 25.4e3, "mil": 25.4, "microinch": 25.4e-3, "nm": 1e-3, "m": 1e6}
#: Measured over expected size may be so far from a unit's factor (friction is not the data sheet's).
_UNIT_TOLERANCE = math.log(2.0)


@dataclass(frozen=True)
class MistakeSettings:
    """Settings of the recognition of mistakes in a campaign.

    Attributes:
        agreement: Correlation of the spikes at reversals that a corrected test must reach (mistakes).
        improvement: By how much that correlation must be better than as given (mistakes).
        runner_up: The second best correction must leave so many times more (mistakes).
        noise_ratio: A test without spikes whose noise is so many times less than the others' is in another unit
            (mistakes).
        same_span: Programs whose measured parts begin and end within this of each other can have each other's trace, s
            (assumed).
        contradiction: A test that fits so much better as given contradicts a mistake of all tests (mistakes).
        weak_agreement: So much correlation still says something of sign and size (mistakes).
        same_size: Sizes that differ by more than this factor are not of the same mistake (mistakes).
        setup_disagrees: A set-up whose tests disagree by more than this has a mistake in it, m (mistakes).
        setup_share: Corrected, they must disagree by less than this share of it (mistakes).
        setup_agrees: Corrected, they must agree within this, m (mistakes).
        independent: Independent values in what a model leaves of one path: sine and cosine of two waves (assumed).
        wrong_sense: How often the sense of an axis is wrong in a machine file, before the data (assumed).
        sure: Probability from which a wrong sense is named.
        visible_spike: A model's spikes are visible from this RMS on, m: about the noise that is as sharp (mistakes).
    """

    agreement: float = 0.5
    improvement: float = 0.5
    runner_up: float = 2.0
    noise_ratio: float = 12.0
    same_span: float = 0.5
    contradiction: float = 0.2
    weak_agreement: float = 0.15
    same_size: float = 4.0
    setup_disagrees: float = 3e-6
    setup_share: float = 0.2
    setup_agrees: float = 3e-6
    independent: float = 4.0
    wrong_sense: float = 0.05
    sure: float = 0.95
    visible_spike: float = 0.06e-6


#: Settings of every check that is not given others.
MISTAKES = MistakeSettings()


@dataclass(frozen=True)
class Mistake:
    """One thing that is wrong with the files.

    Attributes:
        kind: sign, unit, sign_and_unit, direction, swapped, sense, or one of
            :class:`~mjsim.instruments.ball_bar.span.ClockMistake`.
        tests: names of the tests that have it. every: whether these are all.
        factor: what the readings have to be multiplied with; of the clock's mistakes their value.
        unit: what the readings are in, where that is the mistake. evidence: why, for the user.
        either: one of the tests has it, and the data do not say which.
        axis: that counts the other way, where that is the mistake. remedy: what the machine file has to say then.
    """

    kind: str
    tests: tuple[str, ...]
    evidence: str
    every: bool = False
    factor: float = 1.0
    unit: str = ""
    either: bool = False
    axis: str = ""
    remedy: str = ""

    @property
    def certain(self) -> bool:
        """Whether there is one way to put it right."""
        return not self.either and self.kind not in ("unclear", "sense")

    @property
    def where(self) -> str:
        """The tests, for a sentence."""
        if self.every:
            return "all traces"
        if self.either:
            return f"the trace of {_names(self.tests, 'or')}"
        return f"trace{'s' if len(self.tests) > 1 else ''} of {_names(self.tests)}"

    @property
    def sentence(self) -> str:
        """What is wrong and what puts it right, without place."""
        if self.kind == "sign":
            what = f"{self.where}: the sign is the other way round (deviation_um is positive where the bar is longer)"
        elif self.kind == "unit":
            what = f"{self.where}: the readings are in {self.unit}, not in µm: multiply by {self.factor:g}"
        elif self.kind == "sign_and_unit":
            what = f"{self.where}: the readings are in {self.unit} and have the other sign: multiply by {self.factor:g}"
        elif self.kind == "direction":
            who = "every test was" if self.every else f"{_names(self.tests, 'or' if self.either else 'and')} was"
            what = f"{who} run in the other direction: exchange CCW and CW"
        elif self.kind == "sense":
            what = (
                f"{self.axis} counts the other way than the machine file says: {self.remedy}, or "
                f"{_names(self.tests, 'and')} {'were' if len(self.tests) > 1 else 'was'} run the other way round"
            )
        elif self.kind != "swapped":
            return f"{self.where}: {self.evidence}"
        else:
            what = f"the traces of {_names(self.tests)} are exchanged" + (
                ", or those of two of them" if self.either else ""
            )
        return f"{what} ({self.evidence})"

    def to_json(self) -> dict:
        """As ``mjsim check --json`` prints it."""
        return {
            "kind": self.kind,
            "tests": list(self.tests),
            "all": self.every,
            "either": self.either,
            "factor": self.factor,
            "unit": self.unit or None,
            "axis": self.axis or None,
            "evidence": self.evidence,
            "sentence": self.sentence,
        }


def unit_of(factor: float) -> tuple[float, str] | None:
    """What measured over expected size says of sign and unit: the correcting factor and the unit ("" for µm);
    ``None``: neither.
    """
    sign = math.copysign(1.0, factor)
    size = abs(factor)
    if not size:
        return None
    known = {"": 1.0, **UNITS}
    unit = min(known, key=lambda u: abs(math.log(size * known[u])))
    if abs(math.log(size * known[unit])) > _UNIT_TOLERANCE * (1.5 if unit == "" else 1.0):
        return None
    return sign * known[unit], unit


def rewritten(m: Mistake, time: np.ndarray, deviation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and readings of a trace that has the mistake, put right."""
    if m.kind == "time_unit":
        return m.factor * time, deviation
    if m.kind == "origin":
        return time + m.factor, deviation
    return time, m.factor * deviation


def corrected(campaign: Campaign, mistakes: tuple[Mistake, ...]) -> Campaign:
    """The campaign with its mistakes put right, those aside that leave a choice; nothing on disk changes."""
    tests = {t.name: t for t in campaign.tests}
    traces = dict(campaign.traces)
    for m in mistakes:
        if not m.certain:
            continue
        if m.kind == "direction":
            tests |= {name: kind_of(tests[name]).turned(tests[name]) for name in m.tests}
        elif m.kind == "swapped":
            a, b = m.tests
            traces[a], traces[b] = traces[b], traces[a]
        elif m.kind in ("feed", "revolutions"):
            value = m.factor if m.kind == "feed" else round(m.factor)
            tests |= {name: replace(tests[name], **{m.kind: value}) for name in m.tests}
        else:
            for name in m.tests:
                t = traces[name]
                traces[name] = Trace(*rewritten(m, t.time, t.deviation), t.valid)
    return replace(campaign, tests=tuple(tests[t.name] for t in campaign.tests), traces=traces)


def _names(names: tuple[str, ...], last: str = "and") -> str:
    return listed([f'"{n}"' for n in names], last)
