"""Shared fixtures: the two example machines, the paper's tests, the numbers that the paper prints."""

import os
import shutil
import signal
import tomllib
from importlib.resources import files

import numpy as np
import pytest
from commands import CAMPAIGN
from paper_traces import ANGLE, UM

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.simulation.cache import forget_stale_code
from mjsim.simulation.multibody import simulate

forget_stale_code()
os.environ.setdefault("MJSIM_CACHE", "off")  # each test computes what it looks at
os.environ.setdefault("MJSIM_TRACEBACK", "1")  # a fault of mjsim's own is shown as it is
# A job started in the background ignores Ctrl-C, and so would the commands under test.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

DEG = np.pi / 180.0
#: Machine name -> the example campaign that brings it.
MACHINES = {"M1": "hidden-backlash", "M2": "two-candidates"}


#: Files that take longest for their number of tests: begun first, so that all workers end together.
LONG = (
    "test_workbench_browser", "test_start_browser", "test_examples", "test_portability", "test_estimation",
    "test_search", "test_single_revolutions", "test_worn_worm", "test_chain_campaigns", "test_figures", "test_bank",
    "test_angular_diagnosis", "test_docs", "test_pitch", "test_joint", "test_log_causes", "test_log_plan", "test_batch",
    "test_fleet", "test_planning", "test_report_browser", "test_extras", "test_cli", "test_sphere", "test_workbench",
    "test_linuxcnc", "test_nc_files", "test_own_effects", "test_mistakes", "test_shell", "test_model", "test_chain",
    "test_determinism", "test_writing", "test_report", "test_wild", "test_first_hour", "test_oracle_drives",
    "test_vibration", "test_convergence", "test_drive", "test_paper", "test_upkeep",
)  # fmt: skip


def pytest_collection_modifyitems(items):
    """The order of files alone; inside of one nothing changes."""
    items.sort(key=lambda item: LONG.index(item.path.stem) if item.path.stem in LONG else len(LONG))


def _read(name):
    machine = read_machine(examples() / MACHINES[name] / "machine.toml")
    assert machine.name == name
    return machine


@pytest.fixture(autouse=True)
def catalogue():
    """Effects of a user's own that a test brings in are gone after it: each test runs with the catalogue as it is
    installed.
    """
    before = registry.kinds()
    yield
    registry.restore(before)


@pytest.fixture(scope="session")
def good(tmp_path_factory):
    """A correct campaign with one measured test, whose trace is zeros."""
    folder = tmp_path_factory.mktemp("campaign") / "short"
    (folder / "traces").mkdir(parents=True)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    shutil.copy(examples() / "hidden-backlash" / "machine.toml", folder)
    lo, hi = Program(read_campaign(folder, traces=False).tests[0]).measured_span
    rows = [f"{t:.3f},0.0" for t in np.arange(lo, hi, 0.01)]
    (folder / "traces" / "turn.csv").write_text("\n".join(["time_s,deviation_um", *rows, ""]))
    return folder


@pytest.fixture(scope="module")
def shared_results(tmp_path_factory):
    """Commands of all tests that ask for this find each other's diagnoses again, for this run of the tests alone."""
    base = tmp_path_factory.getbasetemp()
    folder = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    before = os.environ["MJSIM_CACHE"]
    os.environ["MJSIM_CACHE"] = str(folder / "results")
    yield
    os.environ["MJSIM_CACHE"] = before


@pytest.fixture
def fast_plans(monkeypatch):
    """What may be planned is first tried at 4000 mm/min: slow tests take long to simulate."""
    monkeypatch.setattr("mjsim.inference.planning.candidates.FIRST_FEEDS", (4000 / 60e3,))


@pytest.fixture(scope="session")
def m1():
    """The machine of most examples: leads of 10 mm, worms of 60 and 72 teeth, Kpp 45/s, friction on every axis."""
    return _read("M1")


@pytest.fixture(scope="session")
def m2():
    """A stiffer machine with other gears: leads of 16 and 12 mm, worms of 90 and 120 teeth, Kpp 60/s."""
    return _read("M2")


@pytest.fixture(scope="session", params=tuple(MACHINES))
def machine(request):
    """Both machines in turn."""
    return _read(request.param)


@pytest.fixture(scope="session")
def bare():
    """A function that takes every effect out of a machine."""

    def strip(machine):
        for effect in machine.effects:
            machine = machine.without(effect.key)
        return machine

    return strip


@pytest.fixture(scope="session")
def paper():
    """The numbers that the paper prints, with their tolerances."""
    return tomllib.loads(files("mjsim.paper").joinpath("numbers.toml").read_text())


@pytest.fixture(scope="session")
def cone():
    """``cone(theta_deg, beta_deg, ball_mm, feed=mm/min, **fields)``: a cone-frustum test with the paper's bar of
    100 mm.
    """

    def make(theta, beta, ball, feed=1000.0, **fields):
        fields = {"name": f"cone{theta:g}", "revolutions": 1, **fields}
        return BallBarTest(
            kind="cone_frustum",
            table_ball=tuple(x / 1e3 for x in ball),
            length=0.1,
            feed=feed / 60e3,
            half_apex=theta * DEG,
            inclination=beta * DEG,
            **fields,
        )

    return make


@pytest.fixture(scope="session")
def circle():
    """``circle(plane, ball_mm, feed=mm/min, **fields)``: a two-axis circular test."""

    def make(plane, ball, feed=1000.0, **fields):
        fields = {"name": f"circle-{plane}", "revolutions": 1, **fields}
        return BallBarTest(
            kind="circular",
            table_ball=tuple(x / 1e3 for x in ball),
            length=0.1,
            feed=feed / 60e3,
            plane=plane,
            **fields,
        )

    return make


@pytest.fixture(scope="session")
def turn():
    """``turn(axis, from_deg, to_deg, ball_mm, sensitive, feed=mm/min, **fields)``: one rotary axis turning."""

    def make(axis, start, stop, ball, sensitive="tangential", feed=1000.0, **fields):
        fields = {"name": f"rotary-{axis}", "revolutions": 1, **fields}
        return BallBarTest(
            kind="rotary",
            table_ball=tuple(x / 1e3 for x in ball),
            length=0.1,
            feed=feed / 60e3,
            axis=axis,
            sensitive=sensitive,
            start=start * DEG,
            stop=stop * DEG,
            direction="CCW" if stop > start else "CW",
            **fields,
        )

    return make


@pytest.fixture(scope="session")
def away_from_reversals():
    """``away(time, command)``: which instants lie more than 50 ms from every reversal of an axis, (n,) bool.

    Reversals are those of the commands (n, 5). The motors follow one lag (some 20 ms) later, so the exclusion reaches
    from 50 ms before the command's reversal to 50 ms after the motor's.
    """

    def away(time, command, margin=0.05, lag=0.03):
        clear = np.ones(len(time), bool)
        for k in range(FIVE_AXIS.count):
            v = np.diff(command[:, k])
            moving = np.flatnonzero(np.abs(v) > 1e-12)
            for i in moving[1:][np.diff(np.sign(v[moving])) != 0]:
                clear &= (time < time[i] - margin) | (time > time[i] + lag + margin)
        return clear

    return away


@pytest.fixture(scope="session")
def quiet(m1, bare):
    """M1 without any effect."""
    return bare(m1)


@pytest.fixture(scope="session")
def traces(cone):
    """``traces(machine, theta, balls, sensitive)``: readings in µm over the plot angle, (len(balls), 3600)."""

    phi = np.radians(ANGLE - 180.0) % (2 * np.pi)
    known = {}

    def run(machine, theta, balls, sensitive="perpendicular"):
        key = lambda ball: (repr(machine.drives), repr(machine.effects), theta, ball, sensitive)  # noqa: E731
        beta = {15: 10, 45: 30}[theta]
        new = [ball for ball in balls if key(ball) not in known]
        tests = [cone(theta, beta, ball, name=f"t{i}", sensitive=sensitive) for i, ball in enumerate(new)]
        for ball, s in zip(new, simulate(machine, tests) if tests else (), strict=True):
            known[key(ball)] = np.interp(phi, s.phi, s.deviation / UM)
        return np.array([known[key(ball)] for ball in balls])

    return run


@pytest.fixture(scope="session")
def caused(quiet, traces):
    """``caused(effects, theta, balls, sensitive)``: what the effects change in the reading of a machine that has
    nothing else.
    """

    def run(effects, theta, balls, sensitive="perpendicular"):
        machine = quiet
        for effect in effects:
            machine = machine.with_effect(effect)
        return traces(machine, theta, balls, sensitive) - traces(quiet, theta, balls, sensitive)

    return run
