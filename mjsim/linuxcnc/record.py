"""What LinuxCNC told the axes: a commanded motion, and an axis log."""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.io.inputs import file_bytes
from mjsim.linuxcnc.configuration import CYCLE, Settings
from mjsim.machine.chain import Chain
from mjsim.nc.control import FeedReport, feed_report
from mjsim.nc.limits import scale
from mjsim.nc.read import read_nc
from mjsim.nc.write import Options, nc_program

#: Kinds of motion (motion.h of LinuxCNC) that are feeds: straight lines and arcs.
FEEDS = (2, 3)
#: Cycles at rest that are kept before and after the path.
_REST = 100


@dataclass(frozen=True, eq=False)
class Record:
    """Every servo cycle of one run.

    Attributes:
        told: Set-points that the drives got, with the control's corrections, (n, axes) m and rad.
        path: Set-points before the corrections, (n, axes) m and rad.
        line: Line of the program, (n,).
        kind: Of the motion, as LinuxCNC numbers it, (n,).
        chain: Axes of the machine.
        seconds: The run took on the clock of the wall, s.
        probed: What it wrote of its probings, (n, 9) mm and degrees; ``None`` where it has not probed.
    """

    told: np.ndarray
    path: np.ndarray
    line: np.ndarray
    kind: np.ndarray
    chain: Chain
    seconds: float
    probed: np.ndarray | None = None

    @cached_property
    def feed(self) -> slice:
        """The cycles of the path: from rest before its first feed block to rest after its last one.

        Raises:
            InputError: the program has no feed block that moves.
        """
        moves = np.abs(np.diff(self.path, axis=0)).max(axis=1) > 1e-13
        on = np.flatnonzero(moves & np.isin(self.kind[1:], FEEDS))
        if not len(on):
            raise InputError("LinuxCNC: the program has no feed block that moves an axis")
        return slice(int(on[0]), int(on[-1]) + 2)

    @property
    def motion(self) -> Commanded:
        """What the drives were told on the path, as a commanded motion on the control's own clock."""
        q = self.told[self.feed]
        return Commanded(np.full(len(q) - 1, CYCLE), q, chain=self.chain, clocked=True)

    @property
    def duration(self) -> float:
        """Of the path, s."""
        part = self.feed
        return (part.stop - part.start - 1) * CYCLE

    def to_csv(self, actual: np.ndarray | None = None) -> str:
        """As an axis log, with a little rest at both ends: command and actual position of every axis.

        Args:
            actual: Positions of the encoders in every cycle, (n, axes) m and rad; nothing: LinuxCNC's simulated joints,
                which follow at once.
        """
        part = slice(max(0, self.feed.start - _REST), self.feed.stop + _REST)
        units = np.array([scale(a) for a in self.chain.letters])
        q = self.told[part] / units
        y = q if actual is None else actual[part] / units
        names, columns = ["time_s"], [np.arange(len(q)) * CYCLE]
        for i, axis in enumerate(self.chain.letters):
            unit = "deg" if self.chain.is_rotary(axis) else "mm"
            names += [f"{axis}_command_{unit}", f"{axis}_actual_{unit}"]
            columns += [q[:, i], y[:, i]]
        text = io.StringIO()
        form = ["%.3f", *["%.9f"] * (len(columns) - 1)]
        np.savetxt(text, np.column_stack(columns), form, ",", header=",".join(names), comments="")
        return text.getvalue()


# -- the model of a control held against what LinuxCNC really told the axes --------------------------------------------

_LARGEST = 20_000_000


@dataclass(frozen=True)
class RunProgram:
    """A program for LinuxCNC: its text, and the motion that it commands."""

    text: str
    motion: Commanded


@dataclass(frozen=True)
class Held:
    """Attributes:
    record: Feed and deviation of what LinuxCNC told the axes.
    model: The same of mjsim's model of it.
    by_f: Duration of the program by its F, s.
    lasted: Duration of the path in the record, s.
    """

    record: FeedReport
    model: FeedReport
    by_f: float
    lasted: float

    def to_json(self) -> dict:
        """Both reports, and the duration."""
        return {"by_f_s": self.by_f, "linuxcnc": self.record.to_json(), "model": self.model.to_json()}

    def rows(self) -> list[list[str]]:
        """A table: what, LinuxCNC, model."""
        r, m = self.record.to_json(), self.model.to_json()

        def both(what: str, text) -> list[str]:
            return [what, text(r), text(m)]

        return [
            ["duration, s", f"{self.lasted:.3f}", f"{self.model.duration:.3f}"],
            both("mean feed, mm/min", lambda d: f"{d['mean_mm_min']:.2f} of {d['nominal_mm_min']:g}"),
            both("feed, mm/min", lambda d: f"{d['min_mm_min']:.1f} to {d['max_mm_min']:.1f}"),
            both("reading, µm", lambda d: f"{d['reading_um']['min']:.3f} to {d['reading_um']['max']:.3f}"),
            both("off the path, µm", lambda d: ", ".join(f"{a} {v:.3f}" for a, v in d["position_um"].items())),
            both("off the path, µrad", lambda d: ", ".join(f"{a} {v:.2f}" for a, v in d["angle_urad"].items())),
        ]


def program_of(test: BallBarTest, options: Options, file: Path | None = None) -> RunProgram:
    """The program that a test has: a file of the dialect ``linuxcnc``, or what mjsim writes.

    Raises:
        InputError: the file cannot be read, or the options do not fit.
    """
    if file is None:
        written = nc_program(test, options)
        return RunProgram(written.text, written.motion)
    motion = read_nc(file, "linuxcnc", chain=test.chain).motion
    data = file_bytes(file, _LARGEST, "allowed: an NC program", "no such file; allowed: an NC program")
    return RunProgram(data.decode("utf-8", errors="replace"), motion)


def held_against(test: BallBarTest, motion: Commanded, record: Record, settings: Settings) -> Held:
    """Compare duration, feed over the path and deviation of a record with the model.

    Args:
        test: What was run.
        motion: What its program commands.
        record: Of LinuxCNC.
        settings: It ran with.
    """
    return Held(
        feed_report(test, record.motion, name="the record of LinuxCNC"),
        feed_report(test, motion, settings.model(test.chain)),
        motion.duration,
        record.duration,
    )
