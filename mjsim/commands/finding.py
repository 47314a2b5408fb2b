"""One cause that a diagnosis has found, whatever instrument shows it; and what the error is before and after each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mjsim.commands.comparison import significant
from mjsim.inference.axis_logs.together import KnownTogether
from mjsim.inference.outcome import Selection
from mjsim.inference.posterior import CompetingModel
from mjsim.inference.search import LEAST
from mjsim.inference.shares import Calibration
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.units import DEG, UM, percent

#: By whom a cause is decided that both instruments support.
BOTH = "both"
#: Most findings that get a rung of the ladder of their own; smaller ones share the last.
_RUNGS = 3


@dataclass(frozen=True)
class DiagnosedEffect:
    """One missing effect.

    Attributes:
        effect: With fitted parameters.
        free: Names of the fitted ones.
        ci95: [low, high] per fitted parameter, in the units of the names.
        rms_before: Of the instrument that has found it, before it is in the model: RMS of all ball-bar tests along the
            ladder of the effects found, m; RMS of its axis in all recordings, m or rad.
        rms_after: The same with it.
        alternatives: Ids that the data cannot tell from this one.
        tests: Where it shows.
        gain: How far the objective (squared residuals in units of the noise) falls with it; for one of axis logs, the
            log evidence that it gains.
        rejected: How much less of that the others reach that were tried in its place, by id.
        models: The model with it, and those with its alternatives.
        found_by: Name of the instrument that has found it.
        together: How its leading number is known where that number's own interval holds the value that means no cause.
        decided_by: Name of the instrument that decides, or ``both``; empty where there is one instrument only.
        worse: By instrument, how much less log evidence each competitor has, by id; empty where nothing competes.
        contradicted: Whether the axis logs are explained better without it.
        probability: That it is this cause, and larger than a machine of its class may have; ``None`` where no posterior
            says so.
        others: Probabilities of its alternatives, by id.
        whole: That it is one of all that could stand in its place, told or not, and larger.
        undetermined: Names of fitted parameters that the data leave open: at a bound, or as wide as before.
    """

    effect: Effect
    free: tuple[str, ...]
    ci95: dict
    rms_before: float
    rms_after: float
    alternatives: tuple[str, ...]
    tests: tuple[str, ...]
    gain: float = 0.0
    rejected: dict[str, float] = field(default_factory=dict)
    models: tuple[CompetingModel, ...] = ()
    found_by: str = BallBarTest.instrument
    together: KnownTogether | None = None
    decided_by: str = ""
    worse: dict[str, dict[str, float]] = field(default_factory=dict)
    contradicted: bool = False
    probability: float | None = None
    others: dict[str, float] = field(default_factory=dict)
    whole: float | None = None
    undetermined: tuple[str, ...] = ()

    @property
    def is_open(self) -> bool:
        """Whether something else may stand in its place, or its size is open also where other numbers are as found."""
        unknown = self.together is not None and not self.together.others
        return bool(self.alternatives) or self.contradicted or unknown

    @property
    def how_probable(self) -> str:
        """A sentence about its probability, and those of what could stand in its place; empty where none is known."""
        if self.probability is None:
            return ""
        others = "".join(f", {i} {percent(p)}" for i, p in self.others.items())
        return f"Probability that it is this, and larger than on a sound machine: {percent(self.probability)}{others}."

    @property
    def reached(self) -> dict[str, float]:
        """Share of its gain that others reach which were tried in its place, by id, the nearest first."""
        near = sorted(self.rejected.items(), key=lambda row: row[1])
        return {i: max(0.0, 1.0 - less / self.gain) for i, less in near} if self.gain > 0.0 else {}

    @property
    def evidence(self) -> str:
        """Which instrument decided, and how clearly; empty where there is one instrument only."""
        if not self.decided_by:
            return ""
        moving = self.found_by if INSTRUMENTS[self.found_by].in_motion else BallBarTest.instrument
        bar, log = (f"the {INSTRUMENTS[n].noun}" for n in (moving, LogTest.instrument))
        who = {moving: bar, LogTest.instrument: log, BOTH: f"{bar} and {log}"}[self.decided_by]
        if self.contradicted:
            return (
                f"The {INSTRUMENTS[LogTest.instrument].noun} is explained better without it. One of the two "
                "instruments is misled."
            )
        if not self.worse:
            return f"Found by {who}."
        bars, logs = (self.worse[n] for n in (moving, LogTest.instrument))
        parts = [f"that of {i} differs by {-bars[i]:+.1f} in {bar} and by {-logs[i]:+.1f} in {log}" for i in logs]
        said = f"Decided by {who}" if self.decided_by != moving else "Not decided"
        return (
            f"{said}, by log evidence: {', '.join(parts)}; {LEAST:g} together are odds of {math.exp(LEAST):.0f} to 1."
        )

    def to_json(self, machine: Machine) -> dict:
        """As one of ``effects`` in the JSON of ``mjsim diagnose``; ``machine`` has its axis."""
        by_log, axis = self.found_by == LogTest.instrument, self.effect.subject
        turns = by_log and axis in machine.chain.letters and machine.chain.is_rotary(axis)
        unit, symbol = (DEG, "deg") if turns else (UM, "um")
        digits = rounded if by_log or self.decided_by else lambda x: round(float(x), 4)
        out = {
            "id": self.effect.id,
            "parameters": {k: rounded(v) for k, v in self.effect.values.items()},
            "ci95": {k: rounded(v) for k, v in self.ci95.items()},
            f"rms_before_{symbol}": digits(self.rms_before / unit),
            f"rms_after_{symbol}": digits(self.rms_after / unit),
            "probability": _share(self.probability),
            "alternatives": [{"id": i, "probability": _share(self.others.get(i))} for i in self.alternatives],
            "alternative_ids": list(self.alternatives),
            "tests": list(self.tests),
            "undetermined": list(self.undetermined),
        }
        if not self.decided_by:
            return out | ({"known_together": self._together()} if by_log else {})
        names = self.worse.get(LogTest.instrument, {})
        return out | {
            "decided_by": self.decided_by,
            "worse": {i: {who: rounded(v[i]) for who, v in self.worse.items()} for i in names},
            "contradicted": self.contradicted,
            "evidence": self.evidence,
        }

    def _together(self) -> dict | None:
        known = self.together
        if known is None:
            return None
        ends = [rounded(x) for x in known.ci95]
        return {"parameter": known.parameter, "others": list(known.others), "ci95": ends, "sentence": known.sentence}


def findings_of(
    selection: Selection, instrument: str, tests_of: Callable[[str], tuple[str, ...]]
) -> list[DiagnosedEffect]:
    """Every effect that was found, in the order of the selection; the ladder has its errors.

    Args:
        selection: The final model and its findings.
        instrument: Name of the instrument that has found them.
        tests_of: Gives the tests that show an effect, by its key.
    """
    of_key, out = {f.effect.key: f for f in selection.fit.effects}, []
    for f in selection.found:
        free = of_key[f.key]
        ci = free.interval(free.vector, selection.fit.covariance_of(free))
        found = DiagnosedEffect(free.effect, free.names, ci, 0.0, 0.0, f.alternatives, tests_of(f.key), f.gain)
        out.append(replace(found, probability=f.probability, others=f.others, whole=f.whole, found_by=instrument))
    return out


def ladder_of(
    found: Sequence[DiagnosedEffect],
    calibration: Sequence[Calibration],
    machine: Machine,
    ends: tuple[Any, Any],
    compared: Callable[[Machine, str], Any],
) -> tuple[tuple[DiagnosedEffect, ...], tuple[Any, ...]]:
    """Findings with the errors before and after each, and the comparisons: one effect more each.

    Args:
        found: In their order.
        calibration: Effects inside their tolerance. Where there are any, the ladder begins with all of them.
        machine: As given.
        ends: Comparison of the machine as given, and of the fitted one.
        compared: Compares a machine, which is described.
    """
    before, after = ends
    expected = machine.with_effects(c.effect.effect for c in calibration)
    rungs = [compared(expected, "the calibrated machine") if calibration and found else before]
    for i in range(1, min(len(found), _RUNGS)):
        part = expected.with_effects(e.effect for e in found[:i])
        rungs.append(compared(part, f"with {i} effect{'s' if i > 1 else ''}"))
    last = len(rungs) - 1
    rungs += [after] * max(1, len(found) - last)
    errors = [(rungs[min(i, last)].rms, rungs[i + 1].rms) for i in range(len(found))]
    effects = (replace(e, rms_before=b, rms_after=a) for e, (b, a) in zip(found, errors, strict=True))
    return tuple(effects), tuple(rungs)


def _share(p: float | None) -> float | None:
    """A probability with four digits."""
    return None if p is None else round(float(p), 4)


def rounded(v):
    """Numbers, and lists and tables of them, with six digits; a text as it is."""
    if isinstance(v, dict):
        return {k: rounded(x) for k, x in v.items()}
    if isinstance(v, (list, tuple)):
        return [rounded(x) for x in v]
    return significant(v) if isinstance(v, (int, float)) else v
