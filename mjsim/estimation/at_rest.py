"""What is missing from a machine's model, from values that were measured while it stood still.

There are few values, and their noise is white. So everything is one small problem of least squares with priors: what
the set-up does (linear), every effect that a machine of its class may have (normal, with its tolerance as two standard
deviations), and what is beyond. As in a ball-bar diagnosis, hypotheses are ranked by log evidence in the linear problem
(:mod:`mjsim.estimation.linear_evidence`), the best set is fitted exactly, and a discrepancy stands for what is in no
model:

    value = reading(machine) + set-up + d + e,   Cov d = σ_s² K + σ_r² P

``K`` falls smoothly with the distance of two positions, ``P`` is 1 for repeats of one place and 0 otherwise; both are 0
between different channels. With a half-Cauchy prior of both sizes, d is zero where the model explains everything. Where
it is not, intervals grow by it, and the machine is called unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from mjsim.campaign.model import Campaign
from mjsim.effects import registry
from mjsim.estimation.calibration import LIMIT_DEVIATIONS, Calibrated, expected_effects
from mjsim.estimation.combinations import Combination, combinations
from mjsim.estimation.data_sheet import data_sheet
from mjsim.estimation.design import Design
from mjsim.estimation.discrepancy import USUAL
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.findings import FINDING, ClassSizes, Verdicts
from mjsim.estimation.fit import Fit
from mjsim.estimation.hypotheses import BEYOND, CAUSE, ORDERS, WIDTHS, entries_of, log_odds_of
from mjsim.estimation.least_squares import LeastSquares
from mjsim.estimation.linear_evidence import Chosen, Columns, LinearEvidence, without
from mjsim.estimation.nuisance import Nuisances
from mjsim.estimation.outcome import Found, verdict_of
from mjsim.estimation.parameters import Block
from mjsim.estimation.posterior import Posterior
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.estimation.shares import Calibration, calibrations_of
from mjsim.estimation.signatures import Candidate, seeds
from mjsim.instruments.base import INSTRUMENTS, Stops
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, silent
from mjsim.simulation.standing import standing
from mjsim.units import DEG

#: Distance over which the smooth discrepancy is correlated, m and rad (assumed: a third of a small machine's travel).
_NEAR_LINEAR, _NEAR_ROTARY = 0.15, 45.0 * DEG
#: Sizes of the discrepancy that are tried, in standard deviations of the noise.
_SIZES = (0.0, *(0.5 * 2.0**k for k in range(11)))
#: From such a share of the noise on, a discrepancy is a misfit.
_SEEN = 1.0
#: Probability from which a misfit is taken for real: more likely than not.
_MISFIT = 0.5
#: Sizes at which the best hypotheses are looked for, the likeliest first.
_LEVELS = 3
#: Step of derivatives, typical sizes; RMS of a column, m, below which an effect does not show.
_STEP, _VISIBLE = 0.02, 1e-10
#: Gauss-Newton steps, and the fall of the objective at which they end.
_STEPS, _CONVERGED = 6, 1e-3
#: Rounds of the search; nats within which something else may stand in the place of a cause, and most that are fitted.
_ROUNDS, _NEAR, _RIVALS = 3, 12.0, 3
#: Prior deviation of an effect's shape from its seed, typical sizes, as for ball-bar tests.
_SHAPE = 3.0
#: Orders per turn in which the position of a rotary axis may be wrong: eccentric encoder or wheel, and its like.
_LOW_ORDERS = (1, 2, 3, 4)


@dataclass(frozen=True)
class RestProblem:
    """Measured tests of instruments that measure while the machine stands still.

    Attributes:
        campaign: The tests of these instruments alone.
        stops: Where the machine stands, by test.
        value: Measured, all tests and channels one after another, (m,) SI.
        noise: Standard deviation of each, (m,) SI.
        columns: Of set-ups and instrument, one prior standard deviation each, (m, k) SI.
        nuisances: Their blocks.
        units: Of the nuisances, in the units of their names, (k,).
        smooth: Correlation of the smooth discrepancy, (m, m).
        same: That of the rough one, (m, m).
        known: What another instrument has found about the machine; stands for the priors of what it fitted.
    """

    campaign: Campaign
    stops: Mapping[str, Stops]
    value: np.ndarray
    noise: np.ndarray
    columns: np.ndarray
    nuisances: Nuisances
    units: np.ndarray
    smooth: np.ndarray
    same: np.ndarray
    known: Posterior | None = None

    @classmethod
    def of(cls, campaign: Campaign, known: Posterior | None = None) -> RestProblem:
        """The measured tests of a campaign.

        Args:
            campaign: Its tests are all of instruments that measure at rest.
            known: What another instrument has found.
        """
        tests = campaign.measured
        stops: dict[str, Stops] = {}
        values, noises, places, channels, rows = [], [], [], [], []
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
        same = np.abs(where[:, None] - where[None]).max(axis=2) < 1e-5
        # sizes of the discrepancy are those of a value with the usual noise: of others in proportion
        noise = np.concatenate(noises)
        weight = equal * np.outer(noise, noise) / np.median(noise) ** 2
        return cls(
            campaign,
            stops,
            np.concatenate(values),
            noise,
            np.vstack(parts),
            nuisances,
            units,
            weight * np.exp(-0.5 * square),
            weight * same,
            known,
        )

    @property
    def count(self) -> int:
        """Number of values."""
        return len(self.value)

    def readings(self, machine: Machine) -> np.ndarray:
        """What an ideal instrument shows of a machine, (m,) SI."""
        plant = build(machine)
        out = []
        for t in self.campaign.measured:
            stood = standing(plant, self.stops[t.name], t.name)
            out.append(INSTRUMENTS[t.instrument].reading(t, stood, plant.geometry).ravel())
        return np.concatenate(out)

    def factor(self, sizes: tuple[float, float]) -> np.ndarray:
        """Lower Cholesky factor of the covariance of the values, (m, m) SI.

        Args:
            sizes: Of the smooth and the rough discrepancy, SI.
        """
        covariance = np.diag(self.noise**2) + sizes[0] ** 2 * self.smooth + sizes[1] ** 2 * self.same
        return np.linalg.cholesky(covariance)

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


def _whiten(factor: np.ndarray, columns: np.ndarray) -> np.ndarray:
    return solve_triangular(factor, columns, lower=True, check_finite=False)


@dataclass(frozen=True)
class Known:
    """What another instrument says of the entries of some effects, as further rows of the problem.

    Attributes:
        keys: Of the effects, in the order of the entries.
        root: Its square and nothing else is the information, (rows, k).
        value: ``root`` times what it has found, (rows,).
    """

    keys: tuple[str, ...]
    root: np.ndarray
    value: np.ndarray

    @classmethod
    def of(cls, posterior: Posterior | None, effects: Sequence[EffectVector]) -> Known | None:
        """What the data of another instrument say by themselves: its posterior without its priors. Effects that are not
        among ``effects`` are marginalised.
        """
        if posterior is None:
            return None
        have = {f.effect.key: f for f in effects}
        keys, places, at = [], [], 0
        mean, vector, precision = [], [], []
        for f in posterior.effects:
            n = len(f.vector)
            mine = have.get(f.effect.key)
            if mine is not None and mine.names == f.names and len(mine.vector) == n:
                keys.append(f.effect.key)
                places += range(at, at + n)
                vector.append(f.vector)
                block = f.block
                mean.append(block.mean)
                precision.append(np.where(block.informative, 1.0, 0.0) / block.deviation**2)
            at += n
        if not keys:
            return None
        covariance = posterior.covariance[np.ix_(places, places)]
        whole, own = np.linalg.inv(0.5 * (covariance + covariance.T)), np.concatenate(precision)
        values, vectors = np.linalg.eigh(whole - np.diag(own))
        kept = values > 1e-6 * max(float(values.max()), 1.0)
        root = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
        right = whole @ np.concatenate(vector) - own * np.concatenate(mean)
        return cls(tuple(keys), root, (vectors[:, kept].T @ right) / np.sqrt(values[kept]))

    def rows(self, fit: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Columns of everything (rows, p), and residual (rows,), both whitened."""
        index = np.arange(fit.parameters.size)
        at = np.concatenate([index[fit.parameters[f"effect {k}"]] for k in self.keys])
        columns = np.zeros((len(self.root), fit.parameters.size))
        columns[:, at] = self.root
        return columns, self.value - self.root @ fit.vector[at]


@dataclass(frozen=True)
class RestModel:
    """A fitted model.

    Attributes:
        fit: Effects and set-up; its design has one block, that of all tests.
        columns: Derivatives of the values by everything, not whitened, (m, p) SI.
        rest: Measured less modelled, (m,) SI.
        sizes: Of the discrepancy, smooth and rough, SI.
        log_odds: Prior odds of its hypotheses, logarithm.
        evidence: Log evidence, prior odds included.
    """

    fit: Fit
    columns: np.ndarray
    rest: np.ndarray
    sizes: tuple[float, float]
    log_odds: float
    evidence: float


@dataclass(frozen=True)
class Option:
    """A hypothesis beside a model.

    Attributes:
        name: Key of the effect.
        log_odds: Of its prior.
        widths: Prior widths that are tried.
        columns: Of its entries, (m, k) SI per unit of width.
        scale: What a width of 1 is, (k,) typical sizes.
        free: The effect, at its seed or as the model has it.
        entries: Which entries of its vector are meant.
        beyond: Whether it is what an expected effect has beyond its tolerance.
        present: Whether the model has it.
    """

    name: str
    log_odds: float
    widths: np.ndarray
    columns: np.ndarray
    scale: np.ndarray
    free: EffectVector
    entries: np.ndarray
    beyond: bool = False
    present: bool = False

    @property
    def id(self) -> str:
        """Of the effect."""
        return self.free.effect.id


@dataclass(frozen=True)
class RestExplained:
    """What the values say.

    Attributes:
        model: The fitted model.
        start: The machine as given, with the set-up fitted alone.
        found: Findings, the largest first.
        calibration: Effects of a machine of its class that are no findings.
        shares: Share of each cause in the explained squared error.
        combinations: Sums of numbers that the values determine.
        verdict: ``identified``, ``ambiguous``, ``unknown`` or ``nothing_found``.
        verdicts: Probabilities of all.
        misfit: Probability that something is left that is in no model.
        not_testable: Ids of effects that the values cannot show.
    """

    model: RestModel
    start: RestModel
    found: tuple[Found, ...]
    calibration: tuple[Calibration, ...]
    shares: dict[str, float]
    combinations: tuple[Combination, ...]
    verdict: str
    verdicts: Verdicts
    misfit: float
    not_testable: tuple[str, ...]


def explain_at_rest(
    problem: RestProblem,
    machine: Machine,
    most: int | None = None,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> RestExplained:
    """What is missing from the model of a machine.

    Args:
        problem: The measured tests.
        machine: As given.
        most: Most findings that are named; without it all.
        progress: Called as work gets on.
        settings: What counts as testable and as open.
    """
    return RestSearch(problem, machine, progress, settings).run(most)


@dataclass
class RestSearch:
    """One search.

    Attributes:
        problem: The measured tests.
        machine: As given.
        progress: Called as work gets on.
        settings: What counts as testable.
    """

    problem: RestProblem
    machine: Machine
    progress: Progress = silent
    settings: DiagnosisSettings = DIAGNOSIS

    @cached_property
    def expected(self) -> dict[str, Calibrated]:
        """What a machine of its class has and these values show, by key."""
        return {c.key: c for c in expected_effects(self.machine) if self._shows(c.free)}

    def _shows(self, f: EffectVector) -> bool:
        """Whether an effect changes anything in the values."""
        if not f.effect.search.quasi_static:
            return False
        machine = self.machine.with_effect(f.effect)
        columns = self.problem.columns_of(machine, f, self.problem.readings(machine))
        return bool(np.sqrt((columns**2).mean(axis=0)).max() > _VISIBLE)

    @cached_property
    def first(self) -> list[EffectVector]:
        """What is in the model from the start: what the class has, and what another instrument has found."""
        out = {c.key: c.free for c in self.expected.values()}
        for f in self.problem.known.effects if self.problem.known else ():
            if self._shows(f):
                mine = self.expected.get(f.effect.key)
                out[f.effect.key] = f if mine is None else f.with_prior(*mine.prior_of(f)[:2])
        return list(out.values())

    @cached_property
    def candidates(self) -> list[Candidate]:
        """Causes of the catalogue that leave something at rest, at their seeds."""
        out = [c for c in seeds(self.machine) if c.effect.search.quasi_static and c.effect.kind != "vibration"]
        pitch = registry.kinds()["pitch_error"]
        for axis in self.machine.chain.rotary:
            out += [Candidate(pitch(axis, components=[[float(n), 0.0, 0.0]]), ("components",)) for n in _LOW_ORDERS]
        return out

    # -- fits ----------------------------------------------------------------------------------------------------------

    def fitted(
        self,
        effects: Sequence[EffectVector],
        sizes: tuple[float, float],
        log_odds: float = 0.0,
        start: Fit | None = None,
        known: bool = True,
    ) -> RestModel:
        """A model, fitted by Gauss-Newton steps."""
        p = self.problem
        numbers = len(data_sheet(self.machine.chain))
        nuisance = p.nuisances.mean if start is None else start.nuisance
        base = self.machine
        for e in base.effects:
            if any(f.effect.key == e.key for f in effects):
                base = base.without(e.key)
        told = Known.of(p.known, effects) if known else None
        fit = Fit(base, tuple(effects), p.nuisances, nuisance, np.zeros(numbers), np.ones(numbers, bool))
        factor = p.factor(sizes)
        now, columns, rest = self._evaluated(fit, factor, told)
        for _ in range(_STEPS):
            moved = now.moved(now.step)
            trial, more, left = self._evaluated(moved, factor, told)
            if trial.objective > now.objective - _CONVERGED:
                if trial.objective < now.objective:
                    now, columns, rest = trial, more, left
                break
            now, columns, rest = trial, more, left
        log_det = 2.0 * float(np.log(np.diag(factor)).sum() - np.log(p.noise).sum())
        precision = now.linear.parameters.precision()
        flexibility = 2.0 * np.log(np.diag(now.linear.factor)).sum() - np.log(precision).sum()
        evidence = -0.5 * (now.objective + log_det + float(flexibility)) + log_odds + _log_prior(sizes, p)
        return RestModel(now, columns, rest, sizes, log_odds, evidence)

    def _evaluated(self, fit: Fit, factor: np.ndarray, told: Known | None) -> tuple[Fit, np.ndarray, np.ndarray]:
        """A fit with residual, design and Gauss-Newton step; its columns and its rest, not whitened."""
        p, machine = self.problem, fit.machine
        base = p.readings(machine)
        rest = p.value - base - p.columns @ fit.nuisance
        sheet = np.zeros((p.count, len(fit.sheet_deviation)))
        own = [p.columns_of(machine, f, base) for f in fit.effects]
        columns = np.hstack([p.columns, sheet, *own])
        white, residual = _whiten(factor, columns), _whiten(factor, rest)
        if told is not None:
            more, off = told.rows(fit)
            white, residual = np.vstack([white, more]), np.append(residual, off)
        design = Design(
            [(np.arange(p.nuisances.size), white[:, : p.nuisances.size])],
            p.nuisances.size,
            white[:, p.nuisances.size :],
        )
        squares = float(residual @ residual)
        made = replace(fit, residual=residual, design=design, sum_squares=squares, readings=(base,))
        made = replace(made, objective=squares + made.parameters.penalty(made.vector))
        made = replace(made, equations=LeastSquares.of_design(made.parameters, design))
        step = made.linear.step(design.T @ residual, made.vector)
        return replace(made, step=step), columns, rest

    # -- hypotheses ----------------------------------------------------------------------------------------------------

    def _options(self, model: RestModel) -> list[Option]:
        """Everything that may be there beside what is expected."""
        p, fit = self.problem, model.fit
        index = np.arange(fit.parameters.size)
        count: dict[str, int] = {}
        for c in self.candidates:
            count[c.effect.key] = count.get(c.effect.key, 0) + 1
        out = []
        for f in fit.effects:
            at = index[fit.parameters[f.block.name]]
            mine = self.expected.get(f.effect.key)
            if mine is None and f.effect.key in {k.effect.key for k in (p.known.effects if p.known else ())}:
                continue  # another instrument has found it: it stays
            if mine is None:
                for _, entries in entries_of(f):
                    odds = log_odds_of(f, self.machine) / len(entries_of(f))
                    scale = np.ones(len(entries))
                    out.append(
                        Option(
                            f.effect.key, odds, WIDTHS, model.columns[:, at[entries]], scale, f, entries, False, True
                        )
                    )
                continue
            _, deviation, _ = mine.prior_of(f)
            for _, entries in entries_of(f):
                limit = LIMIT_DEVIATIONS * deviation[entries]
                wider = f.prior is not None and bool((f.prior[1][entries] > 1.001 * deviation[entries]).any())
                columns = model.columns[:, at[entries]] * limit
                out.append(Option(f.effect.key, CAUSE, BEYOND, columns, limit, f, entries, True, wider))
        have = {f.effect.key for f in fit.effects}
        machine, base = fit.machine, fit.readings[0]
        for c in self.candidates:
            if c.effect.key in have:
                continue
            free = EffectVector(c.effect, c.names)
            entries = np.arange(len(free.vector)) if free.names == ("components",) else np.array(free.linear)
            columns = (
                np.column_stack([(p.readings(machine.with_effect(free.only(int(j), 1.0))) - base) for j in entries])
                if free.is_linear
                else self._seeded(machine, free, entries, base)
            )
            if np.sqrt((columns**2).mean(axis=0)).max() < _VISIBLE:
                continue
            odds = CAUSE - math.log(ORDERS if c.effect.kind == "pitch_error" else count[c.effect.key])
            odds -= math.log(2.0) * bool(c.effect.direction_sign)
            out.append(Option(c.effect.key, odds, WIDTHS, columns, np.ones(len(entries)), free, entries))
        return out

    def _seeded(self, machine: Machine, free: EffectVector, entries: np.ndarray, base: np.ndarray) -> np.ndarray:
        """Columns of the sizes of an effect with a shape, which is that of its seed."""
        out = []
        for k, j in enumerate(entries):
            vector = free.vector.copy()
            vector[entries] = free.neutral
            vector[j] = free.neutral[k] + 1.0
            out.append(self.problem.readings(machine.with_effect(free.at(vector))) - base)
        return np.column_stack(out)

    def _linear(
        self, model: RestModel, options: Sequence[Option], sizes: tuple[float, float]
    ) -> tuple[float, LinearEvidence]:
        """Log evidence of none of the hypotheses at some sizes of the discrepancy, and the linear problem of all."""
        p, fit = self.problem, model.fit
        parameters, index = fit.parameters, np.arange(fit.parameters.size)
        own = [index[parameters[o.free.block.name]][o.entries] for o in options if o.present and not o.beyond]
        inside = np.concatenate(own) if own else np.zeros(0, int)
        always = np.setdiff1d(index[~parameters.frozen], inside)
        # the causes of the model are hypotheses too: the residual is that without them
        off, ours = np.zeros(parameters.size), {o.name for o in options if o.present and not o.beyond}
        for f in fit.effects:
            if f.effect.key in ours:
                off[index[parameters[f.block.name]]] = f.vector - f.off
        rest = model.rest + model.columns[:, inside] @ off[inside]
        factor = p.factor(sizes)
        known = fit.design @ np.eye(parameters.size)
        extra, off_known = known[p.count :], fit.residual[p.count :]
        both = np.hstack([model.columns[:, always], *(o.columns for o in options)])
        white, residual = _whiten(factor, both), _whiten(factor, rest)
        if len(extra):
            right = [
                extra[:, index[parameters[o.free.block.name]][o.entries]] * o.scale
                if o.beyond or o.present
                else np.zeros((len(extra), len(o.entries)))
                for o in options
            ]
            white = np.vstack([white, np.hstack([extra[:, always], *right])])
            residual = np.append(residual, off_known)
        precision, departure = self._class_prior(fit, always)
        n, gram, score = len(always), white.T @ white, white.T @ residual
        lower = np.linalg.cholesky(gram[:n, :n] + np.diag(precision))
        pull = score[:n] - precision * departure
        cross = solve_triangular(lower, gram[:n, n:], lower=True)
        reached = solve_triangular(lower, pull, lower=True)
        log_det = 2.0 * float(np.log(np.diag(factor)).sum() - np.log(p.noise).sum())
        flexibility = 2.0 * np.log(np.diag(lower)).sum() - np.log(precision).sum()
        squares = residual @ residual + precision @ departure**2 - reached @ reached
        none = -0.5 * float(squares + log_det + flexibility) + _log_prior(sizes, p)
        left = gram[n:, n:] - cross.T @ cross
        ends = np.cumsum([0, *(len(o.entries) for o in options)])
        groups = [
            Columns(
                o.name,
                np.arange(a, b),
                o.log_odds,
                o.widths,
                o.free.effect.kind == "pitch_error" or o.beyond,
                _possible(o),
            )
            for o, a, b in zip(options, ends[:-1], ends[1:], strict=True)
        ]
        return none, LinearEvidence(0.5 * (left + left.T), score[n:] - cross.T @ reached, groups)

    def _class_prior(self, fit: Fit, always: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Precisions and departures of what is always in the model, with the tolerances as priors, (n,) each."""
        effects = []
        for f in fit.effects:
            mine = self.expected.get(f.effect.key)
            effects.append(f if mine is None else f.with_prior(*mine.prior_of(f)[:2]))
        released = replace(fit, effects=tuple(effects))
        return released.parameters.precision()[always], released.parameters.departure(released.vector)[always]

    def _with(
        self, model: RestModel, options: Sequence[Option], chosen: Chosen, linear: LinearEvidence
    ) -> list[EffectVector]:
        """Effects of the model with a set of hypotheses, at their linear estimates."""
        estimate = linear.estimate(dict(chosen)) if chosen else {}
        wide: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        kept = set()
        found_before = {f.effect.key for f in self.problem.known.effects} if self.problem.known else set()
        for g, width in chosen.items():
            o = options[g]
            if o.beyond:
                wide.setdefault(o.name, []).append((o.entries, width * o.scale))
            elif o.present:
                kept.add(o.name)
        effects: list[EffectVector] = []
        for f in model.fit.effects:
            mine = self.expected.get(f.effect.key)
            if mine is not None:
                mean, deviation, _ = mine.prior_of(f)
                deviation = deviation.copy()
                for entries, width in wide.get(f.effect.key, ()):
                    deviation[entries] = np.hypot(deviation[entries], width)
                effects.append(f.with_prior(mean, deviation))
            elif f.effect.key in kept or f.effect.key in found_before:
                effects.append(f)
        for g, width in chosen.items():
            o = options[g]
            if o.beyond or o.present:
                continue
            f, vector = o.free, o.free.vector.copy()
            mean, deviation = vector.copy(), np.full(len(vector), _SHAPE)
            neutral = np.zeros(len(o.entries)) if f.names == ("components",) else f.neutral
            vector[o.entries] = neutral + estimate[g]
            mean[o.entries], deviation[o.entries] = neutral, width
            same = next((i for i, e in enumerate(effects) if e.effect.key == f.effect.key), None)
            new = EffectVector(f.at(vector), f.names).with_prior(mean, deviation)
            if same is None:
                effects.append(new)
            elif f.names == ("components",):
                effects[same] = effects[same].with_waves(new)
        return effects

    # -- the search ----------------------------------------------------------------------------------------------------

    def run(self, most: int | None) -> RestExplained:
        p = self.problem
        self.progress("fitting set-up and what a machine of its class has", 0, 1)
        start = self.fitted([], (0.0, 0.0), known=False)
        noise = float(np.median(p.noise))
        model = self.fitted(self.first, (0.0, 0.0))
        options, linear, chosen, weights = self._looked(model)
        for number in range(_ROUNDS):
            self.progress("looking for what explains the rest", number, _ROUNDS)
            before = sorted(options[g].name for g in chosen)
            model = self.fitted(
                self._with(model, options, chosen, linear), self._sizes, self._odds(options, chosen), model.fit
            )
            options, linear, chosen, weights = self._looked(model)
            if sorted(options[g].name for g in chosen) == before:
                model = self.fitted(
                    self._with(model, options, chosen, linear), self._sizes, self._odds(options, chosen), model.fit
                )
                break
        misfit = sum(w for sizes, w in weights.items() if math.hypot(*sizes) > (_SEEN - 1e-9) * noise)
        return self._read(model, start, options, linear, chosen, misfit, most)

    @staticmethod
    def _odds(options: Sequence[Option], chosen: Chosen) -> float:
        return sum(options[g].log_odds for g in chosen)

    def _looked(
        self, model: RestModel
    ) -> tuple[list[Option], LinearEvidence, Chosen, dict[tuple[float, float], float]]:
        """The hypotheses beside a model, their linear problem and the best set at the likeliest sizes of the
        discrepancy; and the probability of all sizes.
        """
        options = self._options(model)
        noise = float(np.median(self.problem.noise))
        grid = [
            (s * noise, r * noise)
            for s in _SIZES
            for r in _SIZES
            if max(s, r) * noise <= _largest(model, self.problem) and not (0.0 < r < s / 16.0 or 0.0 < s < r / 16.0)
        ]
        present = [i for i, o in enumerate(options) if o.present]
        sets: list[Chosen] = [{}]
        if present:
            width = self._linear(model, options, grid[0])[1].odds({})[1]
            sets.append({g: float(width[g]) for g in present})
        found = {sizes: self._best(model, options, sizes, sets)[0] for sizes in grid}
        for sizes in sorted(grid, key=lambda x: -found[x])[:_LEVELS]:
            sets.append(self._linear(model, options, sizes)[1].best_set(present))
        # every set that was found is judged at all sizes
        values = {sizes: self._best(model, options, sizes, sets)[0] for sizes in grid}
        best = max(grid, key=lambda sizes: values[sizes])
        chosen = self._best(model, options, best, sets)[1]
        logs = np.array(list(values.values()))
        shares = np.exp(logs - np.logaddexp.reduce(logs))
        self._sizes = best
        linear = self._linear(model, options, best)[1]
        return options, linear, chosen, dict(zip(values, map(float, shares), strict=True))

    def _best(
        self, model: RestModel, options: Sequence[Option], sizes: tuple[float, float], sets: Sequence[Chosen]
    ) -> tuple[float, Chosen]:
        """Log evidence of the best of some sets of hypotheses at some sizes of the discrepancy, and the set."""
        used = sorted({g for chosen in sets for g in chosen} | {i for i, o in enumerate(options) if o.present})
        none, linear = self._linear(model, [options[g] for g in used], sizes)
        place = {g: i for i, g in enumerate(used)}
        totals = [linear.total({place[g]: width for g, width in chosen.items()}) for chosen in sets]
        i = int(np.argmax(totals))
        return none + totals[i], sets[i]

    # -- what it says --------------------------------------------------------------------------------------------------

    def _read(
        self,
        model: RestModel,
        start: RestModel,
        options: Sequence[Option],
        linear: LinearEvidence,
        chosen: Chosen,
        misfit: float,
        most: int | None,
    ) -> RestExplained:
        fit, of_class = model.fit, ClassSizes(self.expected)
        large = {key for key, p in of_class.sizes(fit).items() if p >= FINDING}
        rivals: dict[str, list[tuple[str, RestModel]]] = {}
        for h in chosen:
            if options[h].name not in large:
                continue
            self.progress(f"what could stand in the place of {options[h].name}", 0, 1)
            rest = without(chosen, h)
            for _, g, width in linear.rivals(chosen, h, _NEAR, 0.0)[:_RIVALS]:
                other = {**rest, g: width}
                trial = self.fitted(
                    self._with(model, options, other, linear), model.sizes, self._odds(options, other), fit
                )
                if options[g].id != options[h].id:
                    rivals.setdefault(options[h].name, []).append((options[g].id, trial))
        rows = of_class.findings(fit, rivals, model.evidence)
        coarse = {f.effect.key for f in fit.effects if not self._resolves(f)}
        named = sorted((r for r in rows if r.whole >= FINDING and r.key not in coarse), key=lambda r: -r.gain)[:most]
        excess = {f.effect.key: of_class.excess(f) for f in fit.effects}
        named.sort(key=lambda r: (-excess[r.key], -r.gain))
        keys = {r.key for r in named}
        inside = [of_class.in_class(f) for f in fit.effects if f.effect.key not in keys]
        index, p = np.arange(fit.parameters.size), self.problem
        parts = {}
        for f in fit.effects:
            part = model.columns[:, index[fit.parameters[f.block.name]]] @ (f.vector - f.off)
            parts[f.effect.key] = part - p.columns @ taken_by(p.columns, part, p.noise)
        entries, shares = calibrations_of(parts, fit, inside, self.settings.observable)
        entries = tuple(replace(c, observable=c.observable and c.effect.effect.key not in coarse) for c in entries)
        # a number that the values do not show is no more beyond its limit than on any machine of the class
        shown = {c.effect.effect.key for c in entries if c.observable} | keys
        verdicts = of_class.verdicts(named, [r for r in rows if r.key in shown], 0.0)
        verdict = "unknown" if misfit >= _MISFIT else verdict_of((bool(r.others) for r in named), False)
        clear = {k: (1.0 - misfit) * v for k, v in vars(verdicts).items()}
        verdicts = Verdicts(**clear | {"unknown": misfit})
        hidden = self._hidden(options, model)
        sums = combinations(fit, self.settings)
        return RestExplained(model, start, tuple(named), entries, shares, sums, verdict, verdicts, misfit, hidden)

    def _resolves(self, f: EffectVector) -> bool:
        """Whether the places are close enough to tell the waves of a pitch error from those of other orders: at least
        two of them in each period (sampling theorem). Otherwise their waves stand for the noise that they make.
        """
        if f.names != ("components",):
            return True
        machine, axis = self.machine, f.effect.subject
        i = machine.chain.index(axis)
        stood = np.concatenate([s.route[s.at[:, 0], i] for s in self.problem.stops.values()])
        turns = np.ptp(stood) / (2.0 * math.pi) * (1.0 if machine.chain.is_rotary(axis) else machine.drives[axis].gear)
        finest = max(row[0] for row in f.effect.values["components"])
        return len(np.unique(np.round(stood, 5))) >= 2.0 * finest * turns

    def _hidden(self, options: Sequence[Option], model: RestModel) -> tuple[str, ...]:
        """Ids of effects that change nothing here, or nothing that everything else could not change as well."""
        limits: dict[str, float] = {}
        fit, factor = model.fit, self.problem.factor(model.sizes)
        for o in options:
            if not self._resolves(o.free):
                continue
            if o.beyond or o.present:
                limits[o.id] = 0.0
                continue
            white = np.vstack(
                [_whiten(factor, o.columns), np.zeros((len(fit.residual) - self.problem.count, o.columns.shape[1]))]
            )
            left = np.diag(fit.linear.left_over(white.T @ white, fit.design.T @ white))
            power = float(np.max(np.where(left > 1e-7 * (white**2).sum(axis=0), left, 0.0)))
            limits[o.id] = min(3.0 / math.sqrt(power) if power > 0.0 else math.inf, limits.get(o.id, math.inf))
        every = registry.all_ids(self.machine.chain)
        return tuple(sorted(i for i in every if limits.get(i, math.inf) > self.settings.testable_size))


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


def _largest(model: RestModel, problem: RestProblem) -> float:
    """Size beyond which no discrepancy can be, SI: twice the RMS of what the model leaves."""
    rest = model.rest / problem.noise * np.median(problem.noise)
    return 2.0 * float(np.sqrt(np.mean(rest**2))) + 1e-9


def _log_prior(sizes: tuple[float, float], problem: RestProblem) -> float:
    """Logarithm of the prior probability of the sizes of the discrepancy: half-Cauchy, in steps of the grid."""
    noise = float(np.median(problem.noise))

    def log_mass(size: float) -> float:
        low, high = (
            (0.0, 0.5 * noise / math.sqrt(2.0)) if size == 0.0 else (size / math.sqrt(2.0), size * math.sqrt(2.0))
        )
        return math.log(2.0 / math.pi * (math.atan(high / USUAL) - math.atan(low / USUAL)))

    return log_mass(sizes[0]) + log_mass(sizes[1])


def _possible(o: Option) -> Callable[[np.ndarray], bool] | None:
    """Whether coefficients of a candidate lie within the bounds of its parameters."""
    if o.beyond or o.present or o.free.polar or o.free.names == ("components",):
        return None
    lower, upper = (end[o.entries] for end in o.free.bounds)
    neutral = o.free.neutral
    slack = 0.02
    return lambda x: bool(((neutral + x >= lower - slack) & (neutral + x <= upper + slack)).all())
