"""Causes that are in no catalogue: a curve of one variable of one axis' motion, with a Gaussian process as its prior.

A cause that nobody listed still depends on something: a position, a velocity, the time since a reversal. Each such
variable of each axis is a hypothesis whose curve is a Gaussian process over the variable. Its prior is one of six:
smooth, rough, a walk of steps, a stretch of worn teeth, the lobes of a table that is not round, or another value for
every stroke. Its coefficients are marginalised, so a curve of many numbers pays for its freedom by itself.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csr_array, diags_array

from mjsim.inference.curve_terms import RADIAL, STRUCTURE, CurveTerm, CurveTerms, radial_curves
from mjsim.inference.fit import Fit
from mjsim.inference.linear_evidence import Columns, LinearEvidence, margin
from mjsim.inference.problem import Problem
from mjsim.inference.resonance import Modes
from mjsim.inference.variables import VARIABLES
from mjsim.inference.whitening import Whitening

#: Logarithm of the prior odds that an axis has a cause that is in no catalogue.
_LOG_ODDS = -7.0
#: Prior standard deviations of a curve, in units of 1 µm or 10 µrad.
WIDTHS = np.geomspace(0.05, 20.0, 8)
#: Length of a curve's changes over its range where it does not repeat (assumed).
_LENGTH = 0.3
#: Corner and exponent of the spectra of curves that repeat: smooth, rough (assumed).
_CLOSED = {"smooth": (2.0, 2.5), "rough": (8.0, 1.0)}
#: Lengths over which a worn stretch of a wheel may change, rad, beside the pitch of one tooth (assumed: a few teeth, a
#: part of the wheel).
_STRETCHES = (math.radians(10.0), math.radians(30.0))
#: Lobes that a table which is not round may have (assumed: what is turned or clamped is oval or has a few lobes).
_LOBES = range(1, 9)
#: Share of the largest variance below which a direction of a prior is left out.
_SMALL = 2e-3
#: So many of the best curves are looked at with more knots, up to such a number: steps and single teeth are sharper
#: than the others.
_REFINED, _LONGEST = 2, 300
#: Curves that compete beside the model, the best of all.
_MOST = 6


@dataclass(frozen=True)
class Curve:
    """A curve of an unknown cause with its prior.

    Attributes:
        term: What it is a curve of.
        prior: ``smooth``, ``rough``, ``steps``, ``teeth``, ``lobes`` or ``strokes``.
        root: From normal coefficients of variance one to values at the knots, (knots, k).
        rows: Readings by these values, whitened by the campaign's noise alone, (count, knots).
        log_odds: Logarithm of its prior odds.
        width: Prior standard deviation where it is in the model; 0 where it is not.
        largest: Its largest value where it is in the model, in units of 1 µm or 10 µrad.
        readings: What it adds to each test where it is in the model, (m,) m.
    """

    term: CurveTerm
    prior: str
    root: np.ndarray
    rows: csr_array
    log_odds: float
    width: float = 0.0
    largest: float = 0.0
    readings: tuple[np.ndarray, ...] = ()

    @property
    def columns(self) -> np.ndarray:
        """Readings by its coefficients over its width, whitened by the campaign's noise alone, (count, k)."""
        return self.rows @ (self.root * self.width)

    @property
    def name(self) -> str:
        """What it is called among the hypotheses."""
        return self.called(self.term)

    @staticmethod
    def called(term: CurveTerm) -> str:
        """What a curve of such a term is called."""
        if term.mode:
            return f"{STRUCTURE} at {term.found_at:.3g} Hz"  # one mode, wherever it is moved
        period = f" / {term.period:.3g}" if term.period else ""
        return f"curve {term.axis or 'clock'} > {term.moves} {term.variable}{period}"

    def is_like(self, other: Curve) -> bool:
        """Whether both have the same term, prior and knots."""
        mine, theirs = ((c.name, c.term.mode, c.prior, c.root.shape) for c in (self, other))
        return mine == theirs

    @property
    def present(self) -> bool:
        """Whether it is in the model."""
        return self.width > 0.0

    def displacing(self, x: np.ndarray) -> np.ndarray:
        """What makes of coefficients how far the curve displaces at each knot, (knots, k).

        That is its value over the mean, which set-up, locations or a pitch error can take up; one that settles has no
        mean that anything takes up.

        Args:
            x: Coefficients near which it is asked for, (k,): they say the phase of a wave.
        """
        return self.root if self.term.settles else self.term.columns.over_the_mean(self.root, x)

    @property
    def widths(self) -> np.ndarray:
        """Prior standard deviations that are tried."""
        return WIDTHS

    def at(self, width: float, x: np.ndarray) -> Curve:
        """The same in the model.

        Args:
            width: Prior standard deviation.
            x: Estimate of its coefficients, (k,).
        """
        values, columns = self.root @ x, self.term.columns
        readings = tuple(columns.of_test(k) @ values for k in range(len(columns)))
        return replace(self, width=width, largest=float(np.abs(values).max()), readings=readings)


def priors_of(term: CurveTerm) -> Iterator[tuple[str, np.ndarray]]:
    """The priors of a curve and their roots (knots, k), each of variance about one."""
    k = len(term.knots)
    if VARIABLES[term.variable].is_counted:
        yield "strokes", np.eye(k)
    elif term.period:
        n, apart = np.arange(k // 2 + 1), (np.arange(k)[:, None] - np.arange(k)) % k
        for name, (corner, exponent) in _CLOSED.items():
            spectrum = (1.0 + (n / corner) ** 2) ** -exponent
            at = (spectrum[:, None] * np.cos(2.0 * np.pi * n[:, None] * np.arange(k) / k)).sum(axis=0)
            yield name, _root(at[apart] / spectrum.sum())
    else:
        apart = np.abs(np.arange(k)[:, None] - np.arange(k)) / (k - 1.0)
        yield "smooth", _settled(term, _root(np.exp(-0.5 * (apart / _LENGTH) ** 2)))
        yield "rough", _settled(term, _root(np.exp(-apart / _LENGTH)))


def _any_prior_of(term: CurveTerm) -> np.ndarray:
    """Root of the mean of a curve's priors, (knots, k)."""
    both = np.hstack([root for _, root in priors_of(term)])
    values, vectors = np.linalg.eigh(0.5 * both @ both.T)
    kept = values > 10.0 * _SMALL * values[-1]
    return vectors[:, kept] * np.sqrt(values[kept])


def _settled(term: CurveTerm, root: np.ndarray) -> np.ndarray:
    """The root of a prior of a curve, which ends at zero where it settles."""
    return root - root[-1] if term.settles else root


def steps_of(term: CurveTerm) -> np.ndarray:
    """Root of the prior of a walk of steps, one at each knot, whose variance is about one, (knots, knots)."""
    k = len(term.knots)
    walk = np.tril(np.ones((k, k)))
    return _settled(term, (walk - walk.mean(axis=0)) * math.sqrt(6.0 / k))


def lobes_of(term: CurveTerm, lobes: int) -> np.ndarray:
    """Root of the prior of a wave with so many periods in one turn, of any phase, (knots, 2)."""
    angle = 2.0 * np.pi * lobes * np.arange(len(term.knots)) / len(term.knots)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def teeth_of(term: CurveTerm, teeth: float) -> Iterator[np.ndarray]:
    """Roots of the priors of worn teeth: waves of the tooth's period whose size changes from place to place, over one
    tooth or more.

    Args:
        term: The wave of the teeth.
        teeth: Of the wheel.

    Yields:
        From normal coefficients to the factors of the wave's cosine and sine at the knots, (2 knots, k).
    """
    apart = np.abs(term.knots[:, None] - term.knots)
    if term.period:
        apart = np.minimum(apart, term.period - apart)
    for stretch in (2.0 * math.pi / teeth, *_STRETCHES):
        root = _root(np.exp(-0.5 * (apart / stretch) ** 2))
        yield np.asarray(block_diag(root, root))


def _root(covariance: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _SMALL * values[-1]
    return vectors[:, kept] * np.sqrt(values[kept])


#: Data whitened as by a model with some modes of its structure, its fit so, and the mode that is moved to where it
#: explains most beside them; ``None`` where all frequencies are looked at.
ModesBeside = tuple[Problem, Fit, CurveTerm | None]


def best_curves(
    problem: Problem,
    fit: Fit,
    plain: Problem,
    own: Collection[str] = (),
    others: bool = True,
    modes_beside: Sequence[ModesBeside] = (),
) -> list[tuple[float, Curve]]:
    """Curves of largest evidence beside a model, the best first: log posterior odds and curve.

    Args:
        problem: The measured tests with the whitening of the model but for curves that are to compete.
        fit: The model, whitened by ``problem``.
        plain: The same tests whitened by the campaign's noise alone.
        own: Names of the curves of the model: each of their priors that comes near the best competes, with the number
            of knots that suits it.
        others: Whether others compete as well, each with the prior that explains most.
        modes_beside: Modes of the structure compete that explain most beside these.
    """
    terms, linear = CurveTerms(plain, fit), _BesideModel(problem, fit)
    contest = _Contest(linear, own)

    def competes(term: CurveTerm) -> bool:
        """Whether a curve is one of those that are looked at."""
        return others or Curve.called(term) in own

    looked_at: list[CurveTerm] = []
    tried: dict[str, int] = {}
    for term in itertools.chain(terms.own(), terms.clock(False), terms.across(), radial_curves(terms)):
        tried[term.axis] = tried.get(term.axis, 0) + 1
        if competes(term):
            looked_at.append(term)
    promise = plain.workers.map(lambda t: _evidence(*linear.of(t), _any_prior_of(t)), looked_at)
    rough = sorted(zip(promise, looked_at, strict=True), key=lambda row: -row[0])
    ranked = []
    for place, (evidence, coarse) in enumerate(rough):
        is_own = Curve.called(coarse) in own
        # coarse knots miss the steps of an encoder and single teeth, which are over the position
        if is_own or place < _MOST or (coarse.variable, coarse.moves) == ("position", coarse.axis):
            finer = [*terms.finer(coarse, _LONGEST)]
            sharp = (_evidence(*linear.of(t), steps_of(t)) for t in finer[-1:])
            ranked.append((max([evidence, *sharp]), is_own, coarse, finer))
    ranked.sort(key=lambda row: -row[0])
    odds = {axis: _LOG_ODDS - math.log(3 * number) for axis, number in tried.items()}
    for place, (_, is_own, coarse, finer) in enumerate(ranked):
        if place >= _MOST and not is_own:
            continue
        for term in (coarse, *(finer if is_own or place < _REFINED else [])):
            steps = [] if VARIABLES[term.variable].is_counted else [("steps", steps_of(term))]
            contest.enter(term, [*priors_of(term), *steps], odds[term.axis])
            if term.moves == RADIAL:
                lobes = [("lobes", lobes_of(term, n)) for n in _LOBES]
                contest.enter(term, lobes, odds[term.axis] - math.log(len(lobes)))
    for axis in (a for a in plain.chain.rotary if a in tried):
        teeth = fit.base.drives[axis].gear
        for term in filter(competes, terms.waves(axis, teeth)):
            contest.enter(term, [("teeth", root) for root in teeth_of(term, teeth)], odds[axis])
    if modes_beside:
        swings = Modes(terms)
        for data, fitted, mode in modes_beside:
            beside = linear if data is problem else _BesideModel(data, fitted)
            found = swings.best(beside.explained_by) if mode is None else [swings.moved(mode, beside.explained_by)]
            for term in found:
                contest.enter(term, [("modes", np.eye(len(term.knots)))], _LOG_ODDS - math.log(3 * len(tried)))
    near = contest.near_the_best()
    distinct = {id(r.term): r.term for r in near}  # several priors of one curve share its rows
    rows = {key: plain.whiten_sparse(term.columns.together()) for key, term in distinct.items()}
    return [(r.evidence, Curve(r.term, r.prior, r.root, rows[id(r.term)], r.log_odds)) for r in near]


@dataclass(frozen=True)
class _Entry:
    """A curve with one prior; as of :class:`Curve`.

    Attributes:
        evidence: Log posterior odds beside the model.
    """

    evidence: float
    term: CurveTerm
    prior: str
    root: np.ndarray
    log_odds: float


class _Contest:
    """Curves that compete beside a model: the best of each name, and of the model's own the best of each prior.

    Args:
        linear: Beside the model.
        own: Names of the curves of the model.
    """

    def __init__(self, linear: _BesideModel, own: Collection[str]) -> None:
        self._linear, self._own = linear, own
        self._best: dict[tuple[str, ...], _Entry] = {}

    def enter(self, term: CurveTerm, priors: Iterable[tuple[str, np.ndarray]], log_odds: float) -> None:
        """Let a curve compete with priors, by name and root, (knots, k), each with such prior odds."""
        known, name = self._linear.of(term), Curve.called(term)
        for prior, root in priors:
            entry = _Entry(_evidence(*known, root) + log_odds, term, prior, root, log_odds)
            key = (name, prior) if name in self._own else (name,)
            if entry.evidence > (self._best[key].evidence if key in self._best else 0.0):
                self._best[key] = entry

    def near_the_best(self) -> list[_Entry]:
        """What competes, the best first: forms of one curve where they come near its best one."""
        out, least = [], {}
        for entry in sorted(self._best.values(), key=lambda e: -e.evidence):
            if entry.evidence >= least.setdefault(Curve.called(entry.term), entry.evidence - margin(entry.evidence)):
                out.append(entry)
        return out


class _BesideModel:
    """The linear problem of a curve's values at its knots beside a fitted model.

    A block lies between two knots, so the columns of a curve are sparse. What is whitened twice stands for the inverse
    covariance of the errors: with it the columns need not be whitened themselves.

    Args:
        problem: The measured tests with the whitening of the model.
        fit: The model, whitened by ``problem``.
    """

    def __init__(self, problem: Problem, fit: Fit) -> None:
        self.fit = fit
        whitening = problem.whitening or Whitening(np.ones(len(problem.tests)))
        columns = whitening.of_all(fit.design.dense(fit.residual))
        seen = np.hstack([columns, whitening.shrunk_together(problem.count)])
        twice, self._basis, first = [], [], 0
        for k, at in enumerate(problem.rows):
            back = problem.filters[k].T
            twice.append(back @ whitening.of_test(k, seen[at]))
            blocks = slice(first, first + back.shape[0])
            self._basis.append((blocks, back @ whitening.shrunk(k, back.shape[1])))
            first = blocks.stop
        # rows of a test that is louder than the campaign weigh less
        weights = np.repeat(1.0 / whitening.factor, [at.stop - at.start for at in problem.rows])
        self._filter = csr_array(diags_array(weights) @ problem.filter)
        self._twice = np.vstack(twice)

    def of(self, term: CurveTerm) -> tuple[np.ndarray, np.ndarray]:
        """Information (k, k) and score (k,) that the data hold about the columns of a curve, most often its values at
        the knots, once the model has taken up what it can.
        """
        hats = term.columns.together()
        white, count = self._filter @ hats, self.fit.design.shape[1]
        own = csr_array(white.T @ white).toarray()
        for blocks, basis in self._basis:
            along = hats[blocks].T @ basis
            own -= along @ along.T
        products = hats.T @ self._twice
        cross, score, together = products[:, :count].T, products[:, count], products[:, count + 1 :]
        own -= together @ together.T
        return self.fit.linear.left_over(own, cross), score - cross.T @ self.fit.step

    def explained_by(self, mode: CurveTerm) -> float:
        """Log evidence of a mode of the structure."""
        return _evidence(*self.of(mode), np.eye(len(mode.knots)))


def _evidence(information: np.ndarray, score: np.ndarray, root: np.ndarray) -> float:
    """Log evidence of a curve beside a model, averaged over its widths.

    Args:
        information: About its values at the knots, (knots, knots).
        score: Likewise, (knots,).
        root: Of its prior, (knots, k).
    """
    own = Columns("curve", np.arange(root.shape[1]), 0.0, WIDTHS)
    return float(LinearEvidence(root.T @ information @ root, root.T @ score, [own]).odds({})[0][0])
