"""Waves of an axis that are there on a part of its travel only, such as a damaged stretch of a worm wheel.

No effect of the catalogue is of that kind. Waves of many neighbouring orders imitate it, and each of them may be within
the tolerance of the pitch error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mjsim.estimation.calibration import Calibrated, expected_effects
from mjsim.estimation.curve_terms import CurveTerm, CurveTerms
from mjsim.estimation.disturbances import readmitted
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fitter
from mjsim.estimation.outcome import JointSelection
from mjsim.machine.chain import is_rotary

#: Unusual orders of one worm gear from which its waves are local: it has a few (assumed).
_MANY = 6


def in_place_of_many_waves(fitter: Fitter, joint: JointSelection) -> tuple[JointSelection, CurveTerm] | None:
    """The outcome with a curve of a rotary axis' position in place of waves that are too many to be waves, and that
    curve; otherwise ``None``.

    Args:
        fitter: Of the machine.
        joint: The outcome with all waves.
    """
    expected = {c.key: c for c in expected_effects(fitter.machine)}
    fit = joint.selection.fit
    many = next((f for f in fit.effects if is_rotary(f.effect.subject) and _unusual(f, expected) >= _MANY), None)
    if many is None:
        return None
    # where nothing repeats, the damaged stretch itself looks like knocks until a model follows it
    problem = readmitted(joint.problem, fit.readings, fit.nuisance)
    fitter, key = fitter.with_problem(problem), many.effect.key
    usual = [expected[key]] if key in expected else []
    fit = fitter.fit([*(f for f in fit.effects if f is not many), *(c.free for c in usual)], start=fit)
    curve = next(CurveTerms(problem, fit).fine(many.effect.subject), None)
    if curve is None:
        return None
    return replace(joint.without({key}, fit, usual), problem=problem), curve


def _unusual(f: EffectVector, expected: Mapping[str, Calibrated]) -> int:
    """Number of an effect's waves of orders that are not expected."""
    mine = expected.get(f.effect.key)
    return len(_orders(f) - (_orders(mine.free) if mine else set()))


def _orders(f: EffectVector) -> set[int]:
    return {round(row[0]) for row in f.effect.values["components"]} if "components" in f.names else set()
