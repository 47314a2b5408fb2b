"""Options of ``mjsim import``: the test's, the columns' and the angle's."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.cli.nc_options import kept
from mjsim.importing.names import options
from mjsim.instruments.ball_bar.kinds import KINDS, all_keys
from mjsim.machine.chain import CHAINS


def _common(name: str, **more):
    return click.option(options()[name], name, **more)


def _specific():
    """Options for the keys that belong to some kinds of tests only, as the kinds describe them."""
    for name, keys in all_keys().items():
        words = sorted({w for k in keys for chain in CHAINS for w in k.words_of(chain)})  # the campaign checks its own
        kinds = [k.name for k in KINDS.values() if name in (key.name for key in k.keys)]
        value = click.Choice(words) if words else common.NUMBER if keys[0].unit is not None else int
        yield click.option(
            keys[0].flag, name, type=value, help=f"{', '.join(kinds)}: {keys[0].help[:1].lower()}{keys[0].help[1:]}"
        )


test = kept(
    click.option(
        "--test", "name", shell_complete=common.test_names, help="Its test in campaign.toml (default: the file's name)."
    ),
    _common("kind", type=click.Choice(sorted(KINDS)), help="For a new test, as all below down to --spindle."),
    *_specific(),
    _common(
        "table_ball_mm",
        nargs=3,
        type=common.NUMBER,
        metavar="X Y Z",
        default=None,
        help="Table ball, mm from the origin of the work frame.",
    ),
    _common("bar_length_mm", type=common.NUMBER, help="Length of the bar, mm."),
    _common("feed_mm_min", type=common.NUMBER, help="Feed on the circle, mm/min."),
    _common("setup", help="Word that tests of one set-up share."),
    _common("started_s", type=common.NUMBER, help="Start on the campaign's clock, s."),
    _common("spindle_deg", type=common.NUMBER, help="Angle at which the spindle is held, ° (default 0)."),
)
columns = kept(
    click.option("--time", metavar="COLUMN", help="Column of the time: name or number from 1."),
    click.option("--angle", metavar="COLUMN", help="Column of the angle, in place of a time."),
    click.option("--rate", type=common.NUMBER, metavar="HZ", help="Samples per second, where there is neither."),
    click.option("--deviation", metavar="COLUMN", help="Column of the deviation."),
    click.option("--time-unit", type=click.Choice(["s", "ms", "us"])),
    click.option("--angle-unit", type=click.Choice(["deg", "rad"])),
    click.option("--deviation-unit", type=click.Choice(["um", "mm", "inch", "mil", "uin", "V"])),
    click.option(
        "--scale", "um_per_volt", type=common.NUMBER, metavar="UM", help="µm per volt, with --deviation-unit V."
    ),
    click.option(
        "--sign",
        type=click.Choice(["outward", "inward"]),
        default="outward",
        help="What is positive (default: outward).",
    ),
    click.option("--absolute/--relative", "absolute", default=None, help="Lengths of the bar, or deviations."),
    click.option(
        "--clock", type=click.Choice(["program", "trace"]), help="Time counts from the program's start, or the trace's."
    ),
    click.option("--separator", type=click.Choice(["semicolon", "tab", "comma", "space"])),
    click.option("--decimal", type=click.Choice(["point", "comma"])),
    click.option(
        "--rows", nargs=2, type=int, metavar="FIRST LAST", default=None, help="Only these lines: one run of several."
    ),
)
angles = kept(
    click.option(
        "--angle-zero", type=common.NUMBER, default=0.0, metavar="DEG", help="The file's angle at φ = 0 (default 0)."
    ),
    click.option("--angle-sense", type=click.Choice(["ccw", "cw"]), help="Which way the file's angle counts."),
    click.option("--start-angle", type=common.NUMBER, metavar="DEG", help="φ of the first sample, where it is not 0."),
)


def read(given: dict):
    """Test name, keys of its table, and reading options from the command line's values."""
    from mjsim.importing.reading import Options
    from mjsim.units import DEG

    name = given.pop("name")
    keys = {k: given.pop(k) for k in options() if k in given}
    keys = {k: list(v) if isinstance(v, tuple) else v for k, v in keys.items() if v is not None}
    inward = given.pop("sign") == "inward"
    zero, start = given.pop("angle_zero") * DEG, given.pop("start_angle")
    return (
        name,
        keys,
        Options(**given, inward=inward, angle_zero=zero, start_angle=None if start is None else start * DEG),
    )
