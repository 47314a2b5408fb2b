"""Units of other systems' columns, by what users and headers call them; factors to SI."""

from __future__ import annotations

import re

import numpy as np

from mjsim.units import AMPERE, DEG, MM, UM

#: Unit -> (factor to SI, other spellings, lower case). Volts have no factor of their own: the sensor's scale makes it.
TIME = {
    "s": (1.0, ("sec", "secs", "second", "seconds", "sek")),
    "ms": (1e-3, ("msec", "millisecond", "milliseconds")),
    "us": (1e-6, ("µs", "μs", "usec", "microsecond", "microseconds")),
}
ANGLE = {
    "deg": (DEG, ("°", "degree", "degrees", "grad")),
    "rad": (1.0, ("radian", "radians")),
    "arcsec": (DEG / 3600.0, ("″", "arc-sec", "arcseconds")),
    "urad": (1e-6, ("µrad", "μrad", "microrad")),
}
LENGTH = {
    "um": (UM, ("µm", "μm", "micron", "microns", "micrometre", "micrometer")),
    "mm": (MM, ("millimetre", "millimeter")),
    "inch": (25.4 * MM, ("in", "inches", '"')),
    "mil": (25.4 * UM, ("mils", "thou")),
    "uin": (25.4e-3 * UM, ("µin", "μin", "microinch", "microinches")),
    "V": (1.0, ("v", "volt", "volts")),
}
VELOCITY = {
    "mm/s": (MM, ("mm_per_s", "mm/sec")),
    "mm/min": (MM / 60.0, ("mm_per_min",)),
    "m/s": (1.0, ("m_per_s",)),
    "m/min": (1.0 / 60.0, ("m_per_min",)),
    "um/s": (UM, ("µm/s", "um_per_s")),
    "inch/min": (25.4 * MM / 60.0, ("ipm", "in/min")),
}
TURNING = {
    "deg/s": (DEG, ("°/s", "deg_per_s", "grad/s")),
    "rpm": (2.0 * np.pi / 60.0, ("1/min", "u/min", "rev/min", "min-1", "min^-1")),
    "rad/s": (1.0, ("rad_per_s",)),
    "deg/min": (DEG / 60.0, ("°/min", "deg_per_min")),
}
PERCENT = {"%": (1.0, ("percent", "prozent"))}
TORQUE = {"Nm": (1.0, ("n·m", "n*m", "n m")), "mNm": (1e-3, ()), **PERCENT}
FORCE = {"N": (1.0, ("newton",)), "kN": (1e3, ())}
CURRENT = {AMPERE: (1.0, ("ampere", "amp", "amps", "arms")), "mA": (1e-3, ()), **PERCENT}
VOLTAGE = {"V": (1.0, ("volt", "volts")), "mV": (1e-3, ()), **PERCENT}
#: By quantity. A percentage is one of a rated value that no file states.
QUANTITIES = {
    "time": TIME,
    "angle": ANGLE,
    "deviation": LENGTH,
    "velocity": VELOCITY,
    "turning": TURNING,
    "torque": TORQUE,
    "force": FORCE,
    "current": CURRENT,
    "control": VOLTAGE,
}
#: What headers call a column of the time, without its unit, in lower case.
TIME_WORDS = {"time", "t", "zeit", "sec", "seconds", "timestamp", "time_s", "date", "datum", "datetime", "date time"}

_BRACKETS = re.compile(r"[\[(<]\s*([^\])>]*?)\s*[\])>]")
_ENDING = re.compile(r"(?:[_/,]|\bin\b)\s*([^\s_/,]+)\s*$")


def unit_named(text: str, quantity: str) -> str | None:
    """The unit that ``text`` spells, or ``None``.

    Args:
        text: with or without brackets.
        quantity: a key of :data:`QUANTITIES`.
    """
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
    if quantity not in ("time", "angle", "deviation"):  # these units hold a / or a _ themselves
        texts += [own for own in (name.rpartition(sign)[2] for sign in " ,") if own != name]
        texts += [name.split("_", n)[-1] for n in range(1, name.count("_") + 1)]
    return next((u for t in texts if t and (u := unit_named(t, quantity))), None)


def factor(unit: str, quantity: str) -> float:
    """Factor from a unit to SI; 1 for a percentage."""
    return QUANTITIES[quantity][unit][0]


def bare(name: str) -> str:
    """A column's name without its unit, lower case."""
    return _ENDING.sub("", _BRACKETS.sub("", name)).strip(" _/,.:").lower() or name.strip().lower()
