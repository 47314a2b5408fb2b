"""Options that the subcommands of ``mjsim nc`` share."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.machine.axis import AXES, TURNING
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.nc.dialects import DIALECTS, READABLE

AXIS = click.Choice(AXES)
ROTARY_AXIS = click.Choice(TURNING)


def kept(*decorators):
    """Several decorators as one, in the order in which ``--help`` shows them."""

    def add(function):
        for d in reversed(decorators):
            function = d(function)
        return function

    return add


_ROLLOVER = "C within 0 to 360°, the short way round."
_turned = click.option(
    "--reversed",
    "turned",
    type=ROTARY_AXIS,
    multiple=True,
    help="Axis whose command has the other sign (repeatable).",
)
#: How an NC file is read.
reading = kept(
    click.option(
        "--dialect",
        type=click.Choice(tuple(READABLE)),
        help="Whose program an NC file is. Default: as its ending and its words say, and otherwise fanuc.",
    ),
    _turned,
    click.option("--rollover/--no-rollover", default=None, help=f"{_ROLLOVER} Default: what the feed moves imply."),
    click.option("--skip", is_flag=True, help="Leave out blocks with /."),
    common.path_option("--ini", help="Configuration of LinuxCNC with subprograms and tools."),
)
#: How a sphere is probed.
probing = kept(
    click.option("--sphere", type=common.NUMBER, help="Diameter of a sphere that is probed, mm."),
    click.option("--tip", type=common.NUMBER, help="Diameter of the probe's tip, mm."),
    click.option("--clearance", type=common.NUMBER, default=3.0, show_default=True, help="Way of a touch, mm."),
    click.option(
        "--safe",
        type=common.NUMBER,
        default=100.0,
        show_default=True,
        help="Height above the sphere at which rotary axes move, mm.",
    ),
)
written_dialect = click.option(
    "--dialect", type=click.Choice(tuple(DIALECTS)), default="fanuc", show_default=True, help="Control."
)
writing = kept(
    click.option(
        "--feed-mode",
        type=click.Choice(["a11", "inverse", "tcp"]),
        help="Meaning of F (default: a11; linuxcnc: inverse).",
    ),
    click.option("--step-deg", type=common.NUMBER, default=0.1, show_default=True, help="Angle φ from block to block."),
    click.option("--decimals", type=int, help="Decimals of the positions (default: the dialect's)."),
    click.option("--feed-decimals", type=int, help="Decimals of F (default: the dialect's)."),
)
signs = kept(_turned, click.option("--rollover", is_flag=True, help=_ROLLOVER))
limits = kept(
    click.option(
        "--limit",
        type=(AXIS, common.NUMBER, common.NUMBER),
        multiple=True,
        metavar="AXIS LOW HIGH",
        help="Travel in mm or ° (default: the model's).",
    ),
    click.option(
        "--max-speed",
        type=(AXIS, common.NUMBER),
        multiple=True,
        metavar="AXIS V",
        help="Warn above V mm/min or °/min (repeatable).",
    ),
)
acceleration = click.option(
    "--acceleration",
    type=(AXIS, common.NUMBER),
    multiple=True,
    metavar="AXIS VALUE",
    help="MAX_ACCELERATION of LinuxCNC, mm/s² or °/s² (default 20000).",
)
force = click.option("--force", is_flag=True, help="Replace files that exist.")


def write_options(dialect, feed_mode, step_deg, decimals, feed_decimals, turned=(), rollover=False, number=1):
    """The options ``writing`` and ``signs`` as the writer takes them."""
    from mjsim.nc.write import Options

    return Options(dialect, feed_mode or "", step_deg, decimals, feed_decimals, tuple(turned), rollover, number)


def how_read(dialect, turned, rollover, skip, ini) -> dict:
    """The options ``reading`` as the reader takes them."""
    return {"dialect": dialect, "reversed": tuple(turned), "rollover": rollover, "skip": skip, "ini": ini}


def allowed(limit, max_speed, chain: Chain = FIVE_AXIS):
    """The model's limits with the changes of ``limits``.

    Raises:
        InputError: the machine has no such axis.
    """
    from mjsim.errors import InputError
    from mjsim.nc.limits import model_limits

    strange = [a for a in (*(a for a, _, _ in limit), *(a for a, _ in max_speed)) if a not in chain.letters]
    if strange:
        raise InputError(f"limit of {strange[0]}: the machine has no such axis; allowed: {', '.join(chain.letters)}")
    return model_limits(chain).changed({a: (low, high) for a, low, high in limit}, dict(max_speed))


def find_test(campaign: Path, name: str, *more: str):
    """The campaign and its test of that name: a reading along a motion, or a test of one of ``more`` instruments. The
    readings of one recording have one program, whichever is named.
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.errors import InputError
    from mjsim.instruments.base import INSTRUMENTS

    c = read_campaign(campaign, traces=False).of(*(n for n, i in INSTRUMENTS.items() if i.in_motion), *more)
    for t in c.tests:
        if name in (t.name, recording_of(t)):
            return c, t
    names = dict.fromkeys(map(recording_of, c.tests))
    raise InputError(f"{c.folder / 'campaign.toml'}: no test {name!r}; it has: {', '.join(names)}")


def recording_of(test) -> str:
    """Name of a test in campaign.toml: of the recording where it is one reading of several."""
    return getattr(test, "recording", test.name)
