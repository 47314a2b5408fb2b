"""Runs of a sweep, one by one and as fast as their MuJoCo steps: everything that runs have in common is made once.

A run gives bit for bit the reading that :func:`mjsim.simulation.multibody.simulate` gives. What is shared: the commands
of a test, the compiled structure of a model (a run only rewrites its numbers), MuJoCo's data and the buffers of a
thread.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from mjsim.batch.figures import FIGURES, Circle, distance
from mjsim.batch.recipe import Recipe
from mjsim.errors import InputError, SimulationError
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.model import build
from mjsim.machine.plant import Plant
from mjsim.simulation import mjmodel
from mjsim.simulation.axes import delayed_commands, own_effects, time_grid
from mjsim.simulation.multibody import check_warnings, not_finite, sensor, set_at_rest
from mjsim.simulation.stability import check_stable
from mjsim.units import DEG, UM

_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_CTRL = int(mujoco.mjtState.mjSTATE_CTRL)


@dataclass(frozen=True)
class Job:
    """One test of one run: ``run`` and ``test`` count from 0; ``values`` and ``sheet`` are the run's, as
    :class:`Recipe` takes them.
    """

    run: int
    test: int
    conditions: BallBarTest
    values: np.ndarray
    sheet: np.ndarray | None


@dataclass(frozen=True)
class Outcome:
    """What came out of a job.

    Attributes:
        figures: (len(FIGURES),) µm, NaN where there is none. error: why the run has no figures, or ``None``.
        trace: (3, n) s, ° and µm, or ``None``.
    """

    run: int
    test: int
    duration: float
    figures: np.ndarray
    error: str | None = None
    trace: np.ndarray | None = None


class TestPlan:
    """What all runs of one test share: program, time grid, commands, controls, the measured part and its angles."""

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
        self.circle = Circle(self.phi[self.span], kind_of(test).goes_round)


def shifted(sent: np.ndarray) -> np.ndarray:
    """Controls (n, nu) as the steps need them: each step is told where to be at its end."""
    return np.ascontiguousarray(np.vstack([sent[1:], sent[-1:]]))


class _Kept:
    """The last few things made, by key; each is made once, also when several threads ask for it."""

    def __init__(self, size: int) -> None:
        self._size, self._kept, self._lock = size, OrderedDict(), threading.Lock()

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        with self._lock:
            if key not in self._kept:
                self._kept[key] = make()
                if len(self._kept) > self._size:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(key)
            return self._kept[key]


class Workshop:
    """Runs jobs of one sweep from any number of threads, inside :func:`mjsim.simulation.callback.installed`.

    Args:
        recipe: makes a run's machine. every: keep every so many ms of a trace; 0 keeps none.
    """

    def __init__(self, recipe: Recipe, every: int = 0) -> None:
        self._recipe, self._every = recipe, every
        self._plans = _Kept(4)
        self._mine = threading.local()

    def plan(self, test: BallBarTest) -> TestPlan:
        """What the runs of ``test`` share."""
        return self._plans.get(repr(test), lambda: TestPlan(test))

    def run(self, job: Job) -> Outcome:
        """Simulate one job; what goes wrong in it is part of the outcome."""
        plan = self.plan(job.conditions)
        try:
            plant = build(self._recipe.machine(job.values, job.sheet))
            deviation = self.deviation(plan, plant)
        except (InputError, SimulationError) as error:
            return Outcome(job.run, job.test, plan.program.duration, np.full(len(FIGURES), np.nan), str(error))
        trace = None
        if self._every:
            part = slice(plan.span.start, plan.span.stop, self._every)
            trace = np.stack([plan.time[part], plan.phi[part] / DEG, deviation[part] / UM])
        return Outcome(job.run, job.test, plan.program.duration, plan.circle.figures(deviation[plan.span]), None, trace)

    def deviation(self, plan: TestPlan, plant: Plant) -> np.ndarray:
        """Reading of one test, (n,) m, in a buffer of the calling thread that its next run overwrites.

        Raises:
            SimulationError: as :func:`mjsim.simulation.multibody.simulate`.
        """
        check_stable(plant)
        structure = mjmodel.structure_of(plant)
        base, own = mjmodel.compiled(structure)
        model = mjmodel.with_numbers(base, plant, own)
        data = self._data(structure, base)
        mujoco.mj_resetData(model, data)
        ops = plant.op_table(plan.test.name, plan.test.started)
        sent, control = self._controls(plan, plant)
        mjmodel.set_test(model, plan.test, sent[0, : plan.test.chain.count], ops)
        set_at_rest(model, data, plan.test, ops, sent[0])
        initial = np.zeros(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, initial, _STATE)
        n = len(plan.time)
        sensors = self._buffer("sensors", n * model.nsensordata).reshape(n, model.nsensordata)
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
        out = self._buffer("deviation", n)
        first, second = (sensor(model, name).start for name in mjmodel.BALLS)
        if not distance(sensors, first, second, plan.test.length, out):
            raise not_finite(plan.test)
        return out

    def _controls(self, plan: TestPlan, plant: Plant) -> tuple[np.ndarray, np.ndarray]:
        if not plant.python_effects and not any(a.delay for a in plant.axes.values()):
            return plan.commands, plan.control
        sent = delayed_commands(plan.program, plan.time, plant)
        if plant.python_effects:
            sent = np.hstack([sent, own_effects(plant, plan.test, plan.time)])
        return sent, shifted(sent)

    def _data(self, structure: mjmodel.Structure, model: mujoco.MjModel) -> mujoco.MjData:
        """MuJoCo's data of the calling thread for models of one structure."""
        if not hasattr(self._mine, "data"):
            self._mine.data, self._mine.buffers = _Kept(4), {}
            self._mine.rollout = rollout.Rollout(nthread=0)
        return self._mine.data.get(structure, lambda: mujoco.MjData(model))

    def _buffer(self, name: str, size: int) -> np.ndarray:
        """The first ``size`` numbers of a buffer of the calling thread that grows when it must."""
        buffers = self._mine.buffers
        if name not in buffers or len(buffers[name]) < size:
            buffers[name] = np.empty(size)
        return buffers[name][:size]
