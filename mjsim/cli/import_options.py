"""Options of ``mjsim import``: the test's, the columns' and the angle's."""

from __future__ import annotations

import click

from mjsim.campaign.schema import DIRECTIONS, NEEDED
from mjsim.cli import common
from mjsim.cli.nc_options import kept
from mjsim.importing.names import OPTION


def _key(name: str, **more):
    return click.option(OPTION[name], name, **more)


test = kept(
    click.option("--test", "name", shell_complete=common.test_names, help="Its test in campaign.toml (default: the file's name)."),
    _key("kind", type=click.Choice(sorted(NEEDED)), help="For a new test, as all below down to --started."),
    _key("plane", type=click.Choice(["XY", "YZ", "ZX"]), help="circular: its plane."),
    _key("axis", type=click.Choice(["A", "C"]), help="rotary: the axis."),
    _key("from_deg", type=common.NUMBER, help="rotary: command at the start, °."),
    _key("to_deg", type=common.NUMBER, help="rotary: command at the end, °."),
    _key("half_apex_deg", type=common.NUMBER, help="cone_frustum: half apex angle, °."),
    _key("inclination_deg", type=common.NUMBER, help="cone_frustum: inclination, °."),
    _key("sensitive_direction", type=click.Choice([d for ds in DIRECTIONS.values() for d in ds]), help="How the bar stands."),
    _key("direction", type=click.Choice(["CCW", "CW"]), help="circular, cone_frustum."),
    _key("revolutions", type=int, help="circular, cone_frustum (default 2)."),
    _key("table_ball_mm", nargs=3, type=common.NUMBER, metavar="X Y Z", default=None, help="Table ball, mm from where A and C meet."),
    _key("bar_length_mm", type=common.NUMBER, help="Length of the bar, mm."),
    _key("feed_mm_min", type=common.NUMBER, help="Feed on the circle, mm/min."),
    _key("setup", help="Word that tests of one set-up share."),
    _key("started_s", type=common.NUMBER, help="Start on the campaign's clock, s."),
)
columns = kept(
    click.option("--time", metavar="COLUMN", help="Column of the time: name or number from 1."),
    click.option("--angle", metavar="COLUMN", help="Column of the angle, in place of a time."),
    click.option("--rate", type=common.NUMBER, metavar="HZ", help="Samples per second, where there is neither."),
    click.option("--deviation", metavar="COLUMN", help="Column of the deviation."),
    click.option("--time-unit", type=click.Choice(["s", "ms"])),
    click.option("--angle-unit", type=click.Choice(["deg", "rad"])),
    click.option("--deviation-unit", type=click.Choice(["um", "mm", "inch", "mil", "uin", "V"])),
    click.option("--scale", "um_per_volt", type=common.NUMBER, metavar="UM", help="µm per volt, with --deviation-unit V."),
    click.option("--sign", type=click.Choice(["outward", "inward"]), default="outward", help="What is positive (default: outward)."),
    click.option("--absolute/--relative", "absolute", default=None, help="Lengths of the bar, or deviations."),
    click.option("--clock", type=click.Choice(["program", "trace"]), help="Time counts from the program's start, or the trace's."),
    click.option("--separator", type=click.Choice(["semicolon", "tab", "comma", "space"])),
    click.option("--decimal", type=click.Choice(["point", "comma"])),
    click.option("--rows", nargs=2, type=int, metavar="FIRST LAST", default=None, help="Only these lines: one run of several."),
)
angles = kept(
    click.option("--angle-zero", type=common.NUMBER, default=0.0, metavar="DEG", help="The file's angle at φ = 0 (default 0)."),
    click.option("--angle-sense", type=click.Choice(["ccw", "cw"]), help="Which way the file's angle counts."),
    click.option("--start-angle", type=common.NUMBER, metavar="DEG", help="φ of the first sample, where it is not 0."),
)


def read(given: dict):
    """Test name, keys of its table, and reading options from the command line's values."""
    from mjsim.importing.reading import Options
    from mjsim.units import DEG

    name = given.pop("name")
    keys = {k: given.pop(k) for k in OPTION}
    keys = {k: list(v) if isinstance(v, tuple) else v for k, v in keys.items() if v is not None}
    inward = given.pop("sign") == "inward"
    zero, start = given.pop("angle_zero") * DEG, given.pop("start_angle")
    return name, keys, Options(**given, inward=inward, angle_zero=zero, start_angle=None if start is None else start * DEG)
