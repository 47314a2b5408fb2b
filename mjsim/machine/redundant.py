"""Error motions of rotary axes that no ball bar can tell from location errors.

A wobble that goes round once with the axis stands still on what the axis carries: it is a location error of the next
axis. A head that carries no further axis moves one point, so that a wobble of one more order looks like a location
error of the head itself. Which orders these are follows from the chain, by the rank of their derivatives.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import Geometry, bar_vector

#: Poses, step of the derivatives (m, rad), and the share of a derivative that counts as rounding.
_POSES, _STEP, _ROUNDING = 60, 1e-6, 1e-6
#: Of the poses that are drawn: any will do, but they have to be the same every time.
_SEED = 1
#: Orders that are looked at, either way.
MOST_ORDERS = 6


@cache
def visible_orders(chain: Chain, axis: str, rotation: bool) -> tuple[int, ...]:
    """Whole orders, −6 to 6 without 0, of an error motion that is no location error in another form.

    Args:
        chain: the machine's axes.
        axis: letter of the rotary axis; all orders of anything else are visible.
        rotation: whether it is a tilt; otherwise it is radial.
    """
    orders = tuple(k for k in range(-MOST_ORDERS, MOST_ORDERS + 1) if k)
    at = [
        i for i, m in enumerate(chain.motions, chain.count) if m.axis == axis and m.rotation == rotation and not m.axial
    ]
    if not chain.is_rotary(axis):
        return orders
    rng = np.random.default_rng(_SEED)
    q = np.zeros((_POSES, len(chain.columns)))
    q[:, chain.linear_columns] = rng.uniform(-0.3, 0.3, (_POSES, len(chain.linear)))
    q[:, chain.rotary_columns] = rng.uniform(-1.2, 1.2, (_POSES, len(chain.rotary)))
    balls = rng.uniform(-0.2, 0.2, (_POSES, 3))  # another place of the table ball in every pose
    first, second = (_of_motion(chain, q, balls, i) for i in at)
    known = [_of_location(chain, q, balls, e.name) for e in chain.location_errors]
    known += [_of_motion(chain, q, balls, chain.index(a)) for a in chain.rotary]
    basis = np.linalg.qr(np.array([k.ravel() for k in known]).T)[0]
    return tuple(k for k in orders if not _is_known(basis, first, second, k * q[:, chain.index(axis)]))


def _is_known(basis: np.ndarray, first: np.ndarray, second: np.ndarray, angle: np.ndarray) -> bool:
    """Whether a vector that turns by ``angle`` (n,), whatever its phase, does the same as the ``basis`` (3n, k)."""
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    both = np.array([(cos * first + sin * second).ravel(), (cos * second - sin * first).ravel()]).T
    left = both - basis @ (basis.T @ both)
    return bool(np.linalg.svd(left, compute_uv=False)[-1] < _ROUNDING * np.linalg.norm(both))


def _of_motion(chain: Chain, q: np.ndarray, balls: np.ndarray, column: int) -> np.ndarray:
    """Derivative of the vector between the balls with respect to one column of ``q``, (n, 3)."""
    h = np.zeros(q.shape[1])
    h[column] = _STEP
    return (bar_vector(chain, q + h, balls) - bar_vector(chain, q - h, balls)) / (2 * _STEP)


def _of_location(chain: Chain, q: np.ndarray, balls: np.ndarray, name: str) -> np.ndarray:
    """The same with respect to a location error, (n, 3)."""
    up, down = (bar_vector(chain, q, balls, Geometry({name: s * _STEP}, {})) for s in (1.0, -1.0))
    return (up - down) / (2 * _STEP)
