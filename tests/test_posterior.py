"""Whitening, discrepancy, evidence of sets of hypotheses, and probabilities about sizes, against closed forms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.stats import ncx2

from mjsim.inference import linear_evidence
from mjsim.inference.discrepancy import Common, Discrepancy, Sizes, _harmonics
from mjsim.inference.linear_evidence import Columns, LinearEvidence
from mjsim.inference.linear_model import Knots, LinearModel, Products
from mjsim.inference.posterior import beyond
from mjsim.inference.samples import revolution_time
from mjsim.inference.whitening import Whitening
from mjsim.instruments.ball_bar.measurement import BallBarTest

NOISE, BLOCK = 0.1e-6, 0.02


@pytest.fixture(scope="module")
def tests():
    """Two tests as a discrepancy sees them: block centres, white noise of 0.1 µm."""
    test = BallBarTest("a", "circular", (0.0, 0.0, 0.155), 0.1, 12.0 / 60.0, revolutions=2)
    time = np.arange(0.0, 2.0 * revolution_time(test), BLOCK)
    sample = SimpleNamespace(test=test, centre=time, block=BLOCK)
    return SimpleNamespace(samples=(sample, sample), whiten_test=lambda k, x: x / NOISE)


def drawn(tests, slow, fast, seed):
    """Rows of both tests in units of the noise: white noise, and a discrepancy of these sizes (m)."""
    rng, out = np.random.default_rng(seed), []
    d = Discrepancy.of_tests(tests)
    for k, s in enumerate(tests.samples):
        lower = np.linalg.cholesky(d.covariance(k, slow, fast, 1.0) + 1e-12 * np.eye(d.basis[k].shape[1]))
        out.append(rng.standard_normal(len(s.centre)) + d.basis[k] @ (lower @ rng.standard_normal(len(lower))))
    return d, np.concatenate(out)


def model(d, rows, columns=None):
    columns = np.ones((len(rows), 1)) if columns is None else columns
    p = columns.shape[1]
    return LinearModel(Products(d, columns), rows, np.full(p, 1e-2), np.zeros(p))


def test_a_discrepancy_is_found_with_its_size(tests):
    none = Sizes(0.3e-6, 0.3e-6, np.ones(2))
    found = []
    for seed in range(3):
        d, rows = drawn(tests, 0.8e-6, 0.4e-6, seed)
        sizes, _ = model(d, rows).tuned(none)
        found.append((sizes.slow, sizes.fast))
        assert np.abs(sizes.factor - 1.0).max() < 0.2  # 60 degrees of freedom
    slow, fast = np.mean(found, axis=0)
    assert 0.5e-6 < slow < 1.2e-6 and 0.3e-6 < fast < 0.5e-6


def test_no_discrepancy_is_found_where_there_is_noise_alone(tests):
    for seed in range(4):
        d, rows = drawn(tests, 0.0, 0.0, seed)
        sizes, evidence = model(d, rows).tuned(Sizes(0.3e-6, 0.3e-6, np.ones(2)))
        assert sizes.rms < 0.02e-6
        assert evidence >= model(d, rows).log_evidence(Sizes(0.3e-6, 0.1e-6, sizes.factor))


def test_a_test_with_more_noise_than_the_others_is_given_more(tests):
    d, rows = drawn(tests, 0.0, 0.0, 7)
    rows[d.rows[1]] *= 1.5
    sizes, _ = model(d, rows).tuned(Sizes(0.3e-6, 0.3e-6, np.ones(2)))
    assert sizes.factor == pytest.approx([1.0, 1.5], abs=0.1)


def test_the_size_of_a_discrepancy_is_found_from_the_largest_that_is_tried(tests):
    """Steps outwards from there change nothing."""
    d, rows = drawn(tests, 0.8e-6, 0.4e-6, 3)
    near, _ = model(d, rows).tuned(Sizes(0.3e-6, 0.3e-6, np.ones(2)))
    far, _ = model(d, rows).tuned(Sizes(1e-3, 1e-3, np.ones(2)))
    assert far.rms == pytest.approx(near.rms, rel=0.2)


def test_a_wave_that_is_faster_than_its_harmonics_is_laid_to_the_noise(tests):
    d, rows = drawn(tests, 0.8e-6, 0.4e-6, 8)
    amplitude = 24.0  # of the noise
    for s, at in zip(tests.samples, d.rows, strict=True):
        rows[at] += amplitude * np.sin(2.0 * np.pi * 63.7 * s.centre / revolution_time(s.test))
    sizes, _ = model(d, rows).tuned(Sizes(0.3e-6, 0.3e-6, np.ones(2)))
    assert sizes.rms < amplitude * NOISE
    assert sizes.factor == pytest.approx(amplitude / np.sqrt(2.0), rel=0.3)


def test_whitened_rows_have_independent_errors_of_variance_one(tests):
    d = Discrepancy.of_tests(tests)
    sizes = Sizes(0.5e-6, 0.2e-6, np.array([1.0, 1.3]))
    whitening = d.whitening(sizes)
    column = np.random.default_rng(1).standard_normal((sum(map(len, d.basis)), 2))
    log_det, whites = 0.0, []
    for k, at in enumerate(d.rows):
        n = len(d.basis[k])
        covariance = sizes.factor[k] ** 2 * np.eye(n) + d.basis[k] @ d.covariance(k, 0.5e-6, 0.2e-6, 1.0) @ d.basis[k].T
        log_det += np.linalg.slogdet(covariance)[1]
        white = whitening.of_test(k, np.eye(n))
        whites.append(white)
        assert white @ covariance @ white.T == pytest.approx(np.eye(n), abs=1e-6)
        assert whitening.undone(k, whitening.of_test(k, column[at])) == pytest.approx(column[at], abs=1e-8)
    assert whitening.log_det == pytest.approx(log_det, rel=1e-9)
    # a coefficient with the prior deviation one that is marginalised adds its column to the covariance
    own = np.vstack([w @ column[at] for w, at in zip(whites, d.rows, strict=True)])
    beside = whitening.beside(own)
    assert beside.log_det - whitening.log_det == pytest.approx(np.linalg.slogdet(np.eye(2) + own.T @ own)[1])
    rows = np.random.default_rng(2).standard_normal(len(own))
    square = rows @ np.linalg.solve(np.eye(len(own)) + own @ own.T, rows)
    assert np.square(beside.of_all(rows)).sum() == pytest.approx(square)
    # one after the other they add as much as both at once
    again = whitening.beside(own[:, :1])
    again = again.beside(again.of_all(own[:, 1:]))
    assert again.log_det == pytest.approx(beside.log_det)
    assert np.square(again.of_all(rows)).sum() == pytest.approx(square)


def test_near_a_jump_of_a_curve_readings_have_an_error_of_half_the_jump(tests):
    """Its instant is not known better. Where the curve changes slowly, and in tests without it, there is none."""
    time = tests.samples[0].centre
    curve = 0.5e-6 * np.sin(2.0 * np.pi * time / time[-1]) + 2e-6 * (time > time[150])
    d = Discrepancy.of_tests(tests).beside_curves(tests, [[curve, np.zeros_like(time)]], [()])
    whitening = d.whitening(Sizes(0.0, 0.0, np.ones(2)))
    white = whitening.of_test(0, np.eye(len(time)))
    error = NOISE * np.sqrt(np.maximum(np.diag(np.linalg.inv(white.T @ white)) - 1.0, 0.0))
    near = np.abs(time - time[150]) < 0.05
    assert error[near] == pytest.approx(1e-6, rel=0.05)
    assert error[np.abs(time - time[150]) > 0.11].max() < 0.01e-6
    assert whitening.of_test(1, np.eye(len(time))) == pytest.approx(np.eye(len(time)))
    # products along the wider basis are those that are computed at once
    columns = np.random.default_rng(5).standard_normal((2 * len(time), 3))
    known, at_once = Products(Discrepancy.of_tests(tests), columns).along_more(d), Products(d, columns)
    rows = np.ones(2 * len(time))
    for k in range(2):
        assert known.of_test(k, rows).along == pytest.approx(at_once.of_test(k, rows).along)


def test_a_reversal_may_be_early_or_late_and_all_that_follows_it(tests):
    """Teeth of a slide that sticks, 0.02 s later than in the model, are no error that asks for an explanation; as much
    of any other shape is one. Before the reversal, and in tests without one, there is no such error.
    """
    time = tests.samples[0].centre
    turn = time[150]

    def teeth(t):
        return np.where(t > turn, np.exp(-(t - turn) / 0.8) * (1.0 - 2.0 * np.mod((t - turn) / 0.3, 1.0)), 0.0)

    still = np.zeros_like(time)
    readings, turns = [[5e-6 * teeth(time), still]], [(np.array([turn]), np.zeros(0))]
    d = Discrepancy.of_tests(tests).beside_curves(tests, readings, turns)
    whitening = d.whitening(Sizes(0.0, 0.0, np.ones(2)))

    def misfit(error):
        white = tests.whiten_test(0, error[:, None])[:, 0]
        return np.square(whitening.of_test(0, white)).sum(), np.square(white).sum()

    late = misfit(5e-6 * (teeth(time - 0.02) - teeth(time)))
    assert late[0] < 10.0 and late[1] > 5_000.0
    other = misfit(1e-6 * np.where(time > turn, np.sin(20.0 * (time - turn)), 0.0))
    assert other[0] > 0.3 * other[1]
    before = misfit(1e-6 * (time < turn - 0.1))
    assert before[0] == pytest.approx(before[1])
    assert whitening.of_test(1, np.eye(len(time))) == pytest.approx(np.eye(len(time)))


def test_the_evidence_of_a_linear_model_is_that_of_its_covariance():
    rng = np.random.default_rng(3)
    columns, rows = rng.standard_normal((60, 3)), rng.standard_normal(60)
    time = np.linspace(0.0, 1.0, 60)
    basis, triangle = np.linalg.qr(_harmonics(time, 0.5)[:, :5])
    own = triangle @ np.diag([0.2, 0.1, 0.1, 0.1, 0.1]) @ triangle.T
    turns = rng.standard_normal((60, 2))  # of slides
    bends = rng.standard_normal((60, 3))
    common = [Common("turns", 1.0, turns, 1.0), Common("none", 1.0, bends, 1.0), Common("bends", 1.0, bends, 1.0)]
    d = Discrepancy([basis], [own], [0.0 * own], common=common)
    prior = np.array([1.0, 4.0, 0.25])
    linear = LinearModel(Products(d, columns), rows, prior, np.zeros(3))
    sizes = Sizes(1.0, 0.0, np.array([1.2]), {"turns": 0.7, "bends": 0.4})
    left = 1.44 * np.eye(60) + basis @ own @ basis.T + 0.49 * turns @ turns.T + 0.16 * bends @ bends.T
    covariance = left + columns @ np.diag(1.0 / prior) @ columns.T
    white = d.whitening(sizes).of_rows(d.rows, np.eye(60))
    assert white.T @ white == pytest.approx(np.linalg.inv(left), abs=1e-4)
    assert d.whitening(sizes).log_det == pytest.approx(np.linalg.slogdet(left)[1], abs=1e-3)
    expected = -0.5 * (rows @ np.linalg.solve(covariance, rows) + np.linalg.slogdet(covariance)[1])
    assert linear.log_evidence(sizes) - d.log_prior(sizes) == pytest.approx(expected)
    one = replace(sizes, common=sizes.common | {"none": 0.2})
    for name, slope in zip(one.common, linear._with_slopes(one)[1][[0, 2, 1]], strict=True):
        more, less = (replace(one, common=one.common | {name: one.common[name] * f}) for f in (1.001, 1.0 / 1.001))
        rise = (linear.log_evidence(more) - linear.log_evidence(less)) / (2.0 * np.log(1.001))
        assert slope == pytest.approx(rise, rel=1e-3)
    further = rng.standard_normal((60, 2))
    wider = LinearModel(Products(d, columns).extended(further), rows, np.append(prior, [1.0, 1.0]), np.zeros(5))
    covariance = covariance + further @ further.T
    expected = -0.5 * (rows @ np.linalg.solve(covariance, rows) + np.linalg.slogdet(covariance)[1])
    assert wider.log_evidence(sizes) - d.log_prior(sizes) == pytest.approx(expected)
    # two curves that share their knots are columns like others
    knots = rng.standard_normal((60, 4)) * (rng.random((60, 4)) < 0.3)
    roots = [rng.standard_normal((4, 3)), rng.standard_normal((4, 2))]
    sparse = csr_array(knots)
    curves = Products(d, columns).extended(further).with_curves(Knots([sparse, sparse], d.rows), roots)
    more = LinearModel(curves, rows, np.append(prior, np.ones(7)), np.zeros(10))
    known = covariance + sum(knots @ root @ root.T @ knots.T for root in roots)
    expected = -0.5 * (rows @ np.linalg.solve(known, rows) + np.linalg.slogdet(known)[1])
    assert more.log_evidence(sizes) - d.log_prior(sizes) == pytest.approx(expected)
    x = rng.standard_normal(10)
    dense = np.hstack([columns, further, *(knots @ root for root in roots)])
    assert curves.times(x) == pytest.approx(dense @ x)
    # asked about these sizes alone, it keeps less and says the same
    short = LinearModel(wider.products, rows, wider.precision, wider.departure, [sizes, sizes.times(0.5)])
    assert short.log_evidence(sizes) == pytest.approx(wider.log_evidence(sizes))
    assert short.log_evidence(sizes.times(0.5)) == pytest.approx(wider.log_evidence(sizes.times(0.5)))


@pytest.fixture
def few():
    """Ten hypotheses in pairs that look alike; the truth is the first of the second pair and the eighth."""
    rng = np.random.default_rng(5)
    x = rng.standard_normal((400, 10))
    x[:, 1::2] = 0.95 * x[:, ::2] + 0.3 * x[:, 1::2]
    y = 0.8 * x[:, 2] - 0.6 * x[:, 7] + rng.standard_normal(400)
    widths = np.array([0.3, 1.0, 3.0])
    hypotheses = [Columns(f"h{i}", np.array([i]), -3.0, widths) for i in range(10)]
    return x, y, LinearEvidence(x.T @ x, x.T @ y, hypotheses)


def test_the_evidence_of_a_set_is_that_of_its_covariance(few):
    x, y, linear = few
    chosen = {2: 1.0, 7: 0.3}
    covariance = np.eye(400) + x[:, [2]] @ x[:, [2]].T + 0.09 * x[:, [7]] @ x[:, [7]].T
    expected = -0.5 * (y @ np.linalg.solve(covariance, y) - y @ y + np.linalg.slogdet(covariance)[1])
    assert linear.total(chosen) == pytest.approx(expected + 2 * (-3.0 - np.log(3)))
    odds, _ = linear.odds({2: 1.0})
    each = [linear.total({2: 1.0, 7: w}) - linear.total({2: 1.0}) for w in (0.3, 1.0, 3.0)]
    assert odds[7] == pytest.approx(np.logaddexp.reduce(each))


def test_the_evidence_of_a_curve_is_that_of_its_covariance():
    """Of many coefficients, beside nothing, beside small hypotheses, and beside another curve with them."""
    rng = np.random.default_rng(6)
    x = rng.standard_normal((300, 104)) @ np.diag(np.geomspace(1.0, 1e-4, 104))
    y = x[:, :50] @ rng.standard_normal(50) + rng.standard_normal(300)
    widths = np.array([0.3, 3.0, 30.0])
    places = [np.arange(60), np.arange(60, 100), *np.arange(100, 104)[:, None]]
    linear = LinearEvidence(x.T @ x, x.T @ y, [Columns(f"h{i}", at, -3.0, widths) for i, at in enumerate(places)])
    for chosen in ({}, {3: 1.0}, {2: 0.3, 1: 3.0}, {1: 30.0, 4: 3.0, 5: 1.0}, {2: 1.0, 1: 30.0, 4: 3.0}):
        odds, _ = linear.odds(chosen)
        for g in set(range(6)) - set(chosen):
            each = [linear.total({**chosen, g: w}) - linear.total(chosen) for w in widths]
            assert odds[g] == pytest.approx(np.logaddexp.reduce(each), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("room", [1e9, 1.0])
def test_the_evidence_of_a_set_is_the_same_whatever_was_asked_before(monkeypatch, room):
    """Curves come and go, one from the sets before: the last of a hundred sets is that of its covariance, also where
    only two sets are kept.
    """
    monkeypatch.setattr(linear_evidence, "_ROOM", room)
    rng = np.random.default_rng(7)
    x = rng.standard_normal((300, 162)) @ np.diag(np.append(np.geomspace(30.0, 1e-3, 160), [1.0, 2.0]))
    y = x[:, 30:60] @ rng.standard_normal(30) + rng.standard_normal(300)
    widths = np.array([0.1, 20.0])
    places = [*np.split(np.arange(160), 4), np.array([160]), np.array([161])]
    linear = LinearEvidence(x.T @ x, x.T @ y, [Columns(f"h{i}", at, 0.0, widths) for i, at in enumerate(places)])
    for _ in range(100):
        chosen = {int(g): float(rng.choice(widths)) for g in np.flatnonzero(rng.random(6) < 0.5)}
        linear.odds(chosen)
        covariance = np.eye(300) + sum(w**2 * x[:, places[g]] @ x[:, places[g]].T for g, w in chosen.items())
        expected = -0.5 * (y @ np.linalg.solve(covariance, y) - y @ y + np.linalg.slogdet(covariance)[1])
        assert linear.total(chosen) == pytest.approx(expected - len(chosen) * np.log(2), rel=1e-8, abs=1e-9)
        assert len(linear._beside) <= (2 if room == 1.0 else 10)


def test_the_planted_set_is_found_from_any_start(few):
    linear = few[2]
    assert set(linear.best_set()) == {2, 7}
    assert set(linear.best_set([3, 6, 0])) == {2, 7}


def test_what_is_impossible_is_not_chosen(few):
    x, y, linear = few
    bounded = [
        Columns(h.name, h.places, h.log_odds, h.widths, is_possible=(lambda v: bool(v[0] > 0.0)))
        for h in linear.hypotheses
    ]
    assert 7 not in LinearEvidence(x.T @ x, x.T @ y, bounded).best_set()


def test_what_looks_alike_is_told_as_a_rival(few):
    linear = few[2]
    best = linear.best_set()
    assert [g for _, g, _ in linear.rivals(best, 2)][:1] == [3]


@pytest.mark.parametrize(("centre", "limit"), [((0.0, 0.0), 1.0), ((2.0, 0.0), 1.5), ((0.6, -0.6), 2.0)])
def test_the_probability_of_a_wave_beyond_its_limit_is_that_of_rice(centre, limit):
    sd = 0.7
    expected = ncx2.sf((limit / sd) ** 2, 2, np.dot(centre, centre) / sd**2)
    assert beyond(np.array(centre), sd**2 * np.eye(2), limit) == pytest.approx(expected, abs=0.01)


def test_a_whitening_without_anything_divides_by_the_noise_factor():
    whitening = Whitening(np.array([2.0]))
    assert whitening.of_test(0, np.ones(3)) == pytest.approx(0.5 * np.ones(3))
    assert whitening.of_all(np.ones(3)) == pytest.approx(np.ones(3))
