"""One cause outside the catalogue is not named as several effects that imitate it, and several causes are not one."""

import numpy as np
import pytest
from independent import campaign as generator
from independent.layouts import layout
from independent.unlisted import EccentricPlay, TableEgg, TableLift
from rotary_fits import fitter_of, free

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.curve_terms import RADIAL
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fitter
from mjsim.estimation.model_choice import explain_with_few
from mjsim.estimation.one_curve import in_place_of_both_directions, one_curve
from mjsim.estimation.outcome import Found, Selection
from mjsim.estimation.problem import Problem
from mjsim.estimation.signatures import SignatureBank
from mjsim.machine.model import build
from mjsim.progress import silent

KEPT = ("axis_location.EX0C", "axis_location.EY0C", "axis_location.EA0C", "axis_location.EB0C", "squareness.XY")


def instead_of(named_of, hidden, folder, kind="rotary-c-tangential"):
    """What one curve explains in place of the named effects."""
    fitter, machine = fitter_of(hidden, folder, kind)
    kept = [c.free for c in expected_effects(machine) if c.key in KEPT]
    named = named_of(machine)
    findings = [f.effect.key for f in named]
    model = fitter.fit([*(f for f in kept if f.effect.key not in findings), *named])
    return one_curve(fitter, fitter.fit(kept), model, findings)


def test_play_that_changes_with_the_position_is_one_cause(tmp_path):
    def named(machine):
        wave = free(machine, "pitch_error.C", direction="CW", components=[[1.0, 0.0005, 10.0]])
        return [wave, *(free(machine, f"axis_location.{name}", value_um=1.0) for name in ("EX0C", "EY0C"))]

    instead = instead_of(named, (EccentricPlay("C", 8.0),), tmp_path)
    assert instead is not None
    fit, curve = instead
    assert curve.axis == "C" and curve.signed
    assert {f.effect.key for f in fit.effects} == set(KEPT)


def wobble(machine):
    """What a table that bulges twice per turn is to the catalogue."""
    motion = registry.make("radial_error_motion.C", amplitude_um=1.0, order=3.0)
    return [EffectVector(motion, ("amplitude_um", "phase_deg"))]


def test_a_table_that_is_not_round_is_one_cause(tmp_path):
    instead = instead_of(wobble, (TableEgg("C", 3.0, phase_deg=20.0),), tmp_path, "rotary-c")
    assert instead is not None
    curve = instead[1]
    assert (curve.axis, curve.moves, curve.variable) == ("C", RADIAL, "position")
    shape = curve.coefficients - curve.coefficients.mean()
    wanted = 3.0 * np.cos(2.0 * curve.knots + np.radians(20.0))
    assert shape == pytest.approx(wanted, abs=0.4)


def test_a_radial_error_motion_stays_one(tmp_path):
    hidden = ({"id": "radial_error_motion.C", "amplitude_um": 3.0, "order": 3.0, "phase_deg": 40.0},)
    assert instead_of(wobble, hidden, tmp_path, "rotary-c") is None


def test_two_causes_are_not_one(tmp_path):
    def named(machine):
        waves = free(machine, "pitch_error.C", components=[[240.0, 0.0003, 10.0]])
        return [free(machine, "backlash.C", width_deg=0.001), waves]

    waves = {"id": "pitch_error.C", "components": [[240.0, 0.0005, 50.0]]}
    assert instead_of(named, ({"id": "backlash.C", "width_deg": 0.003}, waves), tmp_path) is None


def test_a_curve_does_not_stand_for_causes_beside_which_it_does_as_much(tmp_path):
    """Backlash and a pitch error, and besides a play that changes with the position: three causes, not one."""

    def named(machine):
        waves = free(machine, "pitch_error.C", components=[[240.0, 0.0003, 10.0]])
        return [free(machine, "backlash.C", width_deg=0.0002), waves]

    waves = {"id": "pitch_error.C", "components": [[240.0, 0.00015, 50.0]]}
    hidden = ({"id": "backlash.C", "width_deg": 0.0006}, waves, EccentricPlay("C", 2.0))
    assert instead_of(named, hidden, tmp_path) is None


@pytest.mark.parametrize(
    ("hidden", "order", "is_one_cause"),
    [
        ([EccentricPlay("C", 8.0)], 1.0, True),
        ([{"id": "backlash.C", "width_deg": 0.002}, EccentricPlay("C", 8.0)], 1.0, True),
        (
            [
                {"id": "pitch_error.C", "components": [[3.0, 0.003, 10.0]], "direction": "CW"},
                {"id": "pitch_error.C", "components": [[3.0, 0.002, 10.0]], "direction": "CCW"},
            ],
            3.0,
            False,
        ),
    ],
    ids=["eccentric", "eccentric-and-backlash", "two-flanks"],
)
@pytest.mark.parametrize("first", [{"direction": "CW"}, {}], ids=["each-direction", "both-and-one"])
def test_opposite_pitch_errors_are_one_cause_and_others_are_two(first, hidden, order, is_one_cause, tmp_path):
    fitter, machine = fitter_of(tuple(hidden), tmp_path)
    flanks = [
        free(machine, "pitch_error.C", **which, components=[[order, 0.001, 10.0]])
        for which in (first, {"direction": "CCW"})
    ]
    named = fitter.fit([free(machine, "backlash.C", width_deg=0.001), *flanks])
    instead = in_place_of_both_directions(fitter, named, [f.effect.key for f in flanks])
    assert (instead is not None) == is_one_cause
    if instead:
        fit, curve, replaced = instead
        assert replaced == {f.effect.key for f in flanks}
        assert [f.effect.key for f in fit.effects] == ["backlash.C"]
        assert curve.axes == ("C",) and curve.signed


def test_a_table_that_lifts_with_its_speed_is_no_pile_of_effects(tmp_path):
    """Four effects of the catalogue explain it nearly down to the noise."""
    lift = TableLift("C", amplitude=-1.0, moves="Z")
    case = generator.Case("lift", "M2", tuple(layout("table")), (lift,), (0.8,), seed=2)
    generator.write_files(case, tmp_path)
    campaign = read_campaign(tmp_path)
    machine = read_machine(campaign.machine_file)
    fitter = Fitter(Problem.of(campaign, build(machine), threads=2), machine)
    pile = [
        free(machine, "squareness.YZ", angle_urad=1.0),
        EffectVector(registry.make("straightness.EYZ", quadratic_um=1.0), ("quadratic_um", "cubic_um")),
        free(machine, "axis_location.EY0A", value_um=1.0),
        EffectVector(
            registry.make("radial_error_motion.C", amplitude_um=0.3, order=2.0), ("amplitude_um", "phase_deg")
        ),
    ]
    start, named = fitter.fit([]), fitter.fit(pile)
    found = [Found(f.effect.key, 100.0) for f in named.effects]
    explained = explain_with_few(fitter, Selection(start, named, found, SignatureBank(fitter.problem, start)), silent)
    assert explained.selection.found == []
    assert explained.unexplained is not None
    assert explained.unexplained.axes == ("C", "Z") and explained.unexplained.variable == "velocity"
