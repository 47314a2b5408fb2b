"""One dimension is solved for: the height of the balance plates on the cradle's cheeks."""

from __future__ import annotations

import math

from mjsim.machine.modelling.dimensions import Dimensions
from mjsim.machine.modelling.pieces import Piece
from mjsim.machine.modelling.solids import solid
from mjsim.machine.modelling.table_side import cradle, table


def plate_height(d: Dimensions) -> float:
    """The height at which the first moment of cradle and table about the tilting axis vanishes.

    Args:
        d: dimensions and densities of the machine.

    Returns:
        m.

    Raises:
        ValueError: cradle and table are top-heavy, so that no balance plate on top helps.
    """
    frame, disc = cradle(d, 1.0), table(d)
    weighed = {
        "cradle_casting": (frame["cradle_casting"], d.cradle_density),
        "cradle_journals": (frame["cradle_journals"], d.plate_density),
        "table_base": (disc["table_base"], d.table_density),
        "table_top": (disc["table_top"], d.table_density),
    }
    need = -sum(density * _first_moment(pieces) for pieces, density in weighed.values())
    # density * area * (cheek_top + height / 2) * height = need
    area = 2 * (d.cheek_outer - d.cheek_inner) * d.plate_depth
    q = need / (d.plate_density * area)
    if q <= 0:
        raise ValueError(f"cradle and table are top-heavy by {-need:.3f} kg m, balance plates on top cannot help")
    return math.sqrt(d.cheek_top**2 + 2 * q) - d.cheek_top


def _first_moment(pieces: list[Piece]) -> float:
    """Volume times height of its centre, m⁴."""
    properties = solid(pieces).mass_properties
    return float(properties.volume * properties.center_mass[2])
