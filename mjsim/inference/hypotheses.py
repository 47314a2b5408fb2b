"""Everything that may explain data, as hypotheses beside a fitted model, each with its prior.

A hypothesis is an effect of the catalogue at one of its seeds, a further wave of a pitch error, what an expected error
has beyond its tolerance, or a curve of one axis' motion that is in no catalogue. All have the same currency: columns of
the whitened readings, prior widths of their coefficients, prior odds, and how they enter the model.

Prior odds: a cause is there in one of some thousand machines, e^-7; three nats more or less change no answer. Where one
of many may be the one (seeds of an effect, orders of a wave, curves of an axis), each has its share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mjsim.inference.calibration import LIMIT_DEVIATIONS, Calibrated, sheet_deviations
from mjsim.inference.discrepancy import Sizes
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.least_squares import ridge_solution
from mjsim.inference.linear_evidence import Columns, LinearEvidence
from mjsim.inference.linear_model import Knots, LinearModel, Products, marginalised
from mjsim.inference.signatures import Bank, Candidate, Offer, Row, feasible_share, seeds
from mjsim.inference.unknown_curves import Curve
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine

#: Logarithm of the prior odds of one cause.
CAUSE = -7.0
#: Orders that a wave of a wheel or a screw may have.
ORDERS = 300
#: Prior widths of an effect's leading entries, typical sizes; of what is beyond a tolerance, limits.
WIDTHS, BEYOND = np.geomspace(0.1, 30.0, 7), np.array([1.0, 2.0, 4.0, 8.0, 16.0])
#: Prior deviation of an effect's shape (a place, a width, a time constant) from its seed, typical sizes.
_SHAPE = 3.0


@dataclass(frozen=True)
class Hypothesis:
    """One hypothesis beside a model.

    Attributes:
        name: Key of the effect, or what a curve is called.
        log_odds: Logarithm of its prior odds.
        widths: Prior widths of its coefficients that are tried.
        free: The effect of the model that it belongs to; ``None`` for one that the model does not have.
        wave: Which component of a pitch error.
        entries: Which entries of the effect's vector.
        candidate: An effect that is not in the model.
        curve: A curve of an unknown cause.
        beyond: Prior deviations of the entries by the tolerance (k,), where this is what lies beyond it.
        present: Whether it is in the model.
    """

    name: str
    log_odds: float
    widths: np.ndarray
    free: EffectVector | None = None
    wave: int | None = None
    entries: np.ndarray | None = None
    candidate: Candidate | None = None
    curve: Curve | None = None
    beyond: np.ndarray | None = None
    present: bool = False

    @property
    def scale(self) -> np.ndarray | float:
        """By which its columns are multiplied: a width of 1 is the limit of a tolerance, or one typical size."""
        return 1.0 if self.beyond is None else self.beyond

    @property
    def id(self) -> str:
        """What it is called where it may stand in the place of another: by its effect, or what a curve is called."""
        mine = self.free or self.candidate
        return name_of(mine.effect) if mine else self.name

    @property
    def is_wave(self) -> bool:
        """Whether it is one wave of a pitch error, which others may stand beside."""
        mine = self.free or self.candidate
        return mine is not None and mine.effect.kind == "pitch_error"


class Judged(NamedTuple):
    """What one level says of all hypotheses beside a set.

    Attributes:
        evidence: Log evidence of the set, prior odds included.
        odds: Log odds of every hypothesis, (n,).
        width: Of the prior that explains most, (n,).
    """

    evidence: float
    odds: np.ndarray
    width: np.ndarray


def name_of(effect: Effect) -> str:
    """What a cause is called where others may stand in its place: its id, with the sensor that it follows."""
    return effect.key if effect.follows_sensor(effect.subject) else effect.id


def prior_log_odds(effect: Effect, tried: int) -> float:
    """Logarithm of the prior odds of an effect, or of one wave of a pitch error.

    Args:
        effect: As it may be there.
        tried: How many seeds of it are tried.
    """
    choices = ORDERS if effect.kind == "pitch_error" else max(tried, 1)
    return CAUSE - math.log(choices) - math.log(2.0) * bool(effect.values.get("direction"))


def log_odds_of(f: EffectVector, machine: Machine) -> float:
    """Logarithm of the prior odds of an effect in a model, its waves and its choice of a seed counted."""
    missing = [wave for wave, _ in entries_of(f) if not _is_given(f, wave, machine)]
    return len(missing) * prior_log_odds(f.effect, sum(c.effect.id == f.effect.id for c in seeds(machine)))


def widths_of(effect: Effect) -> np.ndarray:
    """Prior widths of an effect's leading entries that are tried, typical sizes."""
    return WIDTHS if effect.search.width is None else np.array([effect.search.width])


def with_prior_of_size(f: EffectVector) -> EffectVector:
    """An effect with a prior of the least width that its size asks for; shapes keep theirs, or have one around where
    they are.
    """
    mean, deviation = f.prior or (f.vector.copy(), np.full(len(f.vector), _SHAPE))
    deviation = deviation.copy()
    for _, entries in entries_of(f):
        mean[entries] = f.off[entries]
        size = np.abs(f.vector - f.off)[entries].max()
        widths = widths_of(f.effect)
        deviation[entries] = widths[min(int(np.searchsorted(widths, size)), len(widths) - 1)]
    return f.with_prior(mean, deviation)


def _is_given(f: EffectVector, wave: int | None, machine: Machine) -> bool:
    """Whether a wave of a pitch error stands in the machine file: it is no cause that is missing there."""
    present = machine.effect(f.effect.key)
    if wave is None or present is None:
        return False
    return f.effect.values["components"][wave][0] in [row[0] for row in present.values["components"]]


def nearest_seed(f: EffectVector, candidates: Sequence[Candidate]) -> Candidate | None:
    """The seed whose shape is nearest to that of a fitted effect: where its fit began, or might have."""
    shape = np.setdiff1d(np.arange(len(f.vector)), f.linear)
    same = [c for c in candidates if c.effect.key == f.effect.key and c.names == f.names]
    return min(
        (c for c in same if not c.at_another_order(f.effect)),
        key=lambda c: float(np.linalg.norm((f.with_effect(c.effect).vector - f.vector)[shape])),
        default=None,
    )


def entries_of(f: EffectVector) -> list[tuple[int | None, np.ndarray]]:
    """Leading entries of an effect, wave by wave: which wave, and the places in its vector."""
    if f.effect.kind == "pitch_error":
        return [(i, np.array([2 * i, 2 * i + 1])) for i in range(len(f.vector) // 2)]
    return [(None, np.array(f.linear if f.linear else range(len(f.vector))))]


def _of_cause(f: EffectVector, log_odds: float, wave: int | None, entries: np.ndarray) -> Hypothesis:
    """A cause of the model, or one of its waves."""
    return Hypothesis(f.effect.key, log_odds, widths_of(f.effect), f, wave, entries, present=True)


def _of_candidate(c: Candidate, log_odds: float) -> Hypothesis:
    """A cause that is not in the model."""
    return Hypothesis(c.effect.key, log_odds, widths_of(c.effect), candidate=c)


class Hypotheses:
    """All hypotheses beside one fitted model, in one linear problem.

    Args:
        fit: The model.
        design: Its columns and its residual, whitened by the campaign's noise alone, (count, p) and (count,).
        bank: Signatures of the catalogue, whitened likewise.
        products: Of their columns.
        expected: Effects that a machine of the class has, by key.
        levels: Sizes of the discrepancy at which the hypotheses are judged, the present ones first: what explains most
            of the data leaves much less than is there now.
        curves: Of the model, and others that compete.
        further: Gives candidates that are no seeds, with their columns, from what each of the catalogue gains, the best
            first.
    """

    def __init__(
        self,
        fit: Fit,
        design: tuple[np.ndarray, np.ndarray],
        bank: Bank,
        products: Products,
        expected: Mapping[str, Calibrated],
        levels: Sequence[Sizes],
        curves: Sequence[Curve] = (),
        further: Callable[[list[Row]], Iterable[Offer]] | None = None,
    ) -> None:
        self.fit, self.expected = fit, expected
        width, p = bank.matrix.shape[1], fit.parameters.size
        count: dict[str, int] = {}
        for c in bank.candidates:
            count[c.effect.id] = count.get(c.effect.id, 0) + 1
        inside, released, beyond = self._of_model(count)
        rows = [(h, width + at) for h, at in beyond]  # columns of the model stand behind those of the catalogue
        self.released = replace(fit, effects=tuple(released))
        have = {f.effect.key: f for f in fit.effects}
        # other seeds of a cause of the model may explain the data as well
        own = [f for f in fit.effects if f.effect.key not in expected]
        nearest = {f.effect.key: nearest_seed(f, bank.candidates) for f in own}
        for c, at in zip(bank.candidates, bank.slices, strict=True):
            mine = have.get(c.effect.key)
            is_new = mine is None or c.at_another_order(mine.effect)
            if at.stop > at.start and (is_new or not (c.effect.key in expected or c is nearest[c.effect.key])):
                odds = prior_log_odds(c.effect, count[c.effect.id])
                rows.append((_of_candidate(c, odds), np.arange(at.start, at.stop)))
        products = products.extended(design[0])
        more: list[np.ndarray] = []
        place = width + p
        if further is not None:
            odds, _ = self._evidence(products, design, width, inside, rows, levels[-1:])[0][1].odds({})
            gains = [(2.0 * (o - h.log_odds), h.candidate) for o, (h, _) in zip(odds[len(inside) :], rows, strict=True)]
            ranked = sorted(((gain, c) for gain, c in gains if c is not None), key=lambda row: -row[0])
            for c, columns in further(ranked):
                odds = prior_log_odds(c.effect, count.get(c.effect.id, 1))
                rows.append((_of_candidate(c, odds), place + np.arange(columns.shape[1])))
                more.append(columns)
                place += columns.shape[1]
        for curve in curves:
            h = Hypothesis(curve.name, curve.log_odds, curve.widths, curve=curve, present=curve.present)
            rows.append((h, place + np.arange(curve.root.shape[1])))
            place += curve.root.shape[1]
        knots = Knots([curve.rows for curve in curves], products.discrepancy.rows)
        products = products.extended(*more).with_curves(knots, [curve.root for curve in curves])
        self.all = [*(h for h, _ in inside), *(h for h, _ in rows)]
        #: Log evidence of the model without any of them, and the linear problem, at each level.
        self.levels = self._evidence(products, design, width, inside, rows, levels)

    @property
    def linear(self) -> LinearEvidence:
        """The linear problem at the present sizes."""
        return self.levels[0][1]

    def _of_model(self, count: Mapping[str, int]):
        """What the model has: its own causes with their places in the vector, all its effects with the tolerances as
        priors, and what expected ones have beyond their tolerance with the places of that.
        """
        fit = self.fit
        parameters = fit.parameters
        index = np.arange(parameters.size)
        inside: list[tuple[Hypothesis, np.ndarray]] = []
        released: list[EffectVector] = []
        beyond: list[tuple[Hypothesis, np.ndarray]] = []
        for f in fit.effects:
            at = index[parameters[f.block.name]]
            mine = self.expected.get(f.effect.key)
            if mine is None:
                released.append(f)
                for wave, entries in entries_of(f):
                    if _is_given(f, wave, fit.base):
                        continue
                    odds = prior_log_odds(f.effect, count.get(f.effect.id, 1))
                    inside.append((_of_cause(f, odds, wave, entries), at[entries]))
                continue
            mean, deviation, own = mine.prior_of(f)
            released.append(f.with_prior(mean, deviation))
            for wave, entries in entries_of(f):
                if not own[entries].all():
                    odds = prior_log_odds(f.effect, 1)
                    inside.append((_of_cause(f, odds, wave, entries), at[entries]))
                    continue
                limit = LIMIT_DEVIATIONS * deviation[entries]
                is_wider = f.prior is not None and bool((f.prior[1][entries] > 1.001 * deviation[entries]).any())
                h = Hypothesis(f.effect.key, CAUSE, BEYOND, f, wave, entries, beyond=limit, present=is_wider)
                beyond.append((h, at[entries]))
        return inside, released, beyond

    def _evidence(
        self,
        products: Products,
        design: tuple[np.ndarray, np.ndarray],
        width: int,
        inside: list,
        rows: list,
        levels: Sequence[Sizes],
    ) -> list[tuple[float, LinearEvidence, Sizes]]:
        """Log evidence of none of the hypotheses, and the linear problem of all, at each level."""
        parameters, vector = self.released.parameters, self.released.vector
        own = np.concatenate([at for _, at in inside]) if inside else np.zeros(0, int)
        always = np.setdiff1d(np.arange(parameters.size), own)
        # the causes of the model are hypotheses too: the residual is that without them
        off = np.zeros(parameters.size)
        for f in self.released.effects:
            off[np.arange(parameters.size)[parameters[f.block.name]]] = f.vector - f.off
        residual = design[1] + design[0][:, own] @ off[own]
        precision, departure = parameters.precision()[always], parameters.departure(vector)[always]
        machine = self.fit.base
        # a friction of the model stands for the data sheet's: without it that is uncertain again
        again = [(at, sheet_deviations(machine, h.free)[h.entries]) for h, at in inside if h.free is not None]
        again = [(at[sd > 0.0], sd[sd > 0.0]) for at, sd in again]
        uncertain = np.concatenate([np.zeros(0, int), *(at for at, _ in again)])
        precision = np.concatenate([precision, np.ones(len(uncertain))])
        departure = np.concatenate([departure, np.zeros(len(uncertain))])
        n = len(precision)

        def bounded(h: Hypothesis) -> Callable[[np.ndarray], bool] | None:
            c = h.candidate
            return None if c is None else lambda x: feasible_share(machine, x, c) >= 1.0

        model = LinearModel(products, residual, np.ones(products.width), np.zeros(products.width), levels)
        columns = [*((h, width + at) for h, at in inside), *rows]
        places = np.concatenate([width + always, width + uncertain, *(at for _, at in columns)])
        scale = [np.ones(len(always)), *(sd for _, sd in again)]
        scale = np.concatenate([*scale, *(np.broadcast_to(h.scale, len(at)) for h, at in columns)])
        ends = np.cumsum([0, *(len(at) for _, at in columns)])
        groups = [
            Columns(h.name, np.arange(a, b), h.log_odds, h.widths, h.is_wave, bounded(h))
            for (h, _), a, b in zip(columns, ends[:-1], ends[1:], strict=True)
        ]
        out = []
        for sizes in levels:
            gram, score, square, log_det = model.normal(sizes)
            gram, score = gram[np.ix_(places, places)] * np.outer(scale, scale), score[places] * scale
            none, step, _ = marginalised(gram[:n, :n], score[:n], square, log_det, precision, departure)
            cross = gram[:n, n:]
            left = gram[n:, n:] - cross.T @ ridge_solution(gram[:n, :n], cross, precision)
            linear = LinearEvidence(0.5 * (left + left.T), score[n:] - cross.T @ step, groups)
            out.append((none + model.discrepancy.log_prior(sizes), linear, sizes))
        return out

    @property
    def present(self) -> list[int]:
        """Places of those that are in the model."""
        return [i for i, h in enumerate(self.all) if h.present]

    def judged(self, here: Mapping[int, float]) -> list[Judged]:
        """What each level says beside a set.

        Args:
            here: Places of the hypotheses of the set, and the widths of their priors.
        """
        chosen = dict(here)
        return [Judged(none + linear.total(chosen), *linear.odds(chosen)) for none, linear, _ in self.levels]

    def is_new_and_seen(self, g: int) -> bool:
        """Whether a hypothesis is an effect that the model does not have and that changes a reading."""
        at = self.linear.hypotheses[g].places
        return self.all[g].candidate is not None and bool(self.linear.information[at, at].any())

    def look_alikes(self, g: int) -> list[int]:
        """Places of what makes sense in the place of a hypothesis however small it is, though not by itself."""
        mine = self.all[g].free or self.all[g].candidate
        others = [(i, h.candidate.effect) for i, h in enumerate(self.all) if h.candidate is not None]
        return [
            i
            for i, e in others
            if mine is not None and e.subject == mine.effect.subject and mine.effect.kind in e.search.looks_like
        ]

    def model_of(self, chosen: Mapping[int, float], linear: LinearEvidence) -> tuple[list[EffectVector], list[Curve]]:
        """Effects and curves of the model with a set of hypotheses, at their linear estimates and with their priors.

        Args:
            chosen: Places of the hypotheses, and the widths of their priors.
            linear: The linear problem of the estimates.
        """
        estimate = linear.estimate(dict(chosen)) if chosen else {}
        mine = {g: self.all[g] for g in chosen}
        effects: list[EffectVector] = []
        for f in self.fit.effects:
            of_effect = {h.wave: (h, chosen[g]) for g, h in mine.items() if h.free is f}
            expected = self.expected.get(f.effect.key)
            if expected is None and not of_effect:
                continue
            effects.append(self._kept(f, expected, of_effect))
        for g, h in mine.items():
            if h.candidate is None:
                continue
            new = self._added(EffectVector(h.candidate.effect, h.candidate.names), estimate[g], chosen[g])
            same = next((i for i, f in enumerate(effects) if f.effect.key == new.effect.key), None)
            if same is None:
                effects.append(new)
            elif new.effect.kind == "pitch_error":
                effects[same] = effects[same].with_waves(new)
            else:  # an error motion of another order
                effects[same] = new
        curves = [h.curve.at(chosen[g], estimate[g]) for g, h in mine.items() if h.curve is not None]
        return effects, curves

    def _kept(
        self, f: EffectVector, expected: Calibrated | None, chosen: dict[int | None, tuple[Hypothesis, float]]
    ) -> EffectVector:
        """An effect of the model with the waves that stay, and the priors that the chosen hypotheses give it."""
        if expected is not None:
            mean, deviation, own = expected.prior_of(f)
        else:
            mean, deviation = f.prior if f.prior is not None else (f.off, np.ones(len(f.vector)))
            own = np.zeros(len(f.vector), bool)
            for wave, entries in entries_of(f):
                own[entries] = _is_given(f, wave, self.fit.base)
        deviation, stays = deviation.copy(), np.ones(len(deviation), bool)
        for wave, entries in entries_of(f):
            if wave in chosen:
                h, width = chosen[wave]
                deviation[entries] = width if h.beyond is None else np.hypot(deviation[entries], width * h.beyond)
            elif not own[entries].all():
                stays[entries] = False
        if stays.all() or f.names != ("components",):
            return f.with_prior(mean, deviation)
        rows = [row for i, row in enumerate(f.effect.values["components"]) if stays[2 * i]]
        left = EffectVector(f.effect.replaced(components=rows), f.names)
        return left.with_prior(mean[stays], deviation[stays])

    def _added(self, free: EffectVector, x: np.ndarray, width: float) -> EffectVector:
        """A candidate at its linear estimate, with the prior of its width; shapes have one around the seed."""
        present = self.fit.base.effect(free.effect.key)
        if free.effect.kind == "pitch_error":
            added = EffectVector(free.at(x), free.names).with_prior(np.zeros(2), np.full(2, width))
            if present is None or any(f.effect.key == free.effect.key for f in self.fit.effects):
                return added
            given = EffectVector(present, free.names)  # the waves of the machine file stay
            return given.with_prior(given.vector, np.full(len(given.vector), width)).with_waves(added)
        vector = free.vector
        if present is not None:
            mean = EffectVector(present, free.names).vector
            return EffectVector(free.at(vector + x), free.names).with_prior(mean, np.full(len(vector), width))
        mean, deviation = vector.copy(), np.full(len(vector), _SHAPE)
        mean[free.linear], deviation[free.linear] = free.neutral, width
        vector[free.linear] = free.neutral + x
        return EffectVector(free.at(vector), free.names).with_prior(mean, deviation)
