"""What a call of ``mjsim import`` has to bring in: one entry for each table of text, and for each run of a ``.b5r``
file.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.importing.b5r import CANDIDATES, Recorded, Run, looks_like_xml, read_recorded
from mjsim.importing.formats import read_any
from mjsim.importing.into_campaign import test_name
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.importing.units import unit_named
from mjsim.instruments.ball_bar.files import ball_bar_table
from mjsim.instruments.ball_bar.kinds import all_keys
from mjsim.instruments.ball_bar.kinds.base import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import FIVE_AXIS

# -- what a text file's header says about its test ---------------------------------------------------------------------

_NAME = "A-Za-zÄÖÜäöüß"
_LINE = re.compile(rf"^\W*([{_NAME}][{_NAME} _-]*?)\s*(?:\(([^)]*)\)|\[([^\]]*)\])?\s*[:=;,\t]\s*(.+?)\s*[;,\t]*$")
_SPACES, _LONGEST = re.compile(r" {2,}"), 300
_VALUE = re.compile(r"^([+-]?\d+(?:[.,]\d+)?)\s*(\S*)$")
_FEEDS = {"mm/min": 1.0, "m/min": 1000.0, "in/min": 25.4, "inch/min": 25.4, "ipm": 25.4}
#: What English and German headers call a key, without its unit; in lower case.
_FEED = {
    "feed",
    "feedrate",
    "feed rate",
    "programmed feedrate",
    "vorschub",
    "programmierter vorschub",
    "vorschubgeschwindigkeit",
}
_LENGTH = {
    "radius", "bar length", "ballbar length", "ball bar length", "nominal length", "test radius",
    "messradius", "kreisradius", "nennlänge", "stablänge",
}  # fmt: skip
_PLANE, _WAY = {"plane", "test plane", "ebene", "messebene"}, {"direction", "run direction", "richtung", "drehrichtung"}
_WAYS = {
    "cw": "CW", "im uhrzeigersinn": "CW", "uhrzeigersinn": "CW",
    "ccw": "CCW", "gegen den uhrzeigersinn": "CCW", "gegenuhrzeigersinn": "CCW",
}  # fmt: skip


def test_keys(header: tuple[str, ...]) -> dict:
    """Keys of a ``[[test]]`` table that the header's lines give; a number without a unit counts only under a key
    that names its unit.
    """
    out: dict = {}
    for line in header[:200]:
        m = _LINE.match(_SPACES.sub(" ", line[:_LONGEST].strip()))
        if not m:
            continue
        name, unit, text = m[1].strip(), m[2] or m[3] or "", m[4].strip('"')
        for key, value in _read(name, unit, text).items():
            out.setdefault(key, value)
    return out


def _read(name: str, unit: str, text: str) -> dict:
    if name in ball_bar_table().model_fields:
        return _own(name, text)
    word, number = name.lower().replace("_", " "), _VALUE.match(text)
    if (
        word in _PLANE and text.upper() in FIVE_AXIS.planes
    ):  # XZ is seen from behind: which way its circle turns is not said
        return {"plane": text.upper()}
    if word in _WAY and text.lower() in _WAYS:
        return {"direction": _WAYS[text.lower()]}
    if number:
        value, unit = float(number[1].replace(",", ".")), (number[2] or unit).lower()
        if word in _FEED and unit in _FEEDS:
            return {"feed_mm_min": round(value * _FEEDS[unit], 6)}
        if word in _LENGTH and unit_named(unit, "deviation") in ("mm", "inch"):
            return {"bar_length_mm": round(value * (25.4 if unit_named(unit, "deviation") == "inch" else 1.0), 6)}
    return {}


def _own(name: str, text: str) -> dict:
    """A key of campaign.toml itself."""
    keys = all_keys().get(name)
    if name in ("kind", "setup") or (keys and keys[0].words):
        return {name: text}
    if keys and keys[0].unit is None:
        return {name: int(text)} if text.isdigit() and text.isascii() and len(text) < 9 else {}
    number = _VALUE.match(text)
    return {name: float(number[1].replace(",", "."))} if number and not number[2] and name != "table_ball_mm" else {}


#: The last reading of a closed circle is near the first: a gap of more than this part of the range has to be asked
#: about.
_CLOSED = 0.3
#: Feed and length of the file may differ by this from the test's, as a ratio.
_SAME = 0.001


@dataclass(frozen=True)
class Source:
    """One recorded trace before it has a place in the campaign.

    Attributes:
        path: its file.
        name: of its test.
        table: its numbers.
        header: keys of a ``[[test]]`` table that the file gives.
        options: how it is read.
        recorded: the ``.b5r`` file of the run, ``None`` for a table of text.
        run: the run.
        unit: of its readings, empty for a table of text.
    """

    path: Path
    name: str
    table: Table
    header: dict
    options: Options
    recorded: Recorded | None = None
    run: Run | None = None
    unit: str = ""

    def timed(self, test: BallBarTest) -> tuple[Options, list[str]]:
        """How its samples follow each other in a test, and what was assumed: a run has neither times nor angles."""
        if self.run is None or self.options.rate is not None:
            return self.options, []
        lo, hi = Program(test).measured_span
        n = len(self.run.readings)
        begin = "φ = 0"
        clock: str | None = "trace"
        if self.options.start_angle is not None:
            begin, clock = f"φ = {np.degrees(self.options.start_angle):g}°", self.options.clock
        note = (
            f"the file does not say where its {n} readings lie; assumed: evenly over the {test.revolutions * 360}° of "
            f"the test, from {begin} on, in the order of the motion, without feed-in (--rate, --start-angle)"
        )
        return replace(self.options, rate=n / (hi - lo), clock=clock), [note]

    def questions(self, test: BallBarTest) -> list[str]:
        """What has to be asked about a run in its test; empty for a table of text."""
        if self.run is None or self.recorded is None:
            return []
        out = []
        for key, have, unit in (("bar_length_mm", test.length * 1e3, "mm"), ("feed_mm_min", test.feed * 6e4, "mm/min")):
            said = self.header.get(key)
            if said is not None and abs(said - have) > _SAME * have:
                word = "length" if key == "bar_length_mm" else "feed"
                out.append(
                    f"the file says {word} {said:g} {unit}, test {test.name} has {have:g} {unit}: is it the right test?"
                )
        if self.run.gap > _CLOSED:
            out.append(
                f"the last reading of run {self.run.direction} is {100 * self.run.gap:.0f} % of the range away "
                f"from the first: do the "
                "readings cover whole turns? mjsim has no circular test of a part of a circle"
            )
        return out


def sources(
    files: Sequence[Path], names: Sequence[str | None], keys: dict, o: Options, known: Campaign | None
) -> list[Source]:
    """What the files hold.

    Args:
        files: tables of text and ``.b5r`` files.
        names: of each file's test, ``None`` where it is not given.
        keys: of new tests, from options.
        o: how the files are read.
        known: the campaign, ``None`` where it has no test yet.

    Raises:
        InputError: a file cannot be read, or a run could belong to several tests.
    """
    out = []
    for path, name in zip(files, names, strict=True):
        if looks_like_xml(path):
            recorded = read_recorded(path)
            if not recorded.runs:
                raise InputError(
                    f"{path}: brings no trace: it has no READINGS; allowed: a .b5r file with recorded runs, or a "
                    f"table as text"
                )
            out += [_of_run(recorded, run, test, o) for run, test in runs_and_tests(recorded, name, keys, known)]
        else:
            table = read_any(path, o)
            out.append(Source(path, name or test_name(path), table, test_keys(table.header), o))
    return out


def _of_run(recorded: Recorded, run: Run, name: str, o: Options) -> Source:
    um, why = recorded.unit(run, o)
    unit = next((name for name, factor in CANDIDATES.items() if factor == um), f"{um:g} µm")
    numbers = np.arange(1, len(run.readings) + 1)
    notes = [f"run {run.direction}; {why}"]
    plane = "".join(recorded.imported.axes)
    if plane[::-1] in FIVE_AXIS.planes:
        notes.append(
            f"the file calls its plane {plane}: CW is taken for G02 of the plane {plane[::-1]}, which is not certain"
        )
    table = Table(recorded.path, ("deviation",), ("um",), run.readings[:, None] * um, numbers, (), tuple(notes))
    header = {**recorded.keys, "direction": run.direction}
    return Source(
        recorded.path, name, table, header, replace(o, deviation_unit="um", um_per_volt=None), recorded, run, unit
    )


def runs_and_tests(recorded: Recorded, name: str | None, keys: dict, known: Campaign | None) -> list[tuple[Run, str]]:
    """Runs with the names of their tests; a run that no test of the campaign fits is left out if no key describes a new
    one.

    Args:
        recorded: the file.
        name: of a test, as the user gives it: that run alone.
        keys: of a new test.
        known: the campaign.

    Raises:
        InputError: several tests fit a run, or the test that is named fits none.
    """
    tests = known.tests if known else ()
    runs = [r for r in recorded.runs if keys.get("direction", r.direction) == r.direction]
    if name is not None or (keys and not runs):
        return [(_the_run(recorded, runs, name, tests, keys), name or "")]
    out = []
    for run in runs:
        fits = [t.name for t in tests if _fits(recorded, run, t)]
        if keys:
            out.append((run, f"{test_name(recorded.path)}-{run.direction.lower()}"))
        elif len(fits) > 1:
            raise InputError(f"{recorded.path}: run {run.direction} fits the tests {', '.join(fits)}; say FILE=TEST")
        elif fits:
            out.append((run, fits[0]))
    return out


def _the_run(
    recorded: Recorded, runs: Sequence[Run], name: str | None, tests: Sequence[BallBarTest], keys: dict
) -> Run:
    """The run of a test that the user names."""
    test = next((t for t in tests if t.name == name), None)
    have = f"{recorded.path}: has {' and '.join(f'run {r.direction}' for r in recorded.runs) or 'no READINGS'}"
    plane = "".join(recorded.imported.axes)
    if test is not None:
        mine = kind_of(test).plane(test)
        if not mine or (plane and set(mine) != set(plane)):
            other = f"test {test.name!r} is {test.kind} {test.plane}".rstrip()
            raise InputError(
                f"{recorded.path}: holds a circle in {plane or 'a plane'}; {other}; allowed: FILE=TEST of such a "
                f"circular test"
            )
        runs = [r for r in runs if r.direction == test.direction]
        have += f", test {test.name!r} runs {test.direction}"
    if len(runs) != 1:
        raise InputError(
            f"{have}; allowed: one run that fits"
            + ("" if test or keys.get("direction") else ", say --direction CW or CCW")
        )
    return runs[0]


def _fits(recorded: Recorded, run: Run, test: BallBarTest) -> bool:
    """Whether a test of the campaign is what the header describes."""
    if kind_of(test).plane(test) != recorded.plane or test.direction != run.direction:
        return False
    said = recorded.keys
    pairs = ((said.get("bar_length_mm"), test.length * 1e3), (said.get("feed_mm_min"), test.feed * 6e4))
    return all(a is None or abs(a - b) <= _SAME * b for a, b in pairs)
