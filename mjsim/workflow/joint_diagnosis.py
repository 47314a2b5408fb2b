"""What a diagnosis from two instruments found, and how it is handed on."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mjsim.campaign.model import Campaign
from mjsim.estimation.settings import DIAGNOSIS
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.units import UM
from mjsim.workflow.compare import Comparison
from mjsim.workflow.diagnosis import Diagnosis
from mjsim.workflow.log_diagnosis import LogDiagnosis, change

#: Difference of the objectives that tells two explanations apart.
ENOUGH = DIAGNOSIS.indistinguishable
#: What the instruments are called in sentences.
INSTRUMENTS = {"ball_bar": "the ball bar", "axis_log": "the axis log", "both": "the ball bar and the axis log"}


@dataclass(frozen=True)
class JointEffect:
    """One cause.

    Attributes:
        effect: With fitted parameters, from both instruments where both see it.
        ci95: [low, high] per fitted parameter.
        decided_by: ``ball_bar``, ``axis_log`` or ``both``.
        alternatives: Ids that both instruments together cannot tell from it.
        tests: Where it shows.
        rejected: How much worse others do in its place, by id.
        bar: By how much worse its competitors are for the ball bar, by id.
        logs: The same for the axis logs.
        rms_before: Of the ball-bar tests before it is in the model, m; of the axis' logs, axis units, where the logs
            have found it.
        rms_after: The same with it.
        contradicted: Whether the logs are explained better without it.
        in_logs: Whether the logs alone have found it.
    """

    effect: Effect
    ci95: dict
    decided_by: str
    alternatives: tuple[str, ...]
    tests: tuple[str, ...]
    rejected: dict[str, float]
    bar: dict[str, float]
    logs: dict[str, float]
    rms_before: float
    rms_after: float
    contradicted: bool
    in_logs: bool = False

    @property
    def sentence(self) -> str:
        """Which instrument decided, and how clearly."""
        if self.contradicted:
            return "The axis log is explained better without it. One of the two instruments is misled."
        if not self.logs:
            return f"Found by {INSTRUMENTS[self.decided_by]}."
        parts = [
            f"{i} fits worse by {self.bar[i]:.1f} in the ball bar and by {self.logs[i]:.1f} in the axis log"
            for i in self.logs
        ]
        said = f"Decided by {INSTRUMENTS[self.decided_by]}" if self.decided_by != "ball_bar" else "Not decided"
        return f"{said}: {', '.join(parts)}; {ENOUGH:g} together tell two apart."

    def to_json(self, machine: Machine) -> dict:
        """As one of ``effects`` in the JSON of ``mjsim diagnose``."""
        before, after = self.rms_before, self.rms_after
        if self.in_logs:
            size = change(machine, self.effect.subject, before, after)
        else:
            size = {"rms_before_um": sig(before / UM), "rms_after_um": sig(after / UM)}
        return {
            "id": self.effect.id,
            "parameters": {k: sig(v) for k, v in self.effect.values.items()},
            "ci95": {k: sig(v) for k, v in self.ci95.items()},
            **size,
            "alternatives": list(self.alternatives),
            "tests": list(self.tests),
            "decided_by": self.decided_by,
            "worse": {i: {"ball_bar": sig(self.bar[i]), "axis_log": sig(self.logs[i])} for i in self.logs},
            "contradicted": self.contradicted,
            "evidence": self.sentence,
        }


@dataclass(frozen=True)
class JointDiagnosis:
    """Result of a diagnosis of ball-bar tests and axis logs.

    Attributes:
        campaign: What was measured.
        verdict: ``identified``, ``ambiguous``, ``unknown`` or ``nothing_found``.
        effects: What is missing; first what the ball bar shows, then what the logs alone show.
        machine: With the effects and the fitted numbers.
        before: Comparison of the ball-bar tests with the machine as given.
        after: The same with :attr:`machine`.
        bar: Diagnosis of the ball-bar tests.
        logs: Diagnosis of the logs.
        not_testable: Ids that neither instrument can show.
    """

    campaign: Campaign
    verdict: str
    effects: tuple[JointEffect, ...]
    machine: Machine
    before: Comparison
    after: Comparison
    bar: Diagnosis
    logs: LogDiagnosis
    not_testable: tuple[str, ...]

    def as_diagnosis(self) -> Diagnosis:
        """The diagnosis of the ball-bar tests with what both instruments have decided."""
        known = {e.effect.key: e for e in self.bar.effects}
        effects = []
        for e, former in zip((e for e in self.effects if not e.in_logs), known.values(), strict=True):
            names = former.free if e.effect.id == former.effect.id else tuple(e.ci95)
            effects.append(
                replace(former, effect=e.effect, free=names, ci95=e.ci95, alternatives=e.alternatives, tests=e.tests)
            )
        rungs = (*self.bar.rungs[:-1], self.after)
        following = self.bar.next_test if self.verdict == "ambiguous" else None
        return replace(
            self.bar,
            verdict=self.verdict if effects else self.bar.verdict,
            effects=tuple(effects),
            machine=self.machine,
            after=self.after,
            rungs=rungs,
            next_test=following,
            not_testable=self.not_testable,
        )

    def to_json(self) -> dict:
        """The JSON of ``mjsim diagnose``: that of the ball-bar tests, and ``axis_logs``."""
        logs = self.logs.to_json()
        out = self.bar.to_json() | {
            "verdict": self.verdict,
            "rms_before_um": sig(self.before.rms / UM),
            "rms_after_um": sig(self.after.rms / UM),
            "effects": [e.to_json(self.machine) for e in self.effects],
            "not_testable": list(self.not_testable),
        }
        if self.verdict != "ambiguous":
            out["next_test"] = None
        keys = ("noise_um", "rms_before_um", "rms_after_um", "unexplained", "data_sheet", "not_separable", "tests")
        return out | {"axis_logs": {k: logs[k] for k in keys}}


def sig(x):
    """Numbers, and lists of them, with six digits."""
    if isinstance(x, (list, tuple)):
        return [sig(v) for v in x]
    return x if isinstance(x, str) else float(f"{float(x):.6g}")
