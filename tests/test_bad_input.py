"""Wrong input: one sentence that names the place, what was found and what is allowed; status 1; nothing written;
nothing on stdout.
"""

import gzip
import json
import os
import shutil
from importlib import import_module

import pytest
from commands import CAMPAIGN, POSIX, refused, run


@pytest.fixture
def campaign(good, tmp_path):
    """A copy that a test may spoil."""
    return shutil.copytree(good, tmp_path / "short")


def test_the_unspoiled_campaign_is_accepted(campaign):
    result = run("compare", campaign, "--json", "--no-plots")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["campaign"] == "short"


# -- campaign.toml -----------------------------------------------------------------------------------------------------

FILE = "campaign.toml"
REPLACED = {
    "wrong key": (
        "feed_mm_min = 2000.0\n[[",
        "feed_mm_mn = 2000.0\n[[",
        FILE,
        '[[test]] "turn"',
        "feed_mm_mn",
        "did you mean 'feed_mm_min'",
    ),
    "missing key": (
        "bar_length_mm = 100.0\nfeed_mm_min = 2000.0\n[[",
        "feed_mm_min = 2000.0\n[[",
        FILE,
        "bar_length_mm",
        "missing",
    ),
    "missing key of the kind": (
        "inclination_deg = 10.0\n",
        "",
        FILE,
        '"cone"',
        "inclination_deg",
        "cone_frustum needs",
    ),
    "angle in radians by name": (
        "half_apex_deg = 15.0",
        "half_apex_rad = 0.26",
        FILE,
        "half_apex_rad",
        "half_apex_deg",
    ),
    "angle too large": ("half_apex_deg = 15.0", "half_apex_deg = 900.0", FILE, "half_apex_deg = 900.0", "less than 90"),
    "text for a number": (
        "feed_mm_min = 2000.0\n[[",
        'feed_mm_min = "fast"\n[[',
        FILE,
        "feed_mm_min = 'fast'",
        "valid number",
    ),
    "decimal comma": ("to_deg = 30.0", "to_deg = 30,0", FILE, "line 10"),
    "number not finite": ("to_deg = 30.0", "to_deg = nan", FILE, "to_deg = nan", "finite"),
    "negative feed": ("feed_mm_min = 2000.0\n[[", "feed_mm_min = -1\n[[", FILE, "feed_mm_min = -1", "greater than 0"),
    "two coordinates": (
        "[0.0, 0.0, 155.0]\nbar_length_mm = 100.0\nfeed_mm_min = 2000.0\n[[",
        "[0.0, 155.0]\nbar_length_mm = 100.0\nfeed_mm_min = 2000.0\n[[",
        FILE,
        "table_ball_mm",
        "3 items",
    ),
    "unknown kind": ('kind = "rotary"', 'kind = "spiral"', FILE, "kind = 'spiral'", "'rotary'"),
    "unknown axis": ('axis = "A"', 'axis = "B"', FILE, "axis = 'B'", "'A' or 'C'"),
    "ball on the axis": (
        "[0.0, 0.0, 155.0]\nbar_length_mm = 100.0\nfeed_mm_min = 2000.0\n[[",
        "[9.0, 0.0, 0.0]\nbar_length_mm = 100.0\nfeed_mm_min = 2000.0\n[[",
        FILE,
        "A axis",
        "1 mm",
    ),
    "duplicate test names": ('name = "cone"', 'name = "turn"', FILE, '"turn" appears 2 times'),
    "name that is a path": ('name = "cone"', 'name = "../cone"', FILE, "../cone"),
    "a million revolutions": (
        'direction = "CCW"',
        'direction = "CCW"\nrevolutions = 1000000',
        FILE,
        "revolutions = 1000000",
        "100",
    ),
    "no tests": (CAMPAIGN[CAMPAIGN.index("[[test]]") :], "", FILE, "'test' is missing"),
    "absolute trace": ("traces/turn.csv", "/etc/passwd", FILE, "/etc/passwd", "inside"),
    "trace that is not there": ("traces/turn.csv", "traces/other.csv", "other.csv", "missing"),
    "trace that is a folder": ("traces/turn.csv", "traces", "traces"),
    "machine that is not there": (
        'name = "short"',
        'name = "short"\nmachine = "other.toml"',
        "other.toml",
        "no such file",
    ),
    "machine with a control character": (
        'name = "short"',
        'name = "short"\nmachine = "a\\u0000b"',
        FILE,
        "machine = 'a\\x00b'",
        "is no file name",
    ),
    "wrong feed for the trace": (
        "feed_mm_min = 2000.0\n[[",
        "feed_mm_min = 1000.0\n[[",
        "turn.csv",
        "feed_mm_min = 2000",
    ),
    "wrong instrument": ("sample_rate_Hz = 100.0", 'kind = "laser"', FILE, "kind = 'laser'", "ball_bar"),
}


@pytest.mark.parametrize("case", REPLACED)
def test_campaign_file(campaign, case):
    old, new, *words = REPLACED[case]
    text = (campaign / FILE).read_text()
    assert old in text
    (campaign / FILE).write_text(text.replace(old, new, 1))
    refused(campaign.parent, ["compare", campaign, "--json"], *words)


RAW = {
    "empty": (b"", FILE, "'name' is missing"),
    "UTF-16": (CAMPAIGN.encode("utf-16"), FILE, "UTF-8"),
    "binary": (bytes(range(256)) * 20, FILE, "UTF-8"),
    "JSON": (b'{"name": "short"}', FILE, "not valid TOML", "line 1"),
}


@pytest.mark.parametrize("case", RAW)
def test_campaign_file_of_other_content(campaign, case):
    data, *words = RAW[case]
    (campaign / FILE).write_bytes(data)
    refused(campaign.parent, ["compare", campaign, "--json"], *words)


# -- traces ------------------------------------------------------------------------------------------------------------

TRACES = {
    "empty": (lambda t: b"", "turn.csv", "line 1", "time_s,deviation_um"),
    "header only": (lambda t: b"time_s,deviation_um\n", "turn.csv", "0 samples", "50"),
    "another header": (
        lambda t: t.replace(b"deviation_um", b"deviation_mm"),
        "turn.csv",
        "line 1",
        "deviation_mm",
        "deviation_um",
    ),
    "no header": (lambda t: t.partition(b"\n")[2], "turn.csv", "line 1", "time_s,deviation_um"),
    "text in a number column": (
        lambda t: line(t, 7, b"0.5,high"),
        "turn.csv, line 7",
        "deviation_um = 'high'",
        "number",
    ),
    "decimal commas": (
        lambda t: b"\n".join([t.split(b"\n")[0], *(r.replace(b".", b",") for r in t.split(b"\n")[1:])]),
        "turn.csv, line 2",
        "4 columns",
        "decimal point",
    ),
    "one more column": (lambda t: line(t, 9, b"0.5,1.0,2.0"), "turn.csv, line 9", "3 columns"),
    "time goes back": (lambda t: line(t, 60, b"0.001,0.0"), "turn.csv, line 60", "time_s = 0.001", "grow"),
    "time not finite": (lambda t: line(t, 60, b"nan,0.0"), "turn.csv, line 60", "time_s", "finite"),
    "no reading is a number": (lambda t: t.replace(b",0.0", b",nan"), "turn.csv", "0 of", "range"),
    "beyond the sensor's range": (lambda t: t.replace(b",0.0", b",5000.0"), "turn.csv", "0 of", "1 mm"),
    "half of it": (lambda t: t[: len(t) // 2].rpartition(b"\n")[0], "turn.csv", "it stops", '"turn"'),
    "times of the day": (
        lambda t: b"\n".join(
            [t.split(b"\n")[0], *(b"%.2f,0.0" % (36000 + 0.01 * i) for i in range(len(t.split(b"\n")) - 2))]
        ),
        "turn.csv",
        "start of the NC program",
    ),
    "milliseconds": (
        lambda t: b"\n".join([t.split(b"\n")[0], *(b"%d,0.0" % (10 * i) for i in range(len(t.split(b"\n")) - 2))]),
        "turn.csv",
        "time_s is in ms, multiply it by 0.001",
    ),
    "binary": (lambda t: b"\x93NUMPY" + bytes(range(256)) * 40, "turn.csv", "not text"),
}


def line(text, number, new):
    rows = text.split(b"\n")
    rows[number - 1] = new
    return b"\n".join(rows)


@pytest.mark.parametrize("case", TRACES)
def test_trace(campaign, case):
    spoil, *words = TRACES[case]
    trace = campaign / "traces" / "turn.csv"
    trace.write_bytes(spoil(trace.read_bytes()))
    refused(campaign.parent, ["compare", campaign, "--json"], *words)


GZIPS = {
    "truncated": lambda d: gzip.compress(d)[:-40],
    "not gzip": lambda d: d,
}


@pytest.mark.parametrize("case", GZIPS)
def test_compressed_trace(campaign, case):
    (campaign / FILE).write_text((campaign / FILE).read_text().replace("turn.csv", "turn.csv.gz"))
    (campaign / "traces" / "turn.csv.gz").write_bytes(GZIPS[case]((campaign / "traces" / "turn.csv").read_bytes()))
    refused(campaign.parent, ["compare", campaign, "--json"], "turn.csv.gz")


@POSIX
def test_trace_through_a_link_that_leaves_the_folder(campaign):
    outside = campaign.parent / "outside.csv"
    shutil.move(campaign / "traces" / "turn.csv", outside)
    (campaign / "traces" / "turn.csv").symlink_to(outside)
    refused(campaign.parent, ["compare", campaign, "--json"], FILE, "inside")


# -- machine.toml ------------------------------------------------------------------------------------------------------

M = "machine.toml"
EFFECT = '\n[[effect]]\nid = "{}"\n{}\n'
MACHINES = {
    "wrong key": (
        lambda t: t.replace("integral_time_s", "integral_time_ms", 1),
        M,
        "[drive.X]",
        "integral_time_ms",
        "integral_time_s",
    ),
    "missing axis": (lambda t: t.replace("[drive.C]", "[drive.B]"), M, "drive"),
    "lead of a rotary axis": (
        lambda t: t.replace("worm_teeth = 60", "lead_mm = 10.0"),
        M,
        "[drive.A]",
        "lead_mm",
        "worm_teeth",
    ),
    "no lead": (lambda t: t.replace("lead_mm = 10.0\n", "", 1), M, "[drive.X]", "lead_mm", "missing"),
    "another configuration": (lambda t: t.replace("w-C'A'Y'bXZ-t", "w-B'XYZ-t"), M, "configuration"),
    "unknown effect": (
        lambda t: t + EFFECT.format("backlsh.A", "width_deg = 0.1"),
        M,
        '[[effect]] "backlsh.A"',
        "known kinds",
        "backlash",
    ),
    "unknown subject": (
        lambda t: t + EFFECT.format("backlash.B", "width_deg = 0.1"),
        M,
        '[[effect]] "backlash.B"',
        "X, Y, Z, A, C",
    ),
    "parameter out of bounds": (
        lambda t: t + EFFECT.format("backlash.A", "width_deg = 400.0"),
        M,
        "backlash.A",
        "width_deg = 400",
        "0 to 1",
    ),
    "parameter of another unit": (
        lambda t: t + EFFECT.format("backlash.A", "width_um = 2.0"),
        M,
        "width_um",
        "width_deg",
    ),
    "missing parameter": (lambda t: t + EFFECT.format("backlash.A", ""), M, "backlash.A", "width_deg", "missing"),
    "parameter not a number": (
        lambda t: t + EFFECT.format("backlash.A", 'width_deg = "wide"'),
        M,
        "width_deg = 'wide'",
        "number",
    ),
    "effect twice": (
        lambda t: t + EFFECT.format("friction.X", "coulomb_Nm = 1.0\npresliding_rad = 0.003"),
        M,
        "friction.X",
        "twice",
    ),
    "id that is a number": (lambda t: t + "\n[[effect]]\nid = 3\n", M, "number 6", "'id'"),
    "component of two numbers": (
        lambda t: t + EFFECT.format("pitch_error.C", "components = [[72, 0.1]]"),
        M,
        "pitch_error.C",
        "[72, 0.1]",
        "three numbers",
    ),
    "wrong direction": (
        lambda t: t + EFFECT.format("pitch_error.C", 'components = [[72, 0.001, 0]]\ndirection = "left"'),
        M,
        "direction = 'left'",
        "CW",
    ),
    "effect file that is not there": (
        lambda t: t + EFFECT.format("mine.A", 'file = "mine.py"'),
        M,
        '[[effect]] "mine.A"',
        "mine.py",
    ),
    "nothing at all": (lambda t: "", M, "missing"),
    "effect that is a number": (lambda t: "effect = 3\n" + t[: t.index("[[effect]]")], M, "effect = 3"),
}


@pytest.mark.parametrize("case", MACHINES)
def test_machine_file(campaign, case):
    spoil, *words = MACHINES[case]
    (campaign / M).write_text(spoil((campaign / M).read_text()))
    refused(campaign.parent, ["compare", campaign, "--json"], *words)


@pytest.mark.parametrize(
    "command",
    [["simulate", "--out", "out"], ["compare"], ["diagnose"], ["add", "backlash.A"], ["remove", "friction.X"]],
)
def test_every_command_names_a_missing_machine(campaign, command):
    name, *rest = command
    rest = [str(campaign / "out") if r == "out" else r for r in rest]
    (campaign / M).unlink()
    refused(campaign.parent, [name, campaign, *rest, "--json"], M, "no such file")
    refused(campaign.parent, [name, campaign, *rest, "--json", "--machine", campaign / "traces"], "traces")


# -- commands ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command",
    [
        ["simulate", "--out", "unused"],
        ["compare"],
        ["diagnose"],
        ["add", "backlash.A"],
        ["remove", "friction.X"],
        ["history"],
    ],
)
def test_no_campaign(campaign, command):
    name, *rest = command
    for where in (campaign / "nowhere", campaign / "traces"):
        refused(campaign.parent, [name, where, *rest, "--json"], "no such campaign", "campaign.toml")


def test_a_folder_that_may_not_be_read(campaign, monkeypatch):
    """The system is made to refuse, because root may read everything."""
    look = os.stat

    def refuse(path, **more):
        if str(path) == str(campaign / FILE):
            raise PermissionError(13, "Permission denied")
        return look(path, **more)

    for command in (["compare", campaign], ["import", campaign / "traces" / "turn.csv", "--campaign", campaign]):
        with monkeypatch.context() as patched:
            patched.setattr(os, "stat", refuse)
            patched.setattr(os, "access", lambda path, mode, **more: str(path) != str(campaign))
            result = run(*command)
        assert result.exit_code == 1, result.output
        assert result.output.endswith(f"{FILE}: cannot be read: Permission denied\n")


def test_trace_for_a_campaign(campaign):
    refused(campaign.parent, ["compare", campaign / "traces" / "turn.csv", "--json"], "turn.csv", "not valid TOML")


def test_nothing_measured(campaign):
    text = (campaign / FILE).read_text()
    (campaign / FILE).write_text(text.replace('trace = "traces/turn.csv"\n', ""))
    for command in (["compare"], ["diagnose"], ["add", "backlash.A"], ["remove", "friction.X"]):
        refused(campaign.parent, [command[0], campaign, *command[1:], "--json"], FILE, "no test has a trace")


def test_simulate(campaign):
    out = campaign / "out"
    refused(campaign.parent, ["simulate", campaign, "--out", out, "--test", "cube", "--json"], "cube", "turn, cone")
    refused(campaign.parent, ["simulate", campaign, "--out", campaign / FILE / "out", "--json"], FILE)
    refused(
        campaign.parent,
        ["simulate", campaign, "--out", "/proc/mjsim", "--test", "turn", "--no-plots", "--json"],
        "cannot be written",
    )
    assert run("simulate", campaign, "--out", out, "--test", "turn").exit_code == 0
    refused(campaign.parent, ["simulate", campaign, "--out", out, "--json"], "turn.csv", "exists already", "--force")


def test_diagnose_says_so_before_it_works(campaign, monkeypatch):
    monkeypatch.setattr(
        import_module("mjsim.commands.diagnose"), "diagnose", lambda *a, **k: pytest.fail("worked first")
    )
    refused(campaign.parent, ["diagnose", campaign, "--write", campaign / M, "--json"], M, "exists already", "--force")
    refused(
        campaign.parent,
        ["diagnose", campaign, "--write", campaign / FILE / "fitted.toml", "--json"],
        "fitted.toml",
        "cannot be written",
    )


def test_unknown_effects(campaign):
    refused(campaign.parent, ["add", campaign, "backlsh.A", "--json"], "backlsh.A", "backlash")
    refused(campaign.parent, ["add", campaign, "backlash.Q", "--json"], "backlash.Q", "X, Y, Z, A, C")
    refused(campaign.parent, ["remove", campaign, "backlash.A", "--json"], "backlash.A", "friction.X")
    refused(campaign.parent, ["effects", "backlsh", "--json"], "backlsh", "backlash")
    refused(campaign.parent, ["effects", "backlash.Q", "--json"], "backlash.Q")
    assert "…" not in run("effects", "nonsense").output  # nothing of what is allowed is cut


def test_effect_that_the_campaign_cannot_show(campaign):
    refused(campaign.parent, ["add", campaign, "pitch_error.C", "--json"], "pitch_error.C")
    refused(campaign.parent, ["add", campaign, "backlash.C", "--json"], "backlash.C", "does not change any reading")


HISTORIES = ["", "{", "[]", '{"steps": 3}', '{"steps": [{"action": "add"}]}']


@pytest.mark.parametrize("text", HISTORIES)
def test_history_that_mjsim_has_not_written(campaign, text):
    (campaign / ".mjsim").mkdir()
    (campaign / ".mjsim" / "history.json").write_text(text)
    refused(campaign.parent, ["history", campaign, "--json"], "history.json")
    refused(campaign.parent, ["remove", campaign, "friction.X", "--json"], "history.json")


def test_history_plot_of_another_kind(campaign):
    (campaign / ".mjsim").mkdir()
    step = {"action": "start", "effect": "", "machine_file": "machine.toml", "effects": [], "rms_um": 1.0,
        "noise_um": 0.1,
            "tests": {"turn": 1.0}}  # fmt: skip
    (campaign / ".mjsim" / "history.json").write_text(json.dumps({"steps": [step]}))
    refused(campaign.parent, ["history", campaign, "--out", campaign / "ladder.docx", "--json"], "ladder.docx", ".png")


def test_state_folder_in_the_way(campaign):
    (campaign / ".mjsim").write_text("a file")
    refused(campaign.parent, ["remove", campaign, "friction.X", "--json"], ".mjsim")


def test_demo_leaves_other_folders_alone(campaign):
    refused(campaign.parent, ["demo", "--out", campaign, "--json"], "exists already")
    refused(campaign.parent, ["demo", "--out", campaign / FILE / "demo", "--json"], FILE)


USAGE = [
    ["frobnicate"],
    ["compare"],
    ["compare", "a", "b"],
    ["compare", ".", "--frob"],
    ["simulate", "."],
    ["add", "."],
    ["remove", "."],
    ["diagnose", ".", "--max-effects", "0"],
    ["diagnose", ".", "--threads", "many"],
    ["history"],
]


@pytest.mark.parametrize("args", USAGE, ids=" ".join)
def test_wrong_usage(tmp_path, args):
    refused(tmp_path, args, "Error: ", status=2)


def test_output_folder_that_is_a_file(campaign):
    refused(campaign.parent, ["simulate", campaign, "--out", campaign / FILE], "--out", status=2)
    refused(campaign.parent, ["compare", campaign, "--out", campaign / FILE], "--out", status=2)
    refused(campaign.parent, ["diagnose", campaign, "--write", campaign / "traces"], "--write", status=2)
