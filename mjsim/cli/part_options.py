"""Options that say where a part stands and how its program is read."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.cli.nc_options import how_read, kept, reading

#: Of a program that is predicted.
PART = kept(
    click.option(
        "--tolerance", type=common.NUMBER, help="Allowed deviation of the part normal to the path, µm: gives a verdict."
    ),
    click.option("--tool", type=common.NUMBER, default=0.0, help="Tool's length less that of the ball's holder, mm."),
    click.option(
        "--zero",
        type=(common.NUMBER, common.NUMBER, common.NUMBER),
        default=(0.0, 0.0, 0.0),
        metavar="X Y Z",
        help="Zero point of the part, mm from where the rotary centrelines meet.",
    ),
    click.option("--feed", type=common.NUMBER, default=1000.0, show_default=True, help="Of a built-in part, mm/min."),
    reading,
)


def part_runs(programs: tuple[str, ...], tolerance, tool, zero, feed, **how) -> list:
    """The programs with the values of :data:`PART`.

    Raises:
        InputError: a tolerance or feed that is none.
    """
    from mjsim.errors import InputError
    from mjsim.prediction.part_run import PartRun, Reading
    from mjsim.units import MM, UM

    if tolerance is not None and tolerance <= 0:
        raise InputError(f"--tolerance {tolerance:g}; allowed: above 0 µm")
    if feed <= 0:
        raise InputError(f"--feed {feed:g}; allowed: above 0 mm/min")
    place = (zero[0] * MM, zero[1] * MM, zero[2] * MM)
    allowed = None if tolerance is None else tolerance * UM
    return [PartRun(p, place, tool * MM, feed * MM / 60.0, Reading(**how_read(**how)), allowed) for p in programs]
