"""Units: SI inside, the file's units at the edges.

A parameter's name ends in its unit (``width_deg``, ``value_um``); :func:`unit_of` reads it back, so that a unit is
written in one place only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

#: Suffix of a parameter name -> (factor to SI, the symbol that is shown).
UNITS: dict[str, tuple[float, str]] = {
    "rad_per_s": (1.0, "rad/s"),
    "Nm_per_urad": (1e6, "N·m/µrad"),
    "N_per_um": (1e6, "N/µm"),
    "urad": (1e-6, "µrad"),
    "deg": (math.pi / 180.0, "°"),
    "um": (1e-6, "µm"),
    "mm": (1e-3, "mm"),
    "ms": (1e-3, "ms"),
    "Nm": (1.0, "N·m"),
    "rad": (1.0, "rad"),
    "Hz": (1.0, "Hz"),
    "ppm": (1e-6, "ppm"),
    "s": (1.0, "s"),
    "m": (1.0, "m"),
    "m_per_s": (1.0, "m/s"),
    "N": (1.0, "N"),
    "N_per_m": (1.0, "N/m"),
    "Nm_per_rad": (1.0, "N·m/rad"),
    "kg": (1.0, "kg"),
    "K": (1.0, "K"),
    "um_per_K": (1e-6, "µm/K"),
}

#: Names that a plain number may have, alone or as an ending: ratios, orders and counts.
DIMENSIONLESS = ("ratio", "order", "gain", "factor", "share", "count", "exponent", "index")

UM = 1e-6
DEG = math.pi / 180.0
MM = 1e-3


def suffix_of(name: str) -> str:
    """The unit that a parameter name is or ends in, as it is written there; empty where there is none."""
    return next((u for u in sorted(UNITS, key=len, reverse=True) if name == u or name.endswith("_" + u)), "")


def has_unit(name: str) -> bool:
    """Whether a parameter name ends in a unit, and that is all of it: ``lag_urad_per_rad_per_s`` has another one."""
    found = suffix_of(name)
    return found != "" and not name.removesuffix(found).endswith("_per_")


def unit_of(name: str) -> tuple[float, str]:
    """Factor to SI and the shown symbol for a parameter name; dimensionless names give ``(1.0, "")``."""
    return UNITS.get(suffix_of(name), (1.0, ""))


#: What the unit of a current is called; no axis.
AMPERE = "A"


def percent(p: float) -> str:
    """A probability as an engineer reads it."""
    if p > 0.9995:
        return "over 99.9 %"
    return f"{100.0 * p:.1f} %" if p > 0.99 else f"{100.0 * p:.0f} %" if p >= 0.01 else "below 1 %"


def listed(parts: Sequence[str], last: str = "and") -> str:
    """One part or more as in a sentence: A, B and C."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"
