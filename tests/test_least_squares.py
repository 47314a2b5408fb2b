"""The parameter vector and the bounded least-squares solver, held against closed forms and scipy."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from mjsim.inference.curve_fit import Together
from mjsim.inference.least_squares import LeastSquares, ridge_solution
from mjsim.inference.parameters import Block, Parameters


@pytest.fixture
def parameters():
    tolerances = np.array([0.5, 2.0, 3.0])
    return Parameters(
        (
            Block.normal("set-up", ("x", "y")),
            Block.normal("triggers", ("first", "second"), limit=0.4),
            Block.normal("calibration", ("a", "b", "c"), mean=np.array([1.0, -1.0, 0.5]), deviation=tolerances),
            Block.normal("effect", ("size",), mean=0.3, deviation=1e3, informative=False),
        )
    )


@pytest.fixture
def system(parameters):
    """Whitened design and residuals; both triggers want to go beyond their limit."""
    rng = np.random.default_rng(4)
    design = rng.standard_normal((60, parameters.size))
    truth = parameters.join({"triggers": np.array([2.0, -0.9]), "effect": np.array([5.0])})
    return design, design @ truth + 0.1 * rng.standard_normal(60)


def stacked(parameters, design, residual, vector, weight=1.0):
    """The same least squares as rows of data and priors."""
    root = np.sqrt(parameters.precision(weight))
    return np.vstack([design, np.diag(root)]), np.concatenate([residual, -root * parameters.departure(vector)])


def test_a_vector_goes_round_its_blocks(parameters):
    vector = np.arange(8.0)
    values = parameters.split(vector)
    assert list(values) == ["set-up", "triggers", "calibration", "effect"]
    np.testing.assert_array_equal(parameters.join(values), vector)
    np.testing.assert_array_equal(vector[parameters["calibration"]], [4.0, 5.0, 6.0])
    assert parameters.place("calibration", "b") == 5
    np.testing.assert_array_equal(parameters.places("effect", "triggers"), [7, 2, 3])
    np.testing.assert_array_equal(
        parameters.part(vector, Parameters(parameters.blocks[1:3])), [2.0, 3.0, 4.0, 5.0, 6.0]
    )


def test_what_is_not_given_stands_at_its_prior(parameters):
    np.testing.assert_array_equal(parameters.join({}), [0, 0, 0, 0, 1.0, -1.0, 0.5, 0.3])
    with pytest.raises(ValueError, match="no block is named 'friction'"):
        parameters.join({"friction": np.zeros(1)})
    with pytest.raises(ValueError, match="has 2 entries, not 3"):
        parameters.join({"set-up": np.zeros(3)})
    with pytest.raises(ValueError, match="different names"):
        parameters.with_blocks(Block.normal("effect", ("other",)))


def test_the_penalty_counts_informative_priors(parameters):
    vector = parameters.join(
        {"set-up": np.array([3.0, 4.0]), "calibration": np.array([2.0, -1.0, 3.5]), "effect": np.array([99.0])}
    )
    assert parameters.penalty(vector) == pytest.approx(25.0 + (1.0 / 0.5) ** 2 + 1.0)
    np.testing.assert_allclose(parameters.precision(4.0), [4, 4, 4, 4, 16.0, 1.0, 4.0 / 9.0, 1e-6])


@pytest.mark.parametrize("weight", [1.0, 7.0])
def test_an_unbounded_step_is_the_least_squares_one(parameters, system, weight):
    free = Parameters(tuple(b for b in parameters.blocks if b.name != "triggers"))
    design, residual = np.delete(system[0], [2, 3], axis=1), system[1]
    vector = free.join({"set-up": np.array([0.2, -0.1])})
    a, b = stacked(free, design, residual, vector, weight)
    step = LeastSquares.of_design(free, design, weight).step(design.T @ residual, vector)
    np.testing.assert_allclose(step, np.linalg.lstsq(a, b, rcond=None)[0], rtol=1e-9, atol=1e-12)


def test_a_bounded_step_is_that_of_scipy(parameters, system):
    design, residual = system
    vector = parameters.join({"triggers": np.array([0.1, -0.4])})  # the second is on its bound already
    step = LeastSquares.of_design(parameters, design).step(design.T @ residual, vector)
    a, b = stacked(parameters, design, residual, vector)
    room = np.nextafter(parameters.lower - vector, -np.inf), np.nextafter(parameters.upper - vector, np.inf)
    expected = lsq_linear(a, b, room, method="bvls", tol=1e-14).x
    np.testing.assert_allclose(step, expected, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose((vector + step)[parameters["triggers"]], [0.4, -0.4], atol=1e-12)
    assert ((vector + 0.5 * step) <= parameters.upper).all()


def test_the_covariance_is_the_inverse(parameters, system):
    design, _ = system
    equations = LeastSquares.of_design(parameters, design)
    inverse = np.linalg.inv(design.T @ design + np.diag(parameters.precision()))
    np.testing.assert_allclose(equations.covariance, inverse, rtol=1e-9, atol=1e-12)
    columns = np.random.default_rng(5).standard_normal((60, 3))
    cross = design.T @ columns
    left = columns.T @ columns - cross.T @ inverse @ cross
    np.testing.assert_allclose(equations.left_over(columns.T @ columns, cross), left, rtol=1e-9)
    step = np.arange(8.0)
    assert equations.gain(step) == pytest.approx(step @ np.linalg.solve(inverse, step))
    np.testing.assert_allclose(
        ridge_solution(design.T @ design, cross, parameters.precision()), inverse @ cross, rtol=1e-8
    )


def test_rows_of_more_noise_tell_less(parameters, system):
    """Rows of four times the variance beside the same priors: the posterior by Bayes' rule."""
    design, _ = system
    informative = parameters.informative
    kept = design[:, informative]
    prior = parameters.precision()[informative]
    blocks = Parameters(tuple(b for b in parameters.blocks if b.name != "effect"))
    assert blocks.size == informative.sum()
    covariance = LeastSquares.of_design(blocks, kept, 4.0).covariance
    np.testing.assert_allclose(covariance, np.linalg.inv(kept.T @ kept / 4.0 + np.diag(prior)), rtol=1e-9, atol=1e-12)


def test_frozen_entries_stay(parameters, system):
    """They do not move, take nothing up, and keep the variance of their prior."""
    design, residual = system
    frozen = np.array([False, True, False])
    block = Block.normal("calibration", ("a", "b", "c"), deviation=2.0, frozen=frozen)
    held = Parameters((*parameters.blocks[:2], block, parameters.blocks[3]))
    vector = held.join({"calibration": np.array([0.1, 0.7, 0.2])})
    equations = LeastSquares.of_design(held, design)
    step = equations.step(design.T @ residual, vector)
    at = held.place("calibration", "b")
    assert step[at] == 0.0 and equations.covariance[at, at] == pytest.approx(4.0)
    without = np.delete(np.arange(held.size), at)
    a, b = stacked(held, design, residual, vector)
    rows = np.r_[np.arange(60), 60 + without]
    low, high = held.lower - vector, held.upper - vector
    expected = lsq_linear(a[np.ix_(rows, without)], b[rows], (low[without], high[without]), method="bvls").x
    np.testing.assert_allclose(step[without], expected, rtol=1e-7, atol=1e-10)


def test_beside_a_curve_the_model_takes_nothing_of_it():
    """What a wide curve explains does not move the parameters, and their covariance is that of the joint problem."""
    rng = np.random.default_rng(8)
    parameters = Parameters((Block.normal("effect", tuple("abc"), mean=0.0, deviation=1e3, informative=False),))
    columns = rng.standard_normal((400, 3))
    design = rng.standard_normal((400, 3)) + 0.8 * columns  # alone, the parameters would take up much of the curve
    truth, curve = np.array([0.3, -0.2, 0.5]), np.array([40.0, -30.0, 60.0])
    residual = design @ truth + columns @ curve + rng.standard_normal(400)
    fit = SimpleNamespace(
        design=design,
        residual=residual,
        vector=np.zeros(3),
        linear=LeastSquares.of_design(parameters, design),
    )
    together = Together(fit, columns)
    both = np.hstack([design, columns])
    covariance = np.linalg.inv(both.T @ both)
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(together.equations.covariance, covariance[:3, :3], rtol=0.01)
    assert (np.abs(together.step - truth) < 4.0 * deviation[:3]).all()
    assert (np.abs(together.coefficients - curve) < 4.0 * deviation[3:]).all()
    alone = fit.linear.step(design.T @ residual, fit.vector)
    assert np.abs(alone - truth).max() > 100.0 * deviation[:3].max()
