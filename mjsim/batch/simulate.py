"""Simulations of a sweep, one by one and as fast as their MuJoCo steps: everything that runs have in common is made
once.

A run gives bit for bit the reading that :func:`mjsim.simulation.multibody.simulate` gives. What is shared: the commands
of a test, the compiled structure of a model (a run only rewrites its numbers), MuJoCo's data and the largest buffer of
a thread.
"""

from __future__ import annotations

import pickle
import threading
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from mujoco import rollout

from mjsim.batch.sweep import Job, Sweep
from mjsim.batch.tables import check_versions
from mjsim.errors import InputError, SimulationError
from mjsim.instruments.ball_bar.iso230 import least_squares_circle
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.kinematics import read_along
from mjsim.machine.model import build
from mjsim.machine.plant import Plant
from mjsim.simulation import callback, mjmodel
from mjsim.simulation.axes import delayed_commands, own_effects, time_grid
from mjsim.simulation.multibody import check_warnings, not_finite, sensor, set_at_rest
from mjsim.simulation.stability import check_stable
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, UM

#: Names of the figures of a reading, in their order.
FIGURES = (
    "circular_error_um",
    "radial_max_um",
    "radial_min_um",
    "centre_phi0_um",
    "centre_phi90_um",
    "rms_um",
    "max_um",
    "min_um",
)
_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_CTRL = int(mujoco.mjtState.mjSTATE_CTRL)
#: How many tests and structures of models are kept.
_KEPT = 4


@dataclass(frozen=True)
class Outcome:
    """What came out of a job.

    Attributes:
        job: Which simulation.
        duration: Of the test's program, s.
        figures: (len(FIGURES),) µm, NaN where there is none.
        error: Why the run has no figures, or ``None``.
        trace: (3, n) s, ° and µm, or ``None``.
    """

    job: Job
    duration: float
    figures: np.ndarray
    error: str | None = None
    trace: np.ndarray | None = None


class TestPlan:
    """What all runs of one test share: program, time grid, commands, controls, the measured part and its circle."""

    __test__ = False

    def __init__(self, test: BallBarTest) -> None:
        self.test = test
        self.program = Program(test)
        self.time = time_grid(self.program)
        self.commands = self.program.commands(self.time)
        self.phi = self.program.phi(self.time)
        self.control = shifted(self.commands)
        lo, hi = self.program.measured_span
        keep = np.flatnonzero((self.time >= lo) & (self.time <= hi))
        self.span = slice(int(keep[0]), int(keep[-1]) + 1)
        phi = self.phi[self.span]
        self._directions = np.column_stack([np.cos(phi), np.sin(phi)])
        self._centre = np.full((2, len(phi)), np.nan)
        try:
            if kind_of(test).goes_round and not test.component:
                least_squares_circle(phi, np.zeros(len(phi)))  # refuses an arc
                basis = np.column_stack([self._directions, np.ones(len(phi))])
                self._centre = np.linalg.solve(basis.T @ basis, basis.T)[:2]
        except InputError:
            pass

    def figures(self, deviation: np.ndarray) -> np.ndarray:
        """:data:`FIGURES` of a reading (n,) m over the measured part, in µm; NaN for what only a full circle has.

        They are those of :func:`mjsim.instruments.ball_bar.iso230.circular_figures`. The angles are the same in every
        run, so what takes the centre out of a reading is computed once.
        """
        centre = self._centre @ deviation
        radial = deviation - self._directions @ centre
        rms = np.sqrt(np.mean(deviation**2))
        iso = np.ptp(radial), radial.max(), radial.min(), *centre
        return np.array([*iso, rms, deviation.max(), deviation.min()]) / UM


def shifted(sent: np.ndarray) -> np.ndarray:
    """Controls (n, nu) as the steps need them: each step is told where to be at its end."""
    return np.ascontiguousarray(np.vstack([sent[1:], sent[-1:]]))


class Simulator:
    """Runs jobs of one sweep from any number of threads, inside :func:`mjsim.simulation.callback.installed`.

    Args:
        sweep: What is run.
    """

    def __init__(self, sweep: Sweep) -> None:
        self._sweep = sweep
        self._plan = lru_cache(_KEPT)(TestPlan)
        self._mine = threading.local()

    def run(self, job: Job) -> Outcome:
        """Simulate one job; what goes wrong in it is part of the outcome."""
        plan = self._plan(self._sweep.test_of(job))
        try:
            deviation = self._deviation(plan, build(self._sweep.machine(job.run)))
        except (InputError, SimulationError) as error:
            return Outcome(job, plan.program.duration, np.full(len(FIGURES), np.nan), str(error))
        trace = None
        if self._sweep.every:
            part = slice(plan.span.start, plan.span.stop, self._sweep.every)
            trace = np.stack([plan.time[part], plan.phi[part] / DEG, deviation[part] / UM])
        return Outcome(job, plan.program.duration, plan.figures(deviation[plan.span]), None, trace)

    def _deviation(self, plan: TestPlan, plant: Plant) -> np.ndarray:
        """Reading of one test, (n,) m.

        Raises:
            SimulationError: As :func:`mjsim.simulation.multibody.simulate`.
        """
        check_stable(plant)
        structure = mjmodel.structure_of(plant)
        base, own = mjmodel.compiled(structure)
        model = mjmodel.with_numbers(base, plant, own)
        if not hasattr(self._mine, "data"):
            self._mine.data = lru_cache(_KEPT)(lambda structure: mujoco.MjData(mjmodel.compiled(structure)[0]))
            self._mine.rollout, self._mine.sensors = rollout.Rollout(nthread=0), np.empty(0)
        data = self._mine.data(structure)
        mujoco.mj_resetData(model, data)
        ops = plant.op_table(plan.test.name, plan.test.started)
        sent, control = self._controls(plan, plant)
        mjmodel.set_test(model, plan.test, sent[0, : plan.test.chain.count], ops)
        set_at_rest(model, data, plan.test, ops, sent[0])
        initial = np.zeros(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, initial, _STATE)
        n, width = len(plan.time), model.nsensordata
        if len(self._mine.sensors) < n * width:
            self._mine.sensors = np.empty(n * width)
        sensors = self._mine.sensors[: n * width].reshape(n, width)
        self._mine.rollout.rollout(
            [model],
            [data],
            initial[None],
            control[None],
            control_spec=_CTRL,
            skip_checks=True,
            nstep=n,
            sensordata=sensors[None],
        )
        check_warnings(plan.test, data)
        first, second = (sensors[:, sensor(model, name)] for name in mjmodel.BALLS)
        away, component = first - second, plan.test.component
        deviation = away @ read_along(component) if component else np.linalg.norm(away, axis=1) - plan.test.length
        if not np.isfinite(deviation).all():
            raise not_finite(plan.test)
        return deviation

    def _controls(self, plan: TestPlan, plant: Plant) -> tuple[np.ndarray, np.ndarray]:
        if not plant.python_effects and not any(a.delay for a in plant.axes.values()):
            return plan.commands, plan.control
        sent = delayed_commands(plan.program, plan.time, plant)
        if plant.python_effects:
            sent = np.hstack([sent, own_effects(plant, plan.test, plan.time)])
        return sent, shifted(sent)


# -- on the workers of a cluster ---------------------------------------------------------------------------------------


def packed(sweep: Sweep) -> bytes:
    """A sweep for another computer; effects of the user's own travel as their code."""
    import cloudpickle

    return cloudpickle.dumps(sweep)


@lru_cache(2)
def _unpacked(sweep: bytes) -> Simulator:
    return Simulator(pickle.loads(sweep))


@one_blas_thread
def run_elsewhere(sweep: bytes, wanted: dict[str, str], job: Job) -> Outcome:
    """Simulate a job of a :func:`packed` sweep.

    Raises:
        InputError: Other versions are installed here than ``wanted``.
    """
    check_versions("that joined later", wanted)
    with callback.installed():
        return _unpacked(sweep).run(job)
