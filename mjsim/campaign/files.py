"""Reading a campaign folder: campaign.toml, machine.toml and the traces."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from mjsim.campaign.chain_file import chain_in
from mjsim.campaign.driven import driven
from mjsim.campaign.instruments import grouped_tests, instrument_tables
from mjsim.campaign.model import Campaign
from mjsim.campaign.schema import CampaignTable, InstrumentTable, with_tests
from mjsim.campaign.temperature import read_temperatures
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.limits import acceptance_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.inputs import named_file
from mjsim.io.toml import check, parse


def read_campaign(path: str | Path, traces: bool = True, as_is: bool = False, spans: bool = True) -> Campaign:
    """Read a campaign.

    Args:
        path: the folder or its campaign.toml.
        traces: also read the recorded traces.
        as_is: the campaign is not to be searched for mistakes (sign, unit, direction) when it is compared with a
            machine.
        spans: refuse traces whose times are not those of their programs.

    Raises:
        InputError: a file, key, value or trace is wrong; nothing is guessed.
    """
    path = Path(path)
    file = path / "campaign.toml" if os.path.isdir(path) else path
    if not os.path.isfile(file):
        raise InputError(
            f"{file}: no such campaign; give a folder that holds a campaign.toml, or the path of a campaign.toml"
        )
    return campaign_from(file, parse(file), traces, as_is, spans)


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
