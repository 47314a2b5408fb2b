"""Sparse Bayesian selection: evidence against its closed form, planted groups found, nothing found in noise."""

import itertools

import numpy as np
import pytest

from mjsim.estimation.evidence import Group, LinearProblem, best_precision, log_bayes_factor, select


def log_evidence(y, columns, precisions, design, prior):
    """Of white noise and Gaussian parameters, written out with the covariance of the data."""
    cov = np.eye(len(y)) + design @ np.diag(1.0 / prior) @ design.T
    if columns.shape[1]:
        cov = cov + columns @ np.diag(1.0 / precisions) @ columns.T
    return -0.5 * (np.linalg.slogdet(cov)[1] + y @ np.linalg.solve(cov, y))


@pytest.fixture
def data():
    rng = np.random.default_rng(3)
    n, widths = 300, (1, 2, 1, 3, 1, 2)
    x = rng.normal(size=(n, sum(widths)))
    x[:, 4] += 0.8 * x[:, 0]  # groups look alike in part
    design = rng.normal(size=(n, 4))
    ends = np.cumsum((0, *widths))
    groups = [Group(f"g{i}", np.arange(a, b)) for i, (a, b) in enumerate(itertools.pairwise(ends))]
    truth = np.zeros(x.shape[1])
    truth[[1, 2]] = 0.6, -0.5
    truth[3] = 0.9
    y = x @ truth + design @ rng.normal(size=4) + rng.normal(size=n)
    return x, y, design, np.full(4, 1.0), groups, truth


def test_bayes_factor_is_the_ratio_of_evidences(data):
    x, y, design, prior, groups, _ = data
    problem = LinearProblem.marginalised(x, y, design, prior)
    inside, a = groups[1], 2.5
    beside = problem.beside(inside.columns, np.full(2, a))
    for group, precision in ((groups[3], 0.7), (groups[2], 11.0)):
        got = log_bayes_factor(*beside.of(group), precision)
        both = np.concatenate([inside.columns, group.columns])
        large = log_evidence(y, x[:, both], np.r_[np.full(2, a), np.full(len(group.columns), precision)], design, prior)
        small = log_evidence(y, x[:, inside.columns], np.full(2, a), design, prior)
        assert got == pytest.approx(large - small, abs=1e-8)


def test_best_precision_is_a_maximum(data):
    x, y, design, prior, groups, _ = data
    problem = LinearProblem.marginalised(x, y, design, prior)
    for group in (groups[1], groups[2]):
        a, gain = best_precision(*problem.of(group))
        for factor in (0.5, 0.8, 1.25, 2.0):
            assert log_bayes_factor(*problem.of(group), factor * a) < gain + 1e-3


def test_planted_groups_are_found_with_their_values(data):
    x, y, design, prior, groups, truth = data
    problem = LinearProblem.marginalised(x, y, design, prior)
    found = select(problem, [Group(g.name, g.columns, -3.0) for g in groups])
    assert sorted(found.precision) == [1, 2]
    assert all(odds > 3.0 for odds in found.log_odds.values())
    deviation = (found.mean - truth[found.columns]) / np.sqrt(np.diag(found.covariance))
    assert np.abs(deviation).max() < 3.0
    assert found.value(groups[2]) == pytest.approx(found.mean[list(found.columns).index(3)])


def test_a_group_with_a_known_prior_stays_and_shrinks(data):
    x, y, design, prior, groups, _ = data
    problem = LinearProblem.marginalised(x, y, design, prior)
    fixed = [Group(groups[0].name, groups[0].columns, precision=1e6), *groups[1:]]
    found = select(problem, fixed)
    assert found.precision[0] == 1e6 and abs(found.value(fixed[0])[0]) < 1e-3


def test_excluded_groups_are_left_out(data):
    x, y, design, prior, groups, _ = data
    problem = LinearProblem.marginalised(x, y, design, prior)
    assert 2 not in select(problem, groups, excluded=[2]).precision


def test_false_alarms_stay_below_the_prior_odds():
    """Forty groups of noise with prior odds of e^-8 each: at most 40 e^-8 = 1.3 % of the problems may name one."""
    rng = np.random.default_rng(8)
    alarms = 0
    for _ in range(300):
        x = rng.normal(size=(120, 60))
        groups = [
            Group(str(i), np.arange(*((i, i + 1) if i < 20 else (2 * i - 20, 2 * i - 18))), -8.0) for i in range(40)
        ]
        problem = LinearProblem.marginalised(x, rng.normal(size=120), np.zeros((120, 0)), np.zeros(0))
        alarms += bool(select(problem, groups).precision)
    assert alarms <= 9  # 3 %: the widths are fitted as well, which costs a factor of about two
