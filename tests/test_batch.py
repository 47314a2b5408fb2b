"""Sweeps: designs, results equal to single simulations, resuming after kills, refusals, a real cluster that loses a
worker.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from commands import POSIX, run, with_b_axis

import mjsim
from mjsim.batch import dataset, scheduler
from mjsim.batch.dataset import opened
from mjsim.batch.simulate import FIGURES
from mjsim.batch.sweep import Job, read_sweep
from mjsim.batch.tables import check_versions
from mjsim.batch.targets import varied_test
from mjsim.cli.main import main
from mjsim.errors import InputError
from mjsim.inference.data_sheet import data_sheet
from mjsim.instruments.ball_bar.iso230 import circular_figures
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import TOLERANCE
from mjsim.simulation import callback
from mjsim.simulation.multibody import simulate

#: Numbers of the data sheet.
SHEET = len(data_sheet(FIVE_AXIS))
#: Two short tests, 2.5 and 4.5 s.
TESTS = """
[[test]]
name = "turn"
kind = "rotary"
axis = "A"
from_deg = 0.0
to_deg = 30.0
sensitive_direction = "tangential"
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 2000.0
[[test]]
name = "circle"
kind = "circular"
plane = "XY"
direction = "CCW"
revolutions = 1
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 50.0
feed_mm_min = 5000.0
"""
BACKLASH = '[[vary]]\nparameter = "backlash.A.width_deg"\nfrom = 0.0\nto = 0.01\ncount = 3\n'
GAIN = '[[vary]]\nparameter = "drive.X.position_gain_per_s"\nvalues = [40.0, 50]\n'
BALL = '[[vary]]\nparameter = "table_ball_mm.y"\nvalues = [0.0, 20.0]\n'
CONE = '[[vary]]\nparameter = "half_apex_deg"\nvalues = [15.0]\n'
OWN = """
import numpy as np
import mjsim

@mjsim.register
class Wave(mjsim.Effect):
    kind = "batch_wave"
    subjects = ("X",)
    title = "Wave"
    parameters = (mjsim.Parameter("amplitude_um", "amplitude", 0.0, 50.0, neutral=0.0),)
    definition = source = signature = "a test's"

    def position_error(self, motion):
        out = np.zeros_like(motion.position)
        out[:, 0] = self.si("amplitude_um") * np.sin(600.0 * motion.position[:, 0])
        return out
"""


@pytest.fixture
def folder(tmp_path):
    shutil.copy(examples() / "hidden-backlash" / "machine.toml", tmp_path)
    return tmp_path


def sweep_file(folder, body, head="", tests=TESTS):
    file = folder / "sweep.toml"
    file.write_text(f'name = "s"\nmachine = "machine.toml"\n{head}\n{tests}\n{body}')
    return file


def own(folder, text=OWN):
    """Put the effect of a user's own into the machine."""
    (folder / "own.py").write_text(text)
    with open(folder / "machine.toml", "a") as file:
        file.write('\n[[effect]]\nid = "batch_wave.X"\nfile = "own.py"\namplitude_um = 1.0\n')


def files(out):
    """Everything in a result folder, byte by byte; nothing hidden may be left but the lock, which is empty."""
    found = {p.relative_to(out).as_posix(): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}
    assert found.pop(".lock", b"") == b""
    return found


# -- designs -----------------------------------------------------------------------------------------------------------


def test_grid(folder):
    s = read_sweep(sweep_file(folder, BACKLASH + GAIN + BALL))
    assert s.runs == 12 and len(list(s.jobs())) == 24
    assert s.values[0].tolist() == [0.0, 40.0, 0.0] and s.values[-1].tolist() == [0.01, 50.0, 20.0]
    assert len({tuple(v) for v in s.values}) == 12
    log = BACKLASH.replace("from = 0.0", "from = 0.0001").replace("count = 3", 'count = 3\nscale = "log"')
    np.testing.assert_allclose(read_sweep(sweep_file(folder, log)).values[:, 0], [1e-4, 1e-3, 1e-2])


def test_latin_hypercube_is_stratified_and_reproducible(folder):
    body = (BACKLASH + BALL.replace("values = [0.0, 20.0]", "from = -10.0\nto = 10.0")).replace("count = 3\n", "")
    body += '[[vary]]\nparameter = "friction.X.coulomb_Nm"\nfrom = 0.1\nto = 10.0\nscale = "log"\n' + GAIN
    head = 'design = "latin_hypercube"\nsamples = 40\nseed = '
    values = read_sweep(sweep_file(folder, body, head + "7")).values
    parts = np.arange(40)
    assert np.array_equal(np.sort(np.floor(values[:, 0] / 0.01 * 40)), parts)
    assert np.array_equal(np.sort(np.floor((values[:, 1] + 10.0) / 20.0 * 40)), parts)
    assert np.array_equal(np.sort(np.floor(np.log(values[:, 2] / 0.1) / np.log(100.0) * 40)), parts)
    assert np.unique(values[:, 3], return_counts=True)[1].tolist() == [20, 20]
    assert np.array_equal(values, read_sweep(sweep_file(folder, body, head + "7")).values)
    assert not np.array_equal(values, read_sweep(sweep_file(folder, body, head + "8")).values)


def test_tolerances_have_the_data_sheets_spread(folder):
    s = read_sweep(sweep_file(folder, BACKLASH, 'design = "tolerances"\nsamples = 200'))
    assert s.runs == 600 and s.sheet.shape == (600, SHEET)
    assert np.array_equal(s.sheet[:200], s.sheet[200:400])  # the same machines at each point of the grid
    table = pd.DataFrame([s.parameters(r) for r in range(200)], columns=[c.name for c in s.columns])
    base = s.base
    for axis in "XYZAC":
        for column, nominal, name in (
            (f"drive.{axis}.position_gain_per_s", base.drives[axis].position_gain, "position_gain"),
            (f"drive.{axis}.inertia_kgm2", base.drives[axis].inertia, "inertia"),
            (f"friction.{axis}.coulomb_Nm", base.effect(f"friction.{axis}").values["coulomb_Nm"], "coulomb"),
        ):
            ratio = table[column] / nominal
            assert abs(ratio.mean() - 1.0) < 0.02 * TOLERANCE[name]
            assert ratio.std() == pytest.approx(TOLERANCE[name], rel=0.03)
    correlation = np.corrcoef(s.sheet[:200].T) - np.eye(SHEET)
    assert np.abs(correlation).max() < 0.3


# -- results -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def b_folder(folder):
    """The folder, with a B axis in the place of A in its machine."""
    file = folder / "machine.toml"
    file.write_text(with_b_axis(file.read_text()))
    return folder


def test_another_machine_runs_its_own_tests(b_folder):
    """Tests of a sweep's own are those of the axes of its machine, also where a value of theirs is varied."""
    file = sweep_file(b_folder, BALL + BACKLASH.replace(".A", ".B"), tests=TESTS.replace('axis = "A"', 'axis = "B"'))
    result = mjsim.run_batch(file, b_folder / "out", threads=2)
    table, sweep = result.to_dataframe(), read_sweep(file)
    assert len(table) == 12 and not result.failed
    for number in (0, 3):
        want = simulate(sweep.machine(number), [sweep.test_of(Job(number, 0))], 1)[0]
        lo, hi = Program(want.test).measured_span
        keep = (want.time >= lo) & (want.time <= hi)
        mine = table[(table["run"] == number) & (table["test"] == "turn")].iloc[0]
        assert mine["max_um"] == pytest.approx(1e6 * want.deviation[keep].max(), rel=1e-9)
        assert abs(mine["max_um"]) < 100.0


def test_a_machine_with_other_axes_than_the_campaign_is_refused(b_folder):
    shutil.copytree(examples() / "hidden-backlash", b_folder / "campaign")
    file = sweep_file(b_folder, GAIN, 'campaign = "campaign"', tests="")
    with pytest.raises(InputError, match=r"""sweep.toml: test .* "w-C'A'Y'bXZ-t"; allowed: "w-C'B'Y'bXZ-t","""):
        read_sweep(file)


def test_results_are_those_of_single_simulations(folder):
    """Every reading bit for bit, through effects that change the model's structure and an effect in plain Python."""
    own(folder)
    vary = {
        "backlash.A.width_deg": (0.0, 0.01),
        "batch_wave.X.amplitude_um": (0.0, 2.0),
        "axis_location.EX0C.value_um": (0.0, 30.0),
        "squareness.XY.angle_urad": (-20.0, 20.0),
        "tilt_error_motion.C.amplitude_urad": (0.0, 5.0),
        "tilt_error_motion.C.order": (1.0, 2.0),
        "servo_delay.X.delay_ms": (0.0, 0.5),
        "drive.X.inertia_kgm2": (0.001, 0.02),
        "table_ball_mm.y": (0.0, 20.0),
        "feed_mm_min": (2000.0, 3000.0),
    }
    body = "".join(f'[[vary]]\nparameter = "{k}"\nvalues = [{a}, {b}]\n' for k, (a, b) in vary.items())
    file = sweep_file(folder, body, 'design = "latin_hypercube"\nsamples = 8\ntraces = true\nevery_ms = 1\nseed = 3')
    result = mjsim.run_batch(file, folder / "out", threads=2)
    assert (result.runs, result.tests, result.simulated, result.failed) == (8, 2, 16, 0)
    table, traces = result.to_dataframe(), result.traces()
    assert list(table["run"]) == sorted(list(range(8)) * 2)
    sweep = read_sweep(file)
    for row in table.to_dict("records"):
        changed = {k: row[k] for k in vary}
        machine = sweep.base
        for key in ("backlash.A", "batch_wave.X", "axis_location.EX0C", "squareness.XY", "servo_delay.X"):
            parameter = next(k for k in vary if k.startswith(key))
            value = {parameter.rpartition(".")[2]: changed[parameter]}
            present = machine.effect(key)
            machine = machine.with_effect(present.replaced(**value) if present else mjsim.make_effect(key, **value))
        tilt = {k.rpartition(".")[2]: v for k, v in changed.items() if k.startswith("tilt")}
        machine = machine.with_effect(mjsim.make_effect("tilt_error_motion.C", **tilt))
        machine = machine.with_drive("X", inertia=row["drive.X.inertia_kgm2"])
        text = file.read_text().replace("[0.0, 0.0, 155.0]", f"[0.0, {row['table_ball_mm.y']!r}, 155.0]")
        for feed in ("2000.0\n[[test", "5000.0\n\n[[vary"):
            text = text.replace(
                f"feed_mm_min = {feed}", f"feed_mm_min = {row['feed_mm_min']!r}\n{feed.partition(chr(10))[2]}"
            )
        (folder / "one.toml").write_text(text)
        test = next(t for t in read_sweep(folder / "one.toml").tests if t.name == row["test"])
        want = simulate(machine, [test], 1)[0]
        lo, hi = Program(test).measured_span
        keep = (want.time >= lo) & (want.time <= hi)
        trace = traces[(traces["run"] == row["run"]) & (traces["test"] == row["test"])].iloc[0]
        assert np.array_equal(trace["deviation_um"], want.deviation[keep] / 1e-6)
        assert np.array_equal(trace["time_s"], want.time[keep])
        assert row["max_um"] == want.deviation[keep].max() / 1e-6 and row["min_um"] == want.deviation[keep].min() / 1e-6
        assert row["rms_um"] == pytest.approx(1e6 * np.sqrt(np.mean(want.deviation[keep] ** 2)), rel=1e-9)
        if test.kind == "rotary":
            assert np.isnan(row["circular_error_um"])
            continue
        iso = circular_figures(want.phi[keep], want.deviation[keep])
        got = [row[n] for n in FIGURES[:5]]
        np.testing.assert_allclose(
            got, [iso.circular_error_um, iso.radial_max_um, iso.radial_min_um, *iso.centre_um], atol=1e-9
        )


def test_threads_change_nothing_and_the_description_is_complete(folder):
    file = sweep_file(folder, BACKLASH, 'design = "tolerances"\nsamples = 3\nseed = 5\ntraces = true')
    mjsim.run_batch(file, folder / "one", threads=1)
    result = mjsim.run_batch(file, folder / "two", threads=2)
    assert files(folder / "one") == files(folder / "two")
    assert list(files(folder / "two")) == ["results/part-00000.parquet", "sweep.json", "traces/part-00000.parquet"]
    about = json.loads((folder / "two" / "sweep.json").read_text())
    assert about["text"] == file.read_text() and about["seed"] == 5 and about["runs"] == 9
    assert set(about["versions"]) == {"mjsim", "mujoco", "numpy", "model"} and set(about["inputs_sha256"]) == {
        "machine"
    }
    inside = pq.read_schema(folder / "two" / "results" / "part-00000.parquet")
    assert json.loads(inside.metadata[b"mjsim.sweep"]) == about
    table = result.to_dataframe()
    assert list(table.columns) == list(about["columns"]) == inside.names
    for name in table.columns:
        meta = inside.field(name).metadata
        assert meta[b"meaning"] and meta[b"unit"].decode() == about["columns"][name]["unit"]
    assert about["columns"]["backlash.A.width_deg"]["unit"] == "°"
    assert about["columns"]["drive.C.inertia_kgm2"]["unit"] == "kg·m²"
    assert len(table.columns) == 2 + 1 + SHEET + 10
    assert set(result.traces().columns) == set(about["trace_columns"])


def test_a_run_that_cannot_be_simulated_is_told_and_the_others_go_on(folder):
    refuse = "        assert self.si('amplitude_um') < 3e-6 or len(motion.time) > 3500, 'too much'\n        out = np"
    own(folder, OWN.replace("        out = np", refuse))
    body = BACKLASH.replace("backlash.A.width_deg", "batch_wave.X.amplitude_um").replace("0.01", "4.0")
    result = mjsim.run_batch(sweep_file(folder, body), folder / "out")
    table = result.to_dataframe().set_index(["run", "test"])
    assert result.failed == 1
    said = "effect batch_wave.X: position_error raised AssertionError: too much (own.py, line 14)"
    assert table.loc[(2, "turn"), "error"].startswith(said)
    assert np.isnan(table.loc[(2, "turn"), "max_um"]) and table.drop((2, "turn"))["max_um"].notna().all()
    assert table["error"].isna().sum() == 5 and table.loc[(2, "circle"), "circular_error_um"] > 0


def test_a_sweep_in_which_every_run_failed_is_no_success(folder):
    own(folder, OWN.replace("        out = np", "        assert False, 'never'\n        out = np"))
    out = folder / "out"
    result = run("batch", sweep_file(folder, GAIN, 'tests = ["turn"]'), "--out", out, "--quiet")
    assert result.exit_code == 1 and isinstance(result.exception, SystemExit)
    assert (
        result.stderr
        == f"mjsim: every simulation of the sweep failed; the column 'error' of {out / 'results'} says why\n"
    )
    assert pd.read_parquet(out / "results")["error"].str.contains("never").all()


# -- kill and resume ---------------------------------------------------------------------------------------------------

_NURSERY = """
import json, os, sys
from mjsim.batch import run
from mjsim.cli.batch import command
for line in sys.stdin:
    arguments, stderr = json.loads(line)
    if (child := os.fork()) == 0:
        os.dup2(os.open(stderr, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        run.FLUSH_S, run.FLUSH_SHARE = 0.0, 1e9
        try:
            command.main(arguments)
        except SystemExit as end:
            os._exit(end.code or 0)
        os._exit(99)
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def nursery():
    """A process that has everything loaded and makes children that run ``mjsim batch``, each to be killed."""
    command = [sys.executable, "-c", _NURSERY]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
    yield process
    process.kill()
    process.wait()


def stop_it(nursery, file, out, rows, sign):
    """Start ``mjsim batch`` and send it a signal once so many runs are there: exit status and what it said."""
    said = out.with_suffix(".stderr")
    nursery.stdin.write(json.dumps([["--quiet", str(file), "--out", str(out)], str(said)]) + "\n")
    nursery.stdin.flush()
    child = int(nursery.stdout.readline())
    try:
        wait_for(lambda: sum(pq.read_metadata(f).num_rows for f in out.glob("results/part-*")) >= rows, nursery)
    finally:
        os.kill(child, sign)
    return int(nursery.stdout.readline()), said.read_text()


@POSIX
def test_killed_several_times_nothing_is_lost_or_done_twice(folder, nursery):
    file = sweep_file(folder, BACKLASH.replace("count = 3", "count = 20") + BALL, "traces = true")
    out, before = folder / "killed", 0
    for wanted in (2, 11, 23, 38):
        assert stop_it(nursery, file, out, wanted, signal.SIGKILL)[0] == -signal.SIGKILL
        half = pd.read_parquet(out / "results")
        assert not half.duplicated(["run", "test"]).any()
        assert before < len(half) < 80 and len(half) >= wanted
        before = len(half)
    assert mjsim.run_batch(file, out).simulated == 80 - before
    mjsim.run_batch(file, folder / "whole")
    assert files(out) == files(folder / "whole")
    assert mjsim.run_batch(file, out).simulated == 0 and files(out) == files(folder / "whole")


@POSIX
def test_interrupted_by_the_user(folder, nursery):
    """Ctrl-C in the middle: the runs in flight are kept, one sentence says how to go on."""
    file = sweep_file(folder, BACKLASH.replace("count = 3", "count = 300"))
    out = folder / "out"
    status, said = stop_it(nursery, file, out, 2, signal.SIGINT)
    assert (
        status == 130
        and said.startswith("mjsim: stopped;")
        and "the same command continues" in said
        and said.count("\n") == 1
    )
    assert 2 <= len(pd.read_parquet(out / "results")) < 600
    assert {p.name for p in out.rglob(".*")} <= {".lock"}


def test_an_interrupt_that_foreign_code_swallows(folder, monkeypatch):
    """Python prints and drops an interrupt that arrives in a destructor; the sweep ends all the same."""
    out, shown = folder / "out", []

    def swallow(stage, done, total):
        shown.append(done)
        if len(shown) == 3:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr("mjsim.cli.common.progress_bar", lambda *_, **__: contextlib.nullcontext(swallow))
    result = run("batch", sweep_file(folder, BACKLASH.replace("count = 3", "count = 30")), "--out", out)
    assert result.exit_code == 130 and "the same command continues from there" in result.stderr
    assert 1 <= len(pd.read_parquet(out / "results")) < 10
    assert signal.getsignal(signal.SIGINT) is before


def test_what_is_running_is_delivered_when_the_work_is_stopped():
    """Whatever the deliveries raise; and nothing further begins."""
    both, got = threading.Barrier(2), []

    def work(number):
        if number < 2:
            both.wait(10.0)
        return number

    def deliver(number, future):
        got.append(future.result())
        raise KeyboardInterrupt

    executor = ThreadPoolExecutor(2)
    crew = scheduler.Crew(executor, lambda: 2)
    with pytest.raises(KeyboardInterrupt):
        scheduler.work_off(crew, range(100), lambda number: executor.submit(work, number), deliver)
    assert {0, 1} <= set(got) <= set(range(6)) and len(got) == len(set(got))


def wait_for(condition, process=None, seconds=60.0):
    """Poll until a condition holds; the process must not end before."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        assert process is None or process.poll() is None, "the process ended before"
        time.sleep(0.005)


@pytest.fixture
def each_written(monkeypatch):
    """Every outcome is written at once, into files of two rows."""
    monkeypatch.setattr("mjsim.batch.run.FLUSH_S", -1.0)
    monkeypatch.setattr("mjsim.batch.run.FLUSH_SHARE", 1e9)
    monkeypatch.setattr(dataset, "ROWS", 2)
    monkeypatch.setattr(dataset, "TRACES", 2)


@pytest.mark.parametrize("step", range(9))
def test_killed_while_files_are_written(folder, monkeypatch, each_written, step):
    """Whichever file is the last one that gets into its place before the kill, the next call ends the work."""
    file = sweep_file(folder, GAIN, "traces = true", tests=TESTS[: TESTS.index("[[test]]", 10)])
    whole, out = folder / "whole", folder / "out"
    mjsim.run_batch(file, whole)
    assert len(files(whole)) == 3
    moved = []

    class Killed(BaseException):
        pass

    def replace(a, b, move=os.replace):
        if len(moved) == step:
            raise Killed
        moved.append(b)
        move(a, b)

    with monkeypatch.context() as m:
        m.setattr(os, "replace", replace)
        try:
            mjsim.run_batch(file, out, threads=1)
            survived = True
        except Killed:
            survived = False
    assert survived == (step >= 5)  # sweep.json, and twice a trace and a result
    assert mjsim.run_batch(file, out).simulated == (0 if survived else 2 - max(step - 1, 0) // 2)
    assert files(out) == files(whole)


def test_a_file_that_a_power_cut_spoiled_is_computed_again(folder, each_written):
    file = sweep_file(folder, BACKLASH)
    whole, out = folder / "whole", folder / "out"
    mjsim.run_batch(file, whole)
    mjsim.run_batch(file, out)
    parts = sorted(out.glob("results/part-*"))
    assert len(parts) == 3
    parts[1].write_bytes(parts[1].read_bytes()[:100])
    assert mjsim.run_batch(file, out).simulated == 2
    assert files(out) == files(whole)


def test_a_file_of_something_else_is_refused(folder):
    file, out = sweep_file(folder, GAIN), folder / "out"
    mjsim.run_batch(file, out)
    other = folder / "other"
    mjsim.run_batch(sweep_file(folder, GAIN + BALL), other)
    sweep_file(folder, GAIN)
    for name, source in (("part-00001", other / "results" / "part-00000.parquet"), ("part-x", file)):
        foreign = out / "results" / f"{name}.parquet"
        shutil.copy(source, foreign)
        with pytest.raises(InputError, match=f"{name}.parquet: is no file of this sweep; move it away"):
            mjsim.run_batch(file, out)
        foreign.unlink()
    assert mjsim.run_batch(file, out).simulated == 0


# -- refusals ----------------------------------------------------------------------------------------------------------


def test_another_sweep_in_the_folder_is_refused(folder):
    out = folder / "out"
    file = sweep_file(folder, GAIN)
    mjsim.run_batch(file, out)
    before = files(out)
    file.write_text("# a comment changes nothing\n" + file.read_text())
    assert mjsim.run_batch(file, out).simulated == 0
    sweep_file(folder, GAIN + BALL)
    with pytest.raises(InputError, match=r"begun with another sweep: the sweep file has another 'vary'; .* --force"):
        mjsim.run_batch(file, out)
    sweep_file(folder, GAIN)
    machine = folder / "machine.toml"
    machine.write_text(machine.read_text().replace("coulomb_Nm = 1.2", "coulomb_Nm = 1.3"))
    with pytest.raises(InputError, match="the machine has changed"):
        mjsim.run_batch(file, out)
    assert files(out)["results/part-00000.parquet"] == before["results/part-00000.parquet"]
    assert mjsim.run_batch(file, out, force=True).simulated == 4
    assert files(out)["results/part-00000.parquet"] != before["results/part-00000.parquet"]
    (folder / "theirs" / "results").mkdir(parents=True)
    (folder / "theirs" / "results" / "part-1.parquet").write_text("mine")
    with pytest.raises(InputError, match=r"has a folder 'results' but no sweep\.json"):
        mjsim.run_batch(file, folder / "theirs")
    with opened(read_sweep(file), out), pytest.raises(InputError, match="another mjsim batch is writing there"):
        mjsim.run_batch(file, out)


@pytest.mark.parametrize(("key", "words"), [("program", "the NC program p.nc"), ("driven_by", "the record r.csv")])
def test_a_test_that_a_file_drives_is_not_varied(folder, key, words):
    """The file has the motion: another feed or cone would not be run."""
    table = {"name": "t", key: words.split()[-1]}
    with pytest.raises(InputError, match=f'feed_mm_min cannot be varied: test "t" is driven by {words}'):
        varied_test(folder / "campaign.toml", "s.toml", table, {"feed_mm_min": 900.0}, FIVE_AXIS)


BAD = {
    "misspelt key": (
        "",
        GAIN.replace("values", "value"),
        "unknown key 'value' (did you mean 'values'?)",
        "from, to, count",
    ),
    "unknown design": ('design = "random"', GAIN, "design = 'random'", "latin_hypercube"),
    "nothing varied": ("", "", "no [[vary]]", "'grid'"),
    "samples of a grid": ("samples = 5", GAIN, "samples = 5", "grid"),
    "no samples": ('design = "latin_hypercube"', GAIN, "'samples' is missing", "latin_hypercube"),
    "no count": ("", BACKLASH.replace("count = 3", ""), "'count' is missing", "backlash.A.width_deg"),
    "count in a hypercube": ('design = "latin_hypercube"\nsamples = 9', BACKLASH, "count = 3", "samples"),
    "values and range": ("", GAIN + "from = 1.0\n", "values and from", "allowed"),
    "half a range": ("", BACKLASH.replace("to = 0.01", ""), "'to' is missing", "backlash.A.width_deg"),
    "no range": ("", BACKLASH.replace("to = 0.01", "to = 0.0"), "both 0", "two different numbers"),
    "log of zero": ("", BACKLASH + 'scale = "log"\n', "from = 0", "above 0"),
    "twice the same": ("", GAIN + GAIN, "appears 2 times", "each parameter once"),
    "value twice": ("", GAIN.replace("50", "40.0"), "a number twice", "each value once"),
    "not a number": ("", GAIN.replace("50", '"50"'), "values", "'50'"),
    "not finite": ("", GAIN.replace("50", "inf"), "values", "finite"),
    "negative width": (
        "",
        BACKLASH.replace("from = 0.0", "from = -0.1"),
        "width_deg = -0.1 is out of bounds",
        "0 to 1 °",
    ),
    "gain out of bounds": ("", GAIN.replace("50", "5000"), "5000", "less than or equal to 1000"),
    "unknown effect": ("", BACKLASH.replace("backlash.A", "slack.A"), "unknown effect 'slack.A'", "backlash"),
    "unknown axis": ("", BACKLASH.replace("backlash.A", "backlash.B"), "unknown effect 'backlash.B'", "X, Y, Z, A, C"),
    "unknown parameter": ("", BACKLASH.replace("width_deg", "width_mm"), "no parameter 'width_mm'", "width_deg"),
    "unknown drive value": ("", GAIN.replace("position_gain_per_s", "kpp"), "'drive.X.kpp'", "position_gain_per_s"),
    "a list": (
        "",
        BACKLASH.replace("backlash.A.width_deg", "pitch_error.A.components"),
        "components of pitch_error.A is no number",
        "allowed",
    ),
    "misspelt test value": ("", BALL.replace("table_ball_mm.y", "table_ball.y"), "'table_ball.y'", "table_ball_mm.y"),
    "incomplete effect": (
        "",
        BACKLASH.replace("backlash.A.width_deg", "drive_compliance.X.damping_ratio"),
        "stiffness",
        "missing",
    ),
    "not of this test": ("", CONE, "half_apex_deg", "does not belong to rotary"),
    "impossible feed": ("", BALL.replace("table_ball_mm.y", "feed_mm_min"), "feed_mm_min = 0", "greater than 0"),
    "too many runs": ("", BACKLASH.replace("count = 3", "count = 600000"), "1200000 simulations", "up to 1000000"),
    "absolute machine": ('campaign = "/etc"', GAIN, "both campaign and [[test]]", "one of the two"),
    "every_ms alone": ("every_ms = 5", GAIN, "every_ms = 5", "traces = true"),
    "unknown test": ('tests = ["turn", "spin"]', GAIN, "no test 'spin'", "turn, circle"),
    "tests of a wrong type": ("tests = 5", GAIN, "tests = '5'", "list of names"),
    "negative seed": ("seed = -1", GAIN, "seed = -1", "greater than or equal to 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_wrong_sweeps_are_refused_in_one_sentence(folder, name):
    head, body, *words = BAD[name]
    refused(folder, sweep_file(folder, body, head), *words)


def refused(folder, file, *words, more=()):
    before = files(folder)
    result = CliRunner().invoke(main, ["batch", str(file), "--out", str(folder / "out"), *more])
    assert result.exit_code == 1 and isinstance(result.exception, SystemExit), result.output
    assert result.stdout == "" and result.stderr.startswith("mjsim: ") and result.stderr.count("\n") == 1, result.stderr
    assert len(result.stderr) < 900
    for word in words:
        assert word in result.stderr, result.stderr
    assert files(folder) == before


def test_wrong_files_are_refused(folder):
    refused(folder, folder / "none.toml", "none.toml: no such file")
    for machine, words in (("/etc/machine.toml", "relative to the sweep file"), ("none.toml", "no such file")):
        (folder / "sweep.toml").write_text(f'name = "s"\nmachine = "{machine}"\n{TESTS}{GAIN}')
        refused(folder, folder / "sweep.toml", machine, words)
    (folder / "sweep.toml").write_text(f'name = "s"\nmachine = "a\\u0000b"\n{TESTS}{GAIN}')
    refused(folder, folder / "sweep.toml", "machine = 'a\\x00b'", "control characters")
    (folder / "sweep.toml").write_text(f'name = "s"\ncampaign = "none"\n{GAIN}')
    refused(folder, folder / "sweep.toml", "none", "no such campaign")
    (folder / "sweep.toml").write_text(f'name = "s"\n{TESTS}{GAIN}')
    refused(folder, folder / "sweep.toml", "'machine' is missing")
    (folder / "sweep.toml").write_text("name = ")
    refused(folder, folder / "sweep.toml", "not valid TOML")


# -- command line ------------------------------------------------------------------------------------------------------


def test_command(folder):
    file, out = sweep_file(folder, BACKLASH, 'tests = ["turn"]'), folder / "out"
    run = lambda *args: CliRunner().invoke(main, ["batch", str(file), *args])  # noqa: E731
    dry = json.loads(run("--dry-run", "--json").stdout)
    assert (dry["runs"], dry["tests"], dry["simulations"]) == (3, ["turn"], 3) and dry["estimated_seconds"] >= 0
    assert dry["first"][1] == {"run": 1, "backlash.A.width_deg": 0.005}
    assert "3 runs of 1 test" in run("--dry-run").stdout and not out.exists()
    data = json.loads(run("--out", str(out), "--json", "--quiet", "--threads", "1").stdout)
    assert data["simulated"] == data["simulations"] == 3 and data["steps_per_s"] > 0
    assert sorted(data["files"]) == [str(out / "results" / "part-00000.parquet"), str(out / "sweep.json")]
    again = run("--out", str(out))
    assert again.exit_code == 0 and "all were there already" in again.stdout
    assert run().exit_code == 2
    text = run("--help").stdout
    assert "Example: mjsim batch" in text and max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize("name", ["backlash", "what-if"])
def test_example_sweeps_are_right(name):
    sweep = read_sweep(examples() / "sweeps" / f"{name}.toml")
    assert (sweep.runs, len(sweep.tests)) == {"backlash": (500, 1), "what-if": (60, 1)}[name]


# -- cluster -----------------------------------------------------------------------------------------------------------


def test_no_scheduler_there(folder, monkeypatch):
    monkeypatch.setattr(scheduler, "TIMEOUT_S", 0.3)
    file = sweep_file(folder, GAIN)
    with pytest.raises(InputError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answered within 0\.3 s"):
        mjsim.run_batch(file, folder / "out", scheduler="tcp://127.0.0.1:9")
    with pytest.raises(InputError, match=r"--scheduler nonsense: .* allowed: the address that `dask scheduler` prints"):
        mjsim.run_batch(file, folder / "out", scheduler="nonsense")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r'pip install "mjsim\[distributed\]"'):
        mjsim.run_batch(file, folder / "out", scheduler="tcp://127.0.0.1:9")
    assert not (folder / "out").exists()


def test_workers_must_have_the_same_versions():
    here = {"mjsim": "0.1.0", "numpy": "2"}
    check_versions("w", here, here)
    with pytest.raises(InputError, match=r"worker w has numpy 1, this machine 2; allowed: the same"):
        check_versions("w", here, {**here, "numpy": "1"})


@pytest.fixture
def dask(tmp_path):
    """A real scheduler and two worker processes: its address, and the workers."""
    pytest.importorskip("distributed")
    place = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    quiet = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "env": os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    }
    options = ["--scheduler-file", str(place)]
    processes = [
        subprocess.Popen(
            [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", *options], **quiet
        )
    ]
    try:
        wait_for(place.exists, processes[0])
        for _ in range(2):
            local = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(tmp_path)]
            processes.append(subprocess.Popen([*dask, "worker", *options, *local], **quiet))
        address = json.loads(place.read_text())["address"]
        from distributed import Client

        with Client(address, timeout=30, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_the_same_bytes(folder, dask):
    address, workers = dask
    own(folder)
    file = sweep_file(folder, BACKLASH.replace("count = 3", "count = 12") + BALL, "traces = true")
    seen = []

    def progress(stage, done, total):
        seen.append(done)
        if done and workers[0].poll() is None:
            workers[0].kill()
            workers[0].wait()

    result = mjsim.run_batch(file, folder / "cluster", scheduler=address, progress=progress)
    assert workers[0].poll() not in (None, 0) and workers[1].poll() is None
    assert 0 < min(n for n in seen if n) < 48 and seen[-1] == result.simulated == 48
    mjsim.run_batch(file, folder / "local")
    assert files(folder / "cluster") == files(folder / "local")


def test_the_callback_stays_as_long_as_one_user_needs_it(m1, circle):
    """A simulation that ends must not take the callback from a sweep that is still running in another thread."""
    test = circle("XY", (0, 0, 155), feed=5000.0)
    want = simulate(m1, [test], 1)[0].deviation
    with callback.installed():
        assert np.array_equal(simulate(m1, [test], 1)[0].deviation, want)
        assert callback._users
    assert not callback._users
