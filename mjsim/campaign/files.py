"""Reading a campaign folder: campaign.toml, machine.toml and the traces."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path
from typing import Any

from mjsim.axislog.measurement import LogInstrument, Logs, Recording
from mjsim.axislog.signals import encoder_step
from mjsim.ballbar.kinds import KINDS, able_kinds, all_keys, kind_of
from mjsim.ballbar.measurement import BallBarTest, Instrument, Trace
from mjsim.ballbar.program import Program
from mjsim.campaign.chain_file import chain_in
from mjsim.campaign.driven import check_keys, with_program, with_record
from mjsim.campaign.instruments import split_instruments
from mjsim.campaign.limits import acceptance_of
from mjsim.campaign.logs import log_tests, read_recording, split_tests
from mjsim.campaign.model import Campaign
from mjsim.campaign.schema import BallBarTable, CampaignTable, InstrumentTable, with_tests, without_tests
from mjsim.campaign.span import explain
from mjsim.campaign.traces import read_trace
from mjsim.errors import InputError
from mjsim.io.inputs import inside, shown
from mjsim.io.toml import check, parse
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM, UM

_ATTRIBUTES = {f.name for f in fields(BallBarTest)}
#: A test's program may last so long, s, and its measured part has to last so long (assumed): 1 ms of it is one step.
LONGEST, SHORTEST = 7200.0, 0.1
#: Longest stretch that may be missing at an end of a trace, s (assumed); more is taken for another feed or another
#: test.
LARGEST_GAP = 4.5


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
    folder = file.parent
    chain = chain_in(folder, data.get("machine", CampaignTable.model_fields["machine"].default))
    bars, logged = split_tests(data)
    data, recorder = split_instruments(file, data, bars["test"], logged)
    bars, logged = split_tests(data)
    empty = empty and not data.get("test")
    schema = with_tests(CampaignTable, chain) if bars["test"] or not (logged or empty) else without_tests(CampaignTable)
    table = check(file, schema, bars if logged or empty else data)
    tests = tuple(test_of(file, t, chain) for t in table.test)
    logs = log_tests(file, data, logged, chain) if logged else ()
    names = [t.name for t in (*tests, *logs)]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f'{file}: [[test]] name "{name}" appears {names.count(name)} times; allowed: each name once'
            )
    i = table.instrument
    instrument = Instrument(i.resolution_um * UM, i.range_mm * MM, i.sample_rate_Hz)
    recorded: dict[str, Trace] = {}
    if traces:
        for t in tests:
            if t.trace is not None:
                path = _inside(file, folder, t.trace, f'[[test]] "{t.name}" trace')
                recorded[t.name] = read_trace(path, instrument)
                if spans:
                    check_span(path, t, recorded[t.name], tests)
    machine = _inside(file, folder, table.machine, "machine", outside=True)
    recordings = {
        t.name: read_recording(_inside(file, folder, t.trace, f'[[test]] "{t.name}" trace'), t)
        for t in logs
        if traces and t.trace is not None
    }
    r = recorder or i
    return Campaign(
        table.name,
        folder,
        machine,
        instrument,
        tests,
        recorded,
        table.measured_on,
        as_is,
        Logs(logs, recordings, _recorder(r, recordings)),
        acceptance_of(file, table.acceptance, tests),
    )


def _recorder(table: InstrumentTable, recordings: dict[str, Recording]) -> LogInstrument:
    """The recorder as stated, with the encoder steps that its recordings show."""
    found: dict[str, float] = {}
    for recording in recordings.values():
        for axis in recording.axes:
            found[axis] = max(found.get(axis, 0.0), encoder_step(recording, axis))
    steps = (table.resolution_um * UM, table.resolution_deg * DEG)
    return LogInstrument(table.sample_rate_Hz, *steps, found)


def _inside(file: Path, folder: Path, name: str, key: str, outside: bool = False) -> Path:
    if not name.strip() or not name.isprintable():
        raise InputError(f"{file}: {key} = {shown(name)} is no file name; allowed: a path inside the campaign's folder")
    target = folder / name
    if Path(name).is_absolute() or (not outside and not inside(folder, target)):
        raise InputError(f"{file}: {key} = {shown(name)} leaves the campaign's folder; allowed: a path inside it")
    return target


def check_span(path: Path, test: BallBarTest, trace: Trace, tests: tuple[BallBarTest, ...] = ()) -> None:
    """Refuse a trace whose times are none of its test's program; ``path`` is what the message names, ``tests`` all of
    the campaign.

    Raises:
        InputError: the trace is too long or too short, or its clock has another origin.
    """
    first, last = Program(test).measured_span
    begin, end = float(trace.time[0]), float(trace.time[-1])
    if spans_fit(test, begin, end):
        return
    mistake = explain(test, begin, end)
    other = next((t.name for t in tests if t.name != test.name and spans_fit(t, begin, end)), None)
    if other is not None and mistake is not None and mistake.usual:
        advice = f'{mistake.sentence}, unless it is the trace of test "{other}"'
    elif other is not None:
        advice = f'it fits the program of test "{other}": are their traces exchanged?'
    else:
        advice = (
            mistake.sentence if mistake else "check feed_mm_min, revolutions and that the trace belongs to this test"
        )
    raise InputError(
        f"{path}: time_s runs from {begin:.2f} to {end:.2f} s ({end - begin:.2f} s), the program of test "
        f'"{test.name}" (feed {test.feed * 60e3:g} mm/min) is measured from {first:.2f} to {last:.2f} s '
        f"({last - first:.2f} s): {advice}"
    )


def spans_fit(test: BallBarTest, begin: float, end: float) -> bool:
    """Whether a trace from ``begin`` to ``end`` s can be of the test: its program's measured part, or that with a
    gap at an end.
    """
    first, last = Program(test).measured_span
    inside = begin >= first - 0.5 and end <= last + 0.5
    want, have = last - first, end - begin
    slack = 0.02 * want + 0.1
    return inside and (abs(have - want) <= slack or (have > 0.6 * want and 0 < want - have < LARGEST_GAP))


def test_of(file: Path, t: BallBarTable, chain: Chain) -> BallBarTest:
    """The test that a ``[[test]]`` table describes.

    Args:
        file: where it stands.
        t: the table.
        chain: axes of the machine.

    Raises:
        InputError: a key is missing, belongs to another kind, or its NC program does not fit.
    """
    place = f'{file}: [[test]] "{t.name}"'
    kind = KINDS[t.kind]
    if reason := kind.cannot(chain):
        able = ", ".join(able_kinds(chain)) or "none of the known kinds"
        raise InputError(
            f"{place}: kind = {t.kind!r} is not for the configuration {chain.configuration!r}: {reason}; "
            f"allowed: {able}"
        )
    for key in kind.needed:
        if getattr(t, key) is None:
            raise InputError(f"{place}: the key {key!r} is missing; {t.kind} needs {', '.join(kind.needed)}")
    for key in set(all_keys()) - {k.name for k in kind.keys}:
        if getattr(t, key) is not None:
            raise InputError(f"{place}: the key {key!r} does not belong to {t.kind}")
    for key in kind.keys:
        words = key.words_of(chain)
        if words and getattr(t, key.name) not in (None, *words):
            raise InputError(
                f"{place}: {key.name} = {getattr(t, key.name)!r}; allowed for {t.kind}: {', '.join(words)}"
            )
    x, y, z = (p * MM for p in t.table_ball_mm)
    check_keys(place, t)
    given: dict[str, Any] = {}
    more: dict[str, Any] = {}
    for key in kind.keys:
        value = getattr(t, key.name)
        if value is not None:
            (given if key.attribute in _ATTRIBUTES else more)[key.attribute] = (
                value if key.unit is None else value * key.unit
            )
    test = BallBarTest(
        name=t.name,
        kind=t.kind,
        table_ball=(x, y, z),
        length=t.bar_length_mm * MM,
        feed=t.feed_mm_min * MM / 60.0,
        setup=t.setup or t.name,
        started=t.started_s,
        spindle=t.spindle_deg * DEG,
        trace=t.trace,
        chain=chain,
        more=more,
        **given,
        **kind.derived(given),
    )
    if wrong := kind.wrong(test):
        raise InputError(f"{place}: {wrong}")
    _check_duration(place, test)
    return _driven(file, place, test, t)


def _check_duration(place: str, test: BallBarTest) -> None:
    program = Program(test)
    lo, hi = program.measured_span
    if not program.duration <= LONGEST or not hi - lo >= SHORTEST:
        raise InputError(
            f"{place}: its program would last {program.duration:.3g} s, {hi - lo:.3g} s of it measured; allowed: "
            f"up to {LONGEST:g} s, and "
            f"at least {SHORTEST:g} s measured; check feed_mm_min, bar_length_mm, table_ball_mm and how far it goes"
        )


def _driven(file: Path, place: str, test: BallBarTest, t: BallBarTable) -> BallBarTest:
    """The test with the motion of its NC file or of a record, where it has one."""
    if t.program is not None:
        return with_program(place, _inside(file, file.parent, t.program, f"{place} program"), test, t)
    if t.driven_by is not None:
        return with_record(_inside(file, file.parent, t.driven_by, f"{place} driven_by"), test)
    return test


def test_table(test: BallBarTest) -> dict:
    """A test as a ``[[test]]`` table of campaign.toml has it; what is not measured yet has no trace, no time and no
    program.
    """
    out: dict = {"name": test.name, "kind": test.kind}
    for key in (k for k in kind_of(test).keys if k.given(test)):
        value = key.of(test)
        out[key.name] = value if key.unit is None else _plain(value / key.unit)
    out |= {
        "table_ball_mm": [_plain(x / MM) for x in test.table_ball],
        "bar_length_mm": _plain(test.length / MM),
        "feed_mm_min": _plain(test.feed / MM * 60.0),
    }
    turned = {"spindle_deg": _plain(test.spindle / DEG)} if test.spindle else {}
    return out | turned | ({"setup": test.setup} if test.setup else {})


def _plain(x: float) -> float:
    return float(f"{x:.9g}")
