"""Ball-bar tests of a campaign: their ``[[test]]`` tables, and whether a trace is of its test."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, create_model

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.acceptance import BIDIRECTIONAL, FIGURES, RANGE, Acceptance, Limit
from mjsim.instruments.ball_bar.kinds import KINDS, able_kinds, all_keys, kind_of
from mjsim.instruments.ball_bar.kinds.base import Key
from mjsim.instruments.ball_bar.measurement import BallBarData, BallBarTest, Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.ball_bar.span import explain
from mjsim.instruments.schema import Clock, Length, Table, Text, one_of, printable
from mjsim.io.inputs import check_rows, csv_text, shown
from mjsim.io.times import check_growing
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.units import DEG, MM, UM

# -- what the tables of ball-bar tests and of their limits may contain -------------------------------------------------


class MotionTable(Table):
    """The keys of every ``[[test]]`` that is a motion."""

    feed_mm_min: Annotated[float, Field(gt=0, le=100000)]
    trace: str | None = None
    program: str | None = None
    program_dialect: Literal["fanuc", "siemens", "linuxcnc", "heidenhain"] | None = None
    program_reversed: list[str] | None = None
    program_rollover: bool | None = None
    driven_by: str | None = None
    setup: Annotated[str, Field(max_length=200), AfterValidator(printable)] | None = None
    started_s: Clock = 0.0
    spindle_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class BallBarTable(MotionTable):
    """The keys that every ball-bar test may have. :func:`ball_bar_table` has those of single kinds as well."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Annotated[str, AfterValidator(one_of(lambda: KINDS))]
    table_ball_mm: Annotated[list[Length], Field(min_length=3, max_length=3)]
    bar_length_mm: Annotated[float, Field(ge=20, le=1000)]


def ball_bar_table(chain: Chain = FIVE_AXIS) -> type[BallBarTable]:
    """What a ``[[test]]`` table may contain on a machine with these axes, whatever its kind."""
    fields: dict[str, Any] = {name: (_type(keys, chain) | None, None) for name, keys in all_keys().items()}
    rotary = Annotated[str, AfterValidator(one_of(lambda: chain.rotary))]
    fields["program_reversed"] = (list[rotary] | None, None)
    return create_model("BallBarTable", __base__=BallBarTable, **fields)


def _type(keys: list[Key], chain: Chain) -> Any:
    """The type of a key that several kinds may have: texts may be any of their words."""
    words = dict.fromkeys(w for k in keys for w in k.words_of(chain))
    return Annotated[str, AfterValidator(one_of(lambda: words))] if words else keys[0].type


class LimitTable(Table):
    """One ``[[acceptance.limit]]``."""

    tests: Annotated[list[str], Field(min_length=1, max_length=1000)]
    figure: Literal[FIGURES]  # pyright: ignore[reportInvalidTypeForm]
    um: Annotated[float, Field(gt=0, le=1e5)]
    source: Text


class AcceptanceTable(Table):
    instrument_um: Annotated[float, Field(ge=0, le=1000)]
    probability: Annotated[float, Field(ge=0.5, le=0.9999)] = 0.95
    limit: Annotated[list[LimitTable], Field(min_length=1, max_length=1000)]


# -- reading recorded traces -------------------------------------------------------------------------------------------

_HEADER = ["time_s", "deviation_um"]
#: A reading that stands still for so many samples at its extreme, and leaves it by so many of its smallest steps, was
#: cut off.
_FLAT, _CUT = 10, 20.0
#: A trace may have so many times fewer samples than its usual step would give; fewer is no even recording.
_UNEVEN = 20
_NUMBER = re.compile(r"\s*[+-]?(?:(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?|nan|inf|infinity)\s*", re.ASCII | re.IGNORECASE)


def read_trace(path: Path, instrument: BallBarData) -> Trace:
    """Read one trace; samples at or beyond the sensor's range, and those of a sensor that stands at its stop, are
    marked invalid.

    Raises:
        InputError: names the file, the line, what was found and what is allowed.
    """
    first, body = csv_text(path, f"a CSV file with the header {','.join(_HEADER)}")
    header = [h.strip() for h in first.split(",")]
    if header != _HEADER:
        raise InputError(f"{path}, line 1: header {shown(first.strip())}; allowed: {','.join(_HEADER)}")
    if not body.strip():
        raise InputError(f"{path}: 0 samples; allowed: at least 50")
    check_rows(path, body.count("\n"))
    time, deviation = _columns(path, body.replace("\r\n", "\n").split("\n"))
    held = saturated(deviation)
    inside = np.isfinite(deviation) & (np.abs(np.nan_to_num(deviation)) < instrument.range * (1 - 1e-9))
    valid = inside & ~held
    if valid.sum() < 50:
        at = f", and {int((inside & held).sum())} more stand at one extreme value" if (inside & held).any() else ""
        raise InputError(
            f"{path}: only {int(inside.sum())} of {len(valid)} samples are inside the sensor's range of "
            f"±{instrument.range * 1e3:g} mm{at}"
        )
    reading = np.clip(np.nan_to_num(deviation), -2 * instrument.range, 2 * instrument.range)
    return Trace(time, reading, valid, int((np.isfinite(deviation) & ~valid).sum()))


def _columns(path: Path, lines: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s and deviations (n,) m of the lines below the header."""
    try:
        data = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
        if data.shape[1] != 2:
            raise ValueError
    except ValueError:
        raise InputError(f"{path}{_first_bad_line(lines)}") from None
    if len(data) < 50:
        raise InputError(f"{path}: {len(data)} samples; allowed: at least 50")
    time, deviation = data[:, 0], data[:, 1] * UM

    def line(i: int) -> int:
        return [number for number, row in enumerate(lines, start=2) if row.strip()][i]

    if not np.isfinite(time).all():
        raise InputError(
            f"{path}, line {line(int(np.flatnonzero(~np.isfinite(time))[0]))}: time_s is not a finite number"
        )
    if np.abs(time).max() > 1e12:
        raise InputError(
            f"{path}, line {line(int(np.argmax(np.abs(time))))}: time_s = {np.abs(time).max():g}; allowed: seconds"
        )
    check_growing(path, time, line)
    usual = float(np.median(np.diff(time)))
    if time[-1] - time[0] > _UNEVEN * usual * len(time):
        raise InputError(
            f"{path}: {len(time)} samples in {time[-1] - time[0]:.4g} s, though every other one follows within "
            f"{usual:.3g} s; "
            "allowed: samples at an even rate"
        )
    return time, deviation


def saturated(deviation: np.ndarray) -> np.ndarray:
    """Which samples (n,) of a reading (n,) m are those of a sensor at its stop: flat tops at its highest or lowest
    value.

    A stop cuts a curve off: the reading stays at one value for :data:`_FLAT` samples or more, and as far before and
    after as it stays there it is away from it by :data:`_CUT` of its smallest steps or more. A peak that is flat
    because its digits are few is left by a few such steps only.
    """
    out = np.zeros(len(deviation), bool)
    known = deviation[np.isfinite(deviation)]
    values = np.unique(known)
    if len(values) < 3:
        return out
    step = max(float(np.diff(values).min()), 1e-9 * float(np.abs(values).max()))
    for stop in (values[0], values[-1]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], deviation == stop, [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            length = end - begin
            if length < _FLAT:
                continue
            half = max(1, length // 2)
            sides = [deviation[max(0, begin - half)], deviation[min(len(deviation), end + half) - 1]]
            away = [abs(x - stop) for x in sides if np.isfinite(x)]
            if away and max(away) > _CUT * step:
                out[begin:end] = True
    return out


def _first_bad_line(lines: list[str]) -> str:
    for number, line in enumerate(lines, start=2):
        if not line.strip():
            continue
        row = line.split(",")
        if len(row) != 2:
            columns = f"{len(row)} column{'s' if len(row) > 1 else ''}"
            return (
                f", line {number}: {columns} in {shown(line, 60)}; allowed: two numbers, time_s and deviation_um "
                f"(decimal point)"
            )
        for name, value in zip(_HEADER, row, strict=True):
            if not _NUMBER.fullmatch(value):
                return (
                    f", line {number}: {name} = {shown(value.strip(), 40)} is not a number; allowed: a number with "
                    f"a decimal point"
                )
    return ": the table cannot be read; allowed: two columns of numbers"


_ATTRIBUTES = {f.name for f in fields(BallBarTest)}
#: A test's program may last so long, s, and its measured part has to last so long (assumed): 1 ms of it is one step.
LONGEST, SHORTEST = 7200.0, 0.1
#: Longest stretch that may be missing at an end of a trace, s (assumed); more is taken for another feed or another
#: test.
LARGEST_GAP = 4.5


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
    """The test that a ``[[test]]`` table describes, with its own motion.

    Args:
        file: where it stands.
        t: the table.
        chain: axes of the machine.

    Raises:
        InputError: a key is missing, or belongs to another kind.
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
    )
    test = kind.completed(test)
    if wrong := kind.wrong(test):
        raise InputError(f"{place}: {wrong}")
    check_duration(place, test)
    return test


def check_duration(place: str, test: BallBarTest) -> None:
    """Refuse a test that lasts too long, or whose measured part is too short.

    Raises:
        InputError: It does.
    """
    program = Program(test)
    lo, hi = program.measured_span
    if not program.duration <= LONGEST or not hi - lo >= SHORTEST:
        raise InputError(
            f"{place}: its program would last {program.duration:.3g} s, {hi - lo:.3g} s of it measured; allowed: "
            f"up to {LONGEST:g} s, and "
            f"at least {SHORTEST:g} s measured; check feed_mm_min, where the ball is, and how far it goes"
        )


def test_table(test: BallBarTest) -> dict:
    """A test as a ``[[test]]`` table of campaign.toml has it; what is not measured yet has no trace, no time and no
    program.
    """
    out: dict = {"name": test.name, "kind": test.kind}
    for key in (k for k in kind_of(test).keys if k.given(test)):
        value = key.of(test)
        out[key.name] = value if key.unit is None else plain(value / key.unit)
    out |= {
        "table_ball_mm": [plain(x / MM) for x in test.table_ball],
        "bar_length_mm": plain(test.length / MM),
        "feed_mm_min": plain(test.feed / MM * 60.0),
    }
    turned = {"spindle_deg": plain(test.spindle / DEG)} if test.spindle else {}
    return out | turned | ({"setup": test.setup} if test.setup else {})


def plain(x: float) -> float:
    """A number as a table has it, without the noise of its last digits."""
    return float(f"{x:.9g}")


# -- the ``[acceptance]`` table of a campaign --------------------------------------------------------------------------


def acceptance_of(file: Path, table: AcceptanceTable | None, tests: Sequence[BallBarTest]) -> Acceptance | None:
    """The limits that the table states; ``None`` without a table.

    Args:
        file: The campaign file, for messages.
        table: As it was read.
        tests: Of the campaign.

    Raises:
        InputError: a limit is for a test that does not exist, or for a figure that the test does not have.
    """
    if table is None:
        return None
    known = {t.name: t for t in tests}
    limits = []
    for number, row in enumerate(table.limit, start=1):
        place = f"{file}: [[acceptance.limit]] number {number}"
        for name in row.tests:
            if name not in known:
                raise InputError(f"{place}: there is no test {name!r}; allowed: {', '.join(known)}")
            round_ = kind_of(known[name]).goes_round
            if round_ == (row.figure == RANGE):
                allowed = "figures of ISO 230-4" if round_ else RANGE
                raise InputError(f"{place}: figure = {row.figure!r} of test {name!r}; allowed for it: {allowed}")
        if row.figure in BIDIRECTIONAL:
            ways = [known[n].direction for n in row.tests]
            if sorted(ways) != ["CCW", "CW"]:
                raise InputError(f"{place}: {row.figure} needs two tests, one CCW and one CW; found: {', '.join(ways)}")
        limits.append(Limit(tuple(row.tests), row.figure, row.um * UM, row.source))
    return Acceptance(tuple(limits), table.instrument_um * UM, table.probability)
