"""HEIDENHAIN TNCscope (``.sco``), as text.

The format is not published by its maker. A public reader and recordings of an iTNC 530 agree on this: lines with ``%``
in front; a section ``%[CURVE…]`` for each channel with ``%CHANNELTYPE=``, ``%AXISTYPE=``, ``%DIMENSION=`` and
``%COUNT=``; after ``%[DATA]`` one row for each sample, a time in µs and the channels, each with a semicolon behind it.
The rows follow each other by ``%SAMPLING=`` µs. ``%CYCLETIME=`` is the cycle of the part of the control that a channel
comes from: shorter than the rows for a current, as long as a new value takes for a slow channel. Where there is no
``%SAMPLING=``, the rows have the shortest cycle.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.io.inputs import check_rows, read_bytes

_KEYS = ("CHANNELTYPE", "AXISTYPE", "DIMENSION", "COUNT", "CYCLETIME", "SAMPLING")
_SIGNALS = {
    "s soll": "command",
    "s ist": "actual",
    "s diff": "lag",
    "v soll": "velocity_command",
    "v ist": "velocity",
    "i ist": "current",
    "m ist": "torque",
}


@register
class TNCscope(Format):
    """Channels with COUNT and SAMPLING or CYCLETIME in their sections, and rows below ``%[DATA]``."""

    suffixes = (".sco",)

    def read(self, path: Path, options: Options) -> Table:
        text = read_bytes(path).decode("cp1252", errors="replace")
        check_rows(path, text.count("\n"))
        lines = text.splitlines()
        channels, begin = _channels(path, lines)
        rows = [(n, line) for n, line in enumerate(lines[begin:], start=begin + 1) if line.strip("; \t")]
        try:
            values = np.array([[float(c.replace(",", ".")) for c in r.rstrip("; \t").split(";")] for _, r in rows])
        except ValueError:
            raise InputError(
                f"{path}: a row below %[DATA] is no row of numbers; allowed: numbers and semicolons"
            ) from None
        if values.ndim != 2 or values.shape[1] != len(channels) + 1:
            raise InputError(
                f"{path}: {len(channels)} channels and rows of another length; allowed: a time and the channels"
            )
        step, chosen = _rows(path, channels)
        count = min(int(_positive(path, channels[i], "COUNT")) for i in chosen)
        values = values[:count]
        time = np.arange(len(values)) * step
        notes = [f"TNCscope, {len(chosen)} channels with {step * 1e3:g} ms"]
        if len(chosen) < len(channels):
            notes.append(f"{len(channels) - len(chosen)} channels with another cycle left out")
        names = [f"{channels[i].get('CHANNELTYPE', '')} {channels[i].get('AXISTYPE', '')}".strip() for i in chosen]
        units = [channels[i].get("DIMENSION", "") for i in chosen]
        known = [_SIGNALS.get(channels[i].get("CHANNELTYPE", "").strip().lower(), "") for i in chosen]
        axes = [(channels[i].get("AXISTYPE", ""), k) if k else ("", "") for i, k in zip(chosen, known, strict=True)]
        table = np.column_stack([time, values[:, [i + 1 for i in chosen]]])
        numbers = np.array([n for n, _ in rows[:count]])
        kinds = (("", "time"), *axes)
        return Table(path, ("time", *names), ("s", *units), table, numbers, (), tuple(notes), kinds)


def _rows(path: Path, channels: list[dict[str, str]]) -> tuple[float, list[int]]:
    """Time from row to row, s, and the channels that have a value in each row."""
    if all("SAMPLING" in c for c in channels):
        steps = [_positive(path, c, "SAMPLING") * 1e-6 for c in channels]
    else:
        steps = [_positive(path, c, "CYCLETIME") * 1e-6 for c in channels]
    fastest = min(steps)
    return fastest, [i for i, s in enumerate(steps) if s == fastest]


def _channels(path: Path, lines: list[str]) -> tuple[list[dict[str, str]], int]:
    """What each channel's section says, and the line behind ``%[DATA]``, from 0."""
    channels: list[dict[str, str]] = []
    inside, common = False, {}
    for number, line in enumerate(lines):
        text = line.strip().lstrip("%").strip()
        if text == "[DATA]":
            if not channels:
                break
            return [common | c for c in channels], number + 1
        if text.startswith("["):
            inside = text.startswith("[CURVE")
            channels += [{}] if inside else []
        elif inside and "=" in text:
            key, _, value = text.partition("=")
            if key.strip() in _KEYS:
                channels[-1][key.strip()] = value.strip()
        elif text.startswith("SAMPLING="):
            common = {"SAMPLING": text.partition("=")[2].strip()}
    raise InputError(f"{path}: no %[CURVE] sections before %[DATA]; allowed: a recording of TNCscope as text")


def _positive(path: Path, channel: dict[str, str], key: str) -> float:
    try:
        value = float(channel[key].replace(",", "."))
        if value > 0.0:
            return value
    except (KeyError, ValueError):
        pass
    raise InputError(f"{path}: a channel has %{key}={channel.get(key)!r}; allowed: a number above 0")
