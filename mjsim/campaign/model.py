"""A measurement campaign: the tests, in order, and what was recorded."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

from mjsim.axislog.measurement import Logs
from mjsim.ballbar.acceptance import Acceptance
from mjsim.ballbar.measurement import BallBarTest, Instrument, Trace


@dataclass(frozen=True)
class Campaign:
    """Tests of one machine with their traces (by test name; tests that were not measured are absent), and the day they
    were measured.

    ``logs`` holds the axis logs, where there are any. ``acceptance`` holds the limits of figures, where the user states
    some.
    ``as_is``: it is not to be searched for mistakes of the user's when it is compared with a machine.
    """

    name: str
    folder: Path
    machine_file: Path
    instrument: Instrument
    tests: tuple[BallBarTest, ...]
    traces: dict[str, Trace]
    measured_on: date | None = None
    as_is: bool = False
    logs: Logs = field(default_factory=Logs)
    acceptance: Acceptance | None = None

    @property
    def measured(self) -> tuple[BallBarTest, ...]:
        """The tests that have a trace, in order."""
        return tuple(t for t in self.tests if t.name in self.traces)

    @property
    def state_folder(self) -> Path:
        """Where mjsim keeps this campaign's history and plots."""
        return self.folder / ".mjsim"
