"""SINUMERIK Operate, trace saved as XML.

The format is not published by its maker. Public readers of it agree on this: the signals stand in
``traceDisplaySetup`` or ``traceDisplaySetup_V20`` with key, name and description. ``traceData/dataFrame`` has one
``dataSignal`` (id, key) for each of them, then one ``rec`` for each instant, with ``time`` in s and an attribute for
each signal by its id. A signal that has not changed since the instant before is left out.
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

_ADDRESS = re.compile(r"\[([^\]]*)\]")


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
        names = ("time", *(_name(said.get(s.get("key"), s)) for s in signals))
        units = ("s", *("" for _ in signals))
        notes = [f"SINUMERIK trace, {len(signals)} signals", "units are not in the file: mm and ° are usual"]
        if len(frames) > 1:
            notes.append(f"{len(frames)} recordings in the file, the longest is taken")
        if lost := frame.find("frameHeader"):
            notes += [f"{lost.get('dropOuts')} samples lost"] if lost.get("dropOuts") not in (None, "0") else []
        return Table(path, names, units, values, np.arange(1, len(values) + 1), (), tuple(notes))


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


def _number(path: Path, row: int, text: str | None) -> float:
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text or "")
    except ValueError:
        raise InputError(f"{path}: record {row + 1} has {text!r}; allowed: a number") from None
