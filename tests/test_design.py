"""The design of a model against the full matrix that it stands for."""

import numpy as np
import pytest

from mjsim.inference.design import Design


@pytest.fixture(params=[False, True], ids=["own errors", "shared errors"])
def both(request):
    """A design of three tests, two of which share a nuisance, and the same as a matrix (90, 5 + 4)."""
    rng = np.random.default_rng(2)
    places = np.array([0, 1]), np.array([0, 2]), np.array([3, 4])
    blocks = [(at, rng.standard_normal((n, 2))) for at, n in zip(places, (20, 30, 40), strict=True)]
    rest = rng.standard_normal((90, 4))
    full = np.hstack([np.zeros((90, 5)), rest])
    for (at, columns), first in zip(blocks, (0, 20, 50), strict=True):
        full[first : first + len(columns), at] = columns
    if not request.param:
        return Design(blocks, 5, rest), full
    shared = np.linalg.qr(rng.standard_normal((90, 3)))[0], np.array([0.2, 0.5, 0.9])
    return Design(blocks, 5, rest, shared), full - shared[0] @ (shared[1][:, None] * (shared[0].T @ full))


def test_a_design_multiplies_like_its_matrix(both):
    design, full = both
    rng = np.random.default_rng(3)
    assert design.shape == full.shape
    for shape in ((9,), (9, 3)):
        x = rng.standard_normal(shape)
        np.testing.assert_allclose(design @ x, full @ x, atol=1e-12)
    for shape in ((90,), (90, 3)):
        x = rng.standard_normal(shape)
        np.testing.assert_allclose(design.T @ x, full.T @ x, atol=1e-12)
    np.testing.assert_allclose(design.T @ design, full.T @ full, atol=1e-12)


def test_a_design_multiplies_with_another_of_the_same_tests(both):
    design, full = both
    part, columns = design.of_nuisances, full[:, :5]
    np.testing.assert_allclose(design.T @ part, full.T @ columns, atol=1e-12)
    np.testing.assert_allclose(part.T @ design, columns.T @ full, atol=1e-12)


def test_a_part_of_a_design_is_that_part_of_its_matrix(both):
    design, full = both
    places = np.array([6, 8])
    near = {"rtol": 0.0, "atol": 1e-12 if design.shared else 0.0}  # of own errors alone it is that part to the bit
    np.testing.assert_allclose(design.columns(places), full[:, places], **near)
    np.testing.assert_allclose(design.columns(slice(5, 7)), full[:, 5:7], **near)
    np.testing.assert_allclose(design.without(places) @ np.eye(7), np.delete(full, places, axis=1), **near)
    np.testing.assert_allclose(design.of_nuisances.dense(), full[:, :5], **near)
    np.testing.assert_allclose(design.dense(full[:, 2]), np.column_stack([full, full[:, 2]]), **near)
