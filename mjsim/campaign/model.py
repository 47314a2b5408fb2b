"""A measurement campaign: the tests, in order, and what was recorded."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.acceptance import Acceptance
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.temperatures import Temperatures


@dataclass(frozen=True)
class Campaign:
    """Tests of one machine, of any instruments, measured or planned.

    Attributes:
        name: Of the campaign.
        folder: Where it is.
        machine_file: Of the machine that was measured.
        tests: In the order of the file; each is what its instrument makes of a ``[[test]]`` table.
        traces: What was recorded, by name of the test, as its instrument reads it; planned tests have none.
        instruments: Numbers of the instruments, by name of the instrument.
        measured_on: Day of the measurements.
        as_is: It is not to be searched for mistakes of the user's when it is compared with a machine.
        acceptance: Limits of figures, where the user states some.
        serial_number: Of the machine; empty where none is stated.
        temperatures: Of temperature.csv; ``None`` where there is none.
    """

    name: str
    folder: Path
    machine_file: Path
    tests: tuple[Any, ...]
    traces: dict[str, Any]
    instruments: dict[str, Any]
    measured_on: date | None = None
    as_is: bool = False
    acceptance: Acceptance | None = None
    serial_number: str = ""
    temperatures: Temperatures | None = None

    @property
    def measured(self) -> tuple[Any, ...]:
        """The tests that have a trace, in order."""
        return tuple(t for t in self.tests if t.name in self.traces)

    @property
    def planned(self) -> tuple[Any, ...]:
        """The tests that have none, in order."""
        return tuple(t for t in self.tests if t.name not in self.traces)

    @property
    def instrument(self) -> Any:
        """Numbers of the instrument, of a campaign that has one."""
        (data,) = self.instruments.values()
        return data

    def of(self, *instruments: str) -> Campaign:
        """The part of one instrument, or of some."""
        if set(self.instruments) <= set(instruments):
            return self
        data = {name: numbers for name, numbers in self.instruments.items() if name in instruments}
        return replace(self._with(t for t in self.tests if t.instrument in instruments), instruments=data)

    @property
    def in_motion(self) -> Campaign:
        """The part whose tests are readings along a motion, as those of a ball bar are."""
        return self.of(*(name for name, i in INSTRUMENTS.items() if i.in_motion))

    def only(self, names: Collection[str]) -> Campaign:
        """The part of some measured tests; all of it where none is named.

        Raises:
            InputError: A name is none of a measured test.
        """
        known = [t.name for t in self.measured]
        for name in names:
            if name not in known:
                raise InputError(
                    f"{self.folder / 'campaign.toml'}: no test {name!r} with a trace; it has: "
                    f"{', '.join(known) or 'none'}"
                )
        return self._with(t for t in self.tests if t.name in names) if names else self

    def _with(self, tests) -> Campaign:
        kept = tuple(tests)
        return replace(self, tests=kept, traces={t.name: self.traces[t.name] for t in kept if t.name in self.traces})

    @property
    def measured_parts(self) -> dict[str, Campaign]:
        """By name of the instrument the part of each that has measured something, in the order of their answers."""
        names = {t.instrument for t in self.measured}
        return {name: self.of(name) for name in INSTRUMENTS if name in names}

    def need_traces(self, why: str) -> None:
        """Refuse a campaign in which nothing was measured; ``why`` ends the sentence.

        Raises:
            InputError: No test has a trace.
        """
        if not self.measured:
            raise InputError(f"{self.folder / 'campaign.toml'}: {self.nothing_measured}; {why}")

    @property
    def nothing_measured(self) -> str:
        """What to say where nothing was measured; a part without tests is that of the first instrument."""
        if self.tests:
            return "no test has a trace"
        return f"no {next(iter(INSTRUMENTS.values())).test_noun} was measured"

    @property
    def state_folder(self) -> Path:
        """Where mjsim keeps this campaign's history and plots."""
        return self.folder / ".mjsim"
