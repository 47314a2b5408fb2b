"""Work that the user of the workbench waits for: one at a time, with its progress, stoppable."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mjsim.errors import InputError


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
    """Does one work at a time."""

    def __init__(self) -> None:
        self.job: Job | None = None
        self._stop_job = threading.Event()

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
