"""A model that is changed effect by effect: the changes, the ladder and the error."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Any

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.workbench import catalogue
from mjsim.workbench import save as saving
from mjsim.workbench.gains import Gain

# -- the ladder of the workbench ---------------------------------------------------------------------------------------


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


class ChangedModel:
    """A model that is changed effect by effect, with its ladder.

    Args:
        campaign: What was measured.
        machine: The model to begin with.
        text: What the machine file had when it was read.
        threads: Simulations side by side.
    """

    def __init__(self, campaign: Campaign, machine: Machine, text: str, threads: int) -> None:
        self.campaign, self.threads = campaign, threads
        #: What the last diagnosis found; ``None`` before the first.
        self.diagnosis: Any = None
        self._text = text
        self._lock = threading.Lock()
        #: The model that the machine file has.
        self.saved = machine
        self.ladder = Ladder(machine)
        #: 95 % intervals of fitted values, by the effect's key and the parameter's name.
        self.intervals: dict[str, dict] = {}
        #: What each effect could explain, by its id, as far as it is known.
        self.gains: dict[str, Gain] = {}
        #: Whether pitch errors and torque ripples are among them.
        self.gains_complete = False
        self._gains_of: Machine | None = None
        self._values: dict[str, Effect] = {}

    # -- what can be done ----------------------------------------------------------------------------------------------

    @property
    def catalogue(self) -> dict[str, list[catalogue.Entry]]:
        """The effects that can be put in, by axis."""
        return catalogue.by_axis(self.machine)

    @property
    def can_fit(self) -> bool:
        """Whether something was measured that an effect can be fitted to."""
        return True

    @property
    def noise(self) -> float | None:
        """RMS of one sample's noise, m; ``None`` where nothing was measured."""
        return None

    @property
    def gains_are_old(self) -> bool:
        """Whether :attr:`gains` are those of another model than the present one."""
        return self._gains_of is not None and self._gains_of is not self.machine

    # -- the model -----------------------------------------------------------------------------------------------------

    @property
    def machine(self) -> Machine:
        """The present model."""
        return self.ladder.machine

    def effect(self, effect_id: str) -> Effect | None:
        """The present model's effect with this id or key; ``None`` where it has none."""
        return self.machine.effect(effect_id)

    def switch(self, effect_id: str, on: bool = True) -> None:
        """Put an effect into the model or take it out.

        An effect that was in the model before comes back with the values that it had. A new one starts at the linear
        estimate from the residual where that is known, otherwise at its typical size.

        Args:
            effect_id: ``kind.SUBJECT``.
            on: In or out.

        Raises:
            InputError: There is no such effect.
        """
        present = [e for e in self.machine.effects if effect_id in (e.id, e.key)]
        if on == bool(present):
            return
        if not on:
            for e in present:
                self._values[e.id] = e
            self.put(f"− {effect_id}", self.machine.without(effect_id))
            return
        self.put(f"+ {effect_id}", self.machine.with_effect(self.start_of(effect_id)))

    def start_of(self, effect_id: str) -> Effect:
        """An effect that the model lacks, as :meth:`switch` puts it in.

        Raises:
            InputError: There is no such effect.
        """
        gain = self.gains.get(effect_id)
        estimate = gain.effect if gain is not None and gain.significant else None
        return self._values.get(effect_id) or estimate or self._typical(effect_id)

    def _typical(self, effect_id: str) -> Effect:
        return self.saved.effect(effect_id) or catalogue.switched_on(effect_id, self.machine)

    def set(self, effect_id: str, **values: Any) -> None:
        """Change values of an effect; one that the model lacks is put in first.

        Args:
            effect_id: ``kind.SUBJECT``, or its key with a direction.
            **values: Parameters in the units of their names.

        Raises:
            InputError: There is no such effect or parameter, or a value is out of bounds.
        """
        effect = self.effect(effect_id) or self._typical(effect_id)
        changed = effect.replaced(**values)
        if changed.key != effect.key:  # another direction: the effect itself, not a second one
            machine = self.machine.without(effect.key).with_effect(changed)
        else:
            machine = self.machine.with_effect(changed)
        self.intervals.pop(effect.key, None)
        self.put(f"{changed.key}: {catalogue.words(changed)}", machine, (effect.id, *sorted(values)))

    def add(self, effect: Effect) -> None:
        """Put an effect with its values into the model, such as one that a diagnosis found."""
        self.put(f"+ {effect.key}", self.machine.with_effect(effect))

    @property
    def unsaved(self) -> list[saving.Change]:
        """Steps from the machine file to the present model."""
        return saving.changes(self.saved, self.machine)

    def put(self, label: str, machine: Machine, merge: tuple | None = None) -> None:
        """Make another model the present one.

        Args:
            label: What was changed.
            machine: The model.
            merge: Changes with the same key make one rung of the ladder.
        """
        self.ladder.push(label, machine, merge)

    def changed_effects(self) -> list[Effect]:
        """Effects of the present model that the machine file lacks or has with other values."""
        known = {e.key: e.values for e in self.saved.effects}
        return [e for e in self.machine.effects if known.get(e.key) != e.values]

    def need_changed_effects(self) -> list[Effect]:
        """The same, to be fitted together.

        Raises:
            InputError: There is none.
        """
        free = self.changed_effects()
        if not free:
            raise InputError("the model has no effect that the machine file lacks; switch one on first")
        return free

    def undo(self) -> bool:
        """Go back by one model; whether there was one."""
        return self.ladder.undo()

    def redo(self) -> bool:
        """Go forward again by one model; whether there was one."""
        return self.ladder.redo()
