"""Angular errors in a diagnosis, on machines of the independent generator whose files state their tolerance."""

import numpy as np
import pytest
from independent import campaign as generator
from independent import chain_campaigns, real_machines
from independent.layouts import arrange, circle, layout

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.tolerance import VOLUMETRIC_TOLERANCE
from mjsim.effects.registry import make
from mjsim.inference.calibration import calibrated_effects
from mjsim.inference.findings import explain
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import seeds
from mjsim.inference.vibration import Separated
from mjsim.machine.model import build
from mjsim.simulation.axes import AxesMotion


def explained(folder, tests, *hidden):
    """The truth by id, and what the search makes of a machine on which everything is a little wrong."""
    within = [
        *real_machines.within("M1", np.random.default_rng(7)),
        *real_machines.volumetric_errors("XYZAC", np.random.default_rng(107)),
    ]
    stated = {"tolerance_stated": True, "volumetric_stated": True}
    case = generator.Case("angular", "M1", tuple(tests), hidden, seed=7, within=tuple(within), **stated)
    generator.write_files(case, folder)
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    problem = Problem.of(campaign, build(machine), threads=2)
    return {e["id"]: e for e in within}, explain(Separated(problem, machine, ()))


def test_a_slide_that_pitches_is_the_finding(tmp_path):
    """Three tests at one place: what Z does to the arm tells pitch of X from scale, squareness and straightness."""
    hidden = {"id": "angular_error.EBX", "linear_urad": 60.0, "quadratic_urad": 0.0}
    _, found = explained(tmp_path, layout("quick"), hidden)
    assert found.verdict == "identified" and [f.key for f in found.selection.found] == ["angular_error.EBX"]
    f = next(f for f in found.selection.fit.effects if f.effect.id == hidden["id"])
    intervals = f.interval(f.vector, found.selection.fit.covariance_of(f))
    assert intervals["linear_urad"][0] < 60.0 < intervals["linear_urad"][1] < 80.0
    assert intervals["quadratic_urad"][0] < 0.0 < intervals["quadratic_urad"][1]


def test_nothing_is_found_where_nothing_hides(tmp_path):
    """The small angles are calibrated: nine intervals of ten hold, and what no test sees keeps its tolerance."""
    truth, found = explained(tmp_path, layout("quick"))
    assert found.verdict == "nothing_found" and not found.selection.found
    entries = {c.effect.effect.id: c for c in found.calibration if c.effect.effect.kind == "angular_error"}
    assert len(entries) == 9
    inside = [
        low < truth[i][name] < high for i, c in entries.items() for name, (low, high) in c.ci95.items()
    ]  # 95 % of 18
    assert sum(inside) >= 16
    # the functional point of Z is the spindle ball, so that its angles move nothing
    for name in ("EAZ", "EBZ", "ECZ"):
        c = entries[f"angular_error.{name}"]
        assert not c.observable and c.ci95["linear_urad"][1] == pytest.approx(0.98 * 12.0, rel=0.01)
    # at one height of the ball a roll of X and one of Y bend the path as straightness does: the arm is 155 mm
    sums = [{(t.effect_id, t.name): t.factor for t in c.terms} for c in found.combinations]
    bent = next(s for s in sums if ("straightness.EYX", "quadratic_um") in s)
    for axis in "XY":
        assert bent["angular_error.EA" + axis, "quadratic_urad"] == pytest.approx(-0.155, rel=0.05)


def test_a_tie_is_said_with_the_name_that_needs_the_smaller_number(tmp_path):
    """On circles of one plane a pitch of Y is squareness. 100 µrad of it are 8 limits, the squareness is 6."""
    tests = arrange([circle("XY", "CCW", 3000.0), circle("XY", "CW", 3000.0)])
    hidden = {"id": "angular_error.EBY", "linear_urad": 100.0, "quadratic_urad": 0.0}
    _, found = explained(tmp_path, tests, hidden)
    assert found.verdict == "ambiguous"
    (one,) = found.selection.found
    assert one.key == "squareness.XY" and set(one.others) == {"angular_error.EAX", "angular_error.EBY"}
    assert one.probability > max(one.others.values())


def test_without_a_stated_tolerance_they_are_not_looked_for(m1):
    kinds = set(VOLUMETRIC_TOLERANCE)
    assert not kinds & {c.effect.kind for c in seeds(m1)}
    stated = m1.with_effect(make("angular_error.EAX", linear_urad=5.0))
    assert {c.id for c in seeds(stated) if c.effect.kind in kinds} == {"angular_error.EAX"}  # it is in the file
    assert not kinds & {c.free.effect.kind for c in calibrated_effects(m1)}


@pytest.mark.parametrize("family", ["head_table", "nutating_table"])
def test_the_generator_agrees_on_other_chains_with_functional_points(family, tmp_path):
    points = {"X": (120.0, -80.0, -300.0), "Y": (60.0, 200.0, -150.0), "Z": (-90.0, 40.0, 250.0)}
    turns = [
        {"id": f"angular_error.E{about}{axis}", "linear_urad": 20.0 + k, "quadratic_urad": -9.0 + k}
        for k, (about, axis) in enumerate((b, a) for b in "ABC" for a in "XYZ")
    ]
    case = chain_campaigns.ChainCase(family, family, 3, points=points)
    rotary = [a for a in case.machine.axes if a in "ABC"]
    runs = [{"id": f"axial_error_motion.{a}", "amplitude_um": 4.0, "order": 2.0, "phase_deg": 30.0} for a in rotary]
    hidden = [*turns, *runs]
    rows = [t for t in case.tests() if t["kind"] != "rotary"][::3]
    chain_campaigns.write_folder(tmp_path, family, case.model(), rows, [(np.zeros(1), np.zeros(1))] * len(rows))
    machine = read_machine(tmp_path / "machine.toml")
    planted = machine.with_effects(
        make(e["id"], machine.chain, **{k: v for k, v in e.items() if k != "id"}) for e in hidden
    )
    effects = {e["id"]: e for e in [*case.model()["effect"], *hidden]}
    effects |= {f"functional_point.{a}": {"mm": list(p)} for a, p in points.items()}
    bare = {e["id"]: e for e in case.model()["effect"]}
    for test, row in zip(read_campaign(tmp_path, traces=False).tests, rows, strict=True):
        motion = AxesMotion(test)
        at = motion.time[400:-400:20]
        mine = (motion.reading(build(planted)) - motion.reading(build(machine)))[400:-400:20]
        drive = case.model()["drive"]
        theirs = chain_campaigns.reading(case, row, drive, effects, at) - chain_campaigns.reading(
            case, row, drive, bare, at
        )
        assert np.ptp(theirs) > 2e-6
        assert np.sqrt(np.mean((mine - theirs) ** 2)) < 0.01 * np.ptp(theirs)
