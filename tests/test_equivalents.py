"""What could stand in the place of a finding: other effects of the catalogue, and what a machine has anyway."""

from functools import partial

from independent import campaign as generator
from independent.layouts import layout

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.equivalents import Equivalents
from mjsim.estimation.fit import Fitter
from mjsim.estimation.problem import Problem
from mjsim.estimation.signatures import SignatureBank
from mjsim.machine.model import build

TURNS = [t for t in layout("rotaries") if t["name"].startswith("rotary-c-tangential")]
CIRCLES = [t for t in layout("short") if t["name"].startswith("circle-xy")]
LOCATIONS = ("axis_location.EX0C", "axis_location.EY0C", "axis_location.EA0C", "axis_location.EB0C")


def slower(test):
    """The same test at a quarter of the feed, an hour later."""
    name = "slow-" + test["name"]
    changed = {"feed_mm_min": test["feed_mm_min"] / 4, "started_s": test["started_s"] + 3600.0}
    return test | changed | {"name": name, "trace": f"traces/{name}.csv"}


def others(folder, tests, hidden, named, kept):
    """Ids of what could stand in the place of a finding (id and values), beside what is held to its tolerance."""
    case = generator.Case("c", "M1", tuple(tests), (hidden,), seed=3, tolerance_stated=True)
    generator.write_files(case, folder)
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    problem = Problem.of(campaign, build(machine), threads=2)
    fitter = Fitter(problem, machine)
    expected = {c.key: c for c in expected_effects(machine) if c.key in kept or c.key == named["id"]}
    cls, subject = registry.effect_class(named["id"], machine.chain)
    values = {k: v for k, v in named.items() if k != "id"}
    finding = EffectVector(cls(subject, **values), tuple(values))
    fit = fitter.fit([*(c.free for c in expected.values() if c.key in kept), finding], exact=True)
    refit = partial(fitter.fit, start=fit, exact=True, iterations=8, fresh=False)
    return set(Equivalents(problem, fit, SignatureBank(problem, fit), expected, refit).of(named["id"]))


def test_a_delay_at_one_speed_may_be_play_beyond_its_tolerance(tmp_path):
    named = {"id": "backlash.C", "width_deg": 0.002}
    assert "servo_delay.C" in others(tmp_path, TURNS, {"id": "servo_delay.C", "delay_ms": 0.1}, named, LOCATIONS)


def test_play_is_no_delay_where_the_speed_changes(tmp_path):
    slow = [slower(t) for t in TURNS]
    named = {"id": "backlash.C", "width_deg": 0.003}
    hidden = {"id": "backlash.C", "width_deg": 0.003}
    assert not others(tmp_path, [*TURNS, *slow], hidden, named, LOCATIONS)


def test_friction_that_the_model_holds_to_its_tolerance_may_be_a_velocity_gain(tmp_path):
    named = {"id": "velocity_gain.Y", "ratio": 0.5}
    hidden = {"id": "friction.Y", "coulomb_Nm": 9.0}
    assert "friction.Y" in others(tmp_path, CIRCLES, hidden, named, ("friction.X", "friction.Y"))
