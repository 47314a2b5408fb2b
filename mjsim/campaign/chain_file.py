"""The axes that a machine file describes: ``configuration``, ``[axis.B]``, ``[axis.X]`` and ``tool_length_mm``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mjsim.campaign.schema import AxisTable, PlacementTable
from mjsim.errors import InputError
from mjsim.io.inputs import shown
from mjsim.io.toml import check, parse
from mjsim.machine.axis import TURNING, Vector
from mjsim.machine.chain import FIVE_AXIS, Chain, Placement, chain_of
from mjsim.units import MM


def chain_of_file(path: Path, data: dict) -> Chain:
    """The chain of a machine file.

    Args:
        path: of the file, for messages.
        data: its tables.

    Raises:
        InputError: names the file, the key, what was found and what is allowed.
    """
    configuration = data.get("configuration", FIVE_AXIS.configuration)
    if not isinstance(configuration, str):
        raise InputError(
            f"{path}: configuration = {shown(configuration)}; allowed: a text such as {FIVE_AXIS.configuration!r}"
        )
    given = check(path, PlacementTable, {k: v for k, v in data.items() if k in PlacementTable.model_fields})
    placements, length = placed(given)
    points = functional_points(given)
    for letter, _ in points:
        if letter in TURNING:
            raise InputError(
                f"{path}: [axis.{letter}] functional_point_mm; allowed: direction and offset_mm, as {letter} turns"
            )
    try:
        chain = chain_of(configuration, placements, length, given.singular_pass, points)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if chain.swivelling and length is None:
        raise InputError(
            f"{path}: the key 'tool_length_mm' is missing; allowed: the distance from the pivot of the head, about "
            f"which {' and '.join(a.letter for a in reversed(chain.swivelling))} turns the tool, to the ball, mm"
        )
    if length is not None and not chain.swivelling:
        raise InputError(
            f"{path}: tool_length_mm = {given.tool_length_mm:g}; allowed: no such key, as the head of "
            f"{configuration!r} does not turn"
        )
    return chain


def placed(table: Any) -> tuple[tuple[tuple[str, Placement], ...], float | None]:
    """Placements of the rotary axes, and the tool's length, m, of a machine file's table."""
    placements = tuple(
        (letter, _placement(one))
        for letter, one in sorted(table.axis.items())
        if one.functional_point_mm is None or one.model_fields_set != {"functional_point_mm"}
    )
    return placements, None if table.tool_length_mm is None else table.tool_length_mm * MM


def functional_points(table: Any) -> tuple[tuple[str, Vector], ...]:
    """Functional points of the linear axes of a machine file's table, m."""
    out: list[tuple[str, Vector]] = []
    for letter, one in sorted(table.axis.items()):
        if one.functional_point_mm is not None:
            x, y, z = (v * MM for v in one.functional_point_mm)
            out.append((letter, (x, y, z)))
    return tuple(out)


def _placement(table: AxisTable) -> Placement:
    x, y, z = (v * MM for v in table.offset_mm)
    if table.direction is None:
        return Placement(None, (x, y, z), table.sense)
    a, b, c = table.direction
    return Placement((a, b, c), (x, y, z), table.sense)


def chain_in(folder: Path, machine: object) -> Chain:
    """The chain of the machine file that a table in ``folder`` names; the shipped machine's where it names none or the
    file cannot be read: who reads it whole says why.
    """
    if not isinstance(machine, str) or not machine.isprintable():
        return FIVE_AXIS
    path = folder / machine
    try:
        return chain_of_file(path, parse(path))
    except InputError:
        return FIVE_AXIS
