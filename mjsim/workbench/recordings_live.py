"""A workbench of recordings whose error is computed in the background."""

from __future__ import annotations

from mjsim.commands.comparison import Comparison
from mjsim.errors import InputError, SimulationError
from mjsim.workbench.jobs import Jobs
from mjsim.workbench.readings import DRIVES
from mjsim.workbench.recordings import RecordingsBench


class RecordingsLive(Jobs):
    """Keeps the error of a workbench up to date.

    Args:
        bench: The workbench. After a change of its model, call :meth:`changed`.
    """

    bench: RecordingsBench
    overlay: Comparison | None
    other: Comparison | None
    #: What simulates.
    engine = DRIVES

    def __init__(self, bench: RecordingsBench) -> None:
        super().__init__(bench, self._quick, self._update_bars)
        self.begin()

    @property
    def settled(self) -> bool:
        """Whether the shown error is that of the present model."""
        return self.overlay is not None and self.overlay.machine is self.bench.machine

    def _quick(self) -> None:
        result = self.bench.quick()
        self.error = ""
        if self.overlay is not None and self.overlay.machine is not result.machine:
            self.other, self.other_name = self.overlay, "before"
        self.overlay = result
        self.version += 1
        self.wake[1].set()

    def _update_bars(self) -> None:
        self.wait_for_job()
        if self.ended:
            return
        try:
            self.bench.update_gains(stopped=lambda: self.ended or not self.settled)
        except (InputError, SimulationError):
            return  # of another model; what is wrong with this one the error says
        self.signatures = 1.0
        self.bars += 1
