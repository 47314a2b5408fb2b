"""Simulation of ball-bar tests in the multibody model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import mujoco
import numpy as np
from mujoco import rollout

from mjsim.errors import InputError, SimulationError
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.extras import need
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import read_along
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation import callback, mjmodel
from mjsim.simulation.axes import behind, own_effects, time_grid
from mjsim.simulation.drive import STEP, SUBSTEPS
from mjsim.simulation.stability import check_stable
from mjsim.simulation.transmission import MEMORY, apply_ops
from mjsim.units import DEG, MM, UM

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")


@dataclass(frozen=True)
class Simulation:
    """One simulated test on the engine's time grid.

    Attributes:
        test: the test. time: (n,) s from the program's start. phi: (n,) rad.
        command, position: commanded and actual (load-side) axis positions, (n, axes) m and rad, in the order of the
            test's chain.
        deviation: ball-bar reading, (n,) m, positive outward: distance of the two sites less the bar's length.
    """

    test: BallBarTest
    time: np.ndarray
    phi: np.ndarray
    command: np.ndarray
    position: np.ndarray
    deviation: np.ndarray

    def columns(self) -> dict[str, np.ndarray]:
        """Everything by name, (n,) each: time_s, phi_deg, deviation_um, then commanded and actual positions in mm
        and degrees.
        """
        units = {a.letter: ("deg", DEG) if a.rotary else ("mm", MM) for a in self.test.chain.axes}
        out = {"time_s": self.time, "phi_deg": self.phi / DEG, "deviation_um": self.deviation / UM}
        for what, q in (("command", self.command), ("actual", self.position)):
            out |= {
                f"{a}_{what}_{name}": x * (1 / size) for (a, (name, size)), x in zip(units.items(), q.T, strict=True)
            }
        return out

    def to_dataframe(self) -> pd.DataFrame:
        """:meth:`columns` as a table, one row per instant."""
        need("to_dataframe", "dataframe", "pandas")
        import pandas as pd

        return pd.DataFrame(self.columns())


def simulate(
    machine: Machine,
    tests: Iterable[BallBarTest],
    threads: int = 2,
    done: Callable[[BallBarTest], None] | None = None,
    step: float = STEP,
    substeps: int = SUBSTEPS,
) -> list[Simulation]:
    """Run tests of a machine in MuJoCo.

    Args:
        machine: drives and effects.
        tests: what to run. threads: tests run side by side (the compiled callback holds no GIL).
        done: called after each test, for progress. step, substeps: time discretisation, s and count.

    Raises:
        InputError: ``tests`` is a single test instead of a list.
        SimulationError: a drive is unstable, MuJoCo warned or a value is not finite.
    """
    if isinstance(tests, BallBarTest):
        raise InputError(f"simulate takes a list of tests; pass [test] for the single test {tests.name!r}")
    return simulate_each(machine, tests, lambda s: s, threads, done, step, substeps)


def simulate_each(
    machine: Machine | Plant,
    tests: Iterable[BallBarTest],
    keep: Callable[[Simulation], T],
    threads: int = 2,
    done: Callable[[BallBarTest], None] | None = None,
    step: float = STEP,
    substeps: int = SUBSTEPS,
) -> list[T]:
    """As :func:`simulate`, but only what ``keep`` makes of each test stays in memory; a plant that is built already
    serves as well.
    """
    plant = machine if isinstance(machine, Plant) else build(machine)
    check_stable(plant)
    with callback.silent():
        model = mjmodel.build_model(plant, step, substeps)
    tests = list(tests)
    check_axes(plant.chain, tests)

    together: dict[str | int, list[int]] = {}
    for k, test in enumerate(tests):  # coordinates of one recording are of one motion
        together.setdefault(test.recording if test.component else k, []).append(k)
    places = list(together.values())
    runs = [[tests[k] for k in mine] for mine in places]
    # in the calling thread, where calls of a user's own code have a time limit
    own = [own_effects(plant, r[0], _grid(Program(r[0]), step)) if plant.python_effects else None for r in runs]

    def one(readings: list[BallBarTest], added: np.ndarray | None) -> list[T]:
        out = [keep(s) for s in _run(prepare(model, plant, readings[0], step, added), readings)]
        if done:
            for test in readings:
                done(test)
        return out

    with callback.installed(), ThreadPoolExecutor(max(1, min(threads, len(runs)))) as pool:
        found = {
            k: x
            for mine, out in zip(places, pool.map(one, runs, own), strict=True)
            for k, x in zip(mine, out, strict=True)
        }
    return [found[k] for k in range(len(tests))]


def check_axes(chain: Chain, tests: Iterable[BallBarTest]) -> None:
    """Refuse tests of a machine with other axes than those of ``chain``.

    Raises:
        InputError: names the test and both configurations.
    """
    for test in tests:
        if test.chain != chain and test.chain.configuration == chain.configuration:
            raise InputError(
                f"test {test.name}: is of a machine whose axes have other directions, offsets or tool length; allowed: "
                "those of the machine which shall run it"
            )
        if test.chain != chain:
            raise InputError(
                f"test {test.name}: is of a machine with the configuration {test.chain.configuration!r}; "
                f"allowed: {chain.configuration!r}, that of the machine which shall run it"
            )


class Reading(NamedTuple):
    """What a comparison needs of a simulated test: ``deviation`` as in :class:`Simulation`."""

    test: BallBarTest
    deviation: np.ndarray


def reading_of(s: Simulation) -> Reading:
    """The reading alone, a thirteenth of a simulation's memory."""
    return Reading(s.test, s.deviation)


class Prepared(NamedTuple):
    """One test at rest: program, time grid (n,), its commands (n, axes), controls (n, nu) at every instant, model
    and data.
    """

    program: Program
    time: np.ndarray
    command: np.ndarray
    sent: np.ndarray
    model: mujoco.MjModel
    data: mujoco.MjData


def _grid(program: Program, step: float) -> np.ndarray:
    """Instants of a simulation, (n,) s."""
    return time_grid(program) if step == STEP else np.arange(int(np.ceil((program.duration + 0.1) / step)) + 1) * step


def prepare(
    model: mujoco.MjModel, plant: Plant, test: BallBarTest, step: float = STEP, added: np.ndarray | None = None
) -> Prepared:
    """One test ready to be stepped.

    Args:
        model: of the plant, as :func:`mjsim.simulation.mjmodel.build_model` makes it.
        plant: the machine's numbers.
        test: what is run.
        step: time step, s.
        added: what the user's own effects add to the axes, (n, axes) m and rad; computed where it is left out.
    """
    program = Program(test)
    time = _grid(program, step)
    command = program.commands(time)
    sent = behind(program, time, command, plant)
    ops = plant.op_table(test.recording, test.started)
    model = mjmodel.for_test(model, test, sent[0], ops)
    data = mujoco.MjData(model)
    if plant.python_effects:
        sent = np.hstack([sent, own_effects(plant, test, time) if added is None else added])
    set_at_rest(model, data, test, ops, sent[0])
    return Prepared(program, time, command, sent, model, data)


def set_at_rest(
    model: mujoco.MjModel, data: mujoco.MjData, test: BallBarTest, ops: np.ndarray, sent: np.ndarray
) -> None:
    """Put the joints of ``data`` where the machine rests on its first controls ``sent`` (nu,), with the operations
    ``ops`` of ``test``.
    """
    first = np.zeros(callback.MAX_JOINTS)
    count = test.chain.count
    first[:count] = sent[:count]
    apply_ops(ops, np.zeros((len(ops), MEMORY)), first, test.started, True)
    if len(sent) > count:
        first[:count] += sent[count:]
    block = model.numeric(callback.NUMERIC).data
    for i in range(int(block[callback.N_JOINTS])):
        data.qpos[int(block[callback.JOINTS + i])] = first[i]


def _run(ready: Prepared, readings: list[BallBarTest]) -> Iterator[Simulation]:
    """Step a motion, and what each reading of it shows."""
    program, time, command, sent, model, data = ready
    control = np.vstack([sent[1:], sent[-1:]])
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, initial, full)
    state, sensors = rollout.rollout(model, data, initial[None], control[None])
    q = np.vstack([initial[1 : 1 + model.nq], state[0, :-1, 1 : 1 + model.nq]])
    for test in readings:
        yield _collect(test, program, time, command, model, data, q, sensors[0])


def check_warnings(test: BallBarTest, data: mujoco.MjData) -> None:
    """Refuse a run in which MuJoCo warned.

    Raises:
        SimulationError: it did.
    """
    for kind, warning in zip(mujoco.mjtWarning.__members__, data.warning, strict=False):
        if warning.number:
            raise SimulationError(
                f"test {test.name}: MuJoCo gave up ({kind}): the bodies get forces that no machine has; "
                "check gains, inertias and friction of the drives and the sizes of the effects"
            )


def not_finite(test: BallBarTest) -> SimulationError:
    """What is wrong when a reading has numbers that are not finite."""
    return SimulationError(
        f"test {test.name}: the simulated reading is not finite; check gains and inertias of the drives"
    )


def _collect(
    test: BallBarTest, program: Program, time: np.ndarray, command: np.ndarray, model, data, q: np.ndarray, sensors
) -> Simulation:
    check_warnings(test, data)
    bar = np.hstack([sensors[:, sensor(model, n)] for n in mjmodel.BALLS])
    away = bar[:, :3] - bar[:, 3:]
    deviation = away @ read_along(test.component) if test.component else np.linalg.norm(away, axis=1) - test.length
    if not np.isfinite(deviation).all():
        raise not_finite(test)
    position = q[:, [model.joint(a).qposadr[0] for a in test.chain.letters]]
    return Simulation(test, time, program.phi(time), command, position, deviation)


def sensor(model: mujoco.MjModel, name: str) -> slice:
    """Where a position sensor's three numbers stand in the model's sensor data."""
    s = model.sensor(name)
    return slice(int(s.adr[0]), int(s.adr[0]) + 3)
