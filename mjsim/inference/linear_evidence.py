"""Which hypotheses the data need, in one linear problem beside a fitted model: by log evidence.

Every hypothesis is a group of coefficients with a normal prior around zero, whose width is one of a few and is averaged
over. What is always in the model is marginalised before. So the evidence of any set of hypotheses follows from the
information and the score of all columns, and adding, dropping or exchanging one costs milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import get_blas_funcs, get_lapack_funcs, solve_triangular

#: Gain in log evidence below which a change is not worth making, nats.
WORTH = 0.5
#: Hypotheses whose linear estimates are held against their bounds: those of largest odds.
_CHECKED = 40
#: Coefficients beyond which a hypothesis, as a curve, is worked with by itself.
_MANY = 30
#: Most sets of curves that are kept, and the memory that they may fill, bytes. Fewer cost time, and change no result.
_KEPT, _ROOM = 10, 1e9
#: Log odds within which another hypothesis may stand in the place of one, nats: odds of 160,000 to one; and the share
#: of its log odds that the linear problem may be wrong by (assumed).
NEAR, _ROUGH = 12.0, 0.1
#: Of BLAS: a product is added to a matrix.
(_GEMM,) = get_blas_funcs(("gemm",), dtype=np.float64)
#: Of LAPACK: a symmetric matrix becomes tridiagonal, vectors are turned alike, and a tridiagonal matrix is solved.
_SYTRD, _ORMQR, _PTTRF, _PTTRS = get_lapack_funcs(("sytrd", "ormqr", "pttrf", "pttrs"), dtype=np.float64)
#: A hypothesis set: places in the list of hypotheses, and the width of each one's prior.
Chosen = dict[int, float]


@dataclass(frozen=True)
class _Beside:
    """The linear problem beside a set of curves. Sets of a search differ from each other in one or two curves, so that
    each is made from the one before: swept by the columns of a curve, or back (Goodnight, Amer. Statist. 33 (1979)
    149-158).

    Attributes:
        curves: The set.
        swept: Information about all columns with, as last row and column, their score, (m + 1, m + 1). The columns of
            the curves have minus their covariance in the place of their information.
        gain: Log evidence of the curves over that of none, without prior odds.
    """

    curves: Chosen
    swept: np.ndarray
    gain: float = 0.0

    def with_curve(self, g: int, at: np.ndarray, width: float) -> _Beside:
        """Beside one curve more.

        Args:
            g: Its place among the hypotheses.
            at: Those of its coefficients, (k,).
            width: Of its prior.
        """
        rows, own = self.swept[at], width**-2.0 * np.eye(len(at))
        lower = np.linalg.cholesky(rows[:, at] + own)
        turn = solve_triangular(lower, np.eye(len(at)), lower=True, check_finite=False)
        half = turn @ rows
        out = self._changed(at, -1.0, half, turn.T @ half, -turn.T @ turn)
        return _Beside({**self.curves, g: width}, out, self.gain + _gain_of(half[:, -1], lower, np.diag(own)))

    def without_curve(self, g: int, at: np.ndarray) -> _Beside:
        """Beside one of the curves less; arguments as of :meth:`with_curve`."""
        rows, own = self.swept[at], self.curves[g] ** -2.0 * np.eye(len(at))
        turn = np.linalg.cholesky(-rows[:, at]).T
        lower = solve_triangular(turn.T, np.eye(len(at)), lower=True, check_finite=False)
        half = lower @ rows
        out = self._changed(at, 1.0, half, lower.T @ half, lower.T @ lower - own)
        return _Beside(without(self.curves, g), out, self.gain - _gain_of(half[:, -1], lower, np.diag(own)))

    def _changed(
        self, at: np.ndarray, sign: float, half: np.ndarray, rows: np.ndarray, block: np.ndarray
    ) -> np.ndarray:
        """The problem with the products of ``half`` (k, m + 1) added or taken away, other ``rows`` of a curve (k, m +
        1), and another ``block`` of its own (k, k).
        """
        out = _GEMM(sign, half.T, half.T, 1.0, self.swept.T, trans_b=True).T
        out[at], out[:, at] = rows, rows.T
        out[np.ix_(at, at)] = block
        return out


@dataclass(frozen=True)
class Columns:
    """One hypothesis as the linear problem sees it.

    Attributes:
        name: What it is called. Two of one name exclude each other, except where ``several``.
        places: Of its coefficients among all columns, (k,).
        log_odds: Logarithm of its prior odds.
        widths: Prior standard deviations of its coefficients that are tried.
        several: Whether others of its name may stand beside it, as waves of one pitch error.
        is_possible: Whether coefficients (k,) lie within the bounds of what they stand for.
    """

    name: str
    places: np.ndarray
    log_odds: float
    widths: np.ndarray
    several: bool = False
    is_possible: Callable[[np.ndarray], bool] | None = None


class LinearEvidence:
    """Log evidence of sets of hypotheses.

    Args:
        information: Of all columns, (m, m).
        score: Of all columns, (m,).
        hypotheses: What the columns belong to.
    """

    def __init__(self, information: np.ndarray, score: np.ndarray, hypotheses: Sequence[Columns]) -> None:
        self.information, self.score, self.hypotheses = information, score, tuple(hypotheses)
        self._log_odds = np.array([h.log_odds for h in hypotheses])
        sizes: dict[tuple[int, int], list[int]] = {}
        for i, h in enumerate(hypotheses):
            sizes.setdefault((len(h.places), len(h.widths)), []).append(i)
        self._batches = [
            (np.array(ix), np.array([hypotheses[i].places for i in ix]), np.array([hypotheses[i].widths for i in ix]))
            for ix in sizes.values()
        ]
        self._known: dict[frozenset[tuple[int, float]], tuple[np.ndarray, np.ndarray]] = {}
        self._beside: dict[frozenset[tuple[int, float]], _Beside] = {}

    def forget(self) -> None:
        """Give back what is kept of sets: GB where they have curves."""
        self._known.clear()
        self._beside.clear()

    def _columns(self, chosen: Chosen) -> tuple[np.ndarray, np.ndarray]:
        """Places and prior precisions of the coefficients of a set."""
        if not chosen:
            return np.zeros(0, int), np.zeros(0)
        places = [self.hypotheses[g].places for g in chosen]
        return np.concatenate(places), np.concatenate(
            [np.full(len(at), width**-2.0) for at, width in zip(places, chosen.values(), strict=True)]
        )

    def odds(self, chosen: Chosen) -> tuple[np.ndarray, np.ndarray]:
        """Log posterior odds of every hypothesis beside a set, and the width of its prior that explains most.

        Those that the set has, or excludes, have odds of zero (their logarithm is minus infinity).
        """
        key = frozenset(chosen.items())  # a search comes to the same sets from several sides
        if key not in self._known:
            self._known[key] = self._odds(chosen)
        return self._known[key]

    def _odds(self, chosen: Chosen) -> tuple[np.ndarray, np.ndarray]:
        """As :meth:`odds`."""
        beside, small = self._beside_curves(chosen)
        taken, score, _ = self._taken(beside, small)
        odds, best = np.full(len(self.hypotheses), -np.inf), np.ones(len(self.hypotheses))
        names = {self.hypotheses[g].name for g in chosen if not self.hypotheses[g].several}
        free = np.array([g not in chosen and h.name not in names for g, h in enumerate(self.hypotheses)], bool)
        left: dict[int, np.ndarray] = {}
        for ix, at, widths in self._batches:
            asked = free[ix]
            if not asked.any():
                continue
            ix, at, widths = ix[asked], at[asked], widths[asked]
            information = _without_taken(beside.swept[at[:, :, None], at[:, None, :]], taken, at)
            evidence = _evidence(information, score[at], widths)
            odds[ix] = np.logaddexp.reduce(evidence, axis=1) - math.log(widths.shape[1]) + self._log_odds[ix]
            best[ix] = widths[np.arange(len(ix)), evidence.argmax(axis=1)]
            left.update(zip(ix.tolist(), information, strict=True))
        for g in np.argsort(-odds)[:_CHECKED]:
            h = self.hypotheses[g]
            if np.isfinite(odds[g]) and h.is_possible is not None:
                x = np.linalg.solve(left[int(g)] + np.eye(len(h.places)) * best[g] ** -2.0, score[h.places])
                if not h.is_possible(x):
                    odds[g] = -np.inf
        return odds, best

    def _beside_curves(self, chosen: Chosen) -> tuple[_Beside, Chosen]:
        """The problem beside the curves of a set, which is kept since sets differ in what is small; and the others."""
        curves = {g: w for g, w in chosen.items() if len(self.hypotheses[g].places) > _MANY}
        key = frozenset(curves.items())
        beside = self._beside.pop(key, None)
        if beside is None:
            if not self._beside:
                self._beside[frozenset()] = _Beside({}, np.pad(self.information, (0, 1)))
                self._beside[frozenset()].swept[-1, :-1] = self._beside[frozenset()].swept[:-1, -1] = self.score
            beside = min(self._beside.values(), key=lambda b: len(key ^ b.curves.items()))
            for g, _ in beside.curves.items() - key:
                beside = beside.without_curve(g, self.hypotheses[g].places)
            for g, width in key - beside.curves.items():
                beside = beside.with_curve(g, self.hypotheses[g].places, width)
            while len(self._beside) >= max(min(_KEPT, _ROOM // beside.swept.nbytes), 2):
                self._beside.pop(next(iter(self._beside)))
        self._beside[key] = beside  # behind the others: the one that is not asked for goes first
        return beside, {g: w for g, w in chosen.items() if g not in curves}

    def _taken(self, beside: _Beside, chosen: Chosen) -> tuple[np.ndarray, np.ndarray, float]:
        """What a further set takes: rows (p, m) whose products are the information of all columns that it takes; the
        score that it leaves, (m,); and its log evidence, without prior odds.
        """
        score = beside.swept[-1, :-1]
        if not chosen:
            return np.zeros((0, len(score))), score, 0.0
        places, precision = self._columns(chosen)
        rows = beside.swept[places]
        lower = np.linalg.cholesky(rows[:, places] + np.diag(precision))
        taken = solve_triangular(lower, rows, lower=True, check_finite=False)
        taken, own = taken[:, :-1], taken[:, -1]
        return taken, score - taken.T @ own, _gain_of(own, lower, precision)

    def total(self, chosen: Chosen) -> float:
        """Log evidence of a set over that of none, with the prior odds."""
        beside, small = self._beside_curves(chosen)
        gain = beside.gain + self._taken(beside, small)[2]
        return gain + sum(self._log_odds[g] - math.log(len(self.hypotheses[g].widths)) for g in chosen)

    def estimate(self, chosen: Chosen) -> dict[int, np.ndarray]:
        """Coefficients (k,) of every hypothesis of a set, fitted together."""
        places, precision = self._columns(chosen)
        x = np.linalg.solve(self.information[np.ix_(places, places)] + np.diag(precision), self.score[places])
        ends = np.cumsum([0, *(len(self.hypotheses[g].places) for g in chosen)])
        return {g: x[a:b] for g, a, b in zip(chosen, ends[:-1], ends[1:], strict=True)}

    def explained(self, chosen: Chosen) -> float:
        """By how much a set, at its estimate, lowers the squared residual and the squared departures from priors."""
        places, _ = self._columns(chosen)
        return float(self.score[places] @ np.concatenate(list(self.estimate(chosen).values())))

    def best_set(self, present: Sequence[int] = (), starts: int = 4) -> Chosen:
        """The set of largest evidence that is found from nothing, and from what is ``present`` or, where nothing is,
        from the ``starts`` best single hypotheses; then every rival of a member is put in beside all once, and what is
        not needed any more goes.
        """
        odds, width = self.odds({})
        first: list[Chosen] = [{}]
        if present:
            first.append({g: float(width[g]) for g in present})
        names: set[str] = set()
        for g in () if present else np.argsort(-odds):
            if odds[g] < 0.0 or len(names) >= starts:
                break
            if self.hypotheses[g].name not in names:
                names.add(self.hypotheses[g].name)
                first.append({int(g): float(width[g])})
        best = max((self.improved(s) for s in first), key=self.total)
        if 0 < len(best) <= 8:
            rivals = dict.fromkeys(
                int(g) for h in best for g in np.argsort(-self.odds(without(best, h))[0])[:3] if int(g) not in best
            )
            own = {self.hypotheses[h].name for h in best if not self.hypotheses[h].several}
            for g in rivals:
                if self.hypotheses[g].name not in own:
                    best = max(best, self.improved({**best, g: float(width[g])}, rounds=2), key=self.total)
        return best

    def improved(self, chosen: Chosen, rounds: int = 4, most: int = 24) -> Chosen:
        """A set with what it still needs; then each member is dropped, exchanged, or given another width once."""
        chosen = dict(chosen)
        for _ in range(rounds):
            changed = False
            while len(chosen) < most:
                odds, width = self.odds(chosen)
                g = int(np.argmax(odds))
                if odds[g] <= 0.0:
                    break
                chosen[g] = float(width[g])
                changed = True
            for h in list(chosen):
                rest = without(chosen, h)
                odds, width = self.odds(rest)
                g = int(np.argmax(odds))
                if odds[g] <= 0.0:
                    chosen, changed = rest, True
                elif g != h and odds[g] > odds[h] + WORTH:
                    chosen, changed = {**rest, g: float(width[g])}, True
                elif width[h] != chosen[h] and np.isfinite(odds[h]):
                    chosen[h] = float(width[h])
            if not changed:
                break
        return chosen

    def rivals(self, chosen: Chosen, h: int) -> list[tuple[float, int, float]]:
        """What could stand in the place of one member, the likeliest first: log odds, place and width of the best
        hypothesis of each name that comes near it. Another seed of the same effect is one of them.

        Args:
            chosen: The set.
            h: The member.
        """
        odds, width = self.odds(without(chosen, h))
        out: dict[str, tuple[float, int, float]] = {}
        for g in np.argsort(-odds):
            if odds[g] < max(odds[h] - margin(odds[h]), 0.0):
                break
            name = self.hypotheses[g].name
            is_other = g != h and not (name == self.hypotheses[h].name and self.hypotheses[h].several)
            if is_other and name not in out:
                out[name] = float(odds[g]), int(g), float(width[g])
        return list(out.values())


def _gain_of(turned: np.ndarray, lower: np.ndarray, precision: np.ndarray) -> float:
    """Log evidence of coefficients over that of their absence.

    Args:
        turned: Their score, turned by the inverse of ``lower``, (p,).
        lower: Root of their information with that of the prior, (p, p).
        precision: Of their priors, (p,).
    """
    return 0.5 * float(turned @ turned + np.log(precision).sum()) - float(np.log(np.diag(lower)).sum())


def _without_taken(information: np.ndarray, taken: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Information about hypotheses, (n, k, k), without what a set takes.

    Args:
        information: With it, (n, k, k).
        taken: What the set takes of all columns, (p, m).
        at: Columns of each hypothesis, (n, k).
    """
    if not len(taken):
        return information
    part = taken[:, at].transpose(1, 0, 2)
    return information - np.matmul(part.transpose(0, 2, 1), part)


def _evidence(information: np.ndarray, score: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Log evidence of hypotheses of k coefficients over that of their absence, by the widths of their priors, (n, w).

    Args:
        information: Of the coefficients, (n, k, k).
        score: (n, k).
        widths: (n, w).
    """
    if score.shape[1] > _MANY:
        return np.array([_of_curve(*one) for one in zip(information, score, widths, strict=True)])
    return _by_eigenvalues(information, score, widths)


def _by_eigenvalues(information: np.ndarray, score: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """The same for any number of coefficients."""
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 1e-12)
    square = np.einsum("gij,gi->gj", vectors, score) ** 2
    prior = widths[:, :, None] ** -2.0
    gain = square[:, None, :] / (values[:, None, :] + prior) - np.log1p(values[:, None, :] / prior)
    return 0.5 * gain.sum(axis=2)


def _of_curve(information: np.ndarray, score: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """The same of one hypothesis, (w,): a tridiagonal matrix has the same evidence and is soon solved for any width."""
    packed, diagonal, beside, tau, _ = _SYTRD(information, lower=1)
    turned = score.copy()
    turned[1:] = _ORMQR("L", "T", packed[1:, :-1], tau, turned[1:, None], 64)[0][:, 0]
    out = []
    for prior in widths**-2.0:
        pivots, factors, failed = _PTTRF(np.maximum(diagonal, 0.0) + prior, beside)
        if failed:  # by rounding the information is negative somewhere
            return _by_eigenvalues(information[None], score[None], widths[None])[0]
        step, _ = _PTTRS(pivots, factors, turned)
        out.append(0.5 * (turned @ step - np.log(pivots / prior).sum()))
    return np.array(out)


def margin(odds: float) -> float:
    """By how much a rival may fall short of a hypothesis with such log odds in the linear problem, nats."""
    return max(NEAR, _ROUGH * odds)


def without(chosen: Chosen, g: int) -> Chosen:
    """A set without one of its hypotheses."""
    return {h: width for h, width in chosen.items() if h != g}
