"""``mjsim check`` as functions: what is wrong with a campaign's files, and a corrected copy of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign, remarks_on
from mjsim.commands.any_instrument import check_plainly
from mjsim.commands.ball_bar.check import CheckedBars, check_bars, write_bars
from mjsim.commands.checked import CheckedPart
from mjsim.commands.comparison import joined
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.model import Machine

#: Checks that compare recordings with the model.
_CHECK = {BallBarTest.instrument: check_bars}


@dataclass(frozen=True)
class CheckResult:
    """Mistakes of a campaign.

    Attributes:
        campaign: As read.
        parts: What is wrong with the tests of each instrument.
    """

    campaign: Campaign
    parts: tuple[CheckedPart, ...]

    @property
    def mistakes(self) -> tuple[Any, ...]:
        """All of them."""
        return tuple(m for part in self.parts for m in part.mistakes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the record of temperatures shows, a sentence each."""
        return tuple(remarks_on(self.campaign))

    @property
    def bars(self) -> CheckedBars | None:
        """Of the ball-bar tests; ``None`` where none was measured."""
        return next((p for p in self.parts if isinstance(p, CheckedBars)), None)

    def to_json(self) -> dict:
        """As ``mjsim check --json`` prints it."""
        data = joined(self.campaign, {p.instrument: p.to_json() for p in self.parts})
        return data if self.campaign.temperatures is None else {**data, "temperature": list(self.remarks)}


def check(path: str | Path, machine: Machine | None = None, threads: int = 2) -> CheckResult:
    """Look for a wrong unit, sign, direction or feed, exchanged traces or columns, and wrong clocks.

    Args:
        path: Folder of the campaign, or its campaign.toml.
        machine: The model; ``None``: the campaign's.
        threads: Simulations side by side.

    Raises:
        InputError: A file cannot be read at all, or no test has a trace.
    """
    campaign = read_campaign(path, spans=False)
    campaign.need_traces("there is nothing to check")
    machine = in_campaign(machine or read_machine(campaign.machine_file), campaign)
    parts = campaign.measured_parts.items()
    return CheckResult(campaign, tuple(_CHECK.get(name, check_plainly)(part, machine, threads) for name, part in parts))


def write_corrected(result: CheckResult, folder: str | Path) -> list[Path]:
    """Write the campaign's files into a new folder, with the mistakes of ball-bar tests put right.

    Raises:
        InputError: A mistake leaves a choice, there is none that can be put right, or the folder has files in it.
    """
    if result.bars is None:
        raise InputError(f"{result.campaign.folder}: nothing to put right")
    return write_bars(result.bars, folder)
