"""SINUMERIK Operate, trace saved as XML.

The format is not published by its maker. Public readers of it agree on this: the signals stand in
``traceDisplaySetup`` or ``traceDisplaySetup_V20`` with key, name and description. ``traceData/dataFrame`` has one
``dataSignal`` (id, key) for each of them, then one ``rec`` for each instant, with ``time`` in s and an attribute for
each signal by its id. A signal that has not changed since the instant before is left out.

The name of a signal ends with its address, ``[u1, 7]``: axis 7 of the NCU. ``unitsType`` is its quantity. Positions
are in mm or °, velocities in mm/min or rpm, as the control shows them (assumed, and compared with the positions).
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.io.inputs import check_rows, read_bytes
from mjsim.units import AMPERE

_ADDRESS = re.compile(r"\[([^\]]*)\]")
_UNITS = {"posn": "mm|deg", "velo": "mm/min|rpm", "current": AMPERE}
#: Beginnings of the names of signals, without digits for their size, and the channel that each of them is.
_SIGNALS = {
    "nckServoDataCmdPos": "command",
    "measPos1": "actual",
    "measPos2": "load",
    "nckServoDataActPos1stEnc": "actual",
    "nckServoDataActPos2ndEnc": "load",
    "nckServoDataFlwErr": "lag",
    "nckServoDataCmdVelCtrlIn": "velocity_command",
    "nckServoDataCmdVelMot": "velocity_command",
    "nckServoDataActVelMot": "velocity",
    "nckServoDataActCurr": "current",
}


@register
class Sinumerik(Format):
    """Every signal is a column, named by its description and its address."""

    suffixes = (".xml",)

    def read(self, path: Path, options: Options) -> Table:
        root = _parsed(path)
        frames = root.findall("traceData/dataFrame")
        if root.tag != "traceSession" or not frames:
            raise InputError(f"{path}: no trace of a SINUMERIK (traceSession with traceData/dataFrame); allowed: one")
        frame = max(frames, key=lambda f: len(f.findall("rec")))
        said = {s.get("key"): s for s in root.iter("signal")}
        signals = frame.findall("dataSignal")
        records = frame.findall("rec")
        check_rows(path, len(records))
        values = np.full((len(records), len(signals) + 1), np.nan)
        for row, record in enumerate(records):
            values[row, 0] = _number(path, row, record.get("time"))
            for column, signal in enumerate(signals, start=1):
                text = record.get(signal.get("id") or "")
                values[row, column] = values[row - 1, column] if text is None else _number(path, row, text)
        kinds = [_channel(said.get(s.get("key"), s)) for s in signals]
        names = ("time", *(_name(said.get(s.get("key"), s)) for s in signals))
        units = [_UNITS.get(s.get("unitsType") or "", "") if k[1] else "" for s, k in zip(signals, kinds, strict=True)]
        notes = [f"SINUMERIK trace, {len(signals)} signals"]
        notes.append("units are not in the file: mm and mm/min, ° and rpm for a rotary axis are usual")
        if len(frames) > 1:
            notes.append(f"{len(frames)} recordings in the file, the longest is taken")
        lost = frame.find("frameHeader")
        if lost is not None:
            notes += [f"{lost.get('dropOuts')} samples lost"] if lost.get("dropOuts") not in (None, "0") else []
        lines = np.arange(1, len(values) + 1)
        channels = (("", "time"), *kinds)
        return Table(path, names, ("s", *units), values, lines, (), tuple(notes), channels)


def _parsed(path: Path) -> Element:
    data = read_bytes(path)
    if b"<!ENTITY" in data or b"<!DOCTYPE" in data:
        raise InputError(f"{path}: has entities or a document type; allowed: a trace as the control saves it")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path}: no readable XML: {str(error)[:80]}") from None


def _name(signal: Element) -> str:
    """Description and address, such as ``Position setpoint [u1, 3]``."""
    address = _ADDRESS.search(signal.get("name") or "")
    said = signal.get("description") or signal.get("name") or signal.get("id") or ""
    return f"{said} {address[0]}"[:120] if address else said[:120]


def _channel(signal: Element) -> tuple[str, str]:
    """Number of the axis and channel of a signal; empty texts where its name does not say it."""
    name = signal.get("name") or ""
    address = _ADDRESS.search(name)
    own = name.partition("[")[0].strip().rpartition("/")[2]
    known = next((c for begin, c in _SIGNALS.items() if own.startswith(begin)), "")
    if own.startswith("nckServoDataActVelMotorSide"):
        known = ""  # turns of the motor, not of the axis
    return (address[1].rpartition(",")[2].strip(), known) if address and known else ("", "")


def _number(path: Path, row: int, text: str | None) -> float:
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text or "")
    except ValueError:
        raise InputError(f"{path}: record {row + 1} has {text!r}; allowed: a number") from None
