"""A campaign in the making, without a page: what is dropped, what is refused, and what is written."""

import io
import shutil
import zipfile

import numpy as np
import pytest
import tomlkit
from commands import cut, run, snapshot
from independent import r_test
from test_import_b5r_runs import document, one

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.errors import InputError
from mjsim.importing.reading import Options
from mjsim.io.resources import examples
from mjsim.workbench.start import recent as opened
from mjsim.workbench.start.draft import Draft, guessed_keys

TRACES = examples() / "healthy" / "traces"
CIRCLE = {
    "kind": "circular",
    "plane": "XY",
    "direction": "CCW",
    "table_ball_mm": [0.0, 0.0, 155.0],
    "bar_length_mm": 100.0,
    "feed_mm_min": 1000.0,
}


@pytest.fixture
def draft():
    draft = Draft()
    draft.choose_template("trunnion-a-medium", 45.0)
    yield draft
    draft.close()


def trace(name):
    return f"{name}.csv.gz", (TRACES / f"{name}.csv.gz").read_bytes()


def test_a_template_a_number_and_a_trace_make_a_campaign(draft, tmp_path):
    """The written files are those that the commands read: machine, tests, traces, limits."""
    draft.set_drives({("A", "worm_teeth"): 60.0, ("X", "lead_mm"): 12.0})
    assert draft.drop(*trace("circle-xy-ccw")) == "circle-xy-ccw.csv.gz: which test is it?"
    dropped = draft.files["circle-xy-ccw.csv.gz"]
    assert dropped.keys == {"kind": "circular", "plane": "XY", "direction": "CCW"} and "deviation_um" in dropped.columns
    draft.bring_in("circle-xy-ccw.csv.gz", "circle-xy-ccw", CIRCLE | {"setup": "centre"})
    draft.set_limits(0.7, [("circle-xy-ccw", "circular_error", 20.0, "ISO 10791-6, 5")])
    draft.choose_instrument("ball_bar", {"range_mm": 2.0})
    assert "µm" in dropped.columns and draft.mistakes() == []
    folder = draft.write(f"  {tmp_path / 'mine'} ")
    campaign, machine = read_campaign(folder), read_machine(folder / "machine.toml")
    assert campaign.name == "mine" and [t.name for t in campaign.measured] == ["circle-xy-ccw"]
    assert campaign.instrument.range == pytest.approx(2e-3) and campaign.acceptance.limits[0].limit == pytest.approx(
        2e-5
    )
    assert machine.drives["A"].gear == 60.0 and machine.factor == 2.0
    assert "# assumed" in (folder / "machine.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("template", ["trunnion-a-medium", "nutating-table-small"])
def test_the_sense_of_an_axis_is_chosen(draft, template):
    """The file says it in the words of one that was written so, and is the same again after the way back."""
    draft.choose_template(template)
    file = draft.folder / "machine.toml"
    before = file.read_text()
    for axis in draft.machine.chain.rotary:
        draft.set_sense(axis, "opposite")
        assert draft.machine.chain.sense(axis) == "opposite"
        assert f"{axis}+ turns the workpiece counter-clockwise, seen against" in file.read_text()
        draft.set_sense(axis, "iso")
    assert file.read_text() == before
    file.write_text(before.replace("CHANGE", "mine"))  # a file that was edited
    draft.set_sense("C", "opposite")
    assert draft.machine.chain.senses == draft.machine.chain.senses.replace("C iso", "C opposite")


def test_the_tests_of_a_campaign_file_wait_for_their_traces(draft, tmp_path):
    source = cut(tmp_path / "given")
    names = [str(t["name"]) for t in tomlkit.parse((source / "campaign.toml").read_text())["test"]]
    assert draft.drop("campaign.toml", (source / "campaign.toml").read_bytes()).endswith("3 tests. Drop their traces.")
    for name in names:
        data = (source / "traces" / f"{name}.csv.gz").read_bytes()
        assert draft.drop(f"{name}.csv.gz", data) == f"{name}.csv.gz: the trace of {name}."
    assert {t.name for t in read_campaign(draft.folder).measured} == set(names)
    draft.remove_test(names[0])
    assert [t["name"] for t in draft.tests] == names[1:]
    for name in names[1:]:
        draft.remove_test(name)
    assert draft.tests == []


def test_programs_of_all_tests(draft):
    with pytest.raises(InputError, match="There is no test yet"):
        draft.programs("fanuc")
    draft.add_tests([{"name": "circle-xy-ccw", **CIRCLE}])
    archive = zipfile.ZipFile(io.BytesIO(draft.programs("siemens")))
    assert archive.namelist() == ["circle-xy-ccw.mpf"]
    program = archive.read("circle-xy-ccw.mpf").decode()
    assert "circle-xy-ccw.mpf: the program that ran in circle-xy-ccw." == draft.drop(
        "circle-xy-ccw.mpf", program.encode()
    )
    assert draft.tests[0]["program"] == "programs/circle-xy-ccw.mpf" and draft.campaign.tests[0].commanded is not None


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.png", b"\x89PNG\r\n\x1a\n\0\1", "a.png"),
        ("a.toml", b"name = 1\n", "neither drives nor tests"),
        ("a.toml", b"name = \n", "a.toml"),
        ("machine.toml", b"[drive.X]\nlead_mm = 10\n", "machine.toml"),
        ("other.nc", b"G1 X1 F100\n", "no test is called 'other'"),
        ("..", b"", "no name of a file"),
        ("a.b5r", b"<nothing/>", "a.b5r"),
    ],
)
def test_a_wrong_file_changes_nothing(draft, name, data, said):
    before = snapshot(draft.folder)
    with pytest.raises(InputError, match=said) as refused:
        draft.drop(name, data)
    assert snapshot(draft.folder) == before and str(draft.folder) not in str(refused.value)


def test_an_r_test_from_plan_to_recording(draft, tmp_path):
    """The tests of a plan, their programs, and recordings that are named as they."""
    place = {"kind": "r_test", "sphere_mm": [110.0, 20.0, 90.0], "setup": "sphere", "feed_mm_min": 4000.0}
    planned = {"name": "c-ccw", **place, "axis": "C", "from_deg": 0.0, "to_deg": 200.0}
    r_test.write(tmp_path, 5, tests=[{**planned, "trace": "traces/c-ccw.csv", "started_s": 0.0}])
    draft.drop("machine.toml", (tmp_path / "machine.toml").read_bytes())
    draft.choose_instrument("r_test")
    with pytest.raises(InputError, match="of which there is none yet: take over a plan first"):
        draft.drop("c-ccw.csv", (tmp_path / "traces" / "c-ccw.csv").read_bytes())
    draft.add_tests([planned])
    with zipfile.ZipFile(io.BytesIO(draft.programs("fanuc"))) as archive:
        assert archive.namelist() == ["c-ccw.nc"] and b"R-TEST C-CCW" in archive.read("c-ccw.nc")
    said = draft.drop("c-ccw.csv", (tmp_path / "traces" / "c-ccw.csv").read_bytes())
    assert said == "c-ccw.csv: the recording of c-ccw." and draft.files["c-ccw.csv"].test == "c-ccw"
    assert draft.mistakes(1) == []
    mine, theirs = (read_campaign(f).traces["c-ccw.dz"] for f in (draft.write(str(tmp_path / "new")), tmp_path))
    assert np.allclose(mine.deviation, theirs.deviation)


def test_what_is_missing_is_said(tmp_path):
    draft = Draft()
    with pytest.raises(InputError, match="No machine is chosen yet"):
        draft.drop(*trace("circle-xy-ccw"))
    draft.choose_template("three-axes-small")
    with pytest.raises(InputError, match="no test yet"):
        draft.write(str(tmp_path / "mine"))
    draft.add_tests([{"name": "circle-xy-ccw", **CIRCLE}])
    with pytest.raises(InputError, match="has no name"):
        draft.write("  ")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty"):
        draft.write(str(tmp_path / "full"))
    with pytest.raises(InputError, match="has tests for a ball bar already"):
        draft.choose_instrument("axis_log")
    with pytest.raises(InputError, match="feed_mm_min"):
        draft.add_tests([{"name": "b", **CIRCLE, "feed_mm_min": -1.0}])
    draft.drop(*trace("circle-xy-ccw"))
    with pytest.raises(InputError, match="allowed: a new or an empty folder"):
        draft.write(str(tmp_path / "full"))
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["full", "mine.txt"]
    draft.close()
    assert not draft.folder.exists()


def test_a_machine_that_the_tests_do_not_fit_is_refused(draft):
    draft.add_tests([{"name": "turn", **{k: v for k, v in CIRCLE.items() if k not in ("plane", "direction")},
                      "kind": "rotary", "axis": "A", "from_deg": 0.0, "to_deg": 90.0,
                      "sensitive_direction": "tangential"}])  # fmt: skip
    with pytest.raises(InputError, match="axis"):
        draft.choose_template("three-axes-small")
    assert draft.machine.chain.letters == ("X", "Y", "Z", "A", "C")


def test_traces_of_a_campaign_that_is_there(tmp_path):
    """Comments of its files stay; a trace that it has is not replaced, and no file of settings is taken."""
    folder = cut(tmp_path / "mine", traces=False)
    file = folder / "campaign.toml"
    file.write_text("# of my own hand\n" + file.read_text())
    draft = Draft(folder)
    draft.drop(
        "circle-xy-ccw.csv.gz", (examples() / "hidden-backlash" / "traces" / "circle-xy-ccw.csv.gz").read_bytes()
    )
    assert [t.name for t in read_campaign(folder).measured] == ["circle-xy-ccw"]
    assert file.read_text().startswith("# of my own hand\n")
    before = snapshot(folder)
    with pytest.raises(InputError):
        draft.drop(*trace("circle-xy-ccw"))
    with pytest.raises(InputError, match="there already"):
        draft.drop("machine.toml", (examples() / "healthy" / "machine.toml").read_bytes())
    assert snapshot(folder) == before
    draft.close()
    assert folder.is_dir()


def test_runs_of_another_system_become_tests(draft):
    """Plane, length and feed come from its header; where the ball sat is asked for. Later it goes to the tests."""
    phi = np.linspace(0.0, 4.0 * np.pi, 720, endpoint=False)
    runs = [one(way, 5.0 + np.cos(2.0 * sign * phi), "0.002") for way, sign in (("CCW", 1.0), ("CW", -1.0))]
    file = document(*runs, feed="1000").encode()
    assert draft.drop("xy.b5r", file).endswith("how were its runs made?")
    keys = draft.files["xy.b5r"].keys
    assert keys["plane"] == "XY" and keys["bar_length_mm"] == 100.0 and keys["feed_mm_min"] == 1000.0
    draft.bring_in("xy.b5r", "xy", CIRCLE)
    assert [(t["name"], t["direction"]) for t in draft.tests] == [("xy-ccw", "CCW"), ("xy-cw", "CW")]
    assert {f.test for f in draft.files.values()} == {"xy-ccw", "xy-cw"}
    assert "runs of xy-ccw, xy-cw" in draft.drop("again.b5r", file)


def test_a_log_whose_header_says_nothing(draft):
    """It is kept and asked about; with its columns named it is a recording."""
    draft.choose_instrument("axis_log")
    time = np.arange(4000) / 1000.0
    rows = np.column_stack([time, 10.0 * np.sin(3.0 * time), 10.0 * np.sin(3.0 * time - 0.02)])
    text = "a,b,c\n" + "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows)
    with pytest.raises(InputError, match="no column of the time"):
        draft.drop("run.csv", text.encode())
    assert not draft.tests and draft.files["run.csv"].problem
    options = Options(time="1", time_unit="s")
    draft.bring_in_log("run.csv", ("X_command=2:mm", "X_actual=3:mm"), options)
    dropped = draft.files["run.csv"]
    assert dropped.test == "run" and not dropped.problem and "X command in mm" in dropped.columns
    assert [t.name for t in read_campaign(draft.folder).measured] == ["run"] and draft.tests[0]["axes"] == ["X"]


def test_a_log_among_traces_is_pointed_out(draft):
    rows = "".join(f"{i / 100},{i},{i - 0.1}\n" for i in range(9))
    said = draft.drop("x.csv", f"time_s,X_command_mm,X_actual_mm\n{rows}".encode())
    assert said == "x.csv: which test is it? If the control recorded it, choose the control in step 2."


def test_a_file_name_and_a_header_suggest_keys(tmp_path):
    (tmp_path / "Cone_CW.txt").write_text("")
    assert guessed_keys(tmp_path / "Cone_CW.txt", ()) == {"kind": "cone_frustum", "direction": "CW"}
    read = guessed_keys(tmp_path / "run 7.csv", ("Vorschub [mm/min]: 1500,0", "Ebene: YZ"))
    assert read == {"feed_mm_min": 1500.0, "plane": "YZ"}


def test_campaigns_opened_last_are_remembered(tmp_path, monkeypatch):
    monkeypatch.setenv("MJSIM_CACHE", str(tmp_path / "cache"))
    folders = [cut(tmp_path / name, traces=False) for name in ("a", "b")]
    for folder in (*folders, folders[0]):
        opened.remember(folder)
    assert opened.recent() == [folders[0], folders[1]]
    shutil.rmtree(folders[1])
    assert opened.recent() == [folders[0]]
    (tmp_path / "cache" / "recent.json").write_text("{")
    assert opened.recent() == []
    monkeypatch.setenv("MJSIM_CACHE", "off")
    opened.remember(folders[0])
    assert opened.recent() == []


@pytest.mark.parametrize("option", [["--as-is"], ["--machine", "machine.toml"]])
def test_options_of_a_campaign_need_one(option):
    result = run("open", "--no-browser", *option)
    assert result.exit_code == 2 and "need a CAMPAIGN" in result.stderr
