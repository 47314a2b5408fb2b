"""Every command with arguments of all sorts: it works, or refuses in one sentence and leaves every file as it is."""

import os
import shutil
from contextlib import contextmanager

import click
import pytest
from commands import run, snapshot
from fuzzing import TALLY, cases, patience, scratch
from hypothesis import given
from hypothesis import strategies as st

from mjsim.animation import scene
from mjsim.batch import run as batch_run
from mjsim.cli.main import _COMMANDS, main
from mjsim.estimation.problem import Problem
from mjsim.simulation import mjmodel

SWEEP = """
name = "widths"
campaign = "short"
tests = ["turn"]
[[vary]]
parameter = "backlash.A.width_deg"
values = [0.0, 0.001]
"""
NC = "G90 G94 G21\nG0 X0. Y0. Z0. A0. C0.\nG1 A10. F100.\nA30.\nM30\n"
HISTORY = (
    '{"steps": [{"action": "start", "effect": "", "machine_file": "machine.toml", "effects": [], "rms_um": 1.0, "noise_um": 0.1, '
    '"tests": {"turn": 1.0}}]}'
)


class Worked(BaseException):
    """The arguments were taken and the long part of the work would begin."""


def leaves(command, name=()):
    """(words, command) of every command that does something."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for sub in command.list_commands(context):
            yield from leaves(command.get_command(context, sub), (*name, sub))
    else:
        yield name, command


LEAVES = {" ".join(words): (words, command) for words, command in leaves(main)}


def test_every_command_is_among_them():
    assert {words[0] for words, _ in LEAVES.values()} == set(_COMMANDS)
    assert len(LEAVES) >= 22


#: What a parameter is given where it is to be right, by its name; a command's own comes first.
GOOD = {
    "campaign": "short", "campaigns": "short", "machine": "short/machine.toml", "out": "out", "effect": "backlash.A",
    "sweep": "sweep.toml", "files": "turn.txt", "file": "p.nc", "folder": "fresh", "shell": "bash", "name": "turn", "names": "turn",
    "tests": "turn", "test": "turn", "write": "fitted.toml", "program": "p.nc", "plot": "p.png", "scheduler": "nonsense",
    "between": ("backlash.A", "backlash.X"), "limit": ("A", "-90", "90"), "max_speed": ("A", "100"), "rows": ("1", "300"),
    "table_ball_mm": ("0", "0", "155"), "only": "3", "fix": "copy", "size": "320x240", "threads": "1", "nc write out": "n.nc",
    "nc read out": "n.csv", "nc feed out": "n.csv", "report out": "r.html", "animate out": "a.gif", "history out": "l.png",
    "new campaign name": "a name", "import campaign": "short",
}  # fmt: skip
PLACES = (
    "nowhere", "short", "short/campaign.toml", "short/machine.toml", "short/traces/turn.csv", "short/traces", "sweep.toml", "p.nc",
    "turn.txt", "", ".", "..", "/", "/dev/null", "/proc/mjsim/x", "short/campaign.toml/below", "loop", "dangling", "fifo", "n" * 300,
    "d/" * 2000 + "x", "a\udcff", "a\nb", "~", "-", "µ ü.toml", "out.docx", "mine.py", "short/.mjsim/history.json", "x.mp4", "x.csv.gz",
    "x.b5r", "tcp://127.0.0.1:x",
)  # fmt: skip
NUMBERS = (
    "nan", "-nan", "inf", "-inf", "1e400", "0", "-0.0", "-1", "1e-300", "1e300", "1e9", "7", "0.5", "3", "9" * 400, "0x10", "1_0", "٣",
    "", "text", "1,5",
)  # fmt: skip
WORDS = (
    "", " ", "nothing", "turn", "cone", "backlash.A", "backlash.Q", "backlash", ".", "A", "C", "XY", "CCW", "a/b", "../x.py", "mine.py",
    "x" * 3000, "\x1b[31m", "a\nb", "µ", "\udcff", "%s{0}", "-1", "1", "²", "1280x720", "0x0", "99999x99999", "axb", "auto", "nan", "inf",
    "1e9",
)  # fmt: skip


def value(draw, key, parameter, good):
    """What is given for one parameter: a list of words."""
    if isinstance(parameter, click.Option) and parameter.is_flag:
        return []
    right = GOOD.get(f"{key} {parameter.name}", GOOD.get(parameter.name))
    if good and right is not None:
        return list(right) if isinstance(right, tuple) else [right]
    kind = parameter.type
    options = WORDS
    if isinstance(kind, click.Path):
        options = PLACES
    elif isinstance(kind, click.Choice):
        options = (*kind.choices, "other", "")
    elif not isinstance(kind, click.types.StringParamType):
        options = NUMBERS
    if isinstance(kind, click.Tuple):
        return [draw(st.sampled_from(one.choices if isinstance(one, click.Choice) else NUMBERS)) for one in kind.types]
    return [draw(st.sampled_from(options)) for _ in range(max(1, parameter.nargs))]


@st.composite
def arguments(draw, key):
    """A line for one command: what it needs, mostly right, and some of its options, mostly wrong."""
    words, command = LEAVES[key]
    line = list(words)
    for p in command.params:
        if p.required and draw(st.integers(0, 9)):
            given_words = value(draw, key, p, draw(st.integers(0, 3)) > 0)
            line += [max(p.opts, key=len), *given_words] if isinstance(p, click.Option) else given_words
    optional = [p for p in command.params if not p.required and p.name not in ("help", "threads")]
    for p in draw(st.lists(st.sampled_from(optional), max_size=4, unique=True)) if optional else ():
        given_words = value(draw, key, p, draw(st.integers(0, 3)) == 0)
        line += [max(p.opts, key=len), *given_words] if isinstance(p, click.Option) else given_words
    return line


@contextmanager
def place(good):
    """A folder with one file of every kind, which is the current one inside."""
    here, folder = os.getcwd(), scratch()
    shutil.copytree(good, folder / "short")
    (folder / "short" / ".mjsim").mkdir()
    (folder / "short" / ".mjsim" / "history.json").write_text(HISTORY)
    (folder / "sweep.toml").write_text(SWEEP)
    (folder / "p.nc").write_text(NC)
    (folder / "turn.txt").write_text((good / "traces" / "turn.csv").read_text())
    (folder / "mine.py").write_text("x = 1\n")
    (folder / "loop").symlink_to("loop")
    (folder / "dangling").symlink_to("gone")
    os.mkfifo(folder / "fifo")
    os.chdir(folder)
    try:
        yield folder
    finally:
        os.chdir(here)
        shutil.rmtree(folder, ignore_errors=True)


def works(*args, **more):
    raise Worked


@pytest.fixture(autouse=True)
def short_work(monkeypatch):
    """What takes long is taken for done once it begins; what comes before it, and the way out, is what is tried here."""
    monkeypatch.setattr(Problem, "of", works)
    monkeypatch.setattr(mjmodel, "build_model", works)
    monkeypatch.setattr(scene, "Stage", works)
    monkeypatch.setattr(batch_run, "run_local", works)
    monkeypatch.setattr(batch_run, "estimate", lambda *_: (1, 1.0))


@pytest.mark.parametrize("key", LEAVES)
def test_arguments(good, key):
    @cases(12)
    @given(arguments(key))
    def property(line):
        with place(good) as folder:
            before = snapshot(folder)
            with patience(30):
                try:
                    result = run(*line)
                except Worked:
                    result = None
            if result is None or isinstance(result.exception, Worked):
                TALLY[f"mjsim {key}", "accepted"] += 1
                return
            what = (line, result.stderr, result.exception)
            assert result.exception is None or isinstance(result.exception, SystemExit), what
            assert result.exit_code in (0, 1, 2), what
            assert "Traceback" not in result.output, what
            left = [p for p in folder.rglob("*") if p.name.startswith(".") and p.name not in (".mjsim", ".mjsim-demo")]
            assert not left, what
            if result.exit_code == 0:
                TALLY[f"mjsim {key}", "accepted"] += 1
                return
            assert result.stdout == "", what
            assert snapshot(folder) == before, what
            if result.exit_code == 1:
                assert result.stderr.startswith("mjsim: ") and result.stderr.count("\n") == 1 and len(result.stderr) < 700, what
                TALLY[f"mjsim {key}", "refused"] += 1
            else:
                assert "Error: " in result.stderr or "Usage: " in result.stderr, what
                TALLY[f"mjsim {key}", "usage"] += 1

    property()
