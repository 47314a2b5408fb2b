"""Machine templates, data sheets that are known within a factor only, and the plan of a new campaign."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from commands import as_json, ok, run

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.machine_templates import FACTOR, LAYOUTS, SIZES, TEMPLATES
from mjsim.campaign.new import machine_text
from mjsim.inference.calibration import sheet_range
from mjsim.inference.data_sheet import calibrated, data_sheet, sheet_block, sheet_of
from mjsim.inference.planning.whole_campaign import CampaignPlanner, possible_tests
from mjsim.inference.problem import sheet_plants
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import TOLERANCE, build
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.stability import check_stable


@pytest.fixture(scope="module")
def three_axes():
    """A machine whose plans are quick: three circles can be run on it."""
    template = TEMPLATES["three-axes-medium"]
    return read_machine("machine.toml", machine_text(template.chain, "m", template))


def test_every_template_is_a_machine_that_runs(tmp_path):
    """It reads back with its axes and numbers, its drives are stable, and it says within which factor they hold."""
    for t in TEMPLATES.values():
        machine = read_machine(tmp_path / "machine.toml", machine_text(t.chain, "m", t, 40.0))
        assert machine.chain.letters == t.chain.letters and machine.factor == FACTOR
        tilted = [[a.unit for a in c.axes if a.rotary] for c in (machine.chain, t.chain)]
        assert np.allclose(*tilted)
        assert all(d.position_gain == 40.0 for d in machine.drives.values())
        assert {a: d.inertia for a, d in machine.drives.items()} == {a: t.drive(a).inertia for a in t.chain.letters}
        check_stable(build(machine))


def test_templates_on_the_command_line(tmp_path):
    listed = as_json("machine", "templates")["templates"]
    assert len(listed) == len(LAYOUTS) * len(SIZES) and {"inertia", "coulomb"} <= set(listed[0]["drives"]["X"])
    said = ok("machine", "templates").stdout
    assert all(x.name in said for x in (*LAYOUTS, *SIZES)) and "factor" in said
    folder = tmp_path / "mine"
    ok("machine", "new", "--template", "nutating-table-large", "--position-gain", "33", "-o", folder)
    text = (folder / "machine.toml").read_text(encoding="utf-8")
    assert "# assumed" in text and "factor = 2" in text and read_machine(folder / "machine.toml").chain.axis("B").tilted


@pytest.mark.parametrize(
    ("options", "status", "said"),
    [
        (["--template", "trunnion"], 1, "unknown; allowed: LAYOUT-SIZE"),
        (["--template", "trunnion-a-small", "--position-gain", "0"], 1, "allowed: 1 to 1000 1/s"),
        (["--template", "trunnion-a-small", "--configuration", "XY"], 2, "either"),
        ([], 2, "either"),
        (["--configuration", "XY", "--position-gain", "40"], 2, "needs --template"),
    ],
)
def test_wrong_templates_write_nothing(tmp_path, options, status, said):
    result = run("machine", "new", *options, "-o", tmp_path / "m")
    assert result.exit_code == status and said in result.stderr and not (tmp_path / "m").exists()


def test_a_factor_widens_all_but_the_position_gain():
    """Two standard deviations are the factor, up and down alike; a data sheet without one is what it was."""
    wide = {p.name: p for p in data_sheet(FIVE_AXIS, 2.0) if p.axis == "X"}
    assert {n: p.sd for n, p in wide.items() if not p.wide} == {"position_gain": TOLERANCE["position_gain"]}
    assert wide["inertia"].ratio(2.0) == pytest.approx(2.0) and wide["inertia"].ratio(-2.0) == pytest.approx(0.5)
    assert {p.name: p.sd for p in data_sheet(FIVE_AXIS)} == TOLERANCE and not any(p.wide for p in data_sheet(FIVE_AXIS))


def test_a_wide_number_stays_within_three_standard_deviations(three_axes):
    """So that a cause that the model lacks cannot drive a drive to where it is unstable; data sheets have no bound."""
    block = sheet_block(three_axes, np.zeros(len(sheet_of(three_axes)), bool))
    wide = np.array([p.wide for p in sheet_of(three_axes)])
    assert (block.upper[wide] == 3.0).all() and (block.lower[wide] == -3.0).all() and np.isinf(block.upper[~wide]).all()
    assert sheet_of(three_axes)[int(np.argmax(wide))].ratio(9.0) == pytest.approx(FACTOR**1.5)


def test_a_wide_data_sheet_moves_the_machine(three_axes):
    moves = np.zeros(len(sheet_of(three_axes)))
    at = next(i for i, p in enumerate(sheet_of(three_axes)) if p.label == "inertia.Y")
    moves[at] = 2.0
    moved = calibrated(three_axes, moves)
    assert moved.drives["Y"].inertia == pytest.approx(2.0 * three_axes.drives["Y"].inertia)
    assert moved.drives["X"] == three_axes.drives["X"]


def test_torques_times_one_factor_move_no_axis(three_axes):
    """Then nothing tells the factor: derivatives of single numbers say so as well, or a friction of the wrong drive
    would seem to be known.
    """
    motion = AxesMotion(next(iter(possible_tests(three_axes))))
    base, sheet = build(three_axes), sheet_of(three_axes)
    moved = {sheet[j].name: (sheet[j], plant) for j, (plant, _) in sheet_plants(three_axes, "X").items()}
    each = {
        name: motion.motor_change("X", base.axes["X"], plant.axes["X"]) / (p.step * p.sd)
        for name, (p, plant) in moved.items()
    }
    torques = [each[name] for name in ("velocity_gain", "inertia", "viscous", "coulomb")]
    assert np.abs(sum(torques)).max() < 0.005 * np.abs(each["velocity_gain"]).max()


def test_a_friction_counts_as_wrong_beyond_what_is_believed_of_it(three_axes):
    """A template is believed within a factor, a data sheet within some per cent; a break-away torque is no number of
    it.
    """
    friction = three_axes.effect("friction.X")
    stated = friction.values["coulomb_Nm"]
    assert sheet_range(three_axes, friction)["coulomb_Nm"] == pytest.approx((stated / 2.0, stated * 2.0))
    known = sheet_range(replace(three_axes, factor=None), friction)
    assert known["coulomb_Nm"] == pytest.approx((0.9 * stated, 1.1 * stated))
    assert set(known) == {"coulomb_Nm", "presliding_rad"}


# --- the plan of a new campaign --------------------------------------------------------------------------------------


def test_a_longer_plan_tells_no_less(three_axes):
    planner = CampaignPlanner(three_axes)
    plans = [planner.plan(m) for m in (6.0, 10.0, 30.0)]
    for plan, most in zip(plans, (6.0, 10.0, 30.0), strict=True):
        assert plan.minutes <= most and len({t.name for t in plan.tests}) == len(plan.tests)
    assert [set(a.told) <= set(b.told) for a, b in pairwise(plans)] == [True, True]
    assert len(plans[0].told) < len(plans[1].told)
    full = planner.plan()
    assert set(plans[2].told) <= set(full.told) and full.minutes <= plans[2].minutes
    assert {"backlash.X", "backlash.Y", "backlash.Z"} <= set(full.told)
    assert full.alike["scale_error.X"].startswith("scale_error.")  # the bar's length is not known
    assert "velocity_gain.X" in full.hidden  # the template says so little of it


def test_what_is_told_does_not_depend_on_the_order(three_axes):
    """The information of two tests is the sum of theirs: by brute force, all rows and nuisances in one matrix."""
    planner = CampaignPlanner(three_axes)
    a, b, _ = planner._tests
    shared = planner._count + len(planner._sheet) + 1
    both = planner._told[a.name] + planner._told[b.name] + np.eye(shared + 6)
    left = np.linalg.inv(both)[: planner._count, : planner._count]
    assert planner._entropy([a, b]) == pytest.approx(0.5 * np.linalg.slogdet(left)[1], rel=1e-6)
    assert planner._entropy([a, b]) == pytest.approx(planner._entropy([b, a]))


def test_a_planned_campaign_is_written(tmp_path):
    folder = tmp_path / "mine"
    data = as_json("plan", "--new", "--template", "three-axes-small", "--minutes", "8", "-o", folder)
    assert data["minutes"] <= 8.0 and len(data["tests"]) == 2
    campaign = read_campaign(folder)
    assert [t.name for t in campaign.tests] == [t["name"] for t in data["tests"]] and not campaign.measured
    assert math.isclose(read_machine(campaign.machine_file).factor, FACTOR)
    said = ok("plan", "--new", "--machine", folder / "machine.toml", "--minutes", "6").stdout
    assert "Tells from everything else" in said and "Does not show" in said and "orders are not known" in said


@pytest.mark.parametrize(
    ("options", "status", "said"),
    [
        (["--new", "--template", "three-axes-small", "--minutes", "2"], 1, "too short for a test"),
        (["--new", "--template", "three-axes-small", "--minutes", "soon"], 1, "or full"),
        (["--new"], 2, "either --machine or --template"),
        (["--minutes", "10", "campaign"], 2, "need --new"),
        ([], 2, "Missing argument"),
    ],
)
def test_wrong_plans_write_nothing(tmp_path, options, status, said):
    more = ["-o", tmp_path / "out"] if "--new" in options else []
    result = run("plan", *options, *more)
    assert result.exit_code == status and said in result.stderr and not (tmp_path / "out").exists()
