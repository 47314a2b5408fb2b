"""``mjsim geometry``: where the axes of any machine are, from a campaign alone."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from independent import chain_campaigns, chains

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.tolerance import TYPICAL_TOLERANCE
from mjsim.cli.geometry import show
from mjsim.cli.main import main
from mjsim.commands.calibrate import fit_within_tolerance
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.nuisance import TRIGGERS
from mjsim.inference.nuisance_fit import better_triggers, fit_nuisance
from mjsim.machine.chain import chain_of

#: Family -> numbers that turns of single axes leave open, each with what shows in its place.
OPEN = {
    "head_table": {
        "axis_location.EY0C": "axis_location.EA0B",
        "axis_location.EA0B": "squareness.YZ",
        "axis_location.EZ0B": "table ball z of set-up x100",
    },
    "fork_head": {
        "axis_location.EY0C": "axis_location.EY0A",
        "axis_location.EB0A": "axis_location.EB0C",
        "axis_location.EC0A": "squareness.XY",
    },
    "nutating_table": {"axis_location.EA0B": "squareness.YZ"},
}


def planted(family):
    """Location errors far beyond what a machine of its class has."""
    values = (60.0, -45.0, 80.0, -120.0, 35.0, -70.0, 150.0, -95.0)
    for name, value in zip(chains.FAMILIES[family][3].split(), values, strict=False):
        yield {"id": f"axis_location.{name}", "value_um" if name[1] in "XYZ" else "value_urad": value}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A campaign of each family: turns of single axes in one set-up."""
    made = {}
    for family in OPEN:
        made[family] = tmp_path_factory.mktemp(family)
        case = chain_campaigns.ChainCase(family, family, 21, tuple(planted(family)), kinds=("rotary",))
        chain_campaigns.write(case, made[family])
    return made


@pytest.mark.parametrize("family", OPEN)
def test_location_errors_of_three_families(family, folders):
    """Every number is within its interval, and what hides it is named."""
    hidden = tuple(planted(family))
    result = CliRunner().invoke(main, ["geometry", str(folders[family]), "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    by_id = {row["id"]: row for row in found["geometry"]}
    assert found["explained"] and set(by_id) > {h["id"] for h in hidden}
    for h in hidden:
        row = by_id[h["id"]]
        low, high = row["ci95"]
        middle, half = (low + high) / 2, (high - low) / 2
        assert abs(middle - h[row["parameter"]]) < 1.5 * half
        assert row["determined"] == (half <= (6.0 if row["parameter"] == "value_um" else 15.0))
    assert sum(by_id[h["id"]]["determined"] for h in hidden) >= (0 if family == "fork_head" else 4)
    for number, instead in OPEN[family].items():
        assert not by_id[number]["determined"]
        assert instead in [row["name"] for row in by_id[number]["instead"]]


def test_what_is_left_open_is_said(capsys):
    rows = [
        {"id": "axis_location.EX0C", "parameter": "value_um", "value": 3.0, "ci95": [2.0, 4.0], "determined": True},
        {"id": "axis_location.EZ0B", "parameter": "value_um", "value": 1.0, "ci95": [-19.0, 21.0], "determined": False},
    ]
    names = ["table ball z of set-up a", "squareness.YZ", "table ball z of set-up b"]
    rows = [
        r
        | {
            "meaning": "C centreline",
            "instead": [] if r["determined"] else [{"name": n, "correlation": 0.9} for n in names],
        }
        for r in rows
    ]
    head = {"configuration": "w-C'bXYZB-t", "tests": 3, "residual_over_noise": 2.0, "noise_um": 0.1}
    show(head | {"explained": False, "geometry": rows, "combinations": [], "left_out": ["EX0B"]})
    said = " ".join(capsys.readouterr().out.split())
    assert "more than geometry" in said and "± 20 µm open" in said and "Not listed" in said and "EX0B" in said
    assert "cannot tell it from table ball z of set-up a and b, squareness.YZ" in said


def test_what_no_test_can_tell_apart_is_left_out():
    assert chain_of("w-C'A'Y'bXZ-t").redundant_location_errors == ()
    assert chain_of("w-C'bXYZB-t").redundant_location_errors == ("EX0B",)
    assert chain_of("w-bXYZCA-t").redundant_location_errors == ()


def test_a_campaign_without_traces_is_refused(tmp_path):
    runner = CliRunner()
    assert runner.invoke(main, ["new", "campaign", str(tmp_path / "new")]).exit_code == 0
    result = runner.invoke(main, ["geometry", str(tmp_path / "new")])
    assert result.exit_code == 1 and "no ball-bar test has a trace" in result.output


def test_triggers_leave_a_false_minimum(folders):
    """A trigger that stands 60 ms off is found again; one that stands right is left alone."""
    campaign = read_campaign(folders["fork_head"])
    wide = TYPICAL_TOLERANCE | {"axis_location": {"um": 400.0, "urad": 1000.0}}
    machine = replace(read_machine(campaign.machine_file), tolerance=wide)
    fitter = Fitter(checked_problem(campaign, machine, 1), machine)
    fit, at = fit_within_tolerance(fitter), fitter.problem.nuisances[TRIGGERS]
    assert better_triggers(fitter.problem, fit.readings, fit.nuisance) is None
    moved = fit.nuisance.copy()
    moved[at] += [0.0, -3.0, 0.0]
    back = better_triggers(fitter.problem, fit.readings, moved)
    assert back is not None
    np.testing.assert_allclose(back[at], fit.nuisance[at], rtol=0, atol=0.3)
    # where many tests are not met, the model is wrong and no trigger
    assert better_triggers(fitter.problem, fit.readings, moved, 0.2) is None
    begin = better_triggers(fitter.problem, fit.readings, moved, 0.7)
    assert begin is not None
    np.testing.assert_allclose(begin, back, rtol=0, atol=1e-12)
    again, alone = (fit_nuisance(fitter.problem, list(fit.readings), begin=x) for x in (begin, None))
    np.testing.assert_allclose(again, alone, rtol=0, atol=0.01)
