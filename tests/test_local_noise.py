"""Noise that is louder at some places of a test: found where there is some, and only there."""

import math

import numpy as np
import pytest
from independent import chain_campaigns
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.inference.bar_search import BarSearch
from mjsim.inference.calibration import calibrated_effects
from mjsim.inference.fit import Fitter
from mjsim.inference.local_noise import LocalNoise, Tiles
from mjsim.inference.problem import Problem
from mjsim.machine.model import build

BLOCK, COUNT = 0.01, 3000
TILES = Tiles.of_test(COUNT, BLOCK)


def local_noise(rows, tiles=TILES):
    """That of rows from which nothing has been taken out."""
    return LocalNoise.of_residual(tiles, tiles.transformed(rows), np.ones(tiles.count))


def ringing(at, size, frequency=13.0, damping=0.05):
    """A structure that is hit ``at`` s and rings down, (COUNT,)."""
    since = BLOCK * np.arange(COUNT) - at
    omega = 2.0 * math.pi * frequency
    wave = np.exp(-damping * omega * np.maximum(since, 0.0)) * np.sin(omega * since)
    return np.where(since > 0.0, size * wave, 0.0)


@pytest.mark.parametrize("level", [0.7, 1.0, 3.0])
def test_a_test_that_is_as_loud_everywhere_has_none(level):
    """Twenty of them, however loud they are as a whole."""
    rng = np.random.default_rng(1)
    assert all(local_noise(level * rng.standard_normal(COUNT)) is None for _ in range(20))


def test_a_structure_that_rings_is_louder_where_and_as_it_rings():
    rng = np.random.default_rng(2)
    rows = rng.standard_normal(COUNT) + ringing(7.0, 15.0) + ringing(20.0, 15.0)
    found = local_noise(rows)
    white = found.whitened(rows)
    centre = np.array([0.5 * BLOCK * (at.start + at.stop) for at in TILES.stretches])
    loudest = np.array([found.level[at].max() for at in TILES.stretches])
    rings = np.min([np.abs(centre - 7.3), np.abs(centre - 20.3)], axis=0) < 0.5
    assert loudest[rings].max() > 5.0
    assert loudest[~rings].max() < 2.0
    at = TILES.stretches[int(np.argmax(loudest))]
    frequency = (np.argmax(found.level[at]) + np.arange(2)) / (2.0 * BLOCK * (at.stop - at.start))
    assert frequency[0] < 13.0 < 2.1 * frequency[1]  # its octave
    quiet = np.concatenate([white[a] for a, r in zip(TILES.stretches, rings, strict=True) if not r])
    assert np.std(quiet) == pytest.approx(1.0, abs=0.06)
    assert np.std(white) == pytest.approx(1.0, abs=0.06)


def test_a_burst_does_not_make_the_rest_count_less():
    """With one noise for the whole test its values would count for less than a third."""
    rng = np.random.default_rng(3)
    rows = rng.standard_normal(COUNT)
    rows[1000:1100] *= 10.0
    found = local_noise(rows)
    assert np.mean(rows**2) > 3.5
    assert np.median(found.level) == pytest.approx(1.0, abs=0.1)
    assert found.variance == pytest.approx(np.mean(rows**2), rel=0.1)


def test_its_matrix_does_what_it_does_and_can_be_undone():
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((COUNT, 3))
    found = local_noise(rows[:, 0] + ringing(7.0, 15.0))
    np.testing.assert_allclose(found.matrix() @ rows, found.whitened(rows), atol=1e-12)
    np.testing.assert_allclose(found.undone(found.whitened(rows)), rows, atol=1e-12)


def test_its_evidence_is_that_of_variances_that_are_integrated_out():
    """Over a scaled inverse chi-squared prior with two degrees of freedom, whose scale is the likeliest."""
    rng = np.random.default_rng(5)
    tiles = Tiles.of_test(140, BLOCK)
    rows = rng.standard_normal(140)
    rows[:70] *= 8.0
    found, inside = local_noise(rows, tiles), tiles.transformed(rows)
    squares, counts = tiles.sums(inside**2), tiles.sums(np.ones(140))

    def evidence(scale):
        """Log of the product of the integrals over the logarithm of each tile's variance."""

        def density(x, n, q):
            v = math.exp(x)
            return math.exp(-0.5 * n * (x - math.log(q / n)) - 0.5 * q / v + 0.5 * n) * scale / v * math.exp(-scale / v)

        return sum(
            math.log(quad(density, -20.0, 20.0, (n, q), points=[math.log(q / n)], limit=200)[0])
            - 0.5 * n * (math.log(q / n) + 1.0)
            for n, q in zip(counts, squares, strict=True)
        )

    best = -minimize_scalar(lambda x: -evidence(math.exp(x)), bounds=(-6.0, 6.0), method="bounded").fun
    white = found.whitened(rows)
    assert found.log_evidence - 0.5 * float(white @ white) == pytest.approx(best, abs=0.02)


def test_what_has_been_explained_away_is_no_quiet_noise():
    """A model that follows the lowest frequencies leaves nothing there, and says nothing about their noise."""
    rng = np.random.default_rng(6)
    inside = TILES.transformed(rng.standard_normal(COUNT) + ringing(7.0, 15.0))
    known = np.ones(COUNT)
    low = np.concatenate([np.arange(at.start, at.start + 6) for at in TILES.stretches])
    inside[low], known[low] = 0.0, 0.0
    found = LocalNoise.of_residual(TILES, inside, known)
    assert np.median(found.level[low]) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("frequencies", [(13.0, 13.0), ()])
def test_a_structure_that_rings_makes_its_tests_louder_where_it_rings(tmp_path, frequencies):
    """Modes of spindle head and table, which are in no catalogue, on a machine that has its small errors only."""
    chain_campaigns.write(chain_campaigns.ringing(*frequencies), tmp_path)
    campaign = read_campaign(tmp_path)
    machine = read_machine(campaign.machine_file)
    search = BarSearch(Fitter(Problem.of(campaign, build(machine)), machine))
    known = {c.key: c for c in calibrated_effects(machine)}
    model = search.of_effects([c.free for c in known.values()], known)
    if not frequencies:
        assert not model.base.local and model.leaves_nothing
        return
    assert model.base.local.keys() == {0, 1}
    for k, local in model.base.local.items():
        assert np.median(local.level) == pytest.approx(1.0, abs=0.15)  # the rest of the test counts in full
        loudest = int(np.argmax(local.level))
        at = next(s for s in local.tiles.stretches if s.start <= loudest < s.stop)
        low, high = np.array([0.4, 2.1]) * (loudest - at.start + 0.5) / (2.0 * BLOCK * (at.stop - at.start))
        assert low < 13.0 < high
        white = model.fit.residual[search.plain.rows[k]]
        assert np.mean(white**2) == pytest.approx(1.0, abs=0.1)
    assert 0.05e-6 < model.base.local_rms < model.left
    assert not model.base.with_noises(model.base.noises).local  # it is that beside one noise model, and of its rows
