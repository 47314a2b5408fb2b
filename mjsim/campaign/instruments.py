"""The instruments of a campaign: one ``[instrument]`` table, or tables by name where tests have different ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mjsim.campaign.schema import InstrumentTable, Table
from mjsim.errors import InputError
from mjsim.io.toml import check

#: Kind of instrument -> what a test that it measures is called.
_KINDS = {"ball_bar": "ball-bar test", "axis_log": "axis log"}


class NamedInstruments(Table):
    instrument: dict[str, InstrumentTable]


def split_instruments(file: Path, data: dict, bars: list, logs: list) -> tuple[dict, InstrumentTable | None]:
    """The tables of a campaign with one instrument for its ball-bar tests, and the recorder of its logs.

    Args:
        file: Its campaign.toml.
        data: All its tables.
        bars: Tables of its ball-bar tests.
        logs: Tables of its axis logs.

    Returns:
        The tables with the ball bar's ``[instrument]``, or the recorder's where there is no ball-bar test; the
        recorder, where it is another instrument.

    Raises:
        InputError: Instruments or their names are wrong, or a single one stands for both kinds.
    """
    table: Any = data.get("instrument")
    if not isinstance(table, dict) or not table or not all(isinstance(t, dict) for t in table.values()):
        if bars and logs:
            raise InputError(
                f"{file}: the campaign has ball-bar tests and axis logs and one [instrument]; allowed: one table for "
                f'each, such as [instrument.bar] with kind = "ball_bar" and [instrument.control] with kind = "axis_log"'
            )
        for t in (*bars, *logs):
            if isinstance(t, dict) and "instrument" in t:
                raise InputError(
                    f'{file}: [[test]] "{t.get("name")}": instrument = {t["instrument"]!r}; the campaign names no '
                    f"instruments; allowed: tables [instrument.NAME]"
                )
        return data, None
    named = check(file, NamedInstruments, {"instrument": table}).instrument
    by_kind: dict[str, str] = {}
    for name, instrument in named.items():
        if instrument.kind in by_kind:
            raise InputError(
                f"{file}: [instrument.{name}] and [instrument.{by_kind[instrument.kind]}] are both of the kind "
                f"{instrument.kind}; allowed: one of each kind"
            )
        by_kind[instrument.kind] = name
    for kind, tests in (("ball_bar", bars), ("axis_log", logs)):
        _check_tests(file, tests, by_kind.get(kind), kind)
    bar, recorder = by_kind.get("ball_bar"), by_kind.get("axis_log")
    first = bar if bars or recorder is None else recorder
    data = data | {"instrument": table[first]}
    if isinstance(data.get("test"), list):
        data["test"] = [_without_name(t) for t in data["test"]]
    return data, named[recorder] if recorder is not None else None


def _check_tests(file: Path, tests: list, name: str | None, kind: str) -> None:
    """Refuse tests of a kind that has no instrument, or that name another one."""
    for t in tests:
        place = f'{file}: [[test]] "{t.get("name") if isinstance(t, dict) else t}"'
        if name is None:
            raise InputError(f"{place} is of the kind {kind}; allowed: a table [instrument.NAME] with kind = {kind!r}")
        if isinstance(t, dict) and t.get("instrument", name) != name:
            raise InputError(f"{place}: instrument = {t['instrument']!r}; allowed for {_KINDS[kind]}s: {name!r}")


def _without_name(test: Any) -> Any:
    return {k: v for k, v in test.items() if k != "instrument"} if isinstance(test, dict) else test
