"""What a diagnosis of axis logs found, and how it is handed on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.compare import LogComparison
from mjsim.commands.finding import DiagnosedEffect, rounded
from mjsim.inference.axis_logs.budget import log_budget
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.axis_logs.found import AxisSelection
from mjsim.inference.axis_logs.separability import Inseparable
from mjsim.inference.axis_logs.unexplained import UnexplainedRest
from mjsim.inference.budget import Budget
from mjsim.instruments.axis_log.signals import Finding
from mjsim.machine.model import Machine
from mjsim.units import DEG, MM, UM

#: Why the verdict is ``unknown``.
MORE_IS_LEFT = "more is left than a sound machine leaves, and no effect of the catalogue explains it"


def little_known(axis: str, numbers: Sequence[str]) -> str:
    """What the logs of an axis leave open of its numbers, in words."""
    if len(numbers) == 1:
        return f"{axis}: the logs say little about {numbers[0]}"
    return f"{axis}: only a combination of {', '.join(numbers)} is known"


@dataclass(frozen=True)
class SheetNumber:
    """One number of the data sheet.

    Attributes:
        axis: Letter.
        name: Attribute of the drive or parameter of its friction.
        controller: Name of the controller that it belongs to; empty for the drive.
        stated: SI.
        found: SI.
        ci95: Low and high.
        known: Whether the recordings say more than the prior.
        source: ``recorded output`` or ``motion``.
    """

    axis: str
    name: str
    controller: str
    stated: float
    found: float
    ci95: tuple[float, float]
    known: bool
    source: str

    def to_json(self) -> dict:
        """Plain numbers."""
        return {
            "axis": self.axis,
            "name": self.name,
            "controller": self.controller or None,
            "stated": rounded(self.stated),
            "found": rounded(self.found),
            "ci95": [rounded(x) for x in self.ci95],
            "ratio": rounded(self.found / self.stated),
            "known": self.known,
            "source": self.source,
        }


@dataclass(frozen=True)
class LogDiagnosis:
    """Result of a diagnosis of axis logs.

    Attributes:
        campaign: What was recorded.
        verdict: ``identified``, ``ambiguous``, ``unknown`` or ``nothing_found``.
        effects: What is missing, the largest contribution first.
        sheet: The data sheet as the recordings have it.
        inseparable: Numbers of which only a combination is known.
        rest: What no cause explains, one per axis at most.
        not_testable: Ids that the recordings cannot show.
        machine: With the effects and the fitted numbers.
        before: Comparison of the machine as given.
        after: Comparison of the fitted machine.
        selections: The searches, by axis.
        between: The searches between the two encoders of an axis, by axis.
        signals: What the recorded channels are like, and which of them were not used.
        without_support: Ids of effects that the fit of an axis has and the recordings do not support.
    """

    campaign: Campaign
    verdict: str
    effects: tuple[DiagnosedEffect, ...]
    sheet: tuple[SheetNumber, ...]
    inseparable: tuple[Inseparable, ...]
    rest: tuple[UnexplainedRest, ...]
    not_testable: tuple[str, ...]
    machine: Machine
    before: LogComparison
    after: LogComparison
    selections: Mapping[str, AxisSelection]
    between: Mapping[str, AxisSelection] = field(default_factory=dict)
    signals: tuple[Finding, ...] = ()
    without_support: tuple[str, ...] = ()

    @property
    def probabilities(self) -> dict[str, float]:
        """Of the four verdicts: unknown where an axis leaves more than a sound machine; findings are taken for
        independent of each other.
        """
        known = float(np.prod([1.0 - f.discrepancy.probability for f in self._fits]))
        mine = [e.probability or 0.0 for e in self.effects]
        whole = [p + sum(e.others.values()) for p, e in zip(mine, self.effects, strict=True)]
        nothing = known * float(np.prod([1.0 - p for p in whole]))
        is_sized = all(e.together is None or e.together.others for e in self.effects)
        clear = is_sized * float(np.prod([p / max(w, 1e-30) for p, w in zip(mine, whole, strict=True)]))
        rows = {
            "nothing_found": nothing,
            "identified": (known - nothing) * clear,
            "ambiguous": (known - nothing) * (1.0 - clear),
            "unknown": 1.0 - known,
        }
        return {k: round(p, 4) for k, p in rows.items()}

    @property
    def budget(self) -> tuple[Budget, ...]:
        """Where the uncertainty of every number of the recorded axes comes from: findings first."""
        rows = [b for fit in self._fits for b in log_budget(fit)]
        found = [e.effect.id for e in self.effects]
        place = {name: i for i, name in enumerate(found)}
        return tuple(sorted(rows, key=lambda b: place.get(b.effect_id, len(found))))

    @property
    def _fits(self) -> list[AxisFit]:
        return [s.fit for s in (*self.selections.values(), *self.between.values())]

    def to_json(self) -> dict:
        """The JSON of ``mjsim diagnose``: keys as for ball-bar tests, and the data sheet."""
        rest = max(self.rest, key=lambda r: r.rms, default=None)
        return {
            "verdict": self.verdict,
            "probabilities": self.probabilities,
            "noise_um": rounded(self.before.noise / UM),
            "rms_before_um": rounded(self.before.rms / UM),
            "rms_after_um": rounded(self.after.rms / UM),
            **self._rotary(),
            "effects": [e.to_json(self.machine) for e in self.effects],
            "without_support": list(self.without_support),
            "signals": [f.to_json() for f in self.signals],
            "encoders": [self._encoders_json(a, s) for a, s in self.between.items()],
            "unexplained": self._rest_json(rest) if rest else None,
            "not_testable": list(self.not_testable),
            "data_sheet": [s.to_json() for s in self.sheet],
            "not_separable": [
                {"axis": i.axis, "numbers": list(i.labels), "remedy": i.remedy} for i in self.inseparable
            ],
            "budget": [{k: rounded(v) for k, v in b.to_json().items()} for b in self.budget],
            "samples": sum(t.to_json()["samples"] for t in self.before.tests),
            "next_test": self._next(),
            "tests": [t.to_json() for t in self.after.tests],
        }

    def _rotary(self) -> dict:
        before, after = self.before.rms_rotary, self.after.rms_rotary
        if before is None or after is None:
            return {}
        return {"rms_before_deg": rounded(before / DEG), "rms_after_deg": rounded(after / DEG)}

    def _encoders_json(self, axis: str, s: AxisSelection) -> dict:
        """How well the transmission explains the difference of the two encoders of an axis."""
        rotary = self.machine.chain.is_rotary(axis)
        unit, symbol = (DEG, "deg") if rotary else (UM, "um")
        numbers = {"rms_before": s.given.rms, "rms_after": s.fit.rms}
        return {"axis": axis} | {f"{k}_{symbol}": rounded(v / unit) for k, v in numbers.items()}

    def _rest_json(self, rest: UnexplainedRest) -> dict:
        rotary = self.machine.chain.is_rotary(rest.axis)
        period = None if rest.period is None else rounded(rest.period / (DEG if rotary else MM))
        unit, travel, symbol = (DEG, DEG, "deg") if rotary else (UM, MM, "um")
        return {
            "axes": [rest.axis],
            "variable": rest.variable or None,
            "period": period,
            f"rms_{symbol}": rounded(rest.rms / unit),
            "share": rounded(rest.share),
            "tests": list(rest.tests),
            f"left_{symbol}": rounded(rest.left / unit),
            f"allowed_{symbol}": rounded(rest.allowed / unit),
            "probability": round(rest.probability, 4),
            "worst": {
                "test": rest.worst[0],
                "time_s": rounded(rest.worst[1]),
                f"position_{'deg' if rotary else 'mm'}": rounded(rest.worst[2] / travel),
            },
            "summary": self._rest_sentence(rest, rotary),
            "effect_file": None,
        }

    def _rest_sentence(self, rest: UnexplainedRest, rotary: bool) -> str:
        """What is left, where, and how much a sound machine would leave."""
        unit, travel, small, large = (DEG, DEG, "°", "°") if rotary else (UM, MM, "µm", "mm")
        name, time, place = rest.worst
        place_of = "Between the encoders of" if rest.between else "On"
        said = (
            f"{place_of} {rest.axis}, {rest.left / unit:.3g} {small} RMS are left, and a sound machine leaves at most "
            f"{rest.allowed / unit:.2g} {small}. The largest error is at {time:.3f} s of {name}, at "
            f"{place / travel:.4g} {large}. "
        )
        if not rest.variable:
            return said + "It follows none of position, direction, speed, acceleration, torque and time."
        period = f" with a period of {rest.period / travel:.4g} {large}" if rest.period is not None else ""
        return said + (
            f"{rest.rms / unit:.3g} {small} depend on {rest.variable.replace('_', ' ')}{period} and on no cause of the "
            f"catalogue ({100 * rest.share:.0f} % of what is left)."
        )

    def _next(self) -> dict | None:
        for e in self.effects:
            if e.alternatives:
                motion = "the same motion, both directions, with a longer stop between them and the torque recorded"
                return {
                    "between": [e.effect.id, e.alternatives[0]],
                    "test": {"kind": "log", "axes": [e.effect.subject], "motion": motion},
                    "difference_um": None,
                }
        for i in self.inseparable:
            if len(i.labels) > 1:
                return {
                    "between": list(i.labels[:2]),
                    "test": {"kind": "log", "axes": [i.axis], "motion": i.remedy},
                    "difference_um": None,
                }
        return None
