"""What a text file's header says about its test: ``feed: 1000 mm/min``, ``plane = XY``, and the keys of campaign.toml themselves."""

from __future__ import annotations

import re

from mjsim.campaign.schema import BallBarTable
from mjsim.importing.units import unit_named

_LINE = re.compile(r"^\W*([A-Za-z][A-Za-z _-]*?)\s*(?:\(([^)]*)\)|\[([^\]]*)\])?\s*[:=;,\t]\s*(.+?)\s*[;,\t]*$")
_SPACES, _LONGEST = re.compile(r" {2,}"), 300
_VALUE = re.compile(r"^([+-]?\d+(?:[.,]\d+)?)\s*(\S*)$")
_FEEDS = {"mm/min": 1.0, "m/min": 1000.0, "in/min": 25.4, "inch/min": 25.4, "ipm": 25.4}
#: What headers call a key, without its unit.
_FEED = {"feed", "feedrate", "feed rate", "programmed feedrate"}
_LENGTH = {"radius", "bar length", "ballbar length", "ball bar length", "nominal length", "test radius"}
_PLANE, _WAY = {"plane", "test plane"}, {"direction", "run direction"}
_PLAIN = ("kind", "plane", "direction", "axis", "sensitive_direction", "setup")


def test_keys(header: tuple[str, ...]) -> dict:
    """Keys of a ``[[test]]`` table that the header's lines give; a number without a unit counts only under a key that names its unit."""
    out: dict = {}
    for line in header[:200]:
        m = _LINE.match(_SPACES.sub(" ", line[:_LONGEST].strip()))
        if not m:
            continue
        name, unit, text = m[1].strip(), m[2] or m[3] or "", m[4].strip('"')
        for key, value in _read(name, unit, text).items():
            out.setdefault(key, value)
    return out


def _read(name: str, unit: str, text: str) -> dict:
    if name in BallBarTable.model_fields:
        if name in _PLAIN:
            return {name: text}
        if name == "revolutions":
            return {name: int(text)} if text.isdigit() and text.isascii() and len(text) < 9 else {}
        number = _VALUE.match(text)
        return {name: float(number[1].replace(",", "."))} if number and not number[2] and name != "table_ball_mm" else {}
    word, number = name.lower().replace("_", " "), _VALUE.match(text)
    if word in _PLANE and text.upper() in ("XY", "YZ", "ZX"):  # XZ is seen from behind: which way its circle turns is not said
        return {"plane": text.upper()}
    if word in _WAY and text.upper() in ("CW", "CCW"):
        return {"direction": text.upper()}
    if number:
        value, unit = float(number[1].replace(",", ".")), (number[2] or unit).lower()
        if word in _FEED and unit in _FEEDS:
            return {"feed_mm_min": round(value * _FEEDS[unit], 6)}
        if word in _LENGTH and unit_named(unit, "deviation") in ("mm", "inch"):
            return {"bar_length_mm": round(value * (25.4 if unit_named(unit, "deviation") == "inch" else 1.0), 6)}
    return {}
