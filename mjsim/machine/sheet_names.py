"""Names and units of the numbers of a drive's data sheet, as users read them."""

from __future__ import annotations

#: By attribute of a drive or parameter of its friction: name in words, and unit.
SHEET_NAMES = {
    "inertia": ("inertia", "kg·m²"),
    "viscous": ("viscous friction", "N·m·s/rad"),
    "position_gain": ("position gain", "1/s"),
    "velocity_gain": ("velocity gain", "N·m·s/rad"),
    "integral_time": ("integral time", "s"),
    "coulomb_Nm": ("Coulomb friction", "N·m"),
    "presliding_rad": ("presliding", "rad"),
}


def sheet_name(name: str) -> tuple[str, str]:
    """A number of the data sheet in words, and its unit; empty where there is none."""
    return SHEET_NAMES.get(name, (name.replace("_", " "), ""))
