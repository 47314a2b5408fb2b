"""The text that describes a machine's axes (ISO 10791-6): ``w-C'A'Y'bXZ-t``, or axes alone such as ``XY`` or ``C``."""

from __future__ import annotations

import re
from collections.abc import Mapping

from mjsim.errors import InputError
from mjsim.machine.axis import ABOUT, ALONG, Axis, Placement, axis_of, is_rotary

_EXAMPLE = "w-C'A'Y'bXZ-t"
#: More rotary axes than these cannot be moved from a wanted tool direction alone.
_MOST_ROTARY = 2
_AXIS = f"[{ALONG}{ABOUT}]"
_MACHINE = re.compile(rf"w-((?:{_AXIS}')*)b({_AXIS}*)-t")
_ALONE = re.compile(rf"{_AXIS}{{1,5}}")


def parse(
    configuration: str, placements: Mapping[str, Placement], tool_length: float
) -> tuple[tuple[Axis, ...], tuple[Axis, ...]]:
    """Axes that carry the workpiece, from the workpiece to the bed, and axes that carry the tool, from the bed.

    Args:
        configuration: axes from the workpiece to the tool, those that carry the workpiece marked by '; or axes
            alone, of which the linear ones carry the tool and the others the workpiece.
        placements: rotary axes whose direction, offset or sense is stated, by letter.
        tool_length: from the head's pivot to the spindle ball, m.

    Raises:
        InputError: it is no such text, an axis is there twice, or too many axes turn.
    """
    machine = _MACHINE.fullmatch(configuration)
    if machine:
        work, tool = machine[1].replace("'", ""), machine[2]
    else:
        work = "".join(a for a in configuration if is_rotary(a))
        tool = "".join(a for a in configuration if not is_rotary(a))
    wrong = _wrong(machine is not None, work + tool)
    if wrong:
        raise InputError(
            f"configuration {configuration[:40]!r} is unknown: {wrong}; allowed: each of {', '.join(ALONG)} and up to "
            f"two of {', '.join(ABOUT)} at most once on either side of the bed, those that carry the workpiece with ', "
            f'as in "{_EXAMPLE}", or axes alone, as in "{ALONG[:2]}" or "{ABOUT[-1]}"'
        )
    for letter in placements:
        if letter not in work + tool or not is_rotary(letter):
            turning = ", ".join(a for a in work + tool if is_rotary(a)) or "none, as no axis turns"
            raise InputError(f"axis {letter!r} cannot be placed in {configuration!r}; allowed: {turning}")
    return (
        tuple(axis_of(a, placements.get(a)) for a in work),
        tuple(axis_of(a, placements.get(a), tool_length, on_table=False) for a in tool),
    )


def _wrong(machine: bool, letters: str) -> str:
    """What is wrong with a configuration; empty where nothing is."""
    if not machine and not _ALONE.fullmatch(letters):
        return "it is not of this form"
    twice = sorted({a for a in letters if letters.count(a) > 1})
    if twice:
        return f"{twice[0]} is there twice"
    if machine and all(is_rotary(a) for a in letters):
        return "it has no linear axis"
    turning = [a for a in letters if is_rotary(a)]
    return f"{len(turning)} axes turn" if len(turning) > _MOST_ROTARY else ""
