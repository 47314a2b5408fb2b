"""What only some commands need: without it, one sentence says how to install it, before anything is begun."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from commands import cut, refused, run

from mjsim.errors import InputError
from mjsim.io import extras
from mjsim.io.resources import examples
from mjsim.report import demo
from mjsim.simulation.multibody import Simulation

ROOT = Path(__file__).resolve().parent.parent
HEALTHY = examples() / "healthy"


@pytest.fixture
def without(monkeypatch):
    """``without("av")``: packages that are not installed, as far as mjsim can see."""

    def take_away(*names):
        monkeypatch.setattr(extras, "find_spec", lambda name: None if name in names else True)

    return take_away


def sentence(extra):
    return f'needs the extra "{extra}": pip install "mjsim[{extra}]"'


def test_every_extra_that_is_named_exists():
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(known) == {"report", "video", "dataframe", "batch", "distributed", "workbench", "all"}


@pytest.mark.parametrize(
    ("extra", "missing", "command"),
    [
        ("report", "jinja2", ["report", HEALTHY, "-o", "{t}/page.html"]),
        ("workbench", "nicegui", ["open", HEALTHY, "--no-browser"]),
        ("video", "av", ["animate", HEALTHY, "--test", "circle-xy-ccw", "-o", "{t}/film.mp4"]),
    ],
)
def test_a_command_without_its_extra(tmp_path, without, extra, missing, command):
    without(missing)
    refused(tmp_path, [str(a).format(t=tmp_path) for a in command], sentence(extra))


def test_a_sweep_without_its_extra():
    """In a process of its own: the packages are looked for when the module is loaded."""
    script = (
        "import sys; from mjsim.io import extras; extras.find_spec = lambda name: None\n"
        "from mjsim.cli.main import main; main(['batch', sys.argv[1], '--dry-run'])"
    )
    sweep = examples() / "sweeps" / "backlash.toml"
    done = subprocess.run([sys.executable, "-c", script, sweep], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"mjsim: batch {sentence('batch')}\n"


def test_a_table_without_its_extra(without):
    without("pandas")
    with pytest.raises(InputError, match="to_dataframe needs the extra"):
        Simulation.to_dataframe(None)


def test_a_cluster_without_its_extra(without):
    from mjsim.batch.scheduler import connected

    without("distributed")
    with pytest.raises(InputError, match="--scheduler needs the extra"), connected("tcp://127.0.0.1:9"):
        pass


@pytest.mark.slow
def test_the_walk_through_without_the_report_and_with_it(tmp_path, shared_results, monkeypatch):
    """On three tests of the example, to be quicker."""
    cut(tmp_path / "hidden-backlash")
    monkeypatch.setattr(demo, "examples", lambda: tmp_path)
    out = tmp_path / "demo"
    with monkeypatch.context() as patch:
        patch.setattr(extras, "find_spec", lambda name: None if name == "jinja2" else True)
        result = run("demo", "--out", out)
    assert result.exit_code == 0, result.output
    assert f"report {sentence('report')}" in result.output
    assert {p.name for p in out.glob("*.png")} == {"measured-and-simulated.png", "ladder.png"}
    assert not (out / "report.html").exists()
    again = run("demo", "--out", out)
    assert again.exit_code == 0 and "backlash.A" in again.output, again.output
    assert "backlash.A" in (out / "report.html").read_text() and "backlash" in (out / "machine.toml").read_text()
