"""The shell: a campaign started from nothing, completion, colours that can be switched off, output that fits 80
columns.
"""

import io
import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from commands import POSIX, refused, run

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.campaign.new import TEMPLATE
from mjsim.cli import common
from mjsim.effects import registry
from mjsim.instruments.ball_bar import files
from mjsim.instruments.ball_bar.kinds import KINDS, all_keys
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS

# -- mjsim new campaign ------------------------------------------------------------------------------------------------


def test_a_new_campaign_runs_at_once(tmp_path):
    folder = tmp_path / "my machine"
    result = run("new", "campaign", folder)
    assert result.exit_code == 0 and "mjsim simulate" in result.stdout
    assert sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*")) == [
        "campaign.toml",
        "machine.toml",
        "traces",
        "traces/README.md",
    ]
    campaign = read_campaign(folder)
    assert (campaign.name, mjsim.read_machine(campaign.machine_file).name) == ("my machine", "my machine")
    assert {t.kind for t in campaign.tests} == set(KINDS) - {"simultaneous"} and not campaign.measured
    result = run(
        "simulate", folder, "--test", "rotary-c-tangential-ccw", "--out", folder / "out", "--no-plots", "--json"
    )
    assert result.exit_code == 0, result.output
    (row,) = json.loads(result.stdout)["tests"]
    assert np.isfinite(row["max_um"]) and row["max_um"] - row["min_um"] > 0.1


@pytest.mark.parametrize("name", ["campaign.toml", "machine.toml"])
def test_the_template_explains_its_keys_and_what_is_commented_out_is_right_too(tmp_path, name):
    mjsim.new_campaign(tmp_path / "c")
    text = (tmp_path / "c" / name).read_text()
    lines = []
    for line in text.splitlines():
        commented = line.startswith("# ") and ("=" in line or "[" in line) and not line.startswith(("# Each", "# When"))
        lines.append(line.removeprefix("# ") if commented else line)
    bare = "\n".join(lines)
    (tmp_path / "c" / name).write_text(bare)
    if name == "campaign.toml":
        before, after = tomlkit.parse(text)["test"], read_campaign(tmp_path / "c").tests
        keys, more = {k for t in tomlkit.parse(bare)["test"] for k in t}, 4
        assert keys >= set(all_keys()) and keys <= set(files.ball_bar_table().model_fields)
    else:
        before, after, more = tomlkit.parse(text)["effect"], mjsim.read_machine(tmp_path / "c" / name).effects, 2
    assert len(after) == len(before) + more
    first = [line for line in text.splitlines() if " = " in line and not line.startswith("#")]
    explained = {line.split(" = ")[0] for line in first if "#" in line}
    assert {line.split(" = ")[0] for line in first} - explained <= {"configuration", "name", "id", "kind"}


def test_the_names_of_a_new_campaign(tmp_path, monkeypatch):
    name = 'Müller\'s "big" one \\ 2'
    (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / name)
    mjsim.new_campaign(".")
    assert read_campaign(".").name == name and Path.cwd().samefile(tmp_path / name)
    mjsim.new_campaign(tmp_path / "deep" / "er", name="other")
    assert read_campaign(tmp_path / "deep" / "er").name == "other"
    names = ["README.md", "campaign.toml", "logs.toml", "machine.toml", "positions.toml", "sphere.toml"]
    assert sorted(p.name for p in TEMPLATE.iterdir()) == names


def test_a_new_campaign_overwrites_nothing(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("x")
    refused(tmp_path, ["new", "campaign", tmp_path / "full", "--json"], "is not empty", "mine.txt", "an empty folder")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    refused(tmp_path, ["new", "campaign", tmp_path / "link"], "no folder")
    refused(tmp_path, ["new", "campaign", tmp_path / "full" / "mine.txt" / "c"], "not a folder")
    refused(tmp_path, ["new", "campaign", tmp_path / "c", "--name", "a\nb"], "--name")
    assert run("new", "campaign", tmp_path / "full" / "mine.txt").exit_code == 2


# -- help and completion -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """A folder with the console command, as an installation has it."""
    folder = tmp_path_factory.mktemp("bin")
    (folder / "mjsim").write_text(f"#!{sys.executable}\nfrom mjsim.cli.main import main\nmain()\n")
    (folder / "mjsim").chmod(0o755)
    return folder


def complete(command, *words):
    """What bash proposes for the last word, through the function that the printed script defines."""
    script = (
        'eval "$(mjsim completion bash)"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); compopt() { '
        'COMPREPLY=("compopt:$2"); }; '
        "$(complete -p mjsim | sed 's/.*-F \\([^ ]*\\) .*/\\1/') mjsim; printf '%s\\n' \"${COMPREPLY[@]}\""
    )
    env = {**os.environ, "PATH": f"{command}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "--norc", "-c", script, "bash", "mjsim", *map(str, words)],
        capture_output=True,
        text=True,
        env=env,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split("\n")[:-1]


@POSIX
def test_completion_in_bash(command):
    healthy = examples() / "healthy"
    assert set(complete(command, "")) >= {"compare", "import", "export", "new", "completion"}
    assert complete(command, "add", healthy, "backlash.") == [
        f"backlash.{a}" for a in registry.kinds()["backlash"].subjects_of(FIVE_AXIS)
    ]
    assert complete(command, "simulate", healthy, "--test", "circle") == ["circle-xy-ccw", "circle-xy-cw"]
    assert complete(command, "simulate", healthy / "none", "--test", "c") == [""], "no campaign, nothing to propose"
    assert complete(command, "compare", "ex") == ["compopt:default"], "the shell's own completion of files"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(shell):
    result = run("completion", shell)
    assert "_MJSIM_COMPLETE" in result.stdout and f"{shell}_complete" in result.stdout
    assert json.loads(run("completion", shell, "--json").stdout)["script"].strip() == result.stdout.strip()
    assert run("completion", "csh").exit_code == 2


# -- colours and 80 columns --------------------------------------------------------------------------------------------


def on_a_terminal(command, cwd=None, **environment):
    """Status and output (both streams) of a command on a pseudo terminal of 80 columns."""
    pty, fcntl, termios = (pytest.importorskip(name) for name in ("pty", "fcntl", "termios"))
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    env = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")}
    env |= {"TERM": "xterm-256color", "COLUMNS": "80", **environment}
    process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=env, cwd=cwd)
    os.close(slave)
    out = b""
    try:
        while part := os.read(master, 65536):
            out += part
    except OSError:  # the other end is closed
        pass
    os.close(master)
    return process.wait(60), out.decode()


@pytest.fixture(scope="module")
def short(good, tmp_path_factory):
    """The short campaign with a ladder and an import of another system."""
    import shutil

    folder = shutil.copytree(good, tmp_path_factory.mktemp("shell") / "c")
    step = {"action": "start", "effect": "", "machine_file": "machine.toml", "effects": ["friction.X"], "rms_um": 1.5,
        "noise_um": 0.1,
            "tests": {"turn": 1.5}}  # fmt: skip
    added = {
        **step,
        "action": "add",
        "effect": "axis_location.EX0C",
        "tests": {"a-test-with-a-name-that-is-rather-long-for-a-table": 0.2},
    }
    (folder / ".mjsim").mkdir(exist_ok=True)
    (folder / ".mjsim" / "history.json").write_text(json.dumps({"steps": [step, added]}))
    (folder / "run.b5r").write_text(
        '<T><PLANE TEST_PLANE="XY"/><FEATURE NAME="AF_REVERSAL_SPIKES_A_NEG" DT="UT_LENGTH_UM">1</FEATURE></T>'
    )
    mjsim.import_features(folder, [folder / "run.b5r"])
    return folder


CHEAP = {
    "help": ["--help"],
    "effects": ["effects"],
    "one effect": ["effects", "pitch_error"],
    "history": ["history", "{c}"],
    "compare": ["compare", "{c}", "--no-plots"],
    "compare, quiet": ["compare", "{c}", "--no-plots", "--quiet"],
    "simulate": ["simulate", "{c}", "--test", "turn", "--out", "{t}/sim", "--no-plots"],
    "export": ["export", "{c}", "--out", "{t}/tables"],
    "import --show": ["import", "--show", "--campaign", "{c}"],
    "new campaign": ["new", "campaign", "{t}/new"],
}


ALL = """
import json, sys
from mjsim.cli.main import main
for args in json.loads(sys.argv[1]):
    main(args, standalone_mode=False)
    sys.stdout.flush()
    print("=====", flush=True)
"""


@pytest.fixture(scope="module")
def plain(short, tmp_path_factory):
    """Output of the cheap commands with NO_COLOR on a terminal: one process, whose end may write something too."""
    pytest.importorskip("termios")
    folder = tmp_path_factory.mktemp("plain")
    (folder / "c").symlink_to(short)
    commands = [[a.format(c="c", t="t") for a in args] for args in CHEAP.values()]
    status, out = on_a_terminal([sys.executable, "-c", ALL, json.dumps(commands)], cwd=folder, NO_COLOR="1")
    assert status == 0, out
    assert "\x1b" not in out
    parts = out.replace("\r\n", "\n").split("=====\n")
    assert len(parts) == len(CHEAP) + 1 and parts[-1] == ""
    return dict(zip(CHEAP, parts, strict=False))


@pytest.mark.parametrize("case", CHEAP)
def test_no_escape_sequences_and_80_columns(plain, case):
    lines = [piece for line in plain[case].split("\n") for piece in line.split("\r")]
    assert max(map(len, lines)) <= 80, max(lines, key=len)
    assert bool(plain[case]) == ("quiet" not in case)


def test_a_table_breaks_no_name_while_there_is_room(capsys):
    name = "cone45-x50-perpendicular-ccw"
    common.table(
        ["instrument", "test", "bits", "time min", "makes known"],
        [["touch probe and sphere", name, "12.3", "10", "axis_location.EXC, squareness.XY, angular_error.EAX"]],
    )
    lines = capsys.readouterr().out.splitlines()
    assert name in lines[1] and max(map(len, lines)) <= 80
    common.table([99 * "n"], [["x"]])  # what is longer than any line is shown as well
    assert capsys.readouterr().out.count("n") == 99


def test_the_plain_progress_bar_goes_away(plain):
    """It is one line that is written over, and blank at the end."""
    out = plain["compare"]
    assert "simulating 1/1" in out
    assert out[out.rindex("simulating") :].split("\r")[1].strip() == ""


def test_colours_on_a_terminal_and_where_they_are_asked_for(command):
    env = {**{k: v for k, v in os.environ.items() if k != "NO_COLOR"}, "TERM": "xterm", "FORCE_COLOR": "1"}
    forced = subprocess.run([command / "mjsim", "effects"], capture_output=True, text=True, env=env, timeout=60).stdout
    plain = subprocess.run(
        [command / "mjsim", "effects"], capture_output=True, text=True, env={**env, "NO_COLOR": "1"}, timeout=60
    ).stdout
    assert "\x1b[1m" in forced
    assert forced.replace("\x1b[1m", "").replace("\x1b[0m", "").split() == plain.split() and "\x1b" not in plain
    assert "\x1b[1m" in on_a_terminal([command / "mjsim", "effects"])[1]


@pytest.mark.parametrize(
    ("environment", "terminal", "want"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"NO_COLOR": "1"}, True, False),
        ({"NO_COLOR": ""}, True, True),
        ({"FORCE_COLOR": "1"}, False, True),
        ({"NO_COLOR": "1", "FORCE_COLOR": "1"}, True, False),
        ({"TERM": "dumb"}, True, False),
    ],
)
def test_when_output_is_coloured(monkeypatch, environment, terminal, want):
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"TERM": "xterm", **environment}.items():
        monkeypatch.setenv(name, value)
    stream = io.StringIO()
    stream.isatty = lambda: terminal
    assert common.styled(stream) is want


def test_help_and_completion_wait_for_no_solver():
    code = (
        "import importlib, sys\n"
        "from mjsim.cli.main import main\n"
        "for name in main.list_commands(None):\n"
        "    main.get_command(None, name)\n"
        "slow = {'scipy', 'numba', 'mujoco', 'matplotlib'} & set(sys.modules)\n"
        "assert not slow, slow"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
