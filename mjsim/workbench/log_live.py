"""A workbench of axis logs whose error is computed in the background."""

from __future__ import annotations

import threading

from mjsim.errors import InputError, SimulationError
from mjsim.machine.effect import Effect
from mjsim.workbench.jobs import Jobs
from mjsim.workbench.log_state import LogBench
from mjsim.workflow.log_compare import LogComparison


class LogLive(Jobs):
    """Keeps the error of a workbench up to date; a page looks at :attr:`version` and draws what has changed.

    Args:
        bench: The workbench. After a change of its model, call :meth:`changed`.
    """

    #: There are no bars to wait for.
    signatures = 1.0

    def __init__(self, bench: LogBench) -> None:
        super().__init__()
        self.bench = bench
        self.version = 0
        #: The newest error, and the one of another model that is drawn beside it, with its name.
        self.overlay: LogComparison | None = None
        self.other: LogComparison | None = None
        self.other_name = "before"
        #: What went wrong, in one sentence; empty where nothing did.
        self.error = ""
        self._ended = False
        self._wake = threading.Event()
        threading.Thread(target=self._loop, daemon=True).start()
        self.changed()

    def changed(self) -> None:
        """The model is another one: compute its error."""
        self._wake.set()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._stop_job.set()
        self._wake.set()

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
