"""A campaign as an estimation problem: whitened residuals, nuisances, and derivatives with respect to the data sheet.

All columns are in m per standard deviation of their prior, so every prior is a unit normal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from mjsim.ballbar.measurement import BallBarTest
from mjsim.campaign.model import Campaign
from mjsim.effects import registry
from mjsim.estimation.data_sheet import SHEET, calibrated
from mjsim.estimation.nuisance import fit_nuisance
from mjsim.estimation.outliers import MOST_EVENTS, SAME_PLACE, largest_jump, leave_out_shorter_side, mark_outliers, readmit_outliers
from mjsim.estimation.samples import GRID, GRID_STEPS, Samples, estimate_noise, make_samples
from mjsim.machine.chain import AXES
from mjsim.machine.effect import Effect
from mjsim.machine.kinematics import BarSensitivity
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.stability import check_stable

#: Priors of the nuisances (measurement chain: "typically"), one standard deviation.
TABLE_BALL, SPINDLE_BALL, LENGTH, TRIGGER = 10e-6, 2e-6, 3e-6, 20e-3


@dataclass(frozen=True)
class NuisanceLayout:
    """Where each nuisance stands in the parameter vector."""

    setups: tuple[str, ...]
    tests: tuple[str, ...]

    @property
    def size(self) -> int:
        return 6 * len(self.setups) + 1 + len(self.tests)

    def setup(self, name: str) -> int:
        """First of the six offsets (table ball x y z, spindle ball x y z) of a set-up."""
        return 6 * self.setups.index(name)

    @property
    def length(self) -> int:
        return 6 * len(self.setups)

    def trigger(self, test: str) -> int:
        return self.length + 1 + self.tests.index(test)

    def of(self, test: BallBarTest) -> np.ndarray:
        """Where the nuisances stand that reach one test's reading, (8,): its set-up's six, the length, its trigger."""
        return np.append(self.setup(test.setup) + np.arange(6), [self.length, self.trigger(test.name)])


def sheet_plants(machine: Machine, axes: Iterable[str]) -> dict[int, Plant]:
    """Plants with one number of some axes' data sheet moved by its standard deviation, by its place in SHEET."""
    return {j: build(calibrated(machine, np.eye(len(SHEET))[j])) for j, p in enumerate(SHEET) if p.axis in axes}


def sheet_grid(motion: AxesMotion, sens: BarSensitivity, base: Plant, moved: dict[int, Plant]) -> np.ndarray:
    """Changes of one test's reading from ``base`` to each of ``moved``, (len(SHEET), n) m on the GRID; zero for the others."""
    out = np.zeros((len(SHEET), len(motion.time[::GRID_STEPS])))
    for j, plant in moved.items():
        axis = SHEET[j].axis
        i = AXES.index(axis)
        if motion.moves[i]:
            change = motion.motor(axis, plant.axes[axis], GRID_STEPS) - motion.motor(axis, base.axes[axis], GRID_STEPS)
            out[j] = sens.axes[:, i] * change
    return out


class Problem:
    """Measured tests with everything that does not change while models are tried.

    With ``keep_motions`` false it holds of every test's motions no more than one model needs: a fifth of the memory.

    Attributes:
        campaign: the campaign. samples: one entry per measured test. noise: the noise model.
        motions: axis motions per test. layout: the nuisances. sensitivity: the reading's derivatives along each test, at the
        positions that ``machine`` reaches.

    Raises:
        SimulationError: a drive of ``machine`` is unstable.
    """

    def __init__(
        self,
        campaign: Campaign,
        machine: Machine,
        threads: int = 2,
        block: float | None = None,
        outliers: bool = True,
        keep_motions: bool = True,
    ) -> None:
        self.campaign = campaign
        self.tests = campaign.measured
        self.samples: list[Samples] = make_samples(self.tests, campaign.traces, block)
        self.estimate_noise()
        self.layout = NuisanceLayout(tuple(dict.fromkeys(t.setup for t in self.tests)), tuple(t.name for t in self.tests))
        # a user's plain-Python effect holds Python's lock, so that threads gain nothing, and has a time limit in the calling thread only
        known = {*registry.kinds().values(), *map(type, machine.effects)}
        self._threads = 1 if any(cls.position_error is not Effect.position_error for cls in known) else threads
        self.motions = [AxesMotion(t) if keep_motions else AxesMotion(t, keep=1, light=True) for t in self.tests]
        plant = build(machine)
        check_stable(plant)
        self.outliers = {t.name: 0 for t in self.tests}
        self.sensitivity = self.map(lambda k: self.motions[k].sensitivity(plant, GRID_STEPS))
        if outliers:
            self.leave_out_outliers(plant)

    def estimate_noise(self) -> None:
        """Noise from the samples as they stand now."""
        self.noise = estimate_noise(self.samples, self.campaign.instrument.resolution)

    def leave_out_outliers(self, plant: Plant) -> None:
        """Mark what happened once: spikes, and what a knock has moved. ``plant`` is the machine's as given."""
        self._given = [s.valid.copy() for s in self.samples]
        readings = self.readings(plant)
        rest = self._rest(readings, fit_nuisance(self, readings))
        for s, r in zip(self.samples, rest, strict=True):
            self.outliers[s.test.name] = mark_outliers(s, r, self.noise.rms)
        for _ in range(MOST_EVENTS):
            jumps = {k: at for k, s in enumerate(self.samples) if (at := largest_jump(s, rest[k], self.noise.rms)) is not None}
            accidents = [k for k in jumps if not self._jumps_elsewhere(jumps, k)]
            for k in accidents:
                if leave_out_shorter_side(self.samples[k], jumps[k], rest[k]):
                    self._give_own_setup(k)
                self.outliers[self.tests[k].name] += 1
            if not accidents:
                break
        if any(self.outliers.values()):
            self.estimate_noise()

    def _rest(self, readings: list[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Measured less modelled, every sample, (n,) per test, m."""
        return [
            s.value - s.known - s.sample_all(readings[k] + self.offsets(k, nuisance), self.shift(k, nuisance))
            for k, s in enumerate(self.samples)
        ]

    def readmit_outliers(self, readings: list[np.ndarray], nuisance: np.ndarray) -> bool:
        """Count disturbances again that a fitted model follows; whether there were any. Fits made before have other rows then."""
        found = 0
        for s, given, r in zip(self.samples, self._given, self._rest(readings, nuisance), strict=True):
            back = readmit_outliers(s, given, r, self.noise.rms)
            self.outliers[s.test.name] = max(0, self.outliers[s.test.name] - back)
            found += back
        return found > 0

    def _give_own_setup(self, k: int) -> None:
        """Give the test, of which the part after a knock is kept, ball offsets of its own."""
        t = self.tests[k]
        tests = [*self.tests[:k], replace(t, setup=f"{t.name} after a knock"), *self.tests[k + 1 :]]
        self.tests = tuple(tests)
        self.layout = NuisanceLayout(tuple(dict.fromkeys(t.setup for t in tests)), tuple(t.name for t in tests))

    def _jumps_elsewhere(self, jumps: dict[int, int], k: int) -> bool:
        """Whether another test jumps at the same position of a rotary axis that moves there: then it is no accident."""

        def place(j: int) -> np.ndarray:
            return self.motions[j].program.commands(self.samples[j].time[[jumps[j]]])[0, 3:]

        moving = self.motions[k].moves[3:]
        return any(j != k and (moving & (np.abs(place(j) - place(k)) < SAME_PLACE)).any() for j in jumps)

    def map(self, work: Callable[[int], object]) -> list:
        """``work(k)`` for every test on the problem's threads, in order."""
        if self._threads == 1:
            return [work(k) for k in range(len(self.tests))]
        with ThreadPoolExecutor(self._threads) as pool:
            return list(pool.map(work, range(len(self.tests))))

    @property
    def count(self) -> int:
        """Number of whitened residuals."""
        return int(sum(self.noise.rows(s).sum() for s in self.samples))

    def readings(self, plant: Plant) -> list[np.ndarray]:
        """Simulated readings of all tests on the GRID, m."""
        return self.map(lambda k: self.motions[k].reading(plant, GRID_STEPS))

    def shift(self, k: int, nuisance: np.ndarray) -> float:
        """Trigger shift of test ``k``, s."""
        return float(TRIGGER * nuisance[self.layout.trigger(self.tests[k].name)])

    def offsets(self, k: int, nuisance: np.ndarray) -> np.ndarray:
        """What the set-up's ball offsets and the bar's length add to test ``k``'s reading, on the GRID, m."""
        at = self.layout.setup(self.tests[k].setup)
        sens = self.sensitivity[k]
        return (
            sens.table @ (TABLE_BALL * nuisance[at : at + 3])
            + sens.spindle @ (SPINDLE_BALL * nuisance[at + 3 : at + 6])
            + LENGTH * nuisance[self.layout.length]
        )

    def modelled(self, readings: list[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Modelled block means of every test, m: simulated readings on the GRID with the nuisances (layout.size,) applied."""
        return self.map(lambda k: self.samples[k].sample(readings[k] + self.offsets(k, nuisance), self.shift(k, nuisance)))

    def residual(self, readings: list[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Measured less modelled block means (m,) per test, m."""
        return [s.mean - x for s, x in zip(self.samples, self.modelled(readings, nuisance), strict=True)]

    def nuisance_columns(self, readings: list[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Derivative of the modelled block means, (m, 8) per test, m per prior standard deviation, with respect to ``layout.of(test)``.

        The others are zero: what is computed with these columns grows with the tests, not with their square.
        """

        def columns(k: int) -> np.ndarray:
            s, sens, shift = self.samples[k], self.sensitivity[k], self.shift(k, nuisance)
            out = np.empty((len(s.centre), 8))
            for j in range(3):
                out[:, j] = s.sample(sens.table[:, j], shift) * TABLE_BALL
                out[:, 3 + j] = s.sample(sens.spindle[:, j], shift) * SPINDLE_BALL
            out[:, 6] = LENGTH
            total = readings[k] + self.offsets(k, nuisance)
            out[:, 7] = -s.sample(np.gradient(total, GRID), shift) * TRIGGER
            return out

        return self.map(columns)

    def whiten_nuisance(self, columns: list[np.ndarray]) -> np.ndarray:
        """Whitened rows (count, layout.size) of :meth:`nuisance_columns`."""
        parts = self.map(lambda k: self.noise.whiten(self.samples[k], columns[k]))
        out, row = np.zeros((sum(map(len, parts)), self.layout.size)), 0
        for t, part in zip(self.tests, parts, strict=True):
            out[row : row + len(part), self.layout.of(t)] = part
            row += len(part)
        return out

    def difference(self, base: list[np.ndarray], other: list[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """``other - base`` as block means at the triggers of ``nuisance``, m."""
        return self.map(lambda k: self.samples[k].sample(other[k] - base[k], self.shift(k, nuisance)))

    def sheet_grids(self, machine: Machine, axes: Iterable[str] = AXES) -> list[np.ndarray]:
        """Derivative of the readings with respect to the data sheet of some axes, (n, len(SHEET)) per test on the GRID.

        In m per standard deviation. Only the changed axis is simulated; its motion enters through the reading's sensitivity.
        Columns of other axes are zero.
        """
        base = build(machine)
        moved = sheet_plants(machine, axes)

        return self.map(lambda k: sheet_grid(self.motions[k], self.sensitivity[k], base, moved))

    def sample_grids(self, grids: list[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Block means (m, columns) per test of readings' derivatives (columns, n) on the GRID, at the triggers of ``nuisance``."""

        def columns(k: int) -> np.ndarray:
            s, shift = self.samples[k], self.shift(k, nuisance)
            return np.column_stack([s.sample(g, shift) if g.any() else np.zeros(len(s.centre)) for g in grids[k]])

        return self.map(columns)

    def whiten(self, per_test: list[np.ndarray]) -> np.ndarray:
        """Stack per-test block arrays (m,) or (m, k) into whitened rows (count,) or (count, k)."""
        kept = [np.flatnonzero(self.noise.rows(s)) for s in self.samples]
        ends = np.cumsum([0, *map(len, kept)])
        out = np.empty((ends[-1], *per_test[0].shape[1:]))

        def one(k: int) -> None:  # each test straight into its rows: wide columns fill hundreds of MB
            out[ends[k] : ends[k + 1]] = self.noise.whiten(self.samples[k], per_test[k], kept[k])

        self.map(one)
        return out
