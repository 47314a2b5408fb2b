"""The simplest shape of a generic curve: planted shapes are recovered, noise has none, and the errors beside it are
found better.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from mjsim.inference.curve_fit import Together, bends, changes, free_shape, orders, simplest_shape
from mjsim.inference.curve_terms import CurveTerm, HatColumns, WaveColumns, hats
from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.parameters import Block, Parameters
from mjsim.inference.unexplained import shape_in_words
from mjsim.inference.unknown_curves import WIDTHS, teeth_of
from mjsim.units import DEG

K, ROWS, TURN = 48, 2400, 2.0 * np.pi
KNOT = np.arange(K)
SHAPES = {
    "steps": np.where(KNOT > 20, 4.0, 0.0),
    "bends": np.where(KNOT > 20, 0.4 * (KNOT - 20), 0.0),
    "waves": 4.0 * np.cos(2.0 * np.pi * 3 * KNOT / K + 0.4),
}


def readings(curve, seed=1, noise=1.0):
    """Columns of a curve that is passed twice, and a measurement of it."""
    columns = hats(np.linspace(0.0, 2.0 * K, ROWS) % K, KNOT.astype(float), float(K)).toarray()
    return columns, columns @ curve + noise * np.random.default_rng(seed).standard_normal(ROWS)


def shape_of(curve, **how):
    columns, y = readings(curve, **how)
    return simplest_shape(columns.T @ columns, columns.T @ y, closed=True), columns, y


def curve_of(shape, columns, y):
    """The most likely curve of a shape."""
    parts = columns @ shape.columns
    return shape.columns @ np.linalg.solve(parts.T @ parts + np.diag(shape.precision), parts.T @ y)


@pytest.mark.parametrize("name", SHAPES)
def test_a_planted_shape_is_recovered(name):
    """With it the curve is nearer to the truth than the curve that is free at every knot."""
    shape, columns, y = shape_of(SHAPES[name])
    assert shape.name == name

    def error(shape):
        return np.std(curve_of(shape, columns, y) - SHAPES[name])

    assert error(shape) < 0.5 * error(free_shape(columns.T @ columns, columns.T @ y))


def test_a_line_has_no_bend_where_hardly_any_test_goes():
    """A line from the second knot on explains the readings as well as one from the first."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        x = np.append(rng.uniform(1.0, K - 1.0, ROWS), rng.uniform(0.0, 1.0, 5))
        columns = hats(x, KNOT.astype(float), None).toarray()
        y = 0.1 * x + 0.1 * rng.standard_normal(len(x))
        columns, y = columns - columns.mean(axis=0), y - y.mean()  # the set-up has taken up the level
        shape = simplest_shape(columns.T @ columns, columns.T @ y, closed=False)
        assert shape.name == "bends" and bends(curve_of(shape, columns, y)) == []


def test_a_curve_without_a_simple_shape_stays_free():
    assert shape_of(4.0 * np.random.default_rng(2).standard_normal(K))[0].name == "free"


def test_noise_has_no_curve():
    """The evidence of every shape is below that of none, and next to nothing of the noise is taken up."""
    shape, columns, y = shape_of(np.zeros(K))
    curve = curve_of(shape, columns, y)
    assert shape.log_evidence < 1.0 and np.abs(columns @ curve).max() < 0.2


@pytest.mark.parametrize("seed", range(5))
def test_the_evidence_of_a_shape_is_its_marginal_likelihood(seed):
    """A step's evidence against the covariance of the data, written out."""
    columns, y = readings(SHAPES["steps"], seed)
    columns, y = columns[::20], y[::20]
    shape = simplest_shape(columns.T @ columns, columns.T @ y, closed=False)
    parts = columns @ shape.columns
    cov = np.eye(len(y)) + parts @ np.diag(1.0 / shape.precision) @ parts.T
    none, some = y @ y, np.linalg.slogdet(cov)[1] + y @ np.linalg.solve(cov, y)
    count = len(changes(SHAPES["steps"]))
    prior = -count * (np.log(K - 1) + np.log(len(WIDTHS)))  # of where the step is, and of its width
    assert shape.name == "steps" and shape.log_evidence == pytest.approx(0.5 * (none - some) + prior, abs=0.1)


def test_beside_a_simple_curve_other_errors_are_found_better():
    """A free curve takes up a wave that belongs to the machine; a step does not."""
    columns, y = readings(SHAPES["steps"], seed=3)
    wave = columns @ np.cos(2.0 * np.pi * KNOT / K)
    other = np.linspace(0.0, 2.0 * K, ROWS) > K  # it is a little less in the second turn, so it can be told
    design = (wave * (1.0 - 0.02 * other))[:, None]
    parameters = Parameters((Block.normal("effect", ("a",), mean=0.0, deviation=10.0, informative=True),))
    fit = SimpleNamespace(
        design=design, residual=y + design[:, 0], vector=np.zeros(1), linear=LeastSquares.of_design(parameters, design)
    )
    free = Together(fit, columns)
    simple = Together(fit, columns, shape=lambda a, b: simplest_shape(a, b, closed=False))
    assert simple.shape.name == "steps" and abs(simple.step[0] - 1.0) < 0.1
    assert simple.equations.covariance[0, 0] < 0.1 * free.equations.covariance[0, 0]
    assert abs(simple.step[0] - 1.0) < 4.0 * np.sqrt(simple.equations.covariance[0, 0])


def test_a_curve_that_the_model_takes_up_whole_adds_nothing():
    """Of some of its knots there are no data either."""
    columns, y = readings(SHAPES["steps"])
    columns = np.column_stack([columns[:, :K] * (KNOT < 30), np.zeros(ROWS)])
    parameters = Parameters((Block.normal("effect", tuple(map(str, KNOT)), mean=0.0, deviation=1e9),))
    design = columns[:, :K]
    fit = SimpleNamespace(
        design=design, residual=y, vector=np.zeros(K), linear=LeastSquares.of_design(parameters, design)
    )
    alone = y - design @ fit.linear.step(design.T @ y, fit.vector)
    beside = Together(fit, columns)
    assert np.isfinite(beside.objective)
    assert beside.misfit == pytest.approx(np.mean(alone**2), rel=1e-6)


def test_changes_and_orders_are_told():
    ((place, size),) = changes(SHAPES["steps"])
    assert (place, size) == (20.5, 4.0)
    halfway = np.where(KNOT > 21, 4.0, np.where(KNOT > 20, 1.0, 0.0))  # a step between two knots
    ((place, size),) = changes(halfway)
    assert (place, size) == (21.25, 4.0)
    assert [place for place, _ in changes(SHAPES["steps"], closed=True)] == [20.5, 47.5]
    assert bends(SHAPES["bends"]) == [20.0] and bends(0.4 * KNOT + 1e-3 * SHAPES["bends"]) == []
    assert orders(SHAPES["waves"] + np.cos(2.0 * np.pi * 5 * KNOT / K)) == [3, 5]
    assert changes(np.ones(5)) == []


@pytest.mark.parametrize(
    ("shape", "curve", "period", "told"),
    [
        (
            "steps",
            SHAPES["steps"],
            TURN,
            " The curve is flat but for steps of +0.0023° at 153.8° and -0.0023° at 356.2°.",
        ),
        ("steps", SHAPES["steps"], None, " The curve is flat but for a step of +0.0023° at 153.8°."),
        ("bends", SHAPES["bends"], None, " The curve is straight, with a bend at 150°."),
        (
            "bends",
            np.abs(KNOT - 20.0) + np.abs(KNOT - 30.0),
            None,
            " The curve is straight, with bends at 150° and 225°.",
        ),
        ("bends", 0.4 * KNOT + 1e-3 * SHAPES["bends"], None, " The curve is straight."),
        ("waves", SHAPES["waves"], TURN, " The curve has 3 waves per turn."),
        ("waves", np.cos(TURN * KNOT / K), TURN, " The curve has 1 wave per turn."),
        ("free", SHAPES["waves"], TURN, ""),
    ],
)
def test_the_shape_is_told_in_a_sentence(shape, curve, period, told):
    knots = KNOT * 360.0 / K
    term = CurveTerm("C", "C", "position", knots * DEG, period, [], coefficients=curve, shape=shape)
    assert shape_in_words(term, knots, 1.0 / DEG, "°", "°") == told


@pytest.mark.parametrize("width", [0.6, 3.0])
def test_worn_teeth_are_met_one_by_one_and_in_stretches(width):
    """Damage ``width`` teeth wide on both sides of one place: what the best prior leaves of it is below the noise."""
    teeth, knots, noise = 60.0, np.arange(720) * (TURN / 720), 0.05
    from_there = knots - 2.0
    damage = np.exp(-0.5 * (from_there * teeth / (width * TURN)) ** 2) * np.cos(teeth * from_there)
    measured = damage + noise * np.random.default_rng(3).standard_normal(720)
    left = []
    for factors in teeth_of(CurveTerm("C", "C", "position", knots, TURN, ()), teeth):
        cosine, sine = np.split(factors, 2)
        root = np.cos(teeth * knots)[:, None] * cosine + np.sin(teeth * knots)[:, None] * sine
        sizes = np.linalg.solve(root.T @ root / noise**2 + np.eye(root.shape[1]), root.T @ measured / noise**2)
        left.append(np.sqrt(np.mean((root @ sizes - damage) ** 2)))
    assert min(left) < 0.5 * noise


def test_a_wave_of_teeth_is_followed_between_the_knots():
    """Columns of its size at a few knots per tooth are the wave itself; values at as many knots are far from it."""
    teeth, knots = 67, np.arange(4 * 67) * (TURN / (4 * 67))
    places = np.random.default_rng(5).uniform(0.0, 3.0 * TURN, 4000)
    reach = 2.0 + np.cos(places)

    def hat_columns(wave):
        return HatColumns([places], [reach * wave(teeth * places)], knots, TURN)

    columns = WaveColumns(hat_columns(np.cos), hat_columns(np.sin))
    assert len(columns) == 1 and columns[0].shape == (4000, 2 * len(knots))
    sizes = np.repeat([0.6, -0.8], len(knots))  # cos 67q and sin 67q with one size everywhere
    wave = reach * (0.6 * np.cos(teeth * places) - 0.8 * np.sin(teeth * places))
    assert np.allclose(columns.of_test(0) @ sizes, wave, rtol=0.0, atol=1e-12)
    values = HatColumns([places], [reach], knots, TURN)[0]
    left = wave - values @ np.linalg.lstsq(values, wave, rcond=None)[0]
    assert np.std(left) > 0.05 * np.std(wave)
