"""Campaigns of machines with other chains, made by the independent generator, through the whole program."""

from dataclasses import replace

import numpy as np
import pytest
import tomlkit
from independent import chain_campaigns, chains

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.diagnose import diagnose
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.kinematics import Geometry, reading


def further(case):
    """A leaning circle, and both rotary axes together."""
    (first, _), (second, _) = case.machine.serial()
    common = {"bar_length_mm": 100.0, "feed_mm_min": 2000.0, "table_ball_mm": [100.0, 20.0, 155.0], "started_s": 0.0}
    lean = {"plane": "YZ", "lean_deg": 35.0, "lean_about_deg": 120.0, "direction": "CW", "revolutions": 1}
    yield {"name": "leaning", "trace": "", "kind": "circular", **lean, **common}
    both = {"axis": first, "from_deg": 90.0, "to_deg": -60.0, "second_from_deg": -20.0, "second_to_deg": 70.0}
    other = {"axis": second, "from_deg": -30.0, "to_deg": 50.0, "second_from_deg": 10.0, "second_to_deg": 200.0}
    for name, one in (("first", both), ("second", other)):
        for bar in "XYZ":
            test = {"name": name + bar, "trace": "", "kind": "simultaneous", **one, "sensitive_direction": bar}
            yield {**test, **common}


@pytest.mark.parametrize("family", chains.FAMILIES)
def test_programs_and_readings_agree(family, tmp_path):
    """The same campaign file means the same motion and the same reading to the generator and to mjsim."""
    case = chain_campaigns.ChainCase(family, family, 3)
    (tmp_path / "machine.toml").write_text(tomlkit.dumps(case.model()))
    tables = [*case.tests(), *further(case)]
    head = {"name": family, "machine": "machine.toml", "test": [{**t, "trace": None} for t in tables]}
    for t in head["test"]:
        del t["trace"]
    (tmp_path / "campaign.toml").write_text(tomlkit.dumps(head))
    campaign = read_campaign(tmp_path)
    chain = read_machine(campaign.machine_file).chain
    assert len(tables) >= 11 and chain.letters == tuple(case.machine.axes)
    location = {e.name: 1e-3 * (k + 1) for k, e in enumerate(chain.location_errors)}
    assert set(location) == set(chains.FAMILIES[family][3].split())
    text, directions, length, _, _ = chains.FAMILIES[family]
    machine = chains.Kinematics(text, directions, None, 0.25 if length is None else length, location)
    for test, table in zip(campaign.tests, tables, strict=True):
        mine, theirs = Program(test), case.program(table)
        time = np.linspace(0.0, mine.duration, 400)
        assert mine.duration == pytest.approx(theirs.duration, rel=1e-9)
        q = mine.commands(time)
        np.testing.assert_allclose(q, theirs.commands(time), rtol=0, atol=1e-8)
        bar = machine.bar(dict(zip(case.machine.axes, q.T, strict=True)), {}, theirs.ball)
        got = reading(chain, q, np.array(test.table_ball), test.length, Geometry(location))
        np.testing.assert_allclose(got, np.linalg.norm(bar, axis=1) - test.length, rtol=0, atol=1e-12)


def test_a_hidden_play_of_a_head_is_named(tmp_path):
    """B head over C table, from the files to the diagnosis."""
    case = chain_campaigns.ChainCase("head", "head_table", 5, ({"id": "backlash.B", "width_deg": 0.002},))
    cones = tuple(t for t in case.usual() if t["kind"] == "cone_frustum" and t["setup"] == "x50")
    chain_campaigns.write(replace(case, plan=cones), tmp_path)
    campaign = read_campaign(tmp_path)
    result = diagnose(campaign, read_machine(campaign.machine_file)).to_json()
    (found,) = result["effects"]
    low, high = found["ci95"]["width_deg"]
    assert (result["verdict"], found["id"]) == ("identified", "backlash.B") and low < 0.002 < high < 1.05 * low
    assert result["rms_after_um"] < 1.1 * result["noise_um"]


def test_a_centreline_far_off_is_not_taken_for_offsets_of_the_balls(tmp_path):
    """Three set-ups whose spindle balls stand off alike, by 17 times their uncertainty, are a centreline that does."""
    hidden = ({"id": "axis_location.EX0B", "value_um": -34.0},)
    chain_campaigns.write(chain_campaigns.ChainCase("trunnion", "bc_trunnion", 12, hidden, kinds=("rotary",)), tmp_path)
    campaign = read_campaign(tmp_path)
    result = diagnose(campaign, read_machine(campaign.machine_file)).to_json()
    (found,) = result["effects"]
    low, high = found["ci95"]["value_um"]
    assert (result["verdict"], found["id"]) == ("identified", "axis_location.EX0B") and low < -34.0 < high
