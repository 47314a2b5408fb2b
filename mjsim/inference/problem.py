"""A campaign as an estimation problem: whitened residuals, nuisances, and derivatives with respect to the data sheet.

All columns are in m per standard deviation of their prior, so every prior is a unit normal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.sparse import block_diag, csr_array

from mjsim.campaign.model import Campaign
from mjsim.effects import registry
from mjsim.inference.data_sheet import LINEAR, calibrated, data_sheet, sheet_of
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.local_noise import LocalNoise, LouderPlace, Tiles
from mjsim.inference.noise import Noise, noises_of
from mjsim.inference.nuisance import TRIGGER, Nuisances, set_up_columns
from mjsim.inference.samples import GRID, GRID_STEPS, Samples, make_samples
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.inference.whitening import Whitening
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect
from mjsim.machine.kinematics import BarSensitivity
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation.axes import AxesMotion, motions_of
from mjsim.simulation.stability import check_stable
from mjsim.threads import Workers

#: Positions that differ by less, m or rad, are the same to an effect: a thousandth of a worm's tooth.
_SAME = 2e-5


class KeptChanges:
    """Changes of the readings by single effects at nearly the same positions of the axes, test by test; and derivatives
    by the numbers of effects on nearly the same drives.

    A fit asks for the same derivatives again and again. Its models move the axes by micrometres, and the numbers of
    most drives by next to nothing.
    """

    def __init__(self) -> None:
        self._positions: list[np.ndarray] = []
        self._changes: list[dict[tuple[str, str], np.ndarray]] = []
        self._by_drive: dict[tuple[int, str, tuple[str, ...]], tuple[np.ndarray, np.ndarray]] = {}

    def move_to(self, positions: Sequence[np.ndarray]) -> None:
        """Forget what was computed at other positions.

        Args:
            positions: Of the axes, one array (n, columns) a test, m and rad.
        """
        if not self._positions:
            self._positions, self._changes = list(positions), [{} for _ in positions]
        for k, (before, now) in enumerate(zip(self._positions, positions, strict=True)):
            if before.shape != now.shape or np.abs(now - before).max() > _SAME:
                self._positions[k], self._changes[k] = now, {}

    def of(self, k: int, effect: Effect) -> np.ndarray | None:
        """What ``effect`` alone adds to the reading of test ``k``, (n,) m, where it is kept."""
        return self._changes[k].get(_key(effect))

    def keep(self, k: int, effect: Effect, change: np.ndarray) -> None:
        """Keep what ``effect`` alone adds to the reading of test ``k``, (n,) m."""
        self._changes[k][_key(effect)] = change

    def of_drive(self, k: int, free: EffectVector, drive: np.ndarray) -> np.ndarray | None:
        """Derivatives of the reading of test ``k`` by the numbers of an effect on a drive, (m, n) m per typical size,
        where they are kept of nearly the same drive.

        Args:
            k: The test.
            free: The effect.
            drive: Numbers of the drive, (numbers,).
        """
        known, derivatives = self._by_drive.get((k, free.effect.key, free.names), (None, None))
        if known is None or known.shape != drive.shape or (np.abs(drive - known) > LINEAR * np.abs(known)).any():
            return None
        return derivatives

    def keep_drive(self, k: int, free: EffectVector, drive: np.ndarray, derivatives: np.ndarray) -> None:
        """Keep derivatives; arguments as of :meth:`of_drive`."""
        self._by_drive[k, free.effect.key, free.names] = drive, derivatives


def _key(effect: Effect) -> tuple[str, str]:
    return effect.id, repr(effect.values)


def sheet_plants(machine: Machine, axes: Iterable[str]) -> dict[int, tuple[Plant, float]]:
    """Plants with one number of some axes' data sheet moved, and by how many standard deviations, by its place in the
    data sheet.
    """
    sheet = sheet_of(machine)
    moves = np.diag([p.step for p in sheet])
    return {j: (build(calibrated(machine, moves[j])), p.step) for j, p in enumerate(sheet) if p.axis in axes}


@np.errstate(over="ignore", invalid="ignore")
def sheet_grid(
    motion: AxesMotion, sens: BarSensitivity, base: Plant, moved: dict[int, tuple[Plant, float]]
) -> np.ndarray:
    """Derivatives of one test's reading with respect to the data sheet, from ``base`` to each of ``moved``, (sheet, n)
    m per standard deviation on the GRID; zero for the others, not finite for an unstable drive. Single precision is
    enough for them, and a diagnosis keeps them all.
    """
    sheet = data_sheet(base.chain)
    out = np.zeros((len(sheet), len(motion.time[::GRID_STEPS])), np.float32)
    for j, (plant, step) in moved.items():
        axis = sheet[j].axis
        i = base.chain.index(axis)
        if motion.moves[i]:
            out[j] = sens.axes[:, i] * motion.motor_change(axis, base.axes[axis], plant.axes[axis], GRID_STEPS) / step
    return out


@dataclass(frozen=True)
class Problem:
    """Measured tests with everything that does not change while models are tried.

    Attributes:
        campaign: As it was read.
        tests: The measured tests.
        samples: Their traces in blocks, one per test.
        noises: Noise models of the block means, by name of the instrument.
        motions: The axes' motions, one per test.
        sensitivity: The reading's derivatives along each test, at the positions that the machine as given reaches.
        nuisances: Blocks of set-up and instrument.
        outliers: Number of disturbances left out, by test.
        workers: Work on the tests side by side.
        settings: What decides in a diagnosis.
        changes: What single effects change in the readings, as far as it was computed.
        whitening: What the errors are beyond the campaign's noise; ``None`` where there is nothing.
        local: Noise of the tests that are louder than the campaign at some places, by the place of the test.
    """

    campaign: Campaign
    tests: tuple[BallBarTest, ...]
    samples: tuple[Samples, ...]
    noises: Mapping[str, Noise]
    motions: tuple[AxesMotion, ...]
    sensitivity: tuple[BarSensitivity, ...]
    nuisances: Nuisances
    outliers: Mapping[str, int]
    workers: Workers
    settings: DiagnosisSettings
    changes: KeptChanges = field(default_factory=KeptChanges)
    whitening: Whitening | None = None
    local: Mapping[int, LocalNoise] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        campaign: Campaign,
        plant: Plant,
        threads: int = 2,
        block: float | None = None,
        keep_motions: bool = True,
        settings: DiagnosisSettings = DIAGNOSIS,
    ) -> Problem:
        """The measured tests of a campaign as they were read.

        Args:
            campaign: With at least one measured test.
            plant: Of the machine as given.
            threads: Tests that are worked on side by side.
            block: Length of an averaging block, s; otherwise by the tests' feeds.
            keep_motions: Without it, a test's motions are kept for one model only: a fifth of the memory.
            settings: What decides in a diagnosis.

        Raises:
            SimulationError: A drive is unstable.
        """
        check_stable(plant)
        # a user's plain-Python effect holds Python's lock, so that threads gain nothing, and has a time limit in the
        # calling thread only; one that is to be fitted is in no plant yet
        known = {*registry.kinds().values(), *map(type, plant.python_effects)}
        workers = Workers(1 if any(c.position_error is not Effect.position_error for c in known) else threads)
        campaign = campaign.in_motion
        tests = campaign.measured
        samples = make_samples(tests, campaign.traces, block)
        noises = noises_of(samples, campaign.instruments)
        motions = motions_of(tests) if keep_motions else motions_of(tests, keep=1, light=True)
        sensitivity = workers.map(lambda k: motions[k].sensitivity(plant, GRID_STEPS), range(len(tests)))
        nuisances = Nuisances.of_tests(tests, settings.trigger_limit)
        outliers = {t.name: 0 for t in tests}
        return cls(
            campaign, tests, tuple(samples), noises, motions, tuple(sensitivity), nuisances, outliers, workers, settings
        )

    def with_samples(
        self, samples: Sequence[Samples], tests: tuple[BallBarTest, ...], outliers: Mapping[str, int]
    ) -> Problem:
        """The problem with other samples of its tests; the noise model stays."""
        nuisances = Nuisances.of_tests(tests, self.settings.trigger_limit)
        return replace(self, samples=tuple(samples), tests=tests, nuisances=nuisances, outliers=outliers, local={})

    def only(self, places: Sequence[int]) -> Problem:
        """The problem with some of its tests; the noise model stays."""
        tests = tuple(self.tests[k] for k in places)
        motions, sensitivity = ([rows[k] for k in places] for rows in (self.motions, self.sensitivity))
        part = replace(self, motions=tuple(motions), sensitivity=tuple(sensitivity), changes=KeptChanges())
        outliers = {t.name: self.outliers[t.name] for t in tests}
        return part.with_samples([self.samples[k] for k in places], tests, outliers)

    def with_noises(self, noises: Mapping[str, Noise]) -> Problem:
        """The problem with other noise models, by name of the instrument; no place is louder than these yet."""
        return replace(self, noises=noises, local={})

    def with_noise_of_samples(self) -> Problem:
        """The problem with the noise estimated again, from its samples."""
        return self.with_noises(noises_of(self.samples, self.campaign.instruments))

    def without(self, parts: Sequence[np.ndarray]) -> Problem:
        """The problem with parts of the readings that are understood left out of the data.

        Args:
            parts: Per test what is left out of every sample, (n,) m.
        """
        samples = tuple(s.without(part) for s, part in zip(self.samples, parts, strict=True))
        return replace(self, samples=samples).with_noise_of_samples()

    def restored(self) -> Problem:
        """The problem with all that :meth:`without` left out, at the noise found without it."""
        return replace(self, samples=tuple(s.without(np.zeros(len(s.time))) for s in self.samples))

    def sample_residuals(self, readings: Sequence[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Measured less modelled, every sample, (n,) per test, m; what was left out of the data does not count.

        Args:
            readings: Simulated readings on the GRID, one per test, m.
            nuisance: (nuisances.size,) in prior standard deviations.
        """

        def one(k: int) -> np.ndarray:
            s = self.samples[k]
            modelled = s.sample_all(readings[k] + self.offsets(k, nuisance), self.shift(k, nuisance))
            return s.value - s.left_out - modelled

        return self.map(one)

    def map(self, work: Callable[[int], object]) -> list:
        """``work(k)`` for every test on the problem's threads, in order."""
        return self.workers.map(work, range(len(self.tests)))

    @property
    def noise(self) -> Noise:
        """Noise model of the first test."""
        return self.noise_of(0)

    def noise_of(self, k: int) -> Noise:
        """Noise model of test ``k``."""
        return self.noises[self.tests[k].instrument]

    @property
    def chain(self) -> Chain:
        """Axes of the machine that was measured."""
        return self.tests[0].chain

    @property
    def count(self) -> int:
        """Number of whitened residuals."""
        return sum(map(len, self._kept))

    @property
    def rows(self) -> list[slice]:
        """Which whitened rows are those of each test."""
        return [slice(int(a), int(b)) for a, b in pairwise(np.cumsum([0, *map(len, self._kept)]))]

    @cached_property
    def _kept(self) -> list[np.ndarray]:
        """Per test, the blocks that have a whitened residual."""
        return [np.flatnonzero(self.noise_of(k).rows(s)) for k, s in enumerate(self.samples)]

    def readings(self, plant: Plant, every: int = GRID_STEPS) -> list[np.ndarray]:
        """Simulated readings of all tests at every ``every``-th instant, m; on the GRID unless it is said."""
        return self.map(lambda k: self.motions[k].reading(plant, every))

    def shift(self, k: int, nuisance: np.ndarray) -> float:
        """Trigger shift of test ``k``, s."""
        return self.nuisances.trigger(nuisance, self.tests[k].recording)

    @cached_property
    def set_up(self) -> list[np.ndarray]:
        """Derivatives of every test's reading by its nuisances but for the trigger, on the GRID, (n, k) m per prior
        standard deviation.
        """
        out = []
        for test, sensitivity in zip(self.tests, self.sensitivity, strict=True):  # a worker may ask for it
            trace, time = self.campaign.traces[test.name], GRID * np.arange(len(sensitivity.table))
            shown = (
                np.column_stack([np.interp(time, trace.time, x) for x in trace.vector.T]) if test.component else None
            )
            out.append(set_up_columns(test, sensitivity, shown))
        return out

    def offsets(self, k: int, nuisance: np.ndarray) -> np.ndarray:
        """What set-up and instrument add to test ``k``'s reading, on the GRID, m."""
        return self.set_up[k] @ nuisance[self.nuisances.of_test(self.tests[k])[:-1]]

    def modelled(self, readings: Sequence[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Modelled block means of every test, m: simulated readings on the GRID with the nuisances
        (nuisances.size,) applied.
        """
        return self.map(lambda k: self.modelled_test(k, readings[k], nuisance))

    def modelled_test(self, k: int, reading: np.ndarray, nuisance: np.ndarray) -> np.ndarray:
        """Modelled block means of one test, (m,) m; arguments as of :meth:`modelled`."""
        return self.samples[k].sample(reading + self.offsets(k, nuisance), self.shift(k, nuisance))

    def residual(self, readings: Sequence[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Measured less modelled block means (m,) per test, m."""
        return [s.mean - x for s, x in zip(self.samples, self.modelled(readings, nuisance), strict=True)]

    def nuisance_columns(self, readings: Sequence[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Derivatives of the modelled block means, (m, k) per test, m per prior standard deviation.

        Columns are those of ``nuisances.of_test(test)``. The other nuisances do not reach that test: what is computed
        with these columns grows with the tests, not with their square.
        """
        return self.map(lambda k: self.nuisance_columns_of_test(k, readings[k], nuisance))

    def nuisance_columns_of_test(self, k: int, reading: np.ndarray, nuisance: np.ndarray) -> np.ndarray:
        """The same of one test, (m, k)."""
        s, shift = self.samples[k], self.shift(k, nuisance)
        late = -s.sample(np.gradient(reading + self.offsets(k, nuisance), GRID), shift) * TRIGGER
        return np.column_stack([*self.set_up_means(k, shift), late])

    def set_up_means(self, k: int, shift: float) -> list[np.ndarray]:
        """Block means (m,) of test ``k``'s :attr:`set_up` at a trigger shift, s, column by column."""
        return [
            self.samples[k].sample(column, shift) if column.any() else np.zeros(len(self.samples[k].centre))
            for column in self.set_up[k].T
        ]

    def whiten_nuisance(self, columns: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Per test, the places (k,) of its nuisances and their columns (rows of the test, k), whitened but for what the
        tests share.
        """
        parts = self.map(lambda k: self.whiten_test(k, columns[k]))
        return [(self.nuisances.of_test(t), part) for t, part in zip(self.tests, parts, strict=True)]

    def difference(
        self, base: Sequence[np.ndarray], other: Sequence[np.ndarray], nuisance: np.ndarray
    ) -> list[np.ndarray]:
        """``other - base`` as block means at the triggers of ``nuisance``, m."""
        return self.map(lambda k: self.samples[k].sample(other[k] - base[k], self.shift(k, nuisance)))

    def sheet_grids(self, machine: Machine, axes: Iterable[str] | None = None) -> list[np.ndarray]:
        """Derivative of the readings with respect to the data sheet of some axes (all), (sheet, n) per test on the
        GRID.

        In m per standard deviation. Only the changed axis is simulated; its motion enters through the reading's
        sensitivity. Columns of other axes are zero.
        """
        base = build(machine)
        moved = sheet_plants(machine, machine.chain.letters if axes is None else axes)

        return self.map(lambda k: sheet_grid(self.motions[k], self.sensitivity[k], base, moved))

    def sample_grids(self, grids: Sequence[np.ndarray], nuisance: np.ndarray) -> list[np.ndarray]:
        """Block means (m, columns) per test of readings' derivatives (columns, n) on the GRID, at the triggers of
        ``nuisance``.
        """

        def columns(k: int) -> np.ndarray:
            s, shift = self.samples[k], self.shift(k, nuisance)
            return np.column_stack([s.sample(g, shift) if g.any() else np.zeros(len(s.centre)) for g in grids[k]])

        return self.map(columns)

    def whiten(self, per_test: Sequence[np.ndarray]) -> np.ndarray:
        """Stack per-test block arrays (m,) or (m, k) into whitened rows (count,) or (count, k)."""
        out = self.whiten_tests(per_test)
        return out if self.whitening is None else self.whitening.of_all(out)

    def whiten_tests(self, per_test: Sequence[np.ndarray]) -> np.ndarray:
        """As :meth:`whiten`, but for what tests share."""
        return self.whiten_each(per_test.__getitem__, np.empty((self.count, *per_test[0].shape[1:])))

    def whiten_each(self, work: Callable[[int], np.ndarray], out: np.ndarray) -> np.ndarray:
        """As :meth:`whiten_tests`, of block arrays that ``work(k)`` makes test by test, into ``out``.

        Each test goes straight into its rows: wide columns fill hundreds of MB.
        """
        rows = self.rows

        def one(k: int) -> None:
            out[rows[k]] = self.whiten_test(k, work(k))

        self.map(one)
        return out

    @property
    def shared(self) -> tuple[np.ndarray, np.ndarray] | tuple[()]:
        """What tests share of their errors, as :class:`~mjsim.inference.design.Design` has it."""
        return self.whitening.shared if self.whitening is not None else ()

    @cached_property
    def filters(self) -> list[csr_array]:
        """What the noise model does to the blocks of each test, as sparse matrices."""
        out = [
            self.noise_of(k).filter(kept, len(s.centre))
            for k, (kept, s) in enumerate(zip(self._kept, self.samples, strict=True))
        ]
        return [csr_array(self.local[k].matrix() @ f) if k in self.local else f for k, f in enumerate(out)]

    @cached_property
    def filter(self) -> csr_array:
        """The same for the blocks of all tests, one test behind the other."""
        return csr_array(block_diag(self.filters, format="csr"))

    def whiten_sparse(self, columns: csr_array | np.ndarray) -> csr_array:
        """Rows (count, k), whitened by the campaign's noise alone, of block columns of all tests, one test below the
        other.
        """
        return csr_array(self.filter @ columns)

    def with_local_noise(self, local: Mapping[int, LocalNoise]) -> Problem:
        """The problem with tests that are louder than the campaign at some places, whitened by the noise alone."""
        return replace(self, local=local, whitening=None)

    def local_noise(self, k: int, rest: np.ndarray, basis: np.ndarray) -> LocalNoise | None:
        """Where test ``k`` is louder than the campaign, by what a model leaves; ``None`` where it is so nowhere.

        Args:
            k: The test.
            rest: What is left, whitened by the noise alone, (n,).
            basis: Orthonormal directions in which more than noise may be left, (n, m).
        """
        tiles = Tiles.of_test(len(rest), self.samples[k].block)
        across, known = rest - basis @ (basis.T @ rest), self.local.get(k)
        if known is None:
            across, basis = tiles.transformed(across), tiles.transformed(basis)
        else:
            across = across * known.level
        return LocalNoise.of_residual(tiles, across, 1.0 - np.square(basis).sum(axis=1))

    @property
    def local_rms(self) -> float:
        """RMS by which places of the tests are louder than the campaign, m."""
        louder = sum(self.local[k].variance - 1.0 for k in self.local) / len(self.tests)
        return self.noise.rms * float(np.sqrt(max(louder, 0.0)))

    def louder_places(self) -> tuple[LouderPlace, ...]:
        """Where tests are louder than the campaign, the loudest test first."""
        out = []
        for k, local in self.local.items():
            row, octave, level = local.loudest
            s, noise = self.samples[k], self.noise_of(k).rms
            louder = noise * float(np.sqrt(max(local.variance - 1.0, 0.0)))
            frequency = (0.5 * octave[0] / s.block, 0.5 * octave[1] / s.block)
            time = float(s.centre[self._kept[k][row]] - s.time[0])
            out.append(LouderPlace(self.tests[k].name, louder, time, frequency, level))
        return tuple(sorted(out, key=lambda place: -place.rms))

    def in_this_noise(self, rows: np.ndarray, other: Problem) -> np.ndarray:
        """Rows (count, k) that the noise alone has whitened, of those that the noise of ``other`` has whitened: the
        same samples with another local noise.
        """
        out = rows.copy(order="K")
        for k, at in enumerate(self.rows):
            before, now = other.local.get(k), self.local.get(k)
            if before is not None and now is not None:
                out[at] *= (before.level / now.level)[:, None]
            elif before is not None:
                out[at] = before.undone(rows[at])
            elif now is not None:
                out[at] = now.whitened(rows[at])
        return out

    def whitened_by(self, whitening: Whitening) -> Problem:
        """The problem with another whitening of what its errors are beyond the campaign's noise."""
        return replace(self, whitening=whitening)

    def whiten_further(self, rows: np.ndarray) -> np.ndarray:
        """Rows (count,) or (count, k) that the campaign's noise alone has whitened, as :meth:`whiten` gives them."""
        return rows if self.whitening is None else self.whitening.of_rows(self.rows, rows)

    def whiten_test(self, k: int, columns: np.ndarray) -> np.ndarray:
        """Whitened rows of block columns (m,) or (m, k) of one test, but for what it shares with other tests."""
        rows = self.noise_of(k).whiten(self.samples[k], columns, self._kept[k])
        rows = self.local[k].whitened(rows) if k in self.local else rows
        return rows if self.whitening is None else self.whitening.of_test(k, rows)
