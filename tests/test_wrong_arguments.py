"""Every command with one wrong argument after another: one sentence, status 1 or 2, and every file is as it was."""

import os
import shutil

import click
import pytest
from commands import run, snapshot

from mjsim.animation import scene
from mjsim.batch import run as batch_run
from mjsim.cli.main import _COMMANDS, main
from mjsim.inference.problem import Problem
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
    '{"steps": [{"action": "start", "effect": "", "machine_file": "machine.toml", "effects": [], "rms_um": 1.0, '
    '"noise_um": 0.1, "tests": {"turn": 1.0}}]}'
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
#: What a parameter is given where it is to be right, by its name; a command's own comes first.
GOOD = {
    "campaign": "short", "machine": "short/machine.toml", "out": "out", "effect": "backlash.A", "sweep": "sweep.toml",
    "files": "turn.txt", "folder": "fresh", "shell": "bash", "test": "turn", "program": "p.nc", "file": "p.nc",
    "nc write out": "n.nc", "nc read out": "n.csv", "nc feed out": "n.csv", "report out": "r.html",
    "animate out": "a.gif",
}  # fmt: skip
PLACES = ("nowhere", "short/traces", "short/traces/turn.csv")
NUMBERS = ("nan", "-1", "text")
WORDS = ("", "nothing", "backlash.Q", "../x")


def test_every_command_is_among_them():
    assert {words[0] for words, _ in LEAVES.values()} == set(_COMMANDS)


def wrong(parameter):
    """What a parameter is given in turn."""
    kind = parameter.type
    if isinstance(kind, click.Path):
        return [[place] for place in PLACES]
    if isinstance(kind, click.Choice):
        return [["other"]]
    if isinstance(kind, click.types.StringParamType):
        return [[word] for word in WORDS]
    return [[number] * max(1, parameter.nargs) for number in NUMBERS]


def lines(key):
    """The command's line with what it needs, and one parameter after another spoiled."""
    words, command = LEAVES[key]
    optional = [p for p in command.params if not p.required and not getattr(p, "is_flag", False) and p.name != "help"]
    needed = [p for p in command.params if p.required]
    for spoiled in (*needed, *optional):
        for value in wrong(spoiled):
            line = list(words)
            for p in needed if spoiled.required else (*needed, spoiled):
                given = value if p is spoiled else [GOOD.get(f"{key} {p.name}", GOOD.get(p.name, "turn"))]
                line += [max(p.opts, key=len), *given] if isinstance(p, click.Option) else given
            yield line


@pytest.fixture
def folder(good, tmp_path, monkeypatch):
    """A folder with one file of every kind. What takes long is taken for done once it begins."""

    def works(*args, **more):
        raise Worked

    for owner, name in ((Problem, "of"), (mjmodel, "build_model"), (scene, "Stage"), (batch_run, "work_off")):
        monkeypatch.setattr(owner, name, works)
    monkeypatch.setattr(batch_run, "estimate", lambda *_: (1, 1.0))
    shutil.copytree(good, tmp_path / "short")
    (tmp_path / "short" / ".mjsim").mkdir(exist_ok=True)
    (tmp_path / "short" / ".mjsim" / "history.json").write_text(HISTORY)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    (tmp_path / "p.nc").write_text(NC)
    shutil.copy(good / "traces" / "turn.csv", tmp_path / "turn.txt")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put_back(folder, before):
    """The folder's files as they were."""
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for path, content in before.items():
        place = folder / path
        if content is None:
            place.mkdir(parents=True, exist_ok=True)
        else:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)


@pytest.mark.parametrize("key", LEAVES)
def test_one_wrong_argument(folder, key):
    before = snapshot(folder)
    for line in lines(key):
        try:
            result = run(*line)
        except Worked:
            result = None
        if result is None or isinstance(result.exception, Worked) or result.exit_code == 0:
            put_back(folder, before)
            continue
        what = (line, result.output, result.exception)
        assert isinstance(result.exception, SystemExit) and result.exit_code in (1, 2), what
        assert result.stdout == "" and "Traceback" not in result.stderr and os.getcwd() == str(folder), what
        assert snapshot(folder) == before, what
        if result.exit_code == 1:
            assert (
                result.stderr.startswith("mjsim: ") and result.stderr.count("\n") == 1 and len(result.stderr) < 700
            ), what
        else:
            assert "Error: " in result.stderr or "Usage: " in result.stderr, what
