"""Which groups of linear parameters the data need: sparse Bayesian selection (automatic relevance determination).

All candidates stand together in one whitened linear problem. Each group of parameters has a Gaussian prior around zero
whose width is found by maximising the evidence (marginal likelihood). A group whose best width is zero is not needed.
The evidence charges every group for its own flexibility, so that a group of twenty parameters has to explain more than
a group of one.

Sources: Tipping, "Sparse Bayesian learning and the relevance vector machine", J. Machine Learning Research 1 (2001)
211-244; Tipping and Faul, "Fast marginal likelihood maximisation for sparse Bayesian models", AISTATS 2003, for one
parameter a group.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from mjsim.estimation.design import Design

#: Prior precisions that are tried for a group of several parameters, relative to the largest eigenvalue of its
#: information.
_PRECISIONS = np.geomspace(1e-9, 1e3, 49)
#: Factors to the best of them that are tried next.
_FINER = np.geomspace(0.5, 2.0, 41)
#: Gain in log evidence below which a step is not worth taking, and most steps.
_LEAST_GAIN, _MOST_STEPS = 1e-2, 1000


@dataclass(frozen=True)
class Group:
    """Parameters that are in the model together or not at all.

    Attributes:
        name: for reports.
        columns: (k,) places of its parameters among the columns of the problem.
        log_odds: logarithm of the prior odds that the group is needed.
        precision: prior precision of its parameters where it is known (then the group is always in), else ``None``.
    """

    name: str
    columns: np.ndarray
    log_odds: float = 0.0
    precision: float | None = None


@dataclass(frozen=True)
class LinearProblem:
    """A whitened linear problem after everything that is always in the model has been marginalised.

    Attributes:
        gram: (m, m) information that the data hold about the columns.
        score: (m,) product of the columns with the residual.
    """

    gram: np.ndarray
    score: np.ndarray

    @classmethod
    def marginalised(
        cls, columns: np.ndarray, residual: np.ndarray, design: np.ndarray | Design, precision: np.ndarray
    ) -> LinearProblem:
        """The problem of ``columns`` beside a ``design`` whose parameters have Gaussian priors around zero.

        Args:
            columns: (n, m) whitened columns of the candidates.
            residual: (n,) whitened residual with all parameters at zero.
            design: (n, p) whitened columns of what is always in the model.
            precision: (p,) prior precisions of its parameters.
        """
        factor = cho_factor(design.T @ design + np.diag(precision))
        cross = design.T @ columns
        reduced = cho_solve(factor, cross)
        gram = columns.T @ columns - cross.T @ reduced
        return cls(0.5 * (gram + gram.T), columns.T @ residual - reduced.T @ (design.T @ residual))

    def scaled(self, factor: float) -> LinearProblem:
        """The same problem where the residual's variance is ``factor`` times as large."""
        return LinearProblem(self.gram / factor, self.score / factor)

    def beside(self, columns: np.ndarray, precision: np.ndarray) -> LinearProblem:
        """The problem of all columns when those of ``columns`` (j,), with prior ``precision`` (j,), are in the
        model.
        """
        if not len(columns):
            return self
        factor = cho_factor(self.gram[np.ix_(columns, columns)] + np.diag(precision))
        cross = self.gram[:, columns]
        return LinearProblem(
            self.gram - cross @ cho_solve(factor, cross.T), self.score - cross @ cho_solve(factor, self.score[columns])
        )

    def of(self, group: Group) -> tuple[np.ndarray, np.ndarray]:
        """Information (k, k) and score (k,) of one group."""
        return self.gram[np.ix_(group.columns, group.columns)], self.score[group.columns]


def log_bayes_factor(information: np.ndarray, score: np.ndarray, precision: float) -> float:
    """Logarithm of the evidence with a group over that without it.

    Args:
        information: (k, k) of the group beside everything else in the model.
        score: (k,) likewise.
        precision: of the group's prior.
    """
    w, v = np.linalg.eigh(information)
    return float(log_bayes_factors(np.maximum(w, 0.0), (v.T @ score) ** 2, np.array([precision]))[0])


def log_bayes_factors(w: np.ndarray, squares: np.ndarray, precisions: np.ndarray) -> np.ndarray:
    """As :func:`log_bayes_factor` for several precisions, from eigenvalues and squared scores along the
    eigenvectors.
    """
    a = precisions[:, None]
    return 0.5 * (squares / (w + a) - np.log1p(w / a)).sum(axis=1)


def best_precision(information: np.ndarray, score: np.ndarray) -> tuple[float, float]:
    """Prior precision of a group at which the evidence is largest, and the log Bayes factor there."""
    if len(score) == 1:
        s, q2 = float(information[0, 0]), float(score[0]) ** 2
        if not q2 > s > 0.0:
            return np.inf, 0.0
        a = s * s / (q2 - s)
        return a, 0.5 * (q2 / (s + a) + np.log(a / (s + a)))
    w, v = np.linalg.eigh(information)
    w = np.maximum(w, 0.0)
    if not w[-1] > 0.0:
        return np.inf, 0.0
    squares = (v.T @ score) ** 2
    precisions = _PRECISIONS * w[-1]
    coarse = precisions[int(np.argmax(log_bayes_factors(w, squares, precisions)))]
    fine = coarse * _FINER
    gains = log_bayes_factors(w, squares, fine)
    best = int(np.argmax(gains))
    return (float(fine[best]), float(gains[best])) if gains[best] > 0.0 else (np.inf, 0.0)


@dataclass(frozen=True)
class SparseModel:
    """The groups that the data need.

    Attributes:
        precision: prior precision of every group in the model, by its place in the list of groups.
        log_odds: by the same place, logarithm of the posterior odds that the group is needed beside the others.
        columns: (j,) places of the model's columns.
        mean: (j,) posterior mean.
        covariance: (j, j) posterior covariance.
    """

    precision: dict[int, float]
    log_odds: dict[int, float]
    columns: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def value(self, group: Group) -> np.ndarray:
        """Posterior mean of one group's parameters, (k,)."""
        place = {int(c): i for i, c in enumerate(self.columns)}
        return self.mean[[place[int(c)] for c in group.columns]]


def select(
    problem: LinearProblem, groups: Sequence[Group], excluded: Sequence[int] = (), steps: int = _MOST_STEPS
) -> SparseModel:
    """The groups of largest evidence: greedily added, re-estimated and deleted, always the step that gains most.

    Args:
        problem: all groups' columns together.
        groups: what may be in the model.
        excluded: places of groups that may not.
        steps: most steps that are taken.
    """
    model = {g: group.precision for g, group in enumerate(groups) if group.precision is not None}
    free = [g for g in range(len(groups)) if g not in model and g not in set(excluded)]
    for _ in range(steps):
        step = _best_step(problem, groups, model, free)
        if step is None:
            break
        g, precision = step
        if precision is None:
            del model[g]
        else:
            model[g] = precision
    return _posterior(problem, groups, model)


def log_evidence(problem: LinearProblem, groups: Sequence[Group], model: SparseModel) -> float:
    """Logarithm of a model's evidence over that of the empty model, with the prior odds of its groups."""
    columns, precision = _columns(groups, model.precision)
    if not len(columns):
        return 0.0
    matrix = problem.gram[np.ix_(columns, columns)] + np.diag(precision)
    score = problem.score[columns]
    gain = 0.5 * float(score @ np.linalg.solve(matrix, score))
    gain -= 0.5 * float(np.linalg.slogdet(matrix)[1] - np.log(precision).sum())
    return gain + sum(groups[g].log_odds for g in model.precision)


def _columns(groups: Sequence[Group], model: dict[int, float]) -> tuple[np.ndarray, np.ndarray]:
    """Columns of a model and their prior precisions."""
    if not model:
        return np.zeros(0, int), np.zeros(0)
    return (
        np.concatenate([groups[g].columns for g in model]),
        np.concatenate([np.full(len(groups[g].columns), a) for g, a in model.items()]),
    )


def _without(problem: LinearProblem, groups: Sequence[Group], model: dict[int, float], g: int):
    """Information and score of group ``g`` beside the rest of the model."""
    rest = {h: a for h, a in model.items() if h != g}
    columns, precision = _columns(groups, rest)
    here = groups[g].columns
    own = LinearProblem(
        problem.gram[np.ix_(np.append(here, columns), np.append(here, columns))],
        problem.score[np.append(here, columns)],
    )
    k = len(here)
    beside = own.beside(np.arange(k, k + len(columns)), precision)
    return beside.gram[:k, :k], beside.score[:k]


def _best_step(
    problem: LinearProblem, groups: Sequence[Group], model: dict[int, float], free: list[int]
) -> tuple[int, float | None] | None:
    """The group to add or to re-estimate with its new precision, or to delete (precision ``None``)."""
    outside = problem.beside(*_columns(groups, model))
    best: tuple[float, tuple[int, float | None] | None] = (_LEAST_GAIN, None)
    for g in free:
        if g in model:
            information, score = _without(problem, groups, model, g)
            now = log_bayes_factor(information, score, model[g]) + groups[g].log_odds
        else:
            (information, score), now = outside.of(groups[g]), 0.0
        precision, gain = best_precision(information, score)
        gain += groups[g].log_odds
        step = (gain - now, (g, precision)) if gain > 0.0 and np.isfinite(precision) else (-now, (g, None))
        if step[0] > best[0] and not (step[1][1] is None and g not in model):
            best = step
    return best[1]


def _posterior(problem: LinearProblem, groups: Sequence[Group], model: dict[int, float]) -> SparseModel:
    columns, precision = _columns(groups, model)
    covariance = np.linalg.inv(problem.gram[np.ix_(columns, columns)] + np.diag(precision))
    odds = {g: log_bayes_factor(*_without(problem, groups, model, g), a) + groups[g].log_odds for g, a in model.items()}
    return SparseModel(model, odds, columns, covariance @ problem.score[columns], covariance)
