"""``mjsim nc``, ``nc read``, ``nc feed`` and the key ``program`` of campaign.toml, as a user runs them."""

import re
import zipfile
from functools import partial

import commands
import numpy as np
import pytest
from click.testing import CliRunner

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.cli.main import main
from mjsim.instruments.ball_bar.program import Program

CAMPAIGN = """\
name = "short"
[[test]]
name = "cone"
kind = "cone_frustum"
half_apex_deg = 15.0
inclination_deg = 10.0
sensitive_direction = "perpendicular"
direction = "CCW"
revolutions = 1
table_ball_mm = [20.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 4000.0
[[test]]
name = "turn"
kind = "rotary"
axis = "A"
from_deg = 0.0
to_deg = 30.0
sensitive_direction = "tangential"
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 3000.0
"""


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "short"
    folder.mkdir()
    (folder / "campaign.toml").write_text(CAMPAIGN)
    machine = mjsim.read_machine(mjsim.read_campaign(_example(), traces=False).machine_file)
    (folder / "machine.toml").write_text(machine.path.read_text())
    return folder


def _example():
    from mjsim.io.resources import examples

    return examples() / "healthy"


run, ok, as_json = (partial(f, "nc") for f in (commands.run, commands.ok, commands.as_json))


def refused(folder, args, *words, status=1):
    return commands.refused(folder, ["nc", *args], *words, status=status)


def test_help():
    for args in ((), ("read",), ("feed",), ("write",)):
        text = ok(*args, "--help").stdout
        assert max(map(len, text.splitlines())) <= 80
        assert "--json" in text and "--quiet" in text and "--force" in text
        assert args == ("write",) or "Example: mjsim nc" in text
    text = ok("campaign", "--help").stdout
    assert text == ok("--help").stdout
    assert all(
        f"mjsim nc{w}" in text
        for w in (" CAMPAIGN --test NAME -o FILE.nc", " read FILE.nc", " feed CAMPAIGN --test NAME")
    )
    assert "nc " in CliRunner().invoke(main, ["--help"]).stdout


@pytest.mark.parametrize(
    "args",
    [(), ("read",), ("feed",), ("a", "--test", "b"), ("read", "a", "--test", "b"), ("a", "--dialect", "x")],
    ids=str,
)
def test_wrong_usage(tmp_path, args):
    assert run(*args).exit_code == 2


def test_write_and_read(campaign, tmp_path):
    file = tmp_path / "cone.nc"
    data = as_json(campaign, "--test", "cone", "-o", file)
    assert set(data) == {"file", "test", "dialect", "feed", "blocks", "duration_s", "axes", "warnings"}
    assert (data["blocks"], data["feed"], data["dialect"]) == (3800, "a11", "fanuc")
    text = file.read_text()
    assert "MACHINE M1" in text and "(TABLE BALL X20 Y0 Z155 MM, BAR 100 MM, FEED 4000 MM/MIN)" in text
    again = ok("write", campaign, "--test", "cone", "-o", tmp_path / "b.nc", "--quiet")
    assert (again.stdout, again.stderr) == ("", "") and (tmp_path / "b.nc").read_text() == text

    read = as_json("read", file, "--campaign", campaign, "--test", "cone", "-o", tmp_path / "cone.csv")
    assert (
        read["blocks"] == 3800
        and read["feed"] == "G94"
        and read["tool_centre_point"] is False
        and read["unnamed_axes"] == []
    )
    assert read["duration_s"] == pytest.approx(data["duration_s"], rel=1e-6)
    for a, row in data["axes"].items():
        assert read["axes"][a] == pytest.approx(row, rel=1e-5, abs=1e-9)
    assert data["axes"]["A"]["min"] == pytest.approx(5.0, abs=2e-4) and data["axes"]["A"]["max"] == pytest.approx(
        25.0, abs=2e-4
    )
    off = read["deviation"]
    assert off["test"] == "cone" and 0.0 < max(off["position_um"].values()) < 1.0 and off["time_ms"] < 0.1
    table = np.genfromtxt(tmp_path / "cone.csv", delimiter=",", names=True)
    assert len(table) == 3801 and table["time_s"][-1] == pytest.approx(read["duration_s"], abs=1e-6)
    said = ok("read", file, "--campaign", campaign, "--test", "cone").stdout
    assert (
        max(map(len, said.splitlines())) <= 80 and "3800 blocks" in said and "against the program of test cone" in said
    )


HOW = {
    "tool tip": "--dialect siemens --feed-mode tcp",
    "LinuxCNC": "--dialect linuxcnc",
    "signs and rollover": "--feed-mode inverse --step-deg 0.5 --reversed A --reversed C --rollover",
}


@pytest.mark.parametrize("case", HOW)
def test_write_and_read_otherwise(campaign, tmp_path, case):
    how = HOW[case].split()
    as_json(campaign, "--test", "cone", "-o", tmp_path / "t.nc", *how)
    kept = [w for i, w in enumerate(how) if not {"--feed-mode", "--step-deg"} & {w, how[i - 1]}]
    off = as_json("read", tmp_path / "t.nc", "--campaign", campaign, "--test", "cone", *kept)["deviation"]
    assert off["feed_mm_min"] == pytest.approx(4000.0, rel=1e-4) and max(off["position_um"].values()) < 8.0


def test_limits(campaign, tmp_path):
    file = tmp_path / "t.nc"
    refused(
        tmp_path,
        [campaign, "--test", "cone", "-o", file, "--limit", "A", "0", "20"],
        "A = 20.0",
        "block N",
        "allowed: 0 to 20°",
    )
    refused(tmp_path, [campaign, "--test", "cone", "-o", file, "--limit", "A", "20", "0"], "limit of A")
    data = as_json(campaign, "--test", "cone", "-o", file, "--limit", "A", "-30", "110", "--max-speed", "C", "5000")
    assert len(data["warnings"]) == 1 and "C is faster than its 5000°/min" in data["warnings"][0]
    assert "warning: C is faster" in ok("read", file, "--max-speed", "C", "5000").stderr
    refused(tmp_path, ["read", file, "--limit", "A", "0", "20"], "t.nc, line ", "A = 20.0", "--limit A LOW HIGH")
    (tmp_path / "far.nc").write_text(re.sub(r"(N100 X\S+ Y\S+ Z)\S+", r"\g<1>955.0", file.read_text()))
    refused(tmp_path, ["read", tmp_path / "far.nc"], "far.nc, line ", "Z = 955", "allowed: -300 to 700 mm")


def test_refusals(campaign, tmp_path):
    file = tmp_path / "t.nc"
    refused(tmp_path, [campaign, "--test", "cube", "-o", file], "cube", "cone, turn")
    refused(tmp_path, [tmp_path / "none", "--test", "cone", "-o", file], "no such campaign")
    refused(tmp_path, [campaign, "--test", "turn", "-o", file, "--feed-mode", "tcp"], "spindle ball rests")
    refused(
        tmp_path,
        [campaign, "--test", "cone", "-o", file, "--dialect", "linuxcnc", "--feed-mode", "a11"],
        "allowed: inverse",
    )
    refused(tmp_path, [campaign, "--test", "cone", "-o", campaign / "campaign.toml" / "t.nc"], "campaign.toml")
    refused(tmp_path, ["read", file], "no such file")
    refused(tmp_path, ["read", campaign / "campaign.toml"], "campaign.toml, line 1", 'name = "short"')
    ok(campaign, "--test", "turn", "-o", file)
    refused(tmp_path, [campaign, "--test", "turn", "-o", file, "--json"], "exists already", "--force")
    ok(campaign, "--test", "turn", "-o", file, "--force")
    refused(tmp_path, ["read", file, "--campaign", campaign, "--test", "cone"], 'no program of test "cone"', "mm apart")
    refused(tmp_path, ["read", file, "-o", file], "exists already")
    refused(tmp_path, ["feed", campaign, "--test", "turn", "--plot", tmp_path / "a.pdf"], "a.pdf", ".png or .svg")
    refused(
        tmp_path, ["feed", campaign, "--test", "turn", "--plot", tmp_path / "a.pdf", "-o", tmp_path / "a.csv"], "a.pdf"
    )
    refused(tmp_path, ["feed", campaign, "--test", "turn", "--cycle-ms", "0.001"], "interpolation cycle", "0.1 to 1000")
    refused(tmp_path, ["feed", campaign, "--test", "turn", "--whole-cycles"], "cycle above 0")
    refused(tmp_path, ["feed", campaign, "--test", "cone", "--program", file], 'no program of test "cone"')


def test_feed(campaign, tmp_path):
    data = as_json("feed", campaign, "--test", "turn", "--dialect", "siemens")
    assert data["mean_mm_min"] == pytest.approx(3000.0, rel=1e-6) and data["duration_s"] == pytest.approx(
        data["ideal_duration_s"], rel=1e-6
    )
    assert data["reading_um"]["min"] == pytest.approx(-0.038, abs=0.02)
    slow = as_json(
        "feed",
        campaign,
        "--test",
        "turn",
        "--cycle-ms",
        "4",
        "--whole-cycles",
        "-o",
        tmp_path / "f.csv",
        "--plot",
        tmp_path / "f.png",
    )
    block = 155.0 * np.radians(0.1) / 3000.0 * 60e3
    assert slow["mean_mm_min"] == pytest.approx(3000.0 * block / 8.0, rel=1e-5) and 4.0 < block < 8.0
    table = np.genfromtxt(tmp_path / "f.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", "phi_deg", "feed_mm_min", "reading_um")
    assert table["feed_mm_min"] == pytest.approx(slow["mean_mm_min"], rel=1e-4)
    assert table["phi_deg"][0] == pytest.approx(2.0, abs=0.1) and table["phi_deg"][-1] == pytest.approx(28.0, abs=0.1)
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    refused(tmp_path, ["feed", campaign, "--test", "turn", "-o", tmp_path / "f.csv"], "exists already")
    ok(campaign, "--test", "turn", "-o", tmp_path / "t.nc", "--step-deg", "1")
    other = as_json("feed", campaign, "--test", "turn", "--program", tmp_path / "t.nc")
    assert other["blocks"] == 30 and other["reading_um"]["min"] == pytest.approx(
        -1e5 * (1 - np.cos(np.radians(0.5))), abs=0.1
    )
    text = ok("feed", campaign, "--test", "turn").stdout
    assert max(map(len, text.splitlines())) <= 80 and re.search(r"mean 3000\.00", text)


# -- the key "program" -------------------------------------------------------------------------------------------------


def with_program(campaign, name, lines):
    text = (campaign / "campaign.toml").read_text()
    (campaign / "campaign.toml").write_text(text.replace(f'name = "{name}"\n', f'name = "{name}"\n{lines}\n'))


def test_a_campaign_that_is_driven_by_nc_files(campaign, tmp_path):
    own = read_campaign(campaign).tests[0]
    ok(
        campaign,
        "--test",
        "cone",
        "-o",
        campaign / "cone.mpf",
        "--dialect",
        "siemens",
        "--reversed",
        "C",
        "--rollover",
        "--step-deg",
        "2",
    )
    with_program(
        campaign,
        "cone",
        'program = "cone.mpf"\nprogram_dialect = "siemens"\nprogram_reversed = ["C"]\nprogram_rollover = true',
    )
    cone, turn = read_campaign(campaign).tests
    assert len(cone.commanded.seconds) == 190 and turn.commanded is None
    assert cone.feed == pytest.approx(own.feed, rel=1e-6)
    time = np.linspace(0.0, Program(own).duration, 301)
    away = np.abs(Program(cone).commands(time) - Program(own).commands(time)).max(axis=0)
    assert (away[3:] < 1e-3).all() and 10e-6 < away[:3].max() < 100e-6, "2° blocks show their chords"
    result = CliRunner().invoke(
        main, ["simulate", str(campaign), "--out", str(tmp_path / "out"), "--test", "cone", "--no-plots", "--json"]
    )
    assert result.exit_code == 0, result.output
    table = np.genfromtxt(tmp_path / "out" / "cone.csv", delimiter=",", names=True)
    command = Program(cone).commands(table["time_s"])
    np.testing.assert_allclose(table["C_command_deg"], np.degrees(command[:, 4]), atol=1e-6)
    assert as_json("feed", campaign, "--test", "cone")["blocks"] == 3800, (
        "the test's own program, unless --program names one"
    )


def test_rollover_of_a_campaigns_program(campaign):
    ok(campaign, "--test", "cone", "-o", campaign / "cone.nc", "--rollover", "--step-deg", "5")
    with_program(campaign, "cone", 'program = "cone.nc"\nprogram_rollover = true')
    c = read_campaign(campaign).tests[0].commanded.axes[:, 4]
    assert np.abs(np.diff(c)).max() < 1.0 and abs(c[-1] - c[0]) > 2 * np.pi


KEYS = {
    "no file": ('program = "none.nc"', "none.nc", "no such file"),
    "outside": ('program = "../t.nc"', "campaign.toml", "inside"),
    "empty": ('program = ""', "campaign.toml", "program"),
    "no program": ('program_rollover = true', "campaign.toml", "'program_rollover'", "needs program"),
    "unknown dialect": ('program = "t.nc"\nprogram_dialect = "haas"', "program_dialect = 'haas'", "'fanuc'"),
    "another axis": ('program = "t.nc"\nprogram_reversed = ["X"]', "program_reversed", "'A' or 'C'"),
    "another sign": ('program = "t.nc"\nprogram_reversed = ["A"]', "t.nc", "A counted the other way"),
    "no G-code": ('program = "machine.toml"', "machine.toml, line 1"),
}  # fmt: skip


@pytest.mark.parametrize("case", KEYS)
def test_wrong_programs(campaign, case):
    lines, *found = KEYS[case]
    ok(campaign, "--test", "cone", "-o", campaign / "t.nc", "--step-deg", "5")
    with_program(campaign, "cone", lines)
    result = CliRunner().invoke(main, ["simulate", str(campaign), "--out", str(campaign / "out"), "--json"])
    assert (result.exit_code, result.stdout) == (1, "") and result.stderr.count("\n") == 1
    assert all(word in result.stderr for word in found), result.stderr
    assert not (campaign / "out").exists()


def test_from_python(campaign, tmp_path):
    test = mjsim.read_campaign(campaign).tests[1]
    mjsim.write_nc(test, tmp_path / "t.nc", mjsim.NCOptions("siemens", step_deg=0.5))
    nc = mjsim.read_nc(tmp_path / "t.nc", "siemens")
    driven = mjsim.driven_by(test, nc.motion)
    assert mjsim.feed_report(test, nc.motion, mjsim.Control(cycle=1e-3)).mean == pytest.approx(test.feed, rel=1e-4)
    (s,) = mjsim.simulate(mjsim.read_machine(campaign / "machine.toml"), [driven])
    assert np.degrees(s.command[-1, 3]) == pytest.approx(30.0)


def test_programs_of_all_tests(campaign, tmp_path):
    """As one by one, but for the number of the program."""
    said = as_json(campaign, "-o", tmp_path / "all.zip", "--dialect", "siemens")
    assert said["tests"] == ["cone", "turn"]
    with zipfile.ZipFile(tmp_path / "all.zip") as archive:
        assert archive.namelist() == ["cone.mpf", "turn.mpf"]
        ok(campaign, "--test", "turn", "-o", tmp_path / "turn.mpf", "--dialect", "siemens")
        assert archive.read("turn.mpf").decode() == (tmp_path / "turn.mpf").read_text(encoding="utf-8")
    assert "all programs are written as .zip" in run(campaign, "-o", tmp_path / "all.nc").stderr
    refused = run(campaign, "-o", tmp_path / "all.zip")
    assert refused.exit_code == 1 and "all.zip" in refused.stderr and "--force" in refused.stderr
