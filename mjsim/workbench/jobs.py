"""What goes on beside a page of the workbench: the error is kept up to date, and one work at a time is done."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mjsim.errors import InputError, SimulationError
from mjsim.machine.effect import Effect


class Stopped(Exception):
    """The user has stopped the work, or it is not wanted any more."""


@dataclass(frozen=True)
class Job:
    """Work that the user waits for.

    Attributes:
        name: What is done.
        stage: What is done just now.
        done: Steps of the stage that are done, of ``total``.
        total: Steps of the stage.
        alone: The bars of the effects wait for it.
    """

    name: str
    stage: str = ""
    done: int = 0
    total: int = 0
    alone: bool = False


class Jobs:
    """Keeps the error of a workbench up to date, and does one work at a time; a page looks at :attr:`version` and draws
    what has changed.

    Args:
        bench: The workbench. After a change of its model, call ``changed``.
        work: What is done in the background, each in a thread of its own whenever its event in :attr:`wake` is set.
    """

    def __init__(self, bench: Any, *work: Callable[[], None]) -> None:
        self.bench = bench
        self.job: Job | None = None
        #: Counts whatever a page may want to draw again: traces, and bars of the effects.
        self.version, self.bars = 0, 0
        #: How far what the bars need is computed, 0 to 1.
        self.signatures = 0.0
        #: The newest error, and the one of another model that is drawn beside it, with its name.
        self.overlay: Any = None
        self.other: Any = None
        self.other_name = "before"
        #: What went wrong, in one sentence; empty where nothing did.
        self.error = ""
        self.ended = False
        self._stop_job = threading.Event()
        self._work = work
        self.wake = [threading.Event() for _ in work]

    def begin(self) -> None:
        """Start the threads."""
        for wake, work in zip(self.wake, self._work, strict=True):
            threading.Thread(target=self._loop, args=(wake, work), daemon=True).start()
        self.changed()

    def _loop(self, wake: threading.Event, work: Callable[[], None]) -> None:
        while not self.ended:
            wake.wait()
            wake.clear()
            if self.ended:
                return
            try:
                work()
            except Stopped:
                pass
            except (InputError, SimulationError) as error:
                self.error = str(error)
                self.version += 1
                self.failed()
            except RuntimeError:
                if not self.ended:  # a program that ends starts no more work
                    raise

    def changed(self) -> None:
        """The model is another one: compute its error."""
        self.wake[0].set()

    def failed(self) -> None:
        """Called after :attr:`error` was set."""

    def preview(self, effect: Effect) -> Any:
        """Draw the present model with an effect beside it.

        Raises:
            InputError: The effect acts on what the machine does not have.
        """
        self.other, self.other_name = self.bench.quick(self.bench.machine.with_effect(effect)), f"with {effect.key}"
        self.version += 1

    def wait_for_job(self) -> None:
        """Wait until the work is done that the bars of the effects wait for."""
        while self.job is not None and self.job.alone and not self.ended:
            time.sleep(0.05)

    def close(self) -> None:
        """End the threads."""
        self.ended = True
        self._stop_job.set()
        for wake in self.wake:
            wake.set()

    def run(self, name: str, work: Callable[..., Any], alone: bool = True) -> Any:
        """Do something that takes a while; one such work at a time.

        Args:
            name: What is done.
            work: Called with ``progress(stage, done, total)``.
            alone: The bars of the effects wait for it; not for a fit, which needs what they are made of.

        Returns:
            What ``work`` returns.

        Raises:
            Stopped: It was stopped by :meth:`stop`.
            InputError: Other work is going on, or as ``work``.
        """
        if self.job is not None:
            raise InputError(f"{self.job.name} is still going on; wait for it or stop it")
        self._stop_job.clear()
        self.job = Job(name, alone=alone)

        def progress(stage: str, done: int, total: int) -> None:
            if self._stop_job.is_set():
                raise Stopped
            self.job = Job(name, stage, done, total, alone)

        try:
            progress("preparing", 0, 0)
            return work(progress)
        finally:
            self.job = None

    def stop(self) -> None:
        """Stop the work that :meth:`run` does, at its next step."""
        self._stop_job.set()
