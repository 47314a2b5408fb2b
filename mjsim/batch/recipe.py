"""What a sweep varies, and how a run's machine is made from its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjsim.campaign.machine_file import DRIVE_KEYS
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.estimation.data_sheet import calibrated, sheet_of
from mjsim.machine.effect import Effect
from mjsim.machine.model import FRICTION_PARAMETERS, Machine

#: Unit of a drive's number as it is shown, by key of machine.toml.
DRIVE_UNITS = {
    "position_gain_per_s": "1/s",
    "velocity_gain_Nms_per_rad": "N·m·s/rad",
    "integral_time_s": "s",
    "inertia_kgm2": "kg·m²",
    "viscous_Nms_per_rad": "N·m·s/rad",
    "gravity_Nm": "N·m",
}
_ATTRIBUTES = {key: attribute for attribute, key in DRIVE_KEYS.items()}


@dataclass(frozen=True)
class Target:
    """One number that a sweep varies, in the unit of its name.

    Attributes:
        name: as the sweep file has it, e.g. ``backlash.A.width_deg``; also the column of the results.
        kind: ``effect``, ``drive`` or ``test``. owner: effect key or axis. key: parameter or key inside it.
        unit: as it is shown. meaning: one line.
    """

    name: str
    kind: str
    owner: str
    key: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Recipe:
    """A base machine, and the targets that a run's values belong to (one each, in this order)."""

    base: Machine
    targets: tuple[Target, ...]

    def machine(self, values: Sequence[float] | np.ndarray, sheet: np.ndarray | None = None) -> Machine:
        """The machine of one run.

        Args:
            values: one per target, units of the names; those of tests change no machine.
            sheet: (sheet,) standard deviations by which the data sheet is moved, before the values are put in.

        Raises:
            InputError: a value is out of its bounds, or an effect that the machine does not have needs more than was
                given.
        """
        machine = self.base if sheet is None else calibrated(self.base, sheet)
        effects: dict[str, dict[str, float]] = {}
        for target, value in zip(self.targets, values, strict=True):
            if target.kind == "drive":
                machine = machine.with_drive(target.owner, **{_ATTRIBUTES[target.key]: float(value)})
            elif target.kind == "effect":
                effects.setdefault(target.owner, {})[target.key] = float(value)
        for key, changes in effects.items():
            machine = machine.with_effect(_changed(machine, key, changes))
        return machine


def _changed(machine: Machine, key: str, changes: dict[str, float]) -> Effect:
    present = machine.effect(key)
    return registry.make(key, machine.chain, **changes) if present is None else present.replaced(**changes)


def sheet_columns(machine: Machine) -> list[Target]:
    """The data sheet's numbers that an ensemble draws, as columns: all that ``machine`` has."""
    out = []
    for p in sheet_of(machine):
        if p.name in FRICTION_PARAMETERS:
            friction, key = machine.effect(f"friction.{p.axis}"), FRICTION_PARAMETERS[p.name]
            if friction is not None and not friction.is_neutral:
                unit = next(q.unit for q in friction.parameters if q.name == key)
                out.append(
                    Target(
                        f"{friction.key}.{key}", "effect", friction.key, key, unit, f"data sheet, ± {100 * p.sd:.3g} %"
                    )
                )
        else:
            key = DRIVE_KEYS[p.name]
            out.append(
                Target(
                    f"drive.{p.axis}.{key}", "drive", p.axis, key, DRIVE_UNITS[key], f"data sheet, ± {100 * p.sd:.3g} %"
                )
            )
    return out


def value_of(machine: Machine, target: Target) -> float:
    """The number that a machine has for a target of a drive or an effect.

    Raises:
        InputError: the machine does not have that effect.
    """
    if target.kind == "drive":
        return getattr(machine.drives[target.owner], _ATTRIBUTES[target.key])
    effect = machine.effect(target.owner)
    if effect is None:
        raise InputError(f"the machine has no effect {target.owner!r}")
    return effect.values[target.key]
