"""Why a diagnosis has named an effect or not, in short sentences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mjsim.commands.diagnosis import Diagnosis
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.problem import Problem
from mjsim.inference.signature_study import SignatureStudy
from mjsim.machine.chain import is_rotary
from mjsim.units import UM, unit_of

#: Cosine from which one named effect is said to explain what this one would.
_SOME = 0.3
#: Probability from which the data need an effect: it is there more likely than not.
_NEEDED = 0.5
Role = Literal["named", "calibrated", "not named", "not testable"]


@dataclass(frozen=True)
class Case:
    """What a reason is made of.

    Attributes:
        effect_id: Of the effect in question.
        result: The diagnosis.
        found: The study of its signature beside the model without it; ``None`` where it has none.
        problem: The measured tests.
        probability: That it is there beside everything else in the model, or larger than its tolerance.
        alone: The same without the named effects; ``None`` where none is named, or this one is.
    """

    effect_id: str
    result: Diagnosis
    found: SignatureStudy | None
    problem: Problem
    probability: float
    alone: float | None


def reason_of(case: Case) -> tuple[Role, str]:
    """The role that an effect has in a diagnosis, and why."""
    named = [e for e in case.result.effects if e.effect.id == case.effect_id]
    if named:
        return "named", _named(case, named[0])
    inside = [c for c in case.result.calibration if c.effect.effect.id == case.effect_id]
    if inside:
        return "calibrated", _calibrated(inside[0])
    if case.found is None:
        return (
            "not testable",
            "It changes no reading of these tests: no axis that it needs moves where the bar sees it.",
        )
    if case.found.hidden or case.effect_id in case.result.not_testable:
        return "not testable", (
            f"Ball offsets, bar length and trigger shifts take up {_percent(case.found.absorbed)} of its squared "
            "signature in these tests, and the data sheet's tolerances or the rest of the model take up what is left. "
            "`mjsim plan` proposes a test that shows it."
        )
    return "not named", _not_named(case, case.found)


def _named(case: Case, entry) -> str:
    share = case.result.explained_shares.get(entry.effect.key)
    parts = ["The data need it."]
    if share is not None:
        parts.append(f"It makes {_percent(share)} of the explained error.")
    parts.append(f"Beside everything else in the model it has a probability of {_percent(case.probability)}.")
    if entry.alternatives:
        parts.append(f"These tests cannot tell it from {' and '.join(entry.alternatives)}.")
    elif case.found is not None and (near := _nearest(case.found)):
        parts.append(f"{near[0]} looks most like it (cosine {near[1]:.2f}), and does not explain the data as well.")
    return " ".join(parts)


def _calibrated(entry) -> str:
    if not entry.observable:
        return (
            "The machine file has a tolerance for it, so it is fitted with that tolerance as prior. These tests do not "
            "observe it: its interval is about as wide as the tolerance. It is no finding."
        )
    return (
        "The machine file has a tolerance for it, so it belongs to the machine. Its 95 % interval does not lie beyond "
        f"the limit of ±{entry.limit:g} {_unit(entry.effect)}, so it is no finding. Its departure from the file "
        f"changes the readings by {entry.rms / UM:.2f} µm RMS once the set-up is fitted."
    )


def _not_named(case: Case, found: SignatureStudy) -> str:
    largest = max(float(np.std(p[s.good])) for p, s in zip(found.parts, case.problem.samples, strict=True))
    parts = []
    there = f"Beside the final model the probability that it is there is {_percent(case.probability)}"
    if case.probability < _NEEDED:
        parts.append(f"The data do not need it. {there}.")
    elif largest < case.problem.settings.visible_share * case.problem.noise.rms:
        parts.append(
            f"It is too small to matter: in its clearest test it changes the reading by {largest / UM:.3f} µm RMS, "
            f"below a quarter of the noise ({case.problem.noise.rms / UM:.3f} µm)."
        )
    elif case.result.unexplained is not None:
        parts.append(
            "Something is left that no effect of the catalogue explains. This one would explain a part of it, and a "
            "generic curve does better."
        )
    else:
        parts.append(
            f"{there}, by a linear estimate. The full fit preferred the model without it, because the size would be "
            "impossible, or because set-up and data sheet explain it as well."
        )
    if case.alone is not None and case.probability < _NEEDED <= case.alone:
        rivals = [e.effect.id for e in case.result.effects]
        near = max(rivals, key=lambda name: found.alike.get(name, 0.0))
        cosine = found.alike.get(near, 0.0)
        what = (
            f"but {near} explains the same part of the data (cosine {cosine:.2f})"
            if cosine > _SOME
            else "but the named effects explain that part of the data"
        )
        parts.append(f"Without the named effects it would have {_percent(case.alone)}, {what}.")
    if any(case.effect_id in e.alternatives for e in case.result.effects):
        owner = next(e.effect.id for e in case.result.effects if case.effect_id in e.alternatives)
        parts.append(f"These tests cannot tell it from {owner}, which was named. One of the two is there.")
    return " ".join(parts)


def _nearest(found: SignatureStudy) -> tuple[str, float] | None:
    return next(iter(found.alike.items()), None)


def _unit(free: EffectVector) -> str:
    """Unit of an effect's size."""
    if "components" in free.names:
        return "°" if is_rotary(free.effect.subject) else "µm"
    return unit_of(next(n for n in free.names if free.specs[n].leading))[1]


def _percent(share: float) -> str:
    if share > 0.9995:
        return "more than 99.9 %"
    return "less than 0.1 %" if share < 0.001 else f"{100.0 * share:.{1 if share < 0.1 or share > 0.99 else 0}f} %"
