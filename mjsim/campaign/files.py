"""Reading a campaign folder: campaign.toml, machine.toml and the traces."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from mjsim.campaign.chain_file import chain_in
from mjsim.campaign.driven import driven
from mjsim.campaign.model import Campaign
from mjsim.campaign.schema import CampaignTable, InstrumentTable, with_tests
from mjsim.campaign.temperature import read_temperatures
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.files import acceptance_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS, instrument_of
from mjsim.instruments.schema import Table
from mjsim.io.inputs import is_file, named_file
from mjsim.io.toml import check, parse

# -- the instruments of a campaign -------------------------------------------------------------------------------------


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


def read_campaign(
    path: str | Path, traces: bool = True, as_is: bool = False, spans: bool = True, empty: bool = False
) -> Campaign:
    """Read a campaign.

    Args:
        path: the folder or its campaign.toml.
        traces: also read the recorded traces.
        as_is: the campaign is not to be searched for mistakes (sign, unit, direction) when it is compared with a
            machine.
        spans: refuse traces whose times are not those of their programs.
        empty: allow one that has no test yet.

    Raises:
        InputError: a file, key, value or trace is wrong; nothing is guessed.
    """
    path = Path(path)
    file = path / "campaign.toml" if os.path.isdir(path) else path
    if not is_file(file):
        raise InputError(
            f"{file}: no such campaign; give a folder that holds a campaign.toml, or the path of a campaign.toml"
        )
    return campaign_from(file, parse(file), traces, as_is, spans, empty)


def campaign_from(
    file: Path, data: dict, traces: bool = True, as_is: bool = False, spans: bool = True, empty: bool = False
) -> Campaign:
    """The campaign that ``data``, the tables of a campaign.toml, describes when it stands at ``file``.

    ``empty`` allows one that has no test yet.

    Raises:
        InputError: as :func:`read_campaign`.
    """
    chain = chain_in(file.parent, data.get("machine", CampaignTable.model_fields["machine"].default))
    instruments, groups = instrument_tables(file, data, grouped_tests(data))
    one = {"instrument": next(iter(instruments.values()))} if "instrument" in data else {}
    none = {"test": [{}]} if empty and not data.get("test") else {}
    table = check(file, CampaignTable, data | one | none)
    tests: dict[int, tuple[Any, ...]] = {}
    for name, rows in groups.items():
        schema = with_tests(CampaignTable, INSTRUMENTS[name].table(chain))
        part = check(file, schema, data | {"instrument": instruments[name], "test": [t for _, t in rows]})
        for (place, _), t in zip(rows, part.test, strict=True):
            mine = INSTRUMENTS[name].tests_of(file, t, chain)
            tests[place] = tuple(driven(file, test, t) if isinstance(test, BallBarTest) else test for test in mine)
    ordered = tuple(test for place in sorted(tests) for test in tests[place])
    names = [t.name for t in ordered]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f'{file}: [[test]] name "{name}" appears {names.count(name)} times; allowed: each name once'
            )
    read = {n: INSTRUMENTS[n].data_of(check(file, InstrumentTable, raw)) for n, raw in instruments.items()}
    campaign = Campaign(
        table.name,
        file.parent,
        named_file(file, table.machine, "machine", outside=True),
        ordered,
        {},
        read,
        table.measured_on,
        as_is,
        acceptance_of(file, table.acceptance, [t for t in ordered if t.instrument == BallBarTest.instrument]),
        table.serial_number or "",
        read_temperatures(file.parent) if traces else None,
    )
    if traces:
        _read_traces(file, campaign, spans)
    return campaign


def _read_traces(file: Path, campaign: Campaign, spans: bool) -> None:
    for t in campaign.tests:
        if t.trace is None:
            continue
        path, instrument = named_file(file, t.trace, f'[[test]] "{t.name}" trace'), INSTRUMENTS[t.instrument]
        campaign.traces[t.name] = instrument.read(path, t, campaign.instruments[t.instrument])
        if spans:
            instrument.look_at(path, t, campaign.traces[t.name], campaign.of(t.instrument).tests)
    for name, data in campaign.instruments.items():
        recorded = {t.name: campaign.traces[t.name] for t in campaign.measured if t.instrument == name}
        campaign.instruments[name] = INSTRUMENTS[name].known_from(data, recorded)
