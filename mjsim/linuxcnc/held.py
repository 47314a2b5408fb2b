"""The model of a control held against what LinuxCNC really told the axes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.io.inputs import file_bytes
from mjsim.linuxcnc.configuration import Settings
from mjsim.linuxcnc.record import Record
from mjsim.nc.control import FeedReport, feed_report
from mjsim.nc.read import read_nc
from mjsim.nc.write import Options, nc_program

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
