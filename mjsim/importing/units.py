"""Units of other systems' columns, by what users and headers call them; factors to SI."""

from __future__ import annotations

import re

from mjsim.units import DEG, MM, UM

#: Unit -> (factor to SI, other spellings, lower case). Volts have no factor of their own: the sensor's scale makes it.
TIME = {"s": (1.0, ("sec", "secs", "second", "seconds", "sek")), "ms": (1e-3, ("msec", "millisecond", "milliseconds"))}
ANGLE = {"deg": (DEG, ("°", "degree", "degrees")), "rad": (1.0, ("radian", "radians"))}
LENGTH = {
    "um": (UM, ("µm", "μm", "micron", "microns", "micrometre", "micrometer")),
    "mm": (MM, ("millimetre", "millimeter")),
    "inch": (25.4 * MM, ("in", "inches", '"')),
    "mil": (25.4 * UM, ("mils", "thou")),
    "uin": (25.4e-3 * UM, ("µin", "μin", "microinch", "microinches")),
    "V": (1.0, ("v", "volt", "volts")),
}
QUANTITIES = {"time": TIME, "angle": ANGLE, "deviation": LENGTH}

_BRACKETS = re.compile(r"[\[(<]\s*([^\])>]*?)\s*[\])>]")
_ENDING = re.compile(r"(?:[_/,]|\bin\b)\s*([^\s_/,]+)\s*$")


def unit_named(text: str, quantity: str) -> str | None:
    """The unit of a quantity (time, angle, deviation) that ``text`` spells, or ``None``."""
    text = text.strip().strip("[]()<>").strip()
    for unit, (_, spellings) in QUANTITIES[quantity].items():
        if text == unit or text.lower() in (unit.lower(), *spellings):
            return unit
    return None


def is_unit(text: str) -> bool:
    """Whether a text is the name of any known unit."""
    return any(unit_named(text, q) for q in QUANTITIES)


def unit_of_column(name: str, own_line: str, quantity: str) -> str | None:
    """The unit that a column's header gives: in a line of its own, in brackets, or behind ``_``, ``/`` or ``in``."""
    texts = [own_line, *_BRACKETS.findall(name), *_ENDING.findall(name)]
    return next((u for t in texts if t and (u := unit_named(t, quantity))), None)


def factor(unit: str, quantity: str) -> float:
    """Factor from a unit to SI (s, rad, m)."""
    return QUANTITIES[quantity][unit][0]


def bare(name: str) -> str:
    """A column's name without its unit, lower case."""
    return _ENDING.sub("", _BRACKETS.sub("", name)).strip(" _/,.:").lower() or name.strip().lower()
