"""The same input gives the same bytes: one thread or two, another process, another order of Python's sets."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import run

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects.registry import make
from mjsim.instruments.ball_bar.program import Program
from mjsim.simulation.multibody import simulate
from mjsim.threads import Workers

_BATCH = """\
name = "s"
machine = "machine.toml"
design = "latin_hypercube"
samples = 4
seed = 11
traces = true
every_ms = 50
[[test]]
{turn}
[[vary]]
parameter = "backlash.A.width_deg"
from = 0.0
to = 0.002
[[vary]]
parameter = "drive.A.position_gain_per_s"
from = 44.0
to = 46.0
"""
#: Each with --threads; what it prints with --json and what it writes is compared.
COMMANDS = [
    ["simulate", "C", "--out", "C/simulated", "--no-plots"],
    ["compare", "C"],
    ["diagnose", "C"],
    ["batch", "C/sweep.toml", "--out", "C/sweep"],
]
#: What is a measured time, not a result.
_CLOCKED = ("seconds", "simulations_per_s", "steps_per_s")


@pytest.fixture(scope="module")
def campaign(good, tmp_path_factory):
    """A campaign of one measured turn of A with backlash in it and noise on it, and a sweep."""
    folder = shutil.copytree(good, tmp_path_factory.mktemp("determinism") / "campaign")
    c = read_campaign(folder, traces=False)
    machine = read_machine(c.machine_file).with_effect(make("backlash.A", width_deg=0.002))
    s = simulate(machine, c.tests[:1])[0]
    lo, hi = Program(s.test).measured_span
    times = np.arange(lo, hi, 0.01)
    noise = np.convolve(np.random.default_rng(6).normal(0.0, 0.2, len(times) + 9), np.ones(10) / 10, "valid")
    rows = [f"{t:.3f},{d:.4f}" for t, d in zip(times, np.interp(times, s.time, s.deviation) * 1e6 + noise, strict=True)]
    (folder / "traces" / "turn.csv").write_text("\n".join(["time_s,deviation_um", *rows, ""]))
    turn = (folder / "campaign.toml").read_text().split("[[test]]")[1].replace('trace = "traces/turn.csv"\n', "")
    (folder / "sweep.toml").write_text(_BATCH.format(turn=turn))
    return folder


def everything(folder, threads):
    """Results and files of all commands in a fresh copy of the campaign, by name; times of day and durations left
    out.
    """
    out = {}
    for name, *rest in COMMANDS:
        args = [str(a).replace("C", str(folder), 1) if a.startswith("C") else a for a in rest]
        result = run(name, *args, "--threads", threads, "--json", "--quiet")
        assert result.exit_code == 0, result.output
        data = {k: v for k, v in json.loads(result.stdout).items() if k not in _CLOCKED}
        out[name] = json.dumps(data).replace(str(folder), "C")
    for file in sorted(folder.rglob("*")):
        if file.is_file() and file.suffix in (".csv", ".parquet", ".json", ".toml"):
            text = file.read_bytes()
            out[file.relative_to(folder).as_posix()] = re.sub(rb'"(time|when|made)[a-z_]*": "[^"]*"', b"", text).hex()
    return out


def test_the_same_bytes_in_two_processes(campaign, tmp_path):
    """This process with two threads, another with one thread and another hash seed: simulate, compare, diagnose,
    batch.
    """
    here = everything(shutil.copytree(campaign, tmp_path / "here"), 2)
    there = shutil.copytree(campaign, tmp_path / "there")
    script = (
        f"import json, test_determinism as t, pathlib; print(json.dumps(t.everything(pathlib.Path({str(there)!r}), 1)))"
    )
    env = {**os.environ, "PYTHONHASHSEED": "4242", "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    other = json.loads(done.stdout)
    assert (
        here.keys() == other.keys()
        and {"diagnose", "simulated/turn.csv", "sweep/results/part-00000.parquet"} <= here.keys()
    )
    assert [name for name in here if here[name] != other[name]] == []
    assert json.loads(here["diagnose"])["noise_um"] > 0


def test_random_numbers_come_from_the_seed_that_is_recorded():
    """A sweep's design draws them, and its description and results keep the seed (test_batch.py). The interval of a
    predicted part and the poses that tell error motions from location errors are drawn from one fixed seed each.
    """
    package = Path(sys.modules["mjsim"].__file__).parent
    draws = re.compile(r"np\.random|numpy\.random|default_rng|RandomState|^\s*import random|from random", re.M)
    found = {f.relative_to(package).as_posix(): draws.findall(f.read_text()) for f in package.rglob("*.py")}
    fixed = dict.fromkeys(("prediction/predict.py", "machine/redundant.py"), "default_rng(_SEED)")
    seeds = {"batch/sweep.py": "default_rng(seed)", **fixed}
    assert {k: v for k, v in found.items() if v} == {file: ["np.random", "default_rng"] for file in seeds}
    for file, drawn in seeds.items():
        assert drawn in (package / file).read_text()


@pytest.mark.parametrize("threads", [1, 2])
def test_work_that_was_started_ends_beside_other_work(threads):
    workers = Workers(threads)
    started = workers.start(lambda: sum(range(10)))
    assert workers.map(lambda x: 2 * x, range(4)) == [0, 2, 4, 6]
    assert started() == 45


@pytest.mark.parametrize("threads", [1, 2])
def test_what_goes_wrong_in_started_work_is_told_to_who_asks(threads):
    started = Workers(threads).start(lambda: [][0])
    with pytest.raises(IndexError):
        started()
