"""What a call of ``mjsim import`` has to bring in: one entry for each table of text, and for each run of a ``.b5r``
file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.importing.b5r import looks_like_xml
from mjsim.importing.b5r_runs import CANDIDATES, Recorded, Run, read_recorded
from mjsim.importing.formats import read_any
from mjsim.importing.header import test_keys
from mjsim.importing.into_campaign import test_name
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.instruments.ball_bar.kinds.base import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import FIVE_AXIS

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
