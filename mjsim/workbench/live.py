"""A workbench whose error is computed in the background: at once by the drives alone, the shown test first, soon after
by the multibody model, then what each effect could explain.
"""

from __future__ import annotations

import threading
import time

from mjsim.commands.comparison import Comparison
from mjsim.errors import InputError, SimulationError
from mjsim.machine.effect import Effect
from mjsim.workbench.jobs import Jobs
from mjsim.workbench.overlay import DRIVES, MULTIBODY, Overlay
from mjsim.workbench.recordings import RecordingsBench
from mjsim.workbench.state import Workbench, most_changed

#: The page has so long to draw the shown test before the others are fitted, which takes both cores, s.
_PICTURE = 0.08
#: Multibody results of the tests that are not shown appear at least so often, s.
_EVERY = 1.0
#: The bars of the effects wait at most so long for changes to be simulated, s; then they go on.
_PATIENCE = 5.0
#: They go on when the user has changed nothing for this time after that, s.
_PAUSE = 0.3


class Live(Jobs):
    """Keeps the error of a workbench up to date; a page looks at :attr:`version` and draws what has changed.

    Args:
        bench: The workbench. After a change of its model, call :meth:`changed`.
    """

    bench: Workbench
    overlay: Overlay | None
    other: Overlay | None

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench, self._quick, self._full, self._update_bars)
        #: Tests that are simulated first.
        self.shown: list[str] = [t.name for t in bench.opened.tests[:1]]
        self.signatures = 1.0 if bench.shared.gains is None or bench.shared.gains.ready else 0.0
        self._asked, self._rested = 0, 0
        self._calm = threading.Event()
        self.begin()

    def changed(self) -> None:
        """The model is another one: compute its error."""
        self._asked += 1
        self._calm.clear()
        super().changed()

    def failed(self) -> None:
        """No better error comes."""
        self._calm.set()

    def show(self, name: str) -> None:
        """Simulate this test first from now on."""
        self.shown = [name]
        self.wake[1].set()

    def _quick(self) -> None:
        asked, now = self._asked, self.overlay
        if now is not None and now.machine is not self.bench.machine:  # all tests take ten times as long
            self._publish(self.bench.quick_one(self.shown[0], now))
            time.sleep(_PICTURE)
        result = self.bench.quick()
        self.error = ""
        self._publish(result)
        if asked == self._asked:
            self.wake[1].set()

    def _full(self) -> None:
        """The shown tests first, then the others, a few at a time, until the model changes."""
        asked, machine, opened = self._asked, self.bench.machine, self.bench.opened
        kept = self.bench.shared.readings.kept(machine)
        first = [n for n in self.shown if n not in kept]
        rest = [t.name for t in opened.tests if t.name not in kept and t.name not in first]
        chunks = [first] if first else []
        chunks += [rest[i : i + opened.threads] for i in range(0, len(rest), opened.threads)]
        last = 0.0
        for i, names in enumerate(chunks):
            if asked != self._asked or self.ended:
                return
            self.bench.shared.readings.multibody(machine, names)
            now = time.monotonic()
            if i == 0 or i == len(chunks) - 1 or now - last > _EVERY:
                if asked != self._asked:
                    return
                self._publish(self.bench.quick(machine))
                last = now
        if asked == self._asked:
            self._calm.set()
            self.wake[2].set()

    def _publish(self, result: Overlay) -> None:
        if result.machine is not self.bench.machine:
            return
        former = self.overlay
        if former is not None and former.machine is not result.machine and former.engine == MULTIBODY:
            self.other, self.other_name = former, "before"
        self.overlay = result
        self.version += 1

    def preview(self, effect: Effect) -> str:
        """Draw the present model with an effect beside it; the name of the test that the effect changes most.

        Raises:
            InputError: The effect acts on what the machine does not have.
        """
        now = self.bench.quick()
        super().preview(effect)
        assert self.other is not None
        return most_changed(now, self.other)[0]

    def _update_bars(self) -> None:
        gains = self.bench.shared.gains
        if gains is None:
            return
        if not gains.ready:

            def progress(_: str, done: int, total: int) -> None:
                self._rest()  # a change of the model goes first, and what the user waits for
                self.wait_for_job()
                self.signatures = done / total
                self.bars += 1

            gains.prepare(progress, lambda: self.ended)
        self.signatures = 1.0
        self._rest()
        asked = self._asked
        for waves in (False, True):
            self.bench.update_gains(waves, stopped=lambda: self.ended or asked != self._asked)
            self.bars += 1
            if asked != self._asked:
                return

    def _rest(self) -> None:
        """Wait while the user changes the model: until it is simulated and no other change has come."""
        limit = time.monotonic() + _PATIENCE
        while self._rested != self._asked and time.monotonic() < limit and not self.ended:
            asked = self._asked
            if self._calm.wait(0.1):
                time.sleep(_PAUSE)
                self._rested = asked

    @property
    def engine(self) -> str:
        """What the newest error was simulated with."""
        return self.overlay.engine if self.overlay is not None else DRIVES

    @property
    def settled(self) -> bool:
        """Whether the shown error is the multibody model's, of all tests and of the present model."""
        now = self.overlay
        return now is not None and now.machine is self.bench.machine and now.engine == MULTIBODY


# -- A workbench of recordings whose error is computed in the background -----------------------------------------------


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
