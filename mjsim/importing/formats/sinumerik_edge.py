"""SINUMERIK Edge, capture of high-frequency data as JSON.

The format is not published by its maker. Public readers agree on this: ``Header/SignalListHFData`` names the columns
(``DES_POS|1`` of axis ``X1``), ``Header/CycleTimeMs`` is the time of one cycle, and each ``HFData`` of ``Payload``
holds rows in this order. The column ``CYCLE`` counts cycles, so that a gap is seen. Positions are in mm or °. The scale
of ``CMD_SPEED`` is not known: it is held against the commanded motion.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.io.inputs import check_rows, read_bytes
from mjsim.units import AMPERE

#: Signal -> (channel, unit). A torque or a current has no unit in the file.
_SIGNALS = {
    "DES_POS": ("command", "mm|deg"),
    "ENC_POS": ("actual", "mm|deg"),
    "ENC1_POS": ("actual", "mm|deg"),
    "ENC2_POS": ("load", "mm|deg"),
    "CONT_DEV": ("lag", "mm|deg"),
    "CMD_SPEED": ("velocity_command", ""),
    "TORQUE": ("torque", "Nm"),
    "CURRENT": ("current", AMPERE),
}


@register
class SinumerikEdge(Format):
    """An object with Header (SignalListHFData, CycleTimeMs) and Payload (HFData)."""

    def recognises(self, head: str) -> bool:
        return head.lstrip("\ufeff \r\n").startswith("{") and '"SignalListHFData"' in head

    def read(self, path: Path, options: Options) -> Table:
        data = json.loads(read_bytes(path))
        signals = data["Header"]["SignalListHFData"]
        names = [str(s["Name"]) for s in signals]
        rows = [row for part in data["Payload"] for row in part.get("HFData", ())]
        check_rows(path, len(rows))
        if not rows or any(len(r) != len(names) for r in rows):
            raise InputError(f"{path}: HFData has no rows of {len(names)} numbers; allowed: a column for each signal")
        values = np.array(rows, float)
        cycle = float(data["Header"].get("CycleTimeMs") or 0.0) * 1e-3
        if not 0.0 < cycle < 1.0:
            raise InputError(f"{path}: CycleTimeMs = {1e3 * cycle:g}; allowed: above 0, below 1000")
        counted = names.index("CYCLE") if "CYCLE" in names else None
        count = np.arange(len(values)) if counted is None else values[:, counted] - values[0, counted]
        known = [_SIGNALS.get(n.partition("|")[0], ("", "")) for n in names]
        channels = [(str(s.get("Axis", "")), k) if k else ("", "") for s, (k, _) in zip(signals, known, strict=True)]
        notes = (
            f"SINUMERIK Edge capture, {len(names)} signals, {1e3 * cycle:g} ms",
            "units are not in the file: mm or °, N m and A are usual",
        )
        return Table(
            path,
            ("time", *(f"{n} {s.get('Axis', '')}" for n, s in zip(names, signals, strict=True))),
            ("s", *(u for _, u in known)),
            np.column_stack([cycle * count, values]),
            np.arange(1, len(values) + 1),
            (),
            notes,
            (("", "time"), *channels),
        )
