"""The table of the recorder in a campaign that had ball-bar tests only."""

from __future__ import annotations

from typing import Any

import tomlkit

from mjsim.instruments.axis_log.files import LOG

#: What the two instruments are called.
BAR, CONTROL = "bar", "control"


def with_recorder(document: Any, rate: float) -> None:
    """Give a parsed campaign.toml the rate of its recorder, and a table for it beside a ball bar's.

    Args:
        document: With all its tables.
        rate: Samples per second of the recording, Hz.
    """
    tables = document.get("test", [])
    bars = [t for t in tables if t.get("kind") != LOG]
    present = document.get("instrument", {})
    named = bool(present) and all(isinstance(v, dict) for v in present.values())
    kinds = [v.get("kind", "ball_bar") for v in present.values()] if named else []
    for recorder in [present, *present.values()] if named else [present]:
        if recorder.get("kind") == "axis_log" and "sample_rate_Hz" not in recorder:
            recorder["sample_rate_Hz"] = float(f"{rate:.6g}")
    if not bars or "axis_log" in kinds:
        return
    instruments = tomlkit.table(is_super_table=True)
    if named:
        for name, table in present.items():
            instruments[name] = table
    else:
        instruments[BAR] = {"kind": "ball_bar"} | {k: v for k, v in present.items()}
    recorder = tomlkit.table()
    recorder["kind"], recorder["sample_rate_Hz"] = "axis_log", float(f"{rate:.6g}")
    instruments[CONTROL] = recorder
    document["instrument"] = instruments
