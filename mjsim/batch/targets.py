"""From a dotted name in a sweep file to the number that it varies."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError

from mjsim.batch.recipe import DRIVE_UNITS, Target
from mjsim.campaign.driven import driven
from mjsim.campaign.schema import DriveTable
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.files import test_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.tables import ball_bar_table
from mjsim.io.toml import check
from mjsim.machine.chain import Chain
from mjsim.machine.model import Machine

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


def target_of(place: str, name: str, machine: Machine) -> Target:
    """The target of a dotted name.

    Raises:
        InputError: there is no such number; the message says what there is.
    """
    if name in TEST_VALUES:
        return Target(name, "test", "", name, *TEST_VALUES[name])
    owner, _, key = name.rpartition(".")
    if name.startswith("drive."):
        axis = owner.removeprefix("drive.")
        if axis not in machine.chain.letters or key not in DRIVE_UNITS:
            axes = ", ".join(machine.chain.letters)
            raise InputError(f"{place}: parameter = {name!r}; allowed: drive.<{axes}>.<{', '.join(DRIVE_UNITS)}>")
        return Target(
            name,
            "drive",
            axis,
            key,
            DRIVE_UNITS[key],
            f"{key.split('_per_')[0]} of the {axis} drive, see the campaign format",
        )
    if "." not in owner:
        kinds = list(registry.kinds_of(machine.effects))
        near = difflib.get_close_matches(name, [*TEST_VALUES, *(f"{k}." for k in kinds)], n=1)
        hint = f" (did you mean {near[0]!r}?)" if near and near[0] in TEST_VALUES else ""
        raise InputError(
            f"{place}: parameter = {name!r}{hint}; allowed: an effect's parameter such as backlash.A.width_deg, "
            f"a drive's such as drive.X.position_gain_per_s, or {', '.join(TEST_VALUES)}"
        )
    return _effect_target(place, name, owner, key, machine)


def _effect_target(place: str, name: str, owner: str, key: str, machine: Machine) -> Target:
    present = machine.effect(owner)
    try:
        cls, subject = (
            (type(present), present.subject) if present is not None else registry.effect_class(owner, machine.chain)
        )
    except InputError as error:
        raise InputError(f"{place}: parameter = {name!r}: {error}") from None
    parameters = {p.name: p for p in cls.parameters_of(subject)}
    numbers = [n for n, p in parameters.items() if p.kind == "number"]
    if key not in numbers:
        what = f"{key} of {owner} is no number" if key in parameters else f"{owner} has no parameter {key!r}"
        raise InputError(
            f"{place}: parameter = {name!r}: {what}; allowed: {', '.join(numbers) or 'none of this effect'}"
        )
    p = parameters[key]
    return Target(
        name, "effect", present.key if present is not None else owner, key, p.unit, f"{cls.title}: {p.meaning}"
    )


def check_drive_value(place: str, target: Target, value: float) -> None:
    """Refuse a drive's number that machine.toml would refuse.

    Raises:
        InputError: names it and what is allowed.
    """
    field = DriveTable.model_fields[target.key]
    bounds = TypeAdapter(_annotated(field))
    try:
        bounds.validate_python(value)
    except ValidationError as error:
        raise InputError(
            f"{place}: {value:g}; {error.errors()[0]['msg'].replace('Input should be', 'allowed:')}"
        ) from None


def _annotated(field: Any) -> Any:
    return Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation


def varied_test(file: Path, place: str, table: dict, changes: dict[str, float], chain: Chain) -> BallBarTest:
    """The test of a ``[[test]]`` table of ``file`` with some of :data:`TEST_VALUES` changed.

    Args:
        place: of the sweep, for messages. changes: name -> value. chain: axes of the machine.

    Raises:
        InputError: the test does not have such a value, or would not be possible with it.
    """
    table = {k: v for k, v in table.items() if k != "trace"}
    for name, value in changes.items():
        key, _, coordinate = name.partition(".")
        if "program" in table:
            raise InputError(
                f'{place}: {name} cannot be varied: test "{table["name"]}" is driven by the NC program '
                f"{table['program']}"
            )
        if coordinate:
            table[key] = [value if a == coordinate else x for a, x in zip("xyz", table[key], strict=True)]
        else:
            table[key] = value
    try:
        checked = check(file, ball_bar_table(chain), table)
        return driven(file, test_of(file, checked, chain), checked)
    except InputError as error:
        if not changes:
            raise
        what = ", ".join(f"{n} = {v:g}" for n, v in changes.items())
        raise InputError(f"{place}: with {what}: {str(error).removeprefix(f'{file}: ')}") from None
