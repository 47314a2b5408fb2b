"""Ball-bar tests of a campaign: their ``[[test]]`` tables, and whether a trace is of its test."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.kinds import KINDS, able_kinds, all_keys, kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest, Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.ball_bar.span import explain
from mjsim.instruments.ball_bar.tables import BallBarTable
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM

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
