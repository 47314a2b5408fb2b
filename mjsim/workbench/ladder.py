"""The ladder of the workbench: every model that was tried, with a way back and forth between them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

from mjsim.machine.model import Machine


@dataclass(frozen=True)
class Rung:
    """One model that was tried.

    Attributes:
        label: What was changed, such as ``+ backlash.A``.
        machine: The model.
        merge: Further changes with the same key replace this rung: a slider on its way makes one rung, not a hundred.
        rms: Residual RMS over all measured tests, m; ``None`` until it is known, and without traces.
        engine: What ``rms`` was simulated with.
    """

    label: str
    machine: Machine
    merge: Hashable = None
    rms: float | None = None
    engine: str = ""


class Ladder:
    """Models in the order in which they were tried, and the one that is present.

    Args:
        machine: The model to begin with.
        label: Its name.
    """

    def __init__(self, machine: Machine, label: str = "machine as given") -> None:
        self.rungs: list[Rung] = [Rung(label, machine)]
        self.place = 0

    @property
    def present(self) -> Rung:
        """The rung one stands on."""
        return self.rungs[self.place]

    @property
    def machine(self) -> Machine:
        """The present model."""
        return self.present.machine

    @property
    def can_undo(self) -> bool:
        """Whether there is a model before the present one."""
        return self.place > 0

    @property
    def can_redo(self) -> bool:
        """Whether a model was undone."""
        return self.place + 1 < len(self.rungs)

    def push(self, label: str, machine: Machine, merge: Hashable = None) -> None:
        """Put a model behind the present one; what was undone is dropped.

        Args:
            label: What was changed.
            machine: The model.
            merge: Key of :class:`Rung`; a rung with the same key, which is present and not the first, is replaced.
        """
        same = merge is not None and self.place > 0 and self.present.merge == merge
        del self.rungs[self.place + (0 if same else 1) :]
        self.rungs.append(Rung(label, machine, merge))
        self.place = len(self.rungs) - 1

    def undo(self) -> bool:
        """Go back by one model; whether there was one."""
        if not self.can_undo:
            return False
        self.place -= 1
        return True

    def redo(self) -> bool:
        """Go forward to the model that was undone last; whether there was one."""
        if not self.can_redo:
            return False
        self.place += 1
        return True

    def go(self, place: int) -> None:
        """Go to the rung with this number.

        Raises:
            IndexError: there is none.
        """
        if not 0 <= place < len(self.rungs):
            raise IndexError(f"the ladder has the rungs 0 to {len(self.rungs) - 1}, not {place}")
        self.place = place

    def note(self, machine: Machine, rms: float, engine: str) -> None:
        """Write the error of a model to its rungs.

        Args:
            machine: The model.
            rms: Residual RMS over all measured tests, m.
            engine: What it was simulated with.
        """
        for i, rung in enumerate(self.rungs):
            if rung.machine is machine:
                self.rungs[i] = replace(rung, rms=rms, engine=engine)
