"""What a sweep can vary: from a dotted name to the number, and to a machine or a test that has another one."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from mjsim.campaign.driven import driven
from mjsim.campaign.machine_file import DRIVE_KEYS
from mjsim.campaign.schema import DriveTable
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.data_sheet import sheet_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS, instrument_of
from mjsim.io.toml import check
from mjsim.machine.chain import Chain
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
#: What of a test can be varied -> unit and meaning.
TEST_VALUES = {
    "feed_mm_min": ("mm/min", "peripheral feed"),
    "bar_length_mm": ("mm", "length of the bar"),
    "half_apex_deg": ("°", "half apex angle of the cone"),
    "inclination_deg": ("°", "inclination of the cone"),
    "from_deg": ("°", "where the rotary axis begins"),
    "to_deg": ("°", "where the rotary axis ends"),
    **{f"table_ball_mm.{a}": ("mm", f"table ball, {a}") for a in "xyz"},
}
#: Keys of a test that name the file with its motion -> what that is.
DRIVERS = {"program": "NC program", "driven_by": "record"}
_ATTRIBUTES = {key: attribute for attribute, key in DRIVE_KEYS.items()}


@dataclass(frozen=True)
class Target:
    """One number that a sweep varies, in the unit of its name.

    Attributes:
        name: As the sweep file has it, e.g. ``backlash.A.width_deg``; also the column of the results.
        kind: ``effect``, ``drive`` or ``test``.
        owner: Key of the effect, or axis.
        key: Parameter or key inside it.
        unit: As it is shown.
        meaning: One line.
    """

    name: str
    kind: str
    owner: str
    key: str
    unit: str
    meaning: str

    def value_of(self, machine: Machine) -> float:
        """The number that a machine has; of a drive or an effect.

        Raises:
            InputError: The machine does not have that effect.
        """
        if self.kind == "drive":
            return getattr(machine.drives[self.owner], _ATTRIBUTES[self.key])
        effect = machine.effect(self.owner)
        if effect is None:
            raise InputError(f"the machine has no effect {self.owner!r}")
        return effect.values[self.key]


def target_of(place: str, name: str, machine: Machine) -> Target:
    """The target of a dotted name.

    Args:
        place: In the sweep file, for the message.
        name: As written there.
        machine: Of the sweep.

    Raises:
        InputError: There is no such number; the message says what there is.
    """
    if name in TEST_VALUES:
        return Target(name, "test", "", name, *TEST_VALUES[name])
    wrong = f"{place}: parameter = {name!r}"
    owner, _, key = name.rpartition(".")
    if name.startswith("drive."):
        axis = owner.removeprefix("drive.")
        if axis not in machine.chain.letters or key not in DRIVE_UNITS:
            axes = ", ".join(machine.chain.letters)
            raise InputError(f"{wrong}; allowed: drive.<{axes}>.<{', '.join(DRIVE_UNITS)}>")
        meaning = f"{key.split('_per_')[0]} of the {axis} drive, see the campaign format"
        return Target(name, "drive", axis, key, DRIVE_UNITS[key], meaning)
    if "." not in owner:
        kinds = list(registry.kinds_of(machine.effects))
        near = difflib.get_close_matches(name, [*TEST_VALUES, *(f"{k}." for k in kinds)], n=1)
        hint = f" (did you mean {near[0]!r}?)" if near and near[0] in TEST_VALUES else ""
        raise InputError(
            f"{wrong}{hint}; allowed: an effect's parameter such as backlash.A.width_deg, "
            f"a drive's such as drive.X.position_gain_per_s, or {', '.join(TEST_VALUES)}"
        )
    present = machine.effect(owner)
    try:
        cls, subject = (
            (type(present), present.subject) if present is not None else registry.effect_class(owner, machine.chain)
        )
    except InputError as error:
        raise InputError(f"{wrong}: {error}") from None
    parameters = {p.name: p for p in cls.parameters_of(subject)}
    numbers = [n for n, p in parameters.items() if p.kind == "number"]
    if key not in numbers:
        what = f"{key} of {owner} is no number" if key in parameters else f"{owner} has no parameter {key!r}"
        raise InputError(f"{wrong}: {what}; allowed: {', '.join(numbers) or 'none of this effect'}")
    p = parameters[key]
    owner = present.key if present is not None else owner
    return Target(name, "effect", owner, key, p.unit, f"{cls.title}: {p.meaning}")


def sheet_targets(machine: Machine) -> list[Target]:
    """The numbers of the data sheet that an ensemble draws: all that ``machine`` has."""
    out = []
    for p in sheet_of(machine):
        meaning = f"data sheet, ± {100 * p.sd:.3g} %"
        if p.name not in FRICTION_PARAMETERS:
            key = DRIVE_KEYS[p.name]
            out.append(Target(f"drive.{p.axis}.{key}", "drive", p.axis, key, DRIVE_UNITS[key], meaning))
            continue
        friction, key = machine.effect(f"friction.{p.axis}"), FRICTION_PARAMETERS[p.name]
        if friction is not None and not friction.is_neutral:
            unit = next(q.unit for q in friction.parameters if q.name == key)
            out.append(Target(f"{friction.key}.{key}", "effect", friction.key, key, unit, meaning))
    return out


def varied_machine(machine: Machine, targets: Sequence[Target], values: Sequence[float] | np.ndarray) -> Machine:
    """A machine with other numbers.

    Args:
        machine: As it was.
        targets: Which numbers; those of tests change no machine.
        values: One for each target, in the units of the names.

    Raises:
        InputError: A value is out of its bounds, or an effect that the machine does not have needs more than was given.
    """
    effects: dict[str, dict[str, float]] = {}
    for target, value in zip(targets, values, strict=True):
        if target.kind == "drive":
            machine = machine.with_drive(target.owner, **{_ATTRIBUTES[target.key]: float(value)})
        elif target.kind == "effect":
            effects.setdefault(target.owner, {})[target.key] = float(value)
    for key, changes in effects.items():
        present = machine.effect(key)
        changed = registry.make(key, machine.chain, **changes) if present is None else present.replaced(**changes)
        machine = machine.with_effect(changed)
    return machine


def check_drive_value(place: str, target: Target, value: float) -> None:
    """Refuse a drive's number that machine.toml would refuse.

    Raises:
        InputError: Names it and what is allowed.
    """
    try:
        DriveTable.__pydantic_validator__.validate_assignment(DriveTable.model_construct(), target.key, value)
    except ValidationError as error:
        allowed = error.errors()[0]["msg"].replace("Input should be", "allowed:")
        raise InputError(f"{place}: {value:g}; {allowed}") from None


def varied_test(
    file: Path, place: str, table: dict, changes: dict[str, float], chain: Chain, reading: str = ""
) -> BallBarTest:
    """The test of a ``[[test]]`` table with some of :data:`TEST_VALUES` changed.

    Args:
        file: Where the table stands.
        place: Of the sweep, for messages.
        table: The test as it is written.
        changes: Name -> value.
        chain: Axes of the machine.
        reading: Of an R-test the name of one of its coordinates.

    Raises:
        InputError: The test does not have such a value, or would not be possible with it.
    """
    table = {k: v for k, v in table.items() if k != "trace"}
    for name, value in changes.items():
        key, _, coordinate = name.partition(".")
        for driver, what in DRIVERS.items():
            if driver in table:
                raise InputError(
                    f'{place}: {name} cannot be varied: test "{table["name"]}" is driven by the {what} {table[driver]}'
                )
        if coordinate and key not in table:
            raise InputError(f'{place}: {name} cannot be varied: test "{table["name"]}" has no {key}')
        if coordinate:
            table[key] = [value if a == coordinate else x for a, x in zip("xyz", table[key], strict=True)]
        else:
            table[key] = value
    try:
        instrument = instrument_of(table.get("kind")) or INSTRUMENTS[BallBarTest.instrument]
        checked: Any = check(file, instrument.table(chain), table)
        (test,) = (t for t in instrument.tests_of(file, checked, chain) if t.name == (reading or table["name"]))
        return driven(file, test, checked)
    except InputError as error:
        if not changes:
            raise
        what = ", ".join(f"{n} = {v:g}" for n, v in changes.items())
        raise InputError(f"{place}: with {what}: {str(error).removeprefix(f'{file}: ')}") from None
