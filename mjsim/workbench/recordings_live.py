"""A workbench of recordings whose error is computed in the background."""

from __future__ import annotations

import threading
import time

from mjsim.errors import InputError, SimulationError
from mjsim.machine.effect import Effect
from mjsim.workbench.jobs import Jobs, Stopped
from mjsim.workbench.recordings import RecordingsBench
from mjsim.workflow.comparison import Comparison


class RecordingsLive(Jobs):
    """Keeps the error of a workbench up to date; a page looks at :attr:`version` and draws what has changed.

    Args:
        bench: The workbench. After a change of its model, call :meth:`changed`.
    """

    def __init__(self, bench: RecordingsBench) -> None:
        super().__init__()
        self.bench = bench
        #: Counts whatever a page may want to draw again: traces, and bars of the effects.
        self.version, self.bars = 0, 0
        #: Whether the bars have been computed once, 0 or 1.
        self.signatures = 0.0
        #: The newest error, and the one of another model that is drawn beside it, with its name.
        self.overlay: Comparison | None = None
        self.other: Comparison | None = None
        self.other_name = "before"
        #: What went wrong, in one sentence; empty where nothing did.
        self.error = ""
        self._ended = False
        self._wake, self._wake_bars = threading.Event(), threading.Event()
        for work in (self._loop, self._bars_loop):
            threading.Thread(target=work, daemon=True).start()
        self.changed()

    def changed(self) -> None:
        """The model is another one: compute its error."""
        self._wake.set()

    def close(self) -> None:
        """End the threads."""
        self._ended = True
        self._stop_job.set()
        self._wake.set()
        self._wake_bars.set()

    @property
    def settled(self) -> bool:
        """Whether the shown error is that of the present model."""
        return self.overlay is not None and self.overlay.machine is self.bench.machine

    def preview(self, effect: Effect) -> None:
        """Draw the present model with an effect beside it.

        Raises:
            InputError: The effect acts on what the machine does not have.
        """
        self.other, self.other_name = self.bench.quick(self.bench.machine.with_effect(effect)), f"with {effect.key}"
        self.version += 1

    def _loop(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            if self._ended:
                return
            try:
                result = self.bench.quick()
            except (InputError, SimulationError) as error:
                self.error = str(error)
                self.version += 1
                continue
            self.error = ""
            if self.overlay is not None and self.overlay.machine is not result.machine:
                self.other, self.other_name = self.overlay, "before"
            self.overlay = result
            self.version += 1
            self._wake_bars.set()

    def _bars_loop(self) -> None:
        while True:
            self._wake_bars.wait()
            self._wake_bars.clear()
            while self.job is not None and self.job.alone and not self._ended:
                time.sleep(0.05)
            if self._ended:
                return
            try:
                self.bench.update_gains(stopped=lambda: self._ended or not self.settled)
            except (Stopped, InputError, SimulationError):
                continue  # of another model; what is wrong with this one the error says
            self.signatures = 1.0
            self.bars += 1
