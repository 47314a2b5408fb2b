"""The commands: round trips on a short campaign, JSON as documented, nothing but JSON on stdout, silence when asked
for.
"""

import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from commands import as_json, ok, run

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.io.resources import examples

TESTS = ("cone45-centre-ccw", "rotary-a-tangential-ccw")
COMMANDS = ("demo", "simulate", "compare", "diagnose", "report", "add", "remove", "history", "effects")


def cut(target: Path, names=TESTS) -> Path:
    """A campaign with a few tests of the hidden-backlash example, its machine file commented."""
    source = examples() / "hidden-backlash"
    (target / "traces").mkdir(parents=True)
    document = tomlkit.parse((source / "campaign.toml").read_text())
    for i in reversed(range(len(document["test"]))):
        if document["test"][i]["name"] not in names:
            del document["test"][i]
    (target / "campaign.toml").write_text(tomlkit.dumps(document))
    for name in names:
        shutil.copy(source / "traces" / f"{name}.csv.gz", target / "traces")
    text = (source / "machine.toml").read_text()
    (target / "machine.toml").write_text("# hall 3\n" + text.replace("[drive.C]", "# new motor\n[drive.C]"))
    return target


@pytest.fixture(scope="session")
def campaign(tmp_path_factory):
    return cut(tmp_path_factory.mktemp("cli") / "short")


# -- help and usage ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", [*COMMANDS, "import", "export", "new campaign", "completion"])
def test_help_has_an_example_and_the_common_options(command):
    text = ok(*command.split(), "--help").stdout
    assert f"Example: mjsim {command}" in text
    assert "--json" in text and "--quiet" in text
    assert max(map(len, text.splitlines())) <= 80


def test_the_list_of_commands():
    text = ok("--help").stdout
    assert all(f"\n  {c} " in text for c in COMMANDS)
    assert ok("--version").stdout == "mjsim, version 0.1.0\n"


def test_the_console_script_from_another_folder(tmp_path, campaign):
    """As a user runs it: another process, another folder, stdout a pipe."""
    command = [sys.executable, "-c", "from mjsim.cli.main import main; main()"]
    done = subprocess.run(
        [*command, "effects", "backlash.A", "--json"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["id"] == "backlash.A"
    done = subprocess.run(
        [*command, "compare", tmp_path / "none", "--json"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("mjsim: ") and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


# -- effects -----------------------------------------------------------------------------------------------------------


def test_effects():
    data = as_json("effects")
    kinds = [e["kind"] for e in data["effects"]]
    assert kinds == sorted(kinds) and {"backlash", "friction", "pitch_error", "servo_gain"} <= set(kinds)
    assert as_json("effects", "backlash.A")["parameters"][0]["unit"] == "°"
    assert as_json("effects", "backlash.X")["parameters"][0]["unit"] == "µm"
    assert as_json("effects", "backlash")["subjects"] == list("XYZAC")
    for name in (None, *kinds):
        text = ok("effects", *([name] if name else [])).stdout
        assert max(map(len, text.splitlines())) <= 80


# -- simulate ----------------------------------------------------------------------------------------------------------


def test_simulate_writes_traces_and_plots(campaign, tmp_path):
    out = tmp_path / "out"
    data = as_json("simulate", campaign, "--test", TESTS[1], "--out", out)
    assert data["campaign"] == "hidden-backlash" and [t["name"] for t in data["tests"]] == [TESTS[1]]
    assert sorted(p.name for p in out.iterdir()) == [f"{TESTS[1]}.csv", f"{TESTS[1]}.png"]
    assert (out / f"{TESTS[1]}.png").read_bytes().startswith(b"\x89PNG")
    table = np.genfromtxt(out / f"{TESTS[1]}.csv", delimiter=",", names=True)
    assert table.dtype.names[:3] == ("time_s", "phi_deg", "deviation_um")
    assert {"A_command_deg", "A_actual_deg", "X_command_mm", "X_actual_mm"} <= set(table.dtype.names)
    assert np.isfinite(table["deviation_um"]).all() and np.allclose(np.diff(table["time_s"]), 0.005)
    assert table["phi_deg"][0] == pytest.approx(0.0, abs=1e-6) and table["phi_deg"].max() == pytest.approx(
        90.0, abs=1e-3
    )
    before = (out / f"{TESTS[1]}.csv").read_bytes()
    assert run("simulate", campaign, "--test", TESTS[1], "--out", out).exit_code == 1
    result = ok("simulate", campaign, "--test", TESTS[1], "--out", out, "--force", "--no-plots", "--quiet")
    assert (result.stdout, result.stderr) == ("", "")
    assert (out / f"{TESTS[1]}.csv").read_bytes() == before


def test_simulate_needs_no_traces_and_takes_another_machine(campaign, tmp_path):
    bare = shutil.copytree(campaign, tmp_path / "bare", ignore=shutil.ignore_patterns("traces", ".mjsim"))
    other = tmp_path / "other.toml"
    other.write_text((campaign / "machine.toml").read_text() + '\n[[effect]]\nid = "backlash.A"\nwidth_deg = 0.002\n')
    ok("simulate", bare / "campaign.toml", "--test", TESTS[1], "--out", tmp_path / "a", "--no-plots")
    ok("simulate", bare, "--test", TESTS[1], "--out", tmp_path / "b", "--no-plots", "--machine", other)
    assert (tmp_path / "a" / f"{TESTS[1]}.csv").read_bytes() != (tmp_path / "b" / f"{TESTS[1]}.csv").read_bytes()
    assert not (bare / ".mjsim").exists()


# -- compare -----------------------------------------------------------------------------------------------------------

COMPARE = {
    "acceptance",
    "campaign",
    "machine",
    "effects",
    "noise_um",
    "noise_source",
    "rms_um",
    "max_um",
    "not_measured",
    "warnings",
    "tests",
    "setups",
    "length_um",
    "iso230_4_bidirectional",
    "plots",
}


def test_compare(campaign, tmp_path):
    data = as_json("compare", campaign, "--out", tmp_path / "plots")
    assert set(data) == COMPARE
    assert [t["name"] for t in data["tests"]] == list(TESTS)
    assert data["rms_um"] > 3 * data["noise_um"] and 0.1 < data["noise_um"] < 0.14
    cone, turn = data["tests"]
    assert cone["iso230_4"]["measured"]["circular_error_um"] > cone["iso230_4"]["simulated"]["circular_error_um"]
    assert turn["iso230_4"] == {}
    files = {Path(p).name for p in data["plots"]}
    assert (
        files
        == {"overview.png", "residual.png", *(f"{n}.png" for n in TESTS)}
        == {p.name for p in (tmp_path / "plots").iterdir()}
    )
    refused = run("compare", campaign, "--out", tmp_path / "plots", "--json")
    assert (refused.exit_code, refused.stdout) == (1, "") and "--force" in refused.stderr


def test_compare_as_a_table(campaign):
    result = ok("compare", campaign, "--no-plots")
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert all(name in result.stdout for name in TESTS)
    result = ok("compare", campaign, "--no-plots", "--quiet")
    assert (result.stdout, result.stderr) == ("", "")


# -- add, history, remove ----------------------------------------------------------------------------------------------

CHANGE = {"effect", "machine_file", "noise_um", "rms_before_um", "rms_after_um", "tests"}


def test_add_history_remove(tmp_path):
    folder = cut(tmp_path / "short")
    text = (folder / "machine.toml").read_text()

    data = as_json("add", folder, "backlash.A")
    assert set(data) == CHANGE and set(data["effect"]) == {"id", "parameters", "ci95"}
    assert data["effect"]["id"] == "backlash.A"
    assert data["effect"]["parameters"]["width_deg"] == pytest.approx(0.002, rel=0.05)
    low, high = data["effect"]["ci95"]["width_deg"]
    assert low < data["effect"]["parameters"]["width_deg"] < high
    assert data["rms_after_um"] < 0.14 < data["rms_before_um"]

    added = (folder / "machine.toml").read_text()
    assert added.startswith(text.rstrip("\n")), "comments and order of the file stay"
    assert tomllib.loads(added)["effect"][:-1] == tomllib.loads(text)["effect"]
    assert (folder / ".mjsim" / "machine.001.toml").read_text() == text

    data = as_json("remove", folder, "backlash.A")
    assert set(data) == CHANGE
    assert tomllib.loads((folder / "machine.toml").read_text()) == tomllib.loads(text)
    assert (folder / ".mjsim" / "machine.002.toml").read_text() == added

    data = as_json("history", folder)
    assert [s["action"] for s in data["steps"]] == ["start", "add", "remove"]
    assert set(data["steps"][0]) == {"action", "effect", "machine_file", "effects", "rms_um", "noise_um", "tests"}
    assert data["steps"][0]["rms_um"] == data["steps"][2]["rms_um"] > data["steps"][1]["rms_um"]
    assert Path(data["plot"]).read_bytes().startswith(b"\x89PNG")
    result = ok("history", folder)
    assert "+ backlash.A" in result.stdout and max(map(len, result.stdout.splitlines())) <= 80


OWN = '''\
"""A lag of the table's tilt that the catalogue does not have."""

import numpy as np

import mjsim


@mjsim.register
class TiltLag(mjsim.Effect):
    kind = "tilt_lag"
    subjects = ("A",)
    title = "Tilt behind its command, by direction"
    parameters = (mjsim.Parameter("lag_deg", "how far behind", -0.1, 0.1, neutral=0.0, scale=0.001),)
    definition = "A - lag · sign(dA/dt)"
    source = "example"
    signature = "A step at every reversal of A."

    def position_error(self, motion):
        out = np.zeros_like(motion.position)
        out[:, 3] = -self.si("lag_deg") * np.tanh(motion.velocity[:, 3] / 1e-4)
        return out
'''


def test_a_users_own_effect_from_file_to_machine_and_back(tmp_path, monkeypatch):
    folder = cut(tmp_path / "short", TESTS[:1])
    text = (folder / "machine.toml").read_text()
    (folder / "tilt_lag.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    data = as_json("add", "short", "short/tilt_lag.py")
    assert data["effect"]["id"] == "tilt_lag.A"
    assert data["effect"]["parameters"]["lag_deg"] == pytest.approx(0.001, rel=0.1)  # half the play, which acts alike
    assert data["rms_after_um"] < 0.4 * data["rms_before_um"]
    assert tomllib.loads((folder / "machine.toml").read_text())["effect"][-1]["file"] == "tilt_lag.py"
    moved = shutil.move(folder, tmp_path / "moved")
    monkeypatch.chdir("/")
    assert as_json("compare", moved, "--no-plots")["rms_um"] == pytest.approx(data["rms_after_um"], rel=0.01)
    as_json("remove", moved, "tilt_lag.A")
    assert tomllib.loads((Path(moved) / "machine.toml").read_text()) == tomllib.loads(text)


# -- the same from Python ----------------------------------------------------------------------------------------------


def test_the_commands_are_functions(campaign, tmp_path):
    import mjsim
    from mjsim.commands.compare import compare

    renamed = {"effects": "list_effects", "report": "make_report"}  # a function never bears the name of a package
    assert {renamed.get(name, name) for name in set(COMMANDS) - {"demo"}} <= set(dir(mjsim))
    c = mjsim.read_campaign(campaign)
    machine = mjsim.read_machine(c.machine_file).with_effect(mjsim.make_effect("backlash.A", width_deg=0.002))
    (simulation,) = mjsim.simulate(machine, [t for t in c.tests if t.name == TESTS[1]])
    assert simulation.position.shape == (len(simulation.time), 5)
    assert compare(c, machine).rms < 0.14e-6
    mjsim.write_machine(machine, c.machine_file, tmp_path / "machine.toml")
    assert read_machine(tmp_path / "machine.toml").effect("backlash.A").values == {"width_deg": 0.002}
    assert mjsim.history(read_campaign(campaign)) == []
