"""ISO 230-4 figures against closed forms."""

import numpy as np
import pytest

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.iso230 import bidirectional_figures, circular_figures, least_squares_circle

UM = 1e-6
PHI = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)


def test_eccentric_circle_has_no_circular_error():
    got = circular_figures(PHI, (3.0 + 7.0 * np.cos(PHI) - 4.0 * np.sin(PHI)) * UM)
    assert got.circular_error_um == pytest.approx(0.0, abs=1e-9)
    assert got.centre_um == pytest.approx((7.0, -4.0), abs=1e-9)
    assert (got.radial_max_um, got.radial_min_um) == pytest.approx((3.0, 3.0), abs=1e-9)


def test_ellipse_gives_twice_its_amplitude():
    got = circular_figures(PHI, (-2.0 + 5.0 * np.cos(2.0 * PHI) + 30.0 * np.sin(PHI)) * UM)
    assert got.circular_error_um == pytest.approx(10.0, abs=1e-6)
    assert got.radial_max_um == pytest.approx(3.0, abs=1e-6)
    assert got.radial_min_um == pytest.approx(-7.0, abs=1e-6)


def test_exact_offset_circle_in_the_plane():
    """A circle of 100 mm whose centre lies 20 µm off: the linear projection errs by the second-order term e²/2R = 2
    nm only.
    """
    r, e = 0.1, 20e-6
    reading = e * np.cos(PHI) + np.sqrt(r**2 - (e * np.sin(PHI)) ** 2) - r
    assert circular_figures(PHI, reading).circular_error_um == pytest.approx(e**2 / (2 * r) / UM, rel=1e-3)


def test_revolutions_and_direction_do_not_matter():
    two = np.concatenate([PHI, PHI + 2.0 * np.pi])
    trace = lambda phi: (1.0 + 2.0 * np.cos(3.0 * phi) + 9.0 * np.cos(phi)) * UM  # noqa: E731
    one = circular_figures(PHI, trace(PHI))
    many = circular_figures(-two, trace(-two))
    assert many.circular_error_um == pytest.approx(one.circular_error_um)
    assert many.centre_um == pytest.approx(one.centre_um)


def test_hysteresis_between_the_directions():
    """±h between the directions and a common second harmonic a: G(b) = 2h + 2a although each direction alone has G
    = 2a.
    """
    h, a, c = 1.5, 2.0, 4.0
    shape = a * np.cos(2.0 * PHI)
    eccentric = 6.0 * np.sin(PHI)
    got = bidirectional_figures(PHI, (c + h + shape + eccentric) * UM, -PHI, (c - h + shape - eccentric) * UM)
    assert got.circular_error_um == pytest.approx(2.0 * h + 2.0 * a, abs=1e-6)
    assert got.mean_radial_error_um == pytest.approx(c, abs=1e-9)
    assert got.centre_um == pytest.approx((0.0, 6.0), abs=1e-9)


def test_the_centre_is_common_to_both_directions():
    """A centre that moves by ±2 µm between the directions is an error of the machine, not of the set-up."""
    got = bidirectional_figures(PHI, 2.0 * UM * np.cos(PHI), -PHI, -2.0 * UM * np.cos(PHI))
    assert got.centre_um == pytest.approx((0.0, 0.0), abs=1e-9)
    assert got.circular_error_um == pytest.approx(4.0, abs=1e-6)


def test_directions_weigh_the_same_whatever_their_sample_counts():
    dense = np.linspace(0.0, 4.0 * np.pi, 20000, endpoint=False)
    got = bidirectional_figures(dense, np.full(dense.size, 10.0 * UM), -PHI, np.full(PHI.size, -2.0 * UM))
    assert got.mean_radial_error_um == pytest.approx(4.0, abs=1e-9)


def test_the_constant_survives_a_missing_stretch():
    kept = (PHI < 1.0) | (PHI > 1.3)
    circle = least_squares_circle(PHI[kept], (3.0 + 5.0 * np.sin(PHI[kept])) * UM)
    assert circle.radius_error_m / UM == pytest.approx(3.0)
    assert circle.centre_m / UM == pytest.approx([0.0, 5.0], abs=1e-9)


@pytest.mark.parametrize(
    ("phi", "deviation", "said"),
    [
        (PHI[:1800], np.zeros(1800), "full circle"),
        (PHI, np.where(PHI < 0.1, np.nan, 0.0), "not finite"),
        (PHI[:2], np.zeros(2), "at least 3"),
        (PHI, np.zeros(5), "one length"),
    ],
)
def test_unusable_traces_are_refused(phi, deviation, said):
    with pytest.raises(ValueError, match=said):
        circular_figures(phi, deviation)


def test_refusals_of_data_are_input_errors():
    with pytest.raises(InputError):
        bidirectional_figures(PHI, np.zeros(PHI.size), PHI[:900], np.zeros(900))
