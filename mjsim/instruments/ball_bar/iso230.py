"""ISO 230-4 figures of circular traces: G and F of one direction, G(b) and D of both.

The terms are those of ISO 230-4:2022, which says "error" where the edition of 2005 said "deviation". The definitions
and symbols, paraphrased, follow the edition of 2005 as commonly cited; the text of 2022 was not at hand:

* circular error **G**: minimum radial separation of two concentric circles that envelop the actual path. The standard
  lets it be
  evaluated as the radial range about the least-squares circle; this module does.
* radial error **F**, as ``Fmax`` and ``Fmin``: deviation of the actual path from the nominal path, positive away from
  the centre. The
  nominal centre is the one found by least squares, which the standard allows for full circles only.
* bi-directional circular error **G(b)**: the same separation for two actual paths together, one run clockwise and one
  counter-clockwise, about their common least-squares centre.
* mean bi-directional radial error **D**: radius of the least-squares circle of both paths together minus the nominal
  radius.

The bar reads along the radius, so a centre offset of a few µm on a circle of many mm shows as ``cx·cos φ + cy·sin φ``
and the least-squares circle is the projection of the reading on ``[cos φ, sin φ, 1]``. The constant is no eccentricity:
it stays in F and is D, and cancels in G. Angles and lengths are SI; the figures are in µm, as their names say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjsim.errors import InputError
from mjsim.units import DEG, UM

#: Widest stretch without samples, as an angle on the circle, that still counts as a full circle [rad].
WIDEST_GAP_RAD = 30.0 * DEG


@dataclass(frozen=True)
class LeastSquaresCircle:
    """Circle that fits radial readings best.

    Attributes:
        centre_m: (2,) centre relative to the nominal one along φ = 0 and φ = 90° [m].
        radius_error_m: its radius minus the nominal radius [m].
    """

    centre_m: NDArray[np.float64]
    radius_error_m: float

    def eccentricity_m(self, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """What the centre offset alone makes of the reading at ``phi_rad``: same shape [m]."""
        phi = np.asarray(phi_rad, dtype=float)
        return self.centre_m[0] * np.cos(phi) + self.centre_m[1] * np.sin(phi)


@dataclass(frozen=True)
class CircularFigures:
    """ISO 230-4 figures of one path run in one direction.

    Attributes:
        circular_error_um: G, radial range about the least-squares centre [µm], >= 0.
        radial_max_um: Fmax, largest deviation from the nominal radius, outward positive [µm].
        radial_min_um: Fmin, smallest deviation from the nominal radius [µm].
        centre_um: (2,) least-squares centre that was taken out, along φ = 0 and φ = 90° [µm].
    """

    circular_error_um: float
    radial_max_um: float
    radial_min_um: float
    centre_um: tuple[float, float]


@dataclass(frozen=True)
class BidirectionalFigures:
    """ISO 230-4 figures of one path run in both directions.

    Attributes:
        circular_error_um: G(b), radial range of both paths about their common least-squares centre [µm], >= 0.
        mean_radial_error_um: D, radius of the common least-squares circle minus the nominal radius [µm].
        centre_um: (2,) common least-squares centre that was taken out, along φ = 0 and φ = 90° [µm].
    """

    circular_error_um: float
    mean_radial_error_um: float
    centre_um: tuple[float, float]


def least_squares_circle(
    phi_rad: ArrayLike, deviation_m: ArrayLike, weight: ArrayLike | None = None
) -> LeastSquaresCircle:
    """Fit centre and radius to radial readings.

    Args:
        phi_rad: (n,) angle on the nominal circle, any number of revolutions either way [rad].
        deviation_m: (n,) reading, outward positive [m].
        weight: (n,) weight of each sample's squared residual; all alike when missing.

    Raises:
        InputError: samples are missing, are not finite, or leave a gap of more than 30° on the circle.
        ValueError: the arrays differ in length.
    """
    phi, deviation = _checked(phi_rad, deviation_m)
    root = np.ones_like(phi) if weight is None else np.sqrt(np.broadcast_to(np.asarray(weight, dtype=float), phi.shape))
    basis = np.column_stack([np.cos(phi), np.sin(phi), np.ones_like(phi)])
    solution = np.asarray(np.linalg.lstsq(basis * root[:, None], deviation * root, rcond=None)[0], dtype=float)
    return LeastSquaresCircle(centre_m=solution[:2], radius_error_m=float(solution[2]))


def circular_figures(phi_rad: ArrayLike, deviation_m: ArrayLike) -> CircularFigures:
    """G, Fmax, Fmin and centre of one path.

    Args:
        phi_rad: (n,) angle on the nominal circle, any number of revolutions either way [rad].
        deviation_m: (n,) reading, outward positive [m]. Outliers are the caller's to leave out.

    Raises:
        InputError, ValueError: as :func:`least_squares_circle`.
    """
    circle = least_squares_circle(phi_rad, deviation_m)
    radial = np.asarray(deviation_m, dtype=float) - circle.eccentricity_m(phi_rad)
    return CircularFigures(
        circular_error_um=float(np.ptp(radial)) / UM,
        radial_max_um=float(radial.max()) / UM,
        radial_min_um=float(radial.min()) / UM,
        centre_um=_um(circle.centre_m),
    )


def bidirectional_figures(
    phi_ccw: ArrayLike, dev_ccw: ArrayLike, phi_cw: ArrayLike, dev_cw: ArrayLike
) -> BidirectionalFigures:
    """G(b), D and centre of one path run counter-clockwise and clockwise.

    Both directions weigh the same, whatever their numbers of samples and revolutions.

    Args:
        phi_ccw, phi_cw: (n,) and (m,) angle on the nominal circle, the same place having the same angle modulo 2π in
            both [rad].
        dev_ccw, dev_cw: (n,) and (m,) readings, outward positive [m].

    Raises:
        InputError, ValueError: as :func:`least_squares_circle`, for either direction.
    """
    ccw, cw = _checked(phi_ccw, dev_ccw), _checked(phi_cw, dev_cw)
    phi, deviation = np.concatenate([ccw[0], cw[0]]), np.concatenate([ccw[1], cw[1]])
    weight = np.concatenate([np.full(ccw[0].size, 1.0 / ccw[0].size), np.full(cw[0].size, 1.0 / cw[0].size)])
    circle = least_squares_circle(phi, deviation, weight)
    radial = deviation - circle.eccentricity_m(phi)
    return BidirectionalFigures(
        circular_error_um=float(np.ptp(radial)) / UM,
        mean_radial_error_um=circle.radius_error_m / UM,
        centre_um=_um(circle.centre_m),
    )


def _checked(phi_rad: ArrayLike, deviation_m: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    phi, deviation = np.asarray(phi_rad, dtype=float), np.asarray(deviation_m, dtype=float)
    if phi.ndim != 1 or phi.shape != deviation.shape:
        raise ValueError(
            f"angle and deviation must be vectors of one length, not of shapes {phi.shape} and {deviation.shape}"
        )
    if phi.size < 3:
        raise InputError(f"a circle needs at least 3 samples, {phi.size} given")
    if not (np.isfinite(phi).all() and np.isfinite(deviation).all()):
        raise InputError("the trace has samples that are not finite; leave them out before taking ISO 230-4 figures")
    around = np.sort(np.mod(phi, 2.0 * np.pi))
    gap = float(np.diff(around, append=around[0] + 2.0 * np.pi).max())
    if gap > WIDEST_GAP_RAD:
        raise InputError(
            f"the trace leaves {gap / DEG:.0f}° of the circle without samples; "
            f"ISO 230-4 figures need a full circle (at most {WIDEST_GAP_RAD / DEG:.0f}° missing)"
        )
    return phi, deviation


def _um(centre_m: NDArray[np.float64]) -> tuple[float, float]:
    return float(centre_m[0]) / UM, float(centre_m[1]) / UM
