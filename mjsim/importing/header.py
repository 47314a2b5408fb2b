"""What a text file's header says about its test: ``feed: 1000 mm/min``, ``plane = XY``, and the keys of
campaign.toml themselves.
"""

from __future__ import annotations

import re

from mjsim.importing.units import unit_named
from mjsim.instruments.ball_bar.kinds import all_keys
from mjsim.instruments.ball_bar.tables import ball_bar_table
from mjsim.machine.chain import FIVE_AXIS

_NAME = "A-Za-zÄÖÜäöüß"
_LINE = re.compile(rf"^\W*([{_NAME}][{_NAME} _-]*?)\s*(?:\(([^)]*)\)|\[([^\]]*)\])?\s*[:=;,\t]\s*(.+?)\s*[;,\t]*$")
_SPACES, _LONGEST = re.compile(r" {2,}"), 300
_VALUE = re.compile(r"^([+-]?\d+(?:[.,]\d+)?)\s*(\S*)$")
_FEEDS = {"mm/min": 1.0, "m/min": 1000.0, "in/min": 25.4, "inch/min": 25.4, "ipm": 25.4}
#: What English and German headers call a key, without its unit; in lower case.
_FEED = {
    "feed",
    "feedrate",
    "feed rate",
    "programmed feedrate",
    "vorschub",
    "programmierter vorschub",
    "vorschubgeschwindigkeit",
}
_LENGTH = {
    "radius", "bar length", "ballbar length", "ball bar length", "nominal length", "test radius",
    "messradius", "kreisradius", "nennlänge", "stablänge",
}  # fmt: skip
_PLANE, _WAY = {"plane", "test plane", "ebene", "messebene"}, {"direction", "run direction", "richtung", "drehrichtung"}
_WAYS = {
    "cw": "CW", "im uhrzeigersinn": "CW", "uhrzeigersinn": "CW",
    "ccw": "CCW", "gegen den uhrzeigersinn": "CCW", "gegenuhrzeigersinn": "CCW",
}  # fmt: skip


def test_keys(header: tuple[str, ...]) -> dict:
    """Keys of a ``[[test]]`` table that the header's lines give; a number without a unit counts only under a key
    that names its unit.
    """
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
    if name in ball_bar_table().model_fields:
        return _own(name, text)
    word, number = name.lower().replace("_", " "), _VALUE.match(text)
    if (
        word in _PLANE and text.upper() in FIVE_AXIS.planes
    ):  # XZ is seen from behind: which way its circle turns is not said
        return {"plane": text.upper()}
    if word in _WAY and text.lower() in _WAYS:
        return {"direction": _WAYS[text.lower()]}
    if number:
        value, unit = float(number[1].replace(",", ".")), (number[2] or unit).lower()
        if word in _FEED and unit in _FEEDS:
            return {"feed_mm_min": round(value * _FEEDS[unit], 6)}
        if word in _LENGTH and unit_named(unit, "deviation") in ("mm", "inch"):
            return {"bar_length_mm": round(value * (25.4 if unit_named(unit, "deviation") == "inch" else 1.0), 6)}
    return {}


def _own(name: str, text: str) -> dict:
    """A key of campaign.toml itself."""
    keys = all_keys().get(name)
    if name in ("kind", "setup") or (keys and keys[0].words):
        return {name: text}
    if keys and keys[0].unit is None:
        return {name: int(text)} if text.isdigit() and text.isascii() and len(text) < 9 else {}
    number = _VALUE.match(text)
    return {name: float(number[1].replace(",", "."))} if number and not number[2] and name != "table_ball_mm" else {}
