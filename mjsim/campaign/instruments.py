"""The instruments of a campaign: one ``[instrument]`` table, or tables by name where tests have different ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mjsim.campaign.schema import InstrumentTable
from mjsim.errors import InputError
from mjsim.instruments.base import INSTRUMENTS, instrument_of
from mjsim.instruments.schema import Table
from mjsim.io.toml import check


class NamedInstruments(Table):
    instrument: dict[str, InstrumentTable]  # pyright: ignore[reportInvalidTypeForm]


#: Tables of tests by name of their instrument, each with its place in the file.
Groups = dict[str, list[tuple[int, Any]]]


def grouped_tests(data: dict) -> Groups:
    """The ``[[test]]`` tables of a campaign by instrument; the ball bar says what is wrong with other kinds."""
    tables = data.get("test")
    out: Groups = {}
    for place, table in enumerate(tables if isinstance(tables, list) else ()):
        found = instrument_of(table.get("kind")) if isinstance(table, dict) else None
        out.setdefault(found.name if found else next(iter(INSTRUMENTS)), []).append((place, table))
    return {name: out[name] for name in INSTRUMENTS if name in out}


def instrument_tables(file: Path, data: dict, groups: Groups) -> tuple[dict[str, Any], Groups]:
    """The table of each instrument, and the tests without the names of instruments.

    Args:
        file: The campaign's file.
        data: All its tables.
        groups: Its tests.

    Returns:
        Raw tables by name of the instrument; the tests.

    Raises:
        InputError: Instruments or their names are wrong, or a single one stands for several.
    """
    table: Any = data.get("instrument")
    if not isinstance(table, dict) or not table or not all(isinstance(t, dict) for t in table.values()):
        if len(groups) > 1:
            nouns = " and ".join(f"{INSTRUMENTS[n].test_noun}s" for n in groups)
            each = " and ".join(f'[instrument.{n}] with kind = "{n}"' for n in groups)
            raise InputError(
                f"{file}: the campaign has {nouns} and one [instrument]; allowed: one table for each, such as {each}"
            )
        for _, t in (row for rows in groups.values() for row in rows):
            if isinstance(t, dict) and "instrument" in t:
                raise InputError(
                    f'{file}: [[test]] "{t.get("name")}": instrument = {t["instrument"]!r}; the campaign names no '
                    f"instruments; allowed: tables [instrument.NAME]"
                )
        single = {} if table is None else table
        kind = single.get("kind") if isinstance(single, dict) else None
        names = list(groups) or [kind if kind in INSTRUMENTS else next(iter(INSTRUMENTS))]
        return dict.fromkeys(names, single), groups
    named = check(file, NamedInstruments, {"instrument": table}).instrument
    by_kind: dict[str, str] = {}
    for name, instrument in named.items():
        if instrument.kind in by_kind:
            raise InputError(
                f"{file}: [instrument.{name}] and [instrument.{by_kind[instrument.kind]}] are both of the kind "
                f"{instrument.kind}; allowed: one of each kind"
            )
        by_kind[instrument.kind] = name
    for kind, rows in groups.items():
        _check_tests(file, [t for _, t in rows], by_kind.get(kind), kind)
    tables = {kind: table[by_kind[kind]] for kind in INSTRUMENTS if kind in by_kind}
    return tables, {kind: [(place, _without_name(t)) for place, t in rows] for kind, rows in groups.items()}


def _check_tests(file: Path, tests: list, name: str | None, kind: str) -> None:
    """Refuse tests of a kind that has no instrument, or that name another one."""
    for t in tests:
        place = f'{file}: [[test]] "{t.get("name") if isinstance(t, dict) else t}"'
        if name is None:
            raise InputError(f"{place} is of the kind {kind}; allowed: a table [instrument.NAME] with kind = {kind!r}")
        if isinstance(t, dict) and t.get("instrument", name) != name:
            noun = INSTRUMENTS[kind].test_noun
            raise InputError(f"{place}: instrument = {t['instrument']!r}; allowed for {noun}s: {name!r}")


def _without_name(test: Any) -> Any:
    return {k: v for k, v in test.items() if k != "instrument"} if isinstance(test, dict) else test
