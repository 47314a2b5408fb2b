"""One effect in detail: its signature test by test, what looks like it, and why it was named or not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.special import expit

from mjsim.campaign.model import Campaign
from mjsim.commands.diagnose import diagnose
from mjsim.commands.diagnosis import Diagnosis
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.bar_search import BarSearch
from mjsim.inference.calibration import expected_effects
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import trusted_problem
from mjsim.inference.problem import Problem
from mjsim.inference.signature_study import SignatureStudy, study_of_candidate, study_of_member
from mjsim.inference.vibration import separate
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program, reversals
from mjsim.io.extras import need
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, UM, unit_of

# -- why a diagnosis has named an effect or not, in short sentences ----------------------------------------------------

#: Cosine from which one named effect is said to explain what this one would.
_SOME = 0.3
#: Probability from which the data need an effect: it is there more likely than not.
_NEEDED = 0.5
Role = Literal["named", "calibrated", "in the machine file", "not named", "not testable"]
#: Of an effect with one of these, a departure from the machine file is told.
DEPARTURES: tuple[Role, ...] = ("calibrated", "in the machine file")


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
        stated: Whether the machine file has it: all is then about a departure from there.
    """

    effect_id: str
    result: Diagnosis
    found: SignatureStudy | None
    problem: Problem
    probability: float
    alone: float | None
    stated: bool = False


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
    return "in the machine file" if case.stated else "not named", _not_named(case, case.found)


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
    what, it = ("another size", "it has another size") if case.stated else ("it", "it is there")
    parts = []
    there = f"Beside the final model the probability that {it} is {_percent(case.probability)}"
    if case.probability < _NEEDED:
        parts.append(f"The data do not need {what}. {there}.")
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


if TYPE_CHECKING:
    import pandas as pd

#: Most effects that look alike in the JSON.
_MOST_ALIKE = 12


@dataclass(frozen=True)
class ExplainedTest:
    """One test.

    Attributes:
        test: As it was run.
        phi: φ of each block of the trace, (m,) rad, signed.
        signature: What the effect changes in the reading there once the set-up is fitted, (m,) m.
        residual: Measured less everything else in the model, (m,) m.
        valid: Blocks that are judged, (m,) bool.
        reversals: Axis letter and φ of its reversals, rad.
    """

    test: BallBarTest
    phi: np.ndarray
    signature: np.ndarray
    residual: np.ndarray
    valid: np.ndarray
    reversals: dict[str, np.ndarray]

    @property
    def signature_rms(self) -> float:
        """RMS of the signature, m."""
        return _rms(self.signature[self.valid])

    @property
    def rms_without(self) -> float:
        """RMS of what everything else in the model leaves, m."""
        return _rms(self.residual[self.valid])

    @property
    def rms_with(self) -> float:
        """RMS of what is left once the signature is taken off as well, m."""
        return _rms((self.residual - self.signature)[self.valid])


@dataclass(frozen=True)
class Explanation:
    """One effect in detail.

    Attributes:
        campaign: What was measured.
        effect: At the size that the signature is shown for.
        fitted: Whether that is its fitted size; otherwise a typical one.
        role: ``named``, ``calibrated``, ``in the machine file``, ``not named`` or ``not testable``.
        reason: Why, in short sentences.
        ci95: 95 % intervals of its fitted size beside everything else in the model.
        estimate: The effect at that size.
        gain: Fall of the squared residuals, in units of the noise, if it is fitted beside everything else.
        probability: That it is there beside everything else in the model, or larger than its tolerance.
        absorbed: Share of its squared signature that set-up errors take up.
        alike: Cosine of other effects' signatures with this one once the set-up is fitted, the largest first.
        noise: RMS of one block of the traces, m.
        tests: The effect in each test.
    """

    campaign: Campaign
    effect: Effect
    fitted: bool
    role: Role
    reason: str
    ci95: dict
    estimate: Effect
    gain: float
    probability: float
    absorbed: float
    alike: dict[str, float]
    noise: float
    tests: tuple[ExplainedTest, ...]

    @property
    def departs(self) -> bool:
        """Whether all of it is about a departure from the machine file."""
        return self.role in DEPARTURES

    def to_json(self) -> dict:
        """Plain numbers in µm and the units of the parameters' names."""
        return {
            "campaign": self.campaign.name,
            "id": self.effect.id,
            "title": self.effect.title,
            "role": self.role,
            "reason": self.reason,
            "parameters": self.estimate.values,
            "ci95": self.ci95,
            "gain": round(self.gain, 1),
            "probability": round(self.probability, 4),
            "taken_up_by_setup": round(self.absorbed, 4),
            "shown_at": self.effect.values,
            "shown_at_fitted_size": self.fitted,
            "noise_um": round(self.noise / UM, 4),
            "alike": [{"id": k, "cosine": round(v, 4)} for k, v in list(self.alike.items())[:_MOST_ALIKE]],
            "tests": [
                {
                    "name": t.test.name,
                    "signature_um": round(t.signature_rms / UM, 4),
                    "rms_without_um": round(t.rms_without / UM, 4),
                    "rms_with_um": round(t.rms_with / UM, 4) if self.fitted else None,
                }
                for t in self.tests
            ],
        }

    def to_dataframe(self) -> pd.DataFrame:
        """One row for each block of each trace: test, phi_deg, signature_um, residual_um, valid."""
        need("to_dataframe", "dataframe", "pandas")
        import pandas as pd

        parts = [
            pd.DataFrame(
                {
                    "test": t.test.name,
                    "phi_deg": t.phi / DEG,
                    "signature_um": t.signature / UM,
                    "residual_um": t.residual / UM,
                    "valid": t.valid,
                }
            )
            for t in self.tests
        ]
        return pd.concat(parts, ignore_index=True)


@one_blas_thread
def explain(
    campaign: Campaign,
    machine: Machine,
    effect: str,
    threads: int = 2,
    progress: Progress = silent,
    result: Diagnosis | None = None,
) -> Explanation:
    """Show one effect in detail: its signature, what looks like it, and why it was named or not.

    Args:
        campaign: With at least one measured test.
        machine: As given.
        effect: Id of the catalogue, or of an effect of the machine file.
        threads: Tests that are worked on side by side.
        progress: Called as work gets on.
        result: Diagnosis of the same campaign and machine, if there is one already.

    Raises:
        InputError: Unknown effect, no measured test, or a vibration, which has no signature over the path.
    """
    cls, subject = registry.effect_class(effect, machine.chain)
    if cls.kind == "vibration":
        raise InputError(
            f"effect {effect}: a vibration has a frequency in time and no signature along the path; "
            "`mjsim diagnose` says which vibrations there are"
        )
    campaign = campaign.in_motion
    result = result or diagnose(campaign, machine, threads=threads, progress=progress)
    progress("fitting the final model again", 0, 2)
    separated = separate(trusted_problem(campaign, machine, threads), machine)
    search = BarSearch(Fitter(separated.problem, separated.machine))
    named = [EffectVector(e.effect, e.free) for e in result.effects if e.effect.kind != "vibration"]
    of_class = [c.effect for c in result.calibration]
    expected = {c.key: c for c in expected_effects(separated.machine)} if of_class else {}
    model = search.of_effects([*of_class, *named], expected)
    problem = model.problem
    progress("signatures", 1, 2)
    mine = next((f for f in model.fit.effects if f.effect.id == effect), None)
    if mine:
        found = study_of_member(problem, model.fit, mine)
    else:  # beside the noise alone: what is left may be all its doing
        found = study_of_candidate(search.plain, search.whitened_by(model, search.plain), effect)
    probability = 0.0 if found is None else float(expit(search.log_odds(model, effect)))
    alone = None
    if named and found is not None and not mine:
        alone = float(expit(search.log_odds(search.of_effects(of_class, expected), effect)))
    stated = any(e.id == effect for e in machine.effects)
    role, reason = reason_of(Case(effect, result, found, problem, probability, alone, stated))
    if found is None:
        nothing = cls(subject, **_typical_values(cls, subject, machine))
        return Explanation(
            campaign, nothing, False, role, reason, {}, nothing, 0.0, 0.0, 0.0, {}, problem.noise.block_rms, (),
        )  # fmt: skip
    return Explanation(
        campaign,
        found.effect,
        found.fitted,
        role,
        reason,
        found.ci95,
        found.estimate,
        found.gain,
        probability,
        found.absorbed,
        found.alike,
        problem.noise.block_rms,
        tuple(_tests(problem, found)),
    )


def _tests(problem: Problem, found: SignatureStudy) -> Iterator[ExplainedTest]:
    for k, (s, part, without) in enumerate(zip(problem.samples, found.parts, found.without, strict=True)):
        program = Program(s.test)
        phi = program.phi(s.centre - problem.shift(k, found.fit.nuisance))
        yield ExplainedTest(s.test, phi, part, without, s.good, reversals(program))


def _typical_values(cls: type[Effect], subject: str, machine: Machine) -> dict:
    """Values of an effect that has no signature: as in the machine file, or where a search would begin."""
    present = next((e for e in machine.effects if e.id == f"{cls.kind}.{subject}"), None)
    if present is not None:
        return present.values
    parameters = cls.parameters_of(subject)
    if any(p.kind == "components" for p in parameters):
        return {"components": []}
    return next(iter(cls.search.seeds_of(parameters, subject, machine.chain, machine.sensors)), {})


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if len(x) else 0.0
