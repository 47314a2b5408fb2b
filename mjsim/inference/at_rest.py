"""What is missing from a machine's model, from values that were measured while it stood still.

Findings are searched for and read as on ball-bar tests (:mod:`mjsim.inference.search`,
:mod:`mjsim.inference.findings`). What is different is the data. There are few values, and their noise is white. What
the set-up does is linear. What another instrument has found is further rows of the same least squares. And what is in
no model depends on the place:

    value = reading(machine) + set-up + d + e,   Cov d = σ_s² K + σ_r² P

``K`` falls smoothly with the distance of two positions, ``P`` is 1 for repeats of one place and 0 otherwise; both are
0 between different channels. Where the times of the values were recorded, half of ``K`` falls with the time between
them in the place of the distance: a machine drifts in other ways than its sensors and an exponential do. With a half-
Cauchy prior of both sizes, d is zero where the model explains everything. Where it is not, intervals grow by it, and
the machine is called unknown.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.effects import registry
from mjsim.inference.budget import Budget, Split, budgets, split_rows
from mjsim.inference.calibration import expected_effects
from mjsim.inference.considered import TEMPERATURE, consider, following
from mjsim.inference.data_sheet import data_sheet
from mjsim.inference.design import Design
from mjsim.inference.discrepancy import USUAL, Discrepancy, Sizes
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.findings import Explained, Reader, UnknownCauses, Verdicts
from mjsim.inference.fit import Fit
from mjsim.inference.hypotheses import Hypotheses, entries_of
from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.linear_model import Products
from mjsim.inference.nuisance import Nuisances
from mjsim.inference.outcome import FoundEffect
from mjsim.inference.parameters import Block
from mjsim.inference.posterior import Posterior
from mjsim.inference.search import Found, Model, Search
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.inference.signatures import Bank, Candidate, Projector, seeds
from mjsim.inference.testability import detection_limits
from mjsim.inference.whitening import Whitening
from mjsim.instruments.base import INSTRUMENTS, Stops
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.progress import Progress, silent
from mjsim.simulation.standing import standing
from mjsim.units import DEG

#: Distance over which the smooth discrepancy is correlated, m and rad (assumed: a third of a small machine's travel).
_NEAR_LINEAR, _NEAR_ROTARY = 0.15, 45.0 * DEG
#: Time over which a drift is correlated, s (assumed: a spindle takes a quarter of an hour to warm up).
_DRIFTS = 900.0
#: Sizes of the discrepancy over which its probability is summed, in standard deviations of the noise: from such a one
#: on it is a misfit, and the machine unknown where that is more likely than not.
_SIZES, _MISFIT, _LIKELY = (0.0, *(0.5 * 2.0**k for k in range(11))), 1.0, 0.5
#: Step of derivatives, typical sizes; RMS of a column, m, below which an effect does not show.
_STEP, _VISIBLE = 0.02, 1e-10
#: Fall of the objective at which a fit ends.
_CONVERGED = 1e-3
#: Orders per turn in which the position of a rotary axis may be wrong: eccentric encoder or wheel, and its like.
_LOW_ORDERS = (1, 2, 3, 4)


@dataclass(frozen=True)
class SampleNoise:
    """White noise.

    Attributes:
        deviation: Standard deviation of every value, (m,) SI.
    """

    deviation: np.ndarray

    @property
    def rms(self) -> float:
        """Of a usual value, SI; values may have different units."""
        return float(np.median(self.deviation))


@dataclass(frozen=True)
class RestProblem:
    """Measured tests of instruments that measure while the machine stands still.

    Attributes:
        campaign: The tests of these instruments alone.
        stops: Where the machine stands, by test.
        value: Measured, all tests and channels one after another, (m,) SI.
        noise: Of each.
        columns: Of set-ups and instrument, one prior standard deviation each, (m, k) SI.
        nuisances: Their blocks.
        units: Of the nuisances, in the units of their names, (k,).
        smooth: Correlation of the smooth discrepancy, (m, m).
        same: That of the rough one, (m, m).
        settings: What counts as testable and as open.
        known: What another instrument has found about the machine.
        whitening: What the errors are beyond the noise; ``None`` where there is nothing.
    """

    campaign: Campaign
    stops: Mapping[str, Stops]
    value: np.ndarray
    noise: SampleNoise
    columns: np.ndarray
    nuisances: Nuisances
    units: np.ndarray
    smooth: np.ndarray
    same: np.ndarray
    settings: DiagnosisSettings = DIAGNOSIS
    known: Known | None = None
    whitening: Whitening | None = None

    @classmethod
    def of(cls, campaign: Campaign, settings: DiagnosisSettings = DIAGNOSIS) -> RestProblem:
        """The measured tests of a campaign.

        Args:
            campaign: Its tests are all of instruments that measure at rest.
            settings: What counts as testable and as open.
        """
        tests = campaign.measured
        stops: dict[str, Stops] = {}
        values, noises, places, channels, rows, hours = [], [], [], [], [], []
        numbers: dict[tuple[str, str], int] = {}  # of channels: the same one in several tests
        for t in tests:
            instrument, recording = INSTRUMENTS[t.instrument], campaign.traces[t.name]
            data = campaign.instruments[t.instrument]
            seen, found = instrument.observe(t, recording), instrument.stops(t, recording)
            assert found is not None and seen.valid.all()
            stops[t.name] = found
            n, k = seen.value.shape
            values.append(seen.value.ravel())
            noises.append(np.tile(instrument.noise(t, recording, data), n))
            first = found.at[:, 0]
            where = np.hstack([found.route[first], found.route[np.maximum(first - 1, 0)]])
            places.append(np.repeat(where, k, axis=0))
            hours.append(np.repeat(found.clock[first], k))
            mine = [numbers.setdefault((t.instrument, c.name), len(numbers)) for c in instrument.channels(t)]
            channels.append(np.tile(mine, n))
            rows.append((t, instrument.nuisances_of(t, recording, seen.time, data)))
        blocks: dict[str, tuple[str, ...]] = {}
        for t, n in rows:
            own = tuple(name for name in n.names if name not in n.shared)
            for block, labels in ((f"set-up {t.setup}", own), (INSTRUMENTS[t.instrument].noun, n.shared)):
                blocks[block] = tuple(dict.fromkeys([*blocks.get(block, ()), *labels]))
        # a fit asks for no more of the ball bar's blocks than that they are blocks
        nuisances = Nuisances(tuple(Block.normal(name, labels) for name, labels in blocks.items() if labels))
        units, parts = np.zeros(nuisances.size), []
        for t, n in rows:
            part = np.zeros((n.columns.shape[0] * n.columns.shape[1], nuisances.size))
            for i, name in enumerate(n.names):
                at = nuisances.place(INSTRUMENTS[t.instrument].noun if name in n.shared else f"set-up {t.setup}", name)
                units[at] = n.spread[i]
                part[:, at] = n.columns[:, :, i].ravel() * n.spread[i]
            parts.append(part)
        chain, where, channel = tests[0].chain, np.vstack(places), np.concatenate(channels)
        equal = channel[:, None] == channel
        here = where[:, : chain.count]
        turn = here[:, None, chain.rotary_columns] - here[None, :, chain.rotary_columns]
        way = here[:, None, chain.linear_columns] - here[None, :, chain.linear_columns]
        distance = (2.0 * np.sin(0.5 * turn) / _NEAR_ROTARY) ** 2
        square = distance.sum(axis=2) + (way / _NEAR_LINEAR).__pow__(2).sum(axis=2)
        smooth = np.exp(-0.5 * square)
        hour = np.concatenate(hours)
        if np.ptp(hour) > 0.0:
            smooth = 0.5 * (smooth + np.exp(-np.abs(hour[:, None] - hour) / _DRIFTS))
        same = np.abs(where[:, None] - where[None]).max(axis=2) < 1e-5
        return cls(
            campaign,
            stops,
            np.concatenate(values),
            SampleNoise(np.concatenate(noises)),
            np.vstack(parts),
            nuisances,
            units,
            equal * smooth,
            (equal & same).astype(float),
            settings,
        )

    @property
    def values_of(self) -> dict[str, slice]:
        """Places of the values of every test, by its name."""
        tests = self.campaign.measured
        sizes = [len(self.stops[t.name].at) * len(INSTRUMENTS[t.instrument].channels(t)) for t in tests]
        ends = np.cumsum([0, *sizes])
        return {t.name: slice(int(a), int(b)) for t, (a, b) in zip(tests, pairwise(ends), strict=True)}

    @property
    def rows(self) -> list[slice]:
        """Rows of the values, and of what another instrument has found."""
        m = len(self.value)
        return [slice(0, m)] if self.known is None else [slice(0, m), slice(m, m + len(self.known.root))]

    @cached_property
    def discrepancy(self) -> Discrepancy:
        """What the values may show that is in no model. Its sizes are those of a value with the usual noise; of others
        it has in proportion. What another instrument has found is as sure as it says.
        """
        usual = self.noise.rms**2
        basis, slow, fast = [np.eye(len(self.value))], [self.smooth / usual], [self.same / usual]
        if self.known is not None:
            further = len(self.known.root)
            basis.append(np.eye(further))
            slow.append(np.zeros((further, further)))
            fast.append(np.zeros((further, further)))
        return Discrepancy(basis, slow, fast)

    @property
    def local_rms(self) -> float:
        """Readings at rest are as loud everywhere, m."""
        return 0.0

    def whitened_by(self, whitening: Whitening) -> RestProblem:
        """The problem with another whitening of what its errors are beyond the noise."""
        return replace(self, whitening=whitening)

    def whiten_further(self, rows: np.ndarray) -> np.ndarray:
        """Rows (count,) or (count, k) over the noise, with all of the whitening."""
        return rows if self.whitening is None else self.whitening.of_rows(self.rows, rows)

    def in_noise(self, columns: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
        """Rows over the noise, (count, k).

        Args:
            columns: Of the values, (m, k) SI.
            known: Those of what another instrument has found; zero without.
        """
        if self.known is not None and known is None:
            known = np.zeros((len(self.known.root), columns.shape[1]))
        rows = columns / self.noise.deviation[:, None]
        return rows if known is None else np.vstack([rows, known])

    def readings(self, machine: Machine) -> np.ndarray:
        """What an ideal instrument shows of a machine, (m,) SI."""
        return self.readings_of(build(machine))

    def readings_of(self, plant: Plant) -> np.ndarray:
        """What an ideal instrument shows of a machine's numbers, (m,) SI."""
        out = []
        for t in self.campaign.measured:
            stood = standing(plant, self.stops[t.name], t.name)
            out.append(INSTRUMENTS[t.instrument].reading_at(t, stood, plant.geometry, self.stops[t.name]).ravel())
        return np.concatenate(out)

    def columns_of(self, machine: Machine, f: EffectVector, base: np.ndarray) -> np.ndarray:
        """Derivatives of the readings by the entries of an effect, (m, n) SI per typical size.

        Args:
            machine: Without the effect, or with it as ``f`` has it.
            f: The effect.
            base: Readings of the machine with the effect as it is, (m,) SI.
        """
        out = []
        for j in range(len(f.vector)):
            effect, change = f.nudged(j, _STEP)
            out.append((self.readings(machine.with_effect(effect)) - base) / change)
        return np.column_stack(out)

    @property
    def clock(self) -> np.ndarray:
        """Campaign clock of every value, (m,) s."""
        out = []
        for t in self.campaign.measured:
            s = self.stops[t.name]
            out.append(np.repeat(s.clock[s.at[:, 0]], len(INSTRUMENTS[t.instrument].channels(t))))
        return np.concatenate(out)

    def temperatures(self, fit: Fit) -> np.ndarray | None:
        """What errors of the temperatures make of the values, whitened, one standard deviation a column, (count, k);
        ``None`` where a model follows no sensor.
        """
        sensors, t = following(fit), fit.machine.temperatures
        if t is None or not sensors:
            return None
        columns, base, always = [], self.readings(fit.machine), np.array([0.0, 1.0])
        for sensor, moved in sensors.items():
            plant, u = build(fit.machine), t.uncertainty(sensor)
            for axis, size in moved:
                plant.follow("thermal_expansion", axis, u * size, always, np.ones(2))
            columns.append((self.readings_of(plant) - base)[:, None] * t.weights(sensor, self.clock))
        return self.whiten_further(self.in_noise(np.hstack(columns)))

    def shows(self, machine: Machine, f: EffectVector) -> bool:
        """Whether an effect changes anything in the values."""
        if not f.effect.search.quasi_static:
            return False
        machine = machine.with_effect(f.effect)
        columns = self.columns_of(machine, f, self.readings(machine))
        return bool(np.sqrt((columns**2).mean(axis=0)).max() > _VISIBLE)


@dataclass(frozen=True)
class Known:
    """What another instrument says of some effects, as further rows of the least squares.

    Attributes:
        effects: As it has found them.
        root: Its square and nothing else is the information about their entries, (rows, k).
        value: ``root`` times what it has found, (rows,).
    """

    effects: tuple[EffectVector, ...]
    root: np.ndarray
    value: np.ndarray

    @classmethod
    def of(cls, posterior: Posterior, keys: Collection[str]) -> Known | None:
        """What the data of another instrument say by themselves: its posterior without its priors.

        Args:
            posterior: Of the other instrument.
            keys: Of the effects; the others are marginalised.
        """
        mine = [(f, at) for f, at in posterior.blocks if f.effect.key in keys]
        if not mine:
            return None
        blocks = [f.block for f, _ in mine]
        own = np.concatenate([np.where(b.informative, 1.0, 0.0) / b.deviation**2 for b in blocks])
        covariance = posterior.part([i for _, at in mine for i in at])
        whole = np.linalg.inv(0.5 * (covariance + covariance.T))
        values, vectors = np.linalg.eigh(whole - np.diag(own))
        kept = values > 1e-6 * max(float(values.max()), 1.0)
        right = whole @ np.concatenate([f.vector for f, _ in mine]) - own * np.concatenate([b.mean for b in blocks])
        root = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
        return cls(tuple(f for f, _ in mine), root, (vectors[:, kept].T @ right) / np.sqrt(values[kept]))

    def rows(self, fit: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Columns of everything (rows, p), and residual (rows,). An effect that the model lacks is off."""
        have, at = {f.effect.key: f for f in fit.effects}, 0
        columns, residual = np.zeros((len(self.root), fit.parameters.size)), self.value.copy()
        for f in self.effects:
            own, value = self.root[:, at : at + len(f.vector)], f.off.copy()
            at += len(f.vector)
            now = have.get(f.effect.key)
            if now is not None:
                mine, theirs = _same_entries(f, now)
                value[mine] = now.vector[theirs]
                columns[:, fit.parameters[now.block.name].start + theirs] = own[:, mine]
            residual -= own @ value
        return columns, residual


def _same_entries(f: EffectVector, other: EffectVector) -> tuple[np.ndarray, np.ndarray]:
    """Places of the entries that two vectors of one effect have in common: in the one, and in the other."""
    if f.names != ("components",):
        return np.arange(len(f.vector)), np.arange(len(f.vector))
    orders, others = ([row[0] for row in x.effect.values["components"]] for x in (f, other))
    pairs = [(2 * i + k, 2 * others.index(n) + k) for i, n in enumerate(orders) if n in others for k in (0, 1)]
    mine, theirs = np.array(pairs, int).reshape(-1, 2).T
    return mine, theirs


class RestFitter:
    """Fits models of one machine to values at rest: Gauss-Newton steps.

    Args:
        problem: The measured tests.
        machine: As given.
    """

    def __init__(self, problem: RestProblem, machine: Machine) -> None:
        self.problem, self.machine = problem, machine

    def with_problem(self, problem: RestProblem) -> RestFitter:
        """The same with another whitening."""
        return RestFitter(problem, self.machine)

    def fit(
        self,
        effects: Sequence[EffectVector],
        start: Fit | None = None,
        iterations: int = 6,
        exact: bool = True,
        fresh: bool = True,
    ) -> Fit:
        """Effects fitted with the set-up.

        Args:
            effects: What is free, at its starting values.
            start: An earlier fit to start from.
            iterations: Steps at most.
            exact: Means nothing here: every fit is exact.
            fresh: Means nothing here: the set-up is linear.
        """
        p, numbers = self.problem, len(data_sheet(self.machine.chain))
        nuisance = p.nuisances.mean if start is None else start.nuisance
        now = self._evaluated(
            Fit(self.machine, tuple(effects), p.nuisances, nuisance, np.zeros(numbers), np.ones(numbers, bool))
        )
        for _ in range(iterations):
            trial = self._evaluated(now.moved(now.step))
            fall = now.objective - trial.objective
            now = trial if fall > 0.0 else now
            if fall < _CONVERGED:
                break
        return now

    def _evaluated(self, fit: Fit) -> Fit:
        """A fit with residual, design and Gauss-Newton step."""
        p, machine, n = self.problem, fit.machine, self.problem.nuisances.size
        base = p.readings(machine)
        sheet = np.zeros((len(p.value), len(fit.sheet_deviation)))
        columns = np.hstack([p.columns, sheet, *(p.columns_of(machine, f, base) for f in fit.effects)])
        rest = p.value - base - p.columns @ fit.nuisance
        known = None if p.known is None else np.column_stack(p.known.rows(fit))
        white = p.whiten_further(p.in_noise(np.column_stack([columns, rest]), known))
        blocks = [(np.arange(n), white[at, :n]) for at in p.rows]
        design, residual = Design(blocks, n, white[:, n:-1]), white[:, -1]
        squares = float(residual @ residual)
        made = replace(
            fit, residual=residual, design=design, whitening=p.whitening, sum_squares=squares, readings=(base,)
        )
        made = replace(made, objective=squares + made.parameters.penalty(made.vector))
        made = replace(made, equations=LeastSquares.of_design(made.parameters, design))
        return replace(made, step=made.linear.step(design.T @ residual, made.vector))


class RestSearch(Search[RestProblem]):
    """One search on values at rest.

    Args:
        problem: The measured tests.
        machine: As given.
        posterior: What another instrument has found.
        progress: Called as work gets on.
    """

    def __init__(
        self, problem: RestProblem, machine: Machine, posterior: Posterior | None = None, progress: Progress = silent
    ) -> None:
        self.expected = [c for c in expected_effects(machine) if problem.shows(machine, c.free)]
        self.found_before = [f for f in posterior.effects if problem.shows(machine, f)] if posterior else []
        if posterior is not None:
            problem = replace(problem, known=Known.of(posterior, {f.effect.key for f in self.found_before}))
        self._bank: tuple[Bank, Products] | None = None
        super().__init__(RestFitter(problem, machine), progress)

    def run(self) -> Found[RestProblem]:
        """The best model."""
        model = self._searched(self._begun(self.expected))
        # few values seldom decide between a cause and a discrepancy by the odds of a step: the likelier is taken
        hypotheses = self._hypotheses(model, curves=False)
        sets = [(none, linear, linear.best_set(hypotheses.present)) for none, linear, _ in hypotheses.levels]
        level = int(np.argmax([none + linear.total(chosen) for none, linear, chosen in sets]))
        trial = self._fitted(model, (hypotheses, sets[level][-1], level))
        model = max(model, trial, key=lambda m: m.evidence)
        start = RestFitter(replace(self.plain, known=None), self.machine).fit([])
        return Found(start, model, self.signatures_at(model)[0], self.trail)

    def _discrepancy(self) -> Discrepancy:
        return self.plain.discrepancy

    def _first(self, effects: Sequence[EffectVector]) -> Fit:
        """Effects fitted from the machine as given, with those that another instrument has found."""
        known = {c.key: c for c in self.expected}
        every = {f.effect.key: f for f in effects}
        for f in self.found_before:
            mine = known.get(f.effect.key)
            every[f.effect.key] = f if mine is None else f.with_prior(*mine.prior_of(f)[:2])
        return self.fitter.fit(list(every.values()))

    def signatures_at(self, model: Model[RestProblem]) -> tuple[Bank, Products]:
        """Signatures of what may be missing, computed once, with their products."""
        if self._bank is None:
            bank = self._signatures(model.fit.machine, {c.key for c in self.expected})
            self._bank = bank, Products(self.discrepancy, bank.matrix)
        return self._bank

    def _signatures(self, machine: Machine, expected: Collection[str]) -> Bank:
        """Signatures of the causes of the catalogue that leave something at rest, at their seeds."""
        every = [c for c in seeds(self.machine) if c.effect.search.quasi_static and c.effect.kind != "vibration"]
        pitch = registry.kinds()["pitch_error"]
        for axis in self.machine.chain.rotary:
            every += [Candidate(pitch(axis, components=[[float(n), 0.0, 0.0]]), ("components",)) for n in _LOW_ORDERS]
        candidates, parts = [], []
        for c in every:
            present = machine.effect(c.effect.key)
            if c.effect.key in expected and not (present and c.at_another_order(present)):
                continue
            columns = self._columns(machine, EffectVector(c.effect, c.names))
            if np.sqrt((columns**2).mean(axis=0)).max() > _VISIBLE:
                candidates.append(c)
                parts.append(columns)
        ends = np.cumsum([0, *(columns.shape[1] for columns in parts)])
        slices = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        return Bank(candidates, self.plain.in_noise(np.hstack([np.zeros((len(self.plain.value), 0)), *parts])), slices)

    def _columns(self, machine: Machine, free: EffectVector) -> np.ndarray:
        """What the sizes of an effect change, with a shape that is that of its seed, (m, k) SI per typical size."""
        p = self.plain
        if self.machine.effect(free.effect.key) is not None:  # moved from where it is
            machine = machine.with_effect(free.effect)
            return p.columns_of(machine, free, p.readings(machine))
        without, unit = p.readings(machine.without(free.effect.key)), np.eye(len(free.vector))
        (_, entries), *_ = entries_of(free)
        changed = [p.readings(machine.with_effect(free.at(free.off + unit[j]))) for j in entries]
        return np.column_stack([c - without for c in changed])

    def _beside(self, model: Model[RestProblem], levels: Sequence[Sizes], curves: bool) -> Hypotheses:
        return Hypotheses(
            model.fit, self.discrepancy.plain(model.fit), *self.signatures_at(model), model.expected, levels
        )

    def misfit(self, model: Model[RestProblem]) -> float:
        """Probability that a discrepancy is there, whatever the sizes and the causes are. What a bound holds at nothing
        is none of them: the linear problem knows no bounds, and would have a negative play explain the data.
        """
        there = [f for f in model.fit.effects if not f.effect.is_neutral]
        if len(there) < len(model.fit.effects):
            fitter = self.fitter.with_problem(model.problem)
            model = replace(model, fit=fitter.fit(there, start=model.fit, exact=True))
        noise, factor = self.plain.noise.rms, np.ones(len(self.discrepancy.basis))
        _, left = self.discrepancy.plain(model.fit)
        most = 2.0 * float(np.sqrt(np.mean(left[self.discrepancy.rows[0]] ** 2)))  # none is larger than what is left
        sizes = [size for size in _SIZES if size <= most]
        grid = [Sizes(s * noise, r * noise, factor) for s in sizes for r in sizes]
        hypotheses = self._beside(model, grid, curves=False)
        sets = [{}, self._widths(hypotheses)]

        def logs(which) -> np.ndarray:
            best = [none + max(linear.total(s) for s in which) for none, linear, _ in hypotheses.levels]
            return np.array(best) + [_log_mass(sizes, noise) - self.discrepancy.log_prior(sizes) for sizes in grid]

        for i in np.argsort(-logs(sets))[:3]:
            sets.append(hypotheses.levels[i][1].best_set(hypotheses.present))
        found = logs(sets)
        shares = np.exp(found - np.logaddexp.reduce(found))
        return float(sum(p for p, sizes in zip(shares, grid, strict=True) if sizes.rms > (_MISFIT - 1e-9) * noise))


def _log_mass(sizes: Sizes, noise: float) -> float:
    """Logarithm of the prior probability of sizes of the discrepancy: half-Cauchy, in steps of the grid."""

    def mass(size: float) -> float:
        low, high = (
            (0.0, 0.5 * noise / math.sqrt(2.0)) if size == 0.0 else (size / math.sqrt(2.0), size * math.sqrt(2.0))
        )
        return 2.0 / math.pi * (math.atan(high / USUAL) - math.atan(low / USUAL))

    return math.log(mass(sizes.slow)) + math.log(mass(sizes.fast))


def taken_by(columns: np.ndarray, part: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """What a set-up takes of an error, in prior standard deviations, (k,).

    A value counts as much as the error is large: so an instrument with a certain unit of length takes no scale error,
    and an arbitrary zero takes every constant.

    Args:
        columns: Of the set-up, one prior standard deviation each, (m, k).
        part: The error, (m,).
        noise: Of the values, which says how they count against each other, (m,).
    """
    size = noise * max(float(np.sqrt(np.mean((part / noise) ** 2))), 1e-12)
    k = columns.shape[1]
    whole = np.vstack([columns / size[:, None], np.eye(k)])
    return np.linalg.lstsq(whole, np.append(part / size, np.zeros(k)), rcond=None)[0]


def split_at_rest(problem: RestProblem) -> Split:
    """How values at rest split: their noise, the discrepancy, and what another instrument has found.

    Args:
        problem: With the whitening of a model.
    """

    def split(weights: np.ndarray) -> dict[str, float]:
        (noise, beside), *known = split_rows(problem.whitening, problem.rows, weights)
        rows = {"noise": noise, "not_understood": beside}
        return rows | {"other_instrument": sum(known[0])} if known else rows

    return split


class RestReader(Reader[RestProblem]):
    """Reads findings out of a search on values at rest."""

    search: RestSearch

    def _parts(self, fit: Fit) -> dict[str, np.ndarray]:
        p = self.model.problem
        design, _ = self.search.discrepancy.plain(fit)
        design, noise = design[: len(p.value)], p.noise.deviation
        out = {}
        for f in fit.effects:
            part = design[:, fit.parameters[f.block.name]] @ (f.vector - f.off) * noise
            out[f.effect.key] = part - p.columns @ taken_by(p.columns, part, noise)
        return out

    def _unknown(self, fit: Fit) -> UnknownCauses:
        return UnknownCauses(fit, self.search.misfit(self.model))

    def _with_instrument(self, problem: RestProblem, fit: Fit) -> Fit:
        errors = problem.temperatures(fit)
        return fit if errors is None else consider(fit, TEMPERATURE, errors)

    def _budget(self, fit: Fit) -> tuple[Budget, ...]:
        problem = self.model.problem
        nouns = tuple({INSTRUMENTS[t.instrument].noun for t in problem.campaign.measured})
        return budgets(fit, split_at_rest(problem), self.stated, nouns)

    def resolves(self, f: EffectVector) -> bool:
        """Whether the places are close enough to tell the waves of a pitch error from those of other orders: at least
        two of them in each period (sampling theorem). Otherwise their waves stand for the noise that they make.
        """
        if f.names != ("components",):
            return True
        machine, axis = self.search.machine, f.effect.subject
        i = machine.chain.index(axis)
        stood = np.concatenate([s.route[s.at[:, 0], i] for s in self.model.problem.stops.values()])
        turns = np.ptp(stood) / (2.0 * math.pi) * (1.0 if machine.chain.is_rotary(axis) else machine.drives[axis].gear)
        finest = max(row[0] for row in f.effect.values["components"])
        return len(np.unique(np.round(stood, 5))) >= 2.0 * finest * turns

    def _verdict(
        self, named: list[FoundEffect], rows: list[FoundEffect], shown: Collection[str], unknown: UnknownCauses
    ) -> tuple[str, Verdicts]:
        verdict, clear = super()._verdict(named, rows, shown, replace(unknown, probability=0.0))
        p = unknown.probability
        verdicts = Verdicts(**{k: (1.0 - p) * v for k, v in vars(clear).items()} | {"unknown": p})
        return "unknown" if p >= _LIKELY else verdict, verdicts

    def clear_tests(self, fit: Fit) -> dict[str, tuple[str, ...]]:
        """By key of an effect the tests in which its part of the reading stands out of the noise, the clearest first;
        the clearest one alone where none does.
        """
        p, out = self.model.problem, {}
        for key, part in self._parts(fit).items():
            white = part / p.noise.deviation
            sums = {name: float(np.sum(white[at] ** 2)) for name, at in p.values_of.items()}
            order = sorted(sums, key=lambda name: -sums[name])
            spread = {name: float(np.sqrt(np.mean(white[at] ** 2))) for name, at in p.values_of.items()}
            clear = [name for name in order if spread[name] > p.settings.visible_share]
            out[key] = tuple(clear or order[:1])
        return out

    def hidden(self) -> tuple[str, ...]:
        """Ids of effects that change nothing here, or nothing that everything else could not change as well."""
        model, bank = self.model, self.found.bank
        white = Bank(bank.candidates, model.problem.whiten_further(bank.matrix), bank.slices)
        limits = detection_limits(Projector(model.fit), white)
        limits |= {f.effect.id: 0.0 for f in model.fit.effects if self.resolves(f)}
        machine = self.search.machine
        every = registry.all_ids(machine.chain, sensors=bool(machine.sensors))
        return tuple(sorted(i for i in every if limits.get(i, math.inf) > model.problem.settings.testable_size))


@dataclass(frozen=True)
class ExplainedAtRest(Explained[RestProblem]):
    """What values at rest say.

    Attributes:
        tests: By key of an effect the tests that show it, the clearest first.
        hidden: Ids of effects that the values cannot show.
        unresolved: Keys of effects of the model whose waves are finer than the places: they are no findings here.
    """

    tests: Mapping[str, tuple[str, ...]]
    hidden: tuple[str, ...]
    unresolved: frozenset[str]


def explain_at_rest(
    problem: RestProblem,
    machine: Machine,
    most: int | None = None,
    progress: Progress = silent,
    posterior: Posterior | None = None,
) -> ExplainedAtRest:
    """What is missing from the model of a machine.

    Args:
        problem: The measured tests.
        machine: As given.
        most: Most findings that are named; without it all.
        progress: Called as work gets on.
        posterior: What another instrument has found.
    """
    search = RestSearch(problem, machine, posterior, progress)
    reader = RestReader(search, search.run(), progress)
    found = reader.read(most)
    fit = found.selection.fit
    unresolved = frozenset(f.effect.key for f in fit.effects if not reader.resolves(f))
    return ExplainedAtRest(**vars(found), tests=reader.clear_tests(fit), hidden=reader.hidden(), unresolved=unresolved)
