"""``mjsim machine``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common


@click.group("machine")
def command() -> None:
    """The machine: its axes and its model.

    \b
    Example: mjsim machine new --configuration "w-C'bXYZB-t" --tool-length 250 -o my-machine
    """


@command.command("new", short_help="Write machine file and MuJoCo model of any chain of axes.")
@click.option("--configuration", required=True, help="Axes from workpiece to tool, e.g. \"w-C'A'Y'bXZ-t\".")
@click.option(
    "--direction",
    "directions",
    type=(str, float, float, float),
    multiple=True,
    metavar="AXIS X Y Z",
    help="Direction of a tilted rotary axis while all axes are at 0. Repeatable.",
)
@click.option(
    "--offset",
    "offsets",
    type=(str, float, float, float),
    multiple=True,
    metavar="AXIS X Y Z",
    help="Offset of a rotary axis from its nominal place, mm. Repeatable.",
)
@click.option(
    "--sense",
    "senses",
    type=(str, str),
    multiple=True,
    metavar="AXIS iso|opposite",
    help="In which sense a rotary axis counts: as ISO 841 says (default), or the other way. Repeatable.",
)
@click.option("--tool-length", type=float, help="From the pivot of a turning head to the ball, mm (default 250).")
@click.option(
    "-o", "--out", "folder", required=True, type=click.Path(path_type=Path, file_okay=False), help="New folder."
)
@click.option("--name", help="Name of the machine (default: the folder's).")
@common.options
def new(configuration, directions, offsets, senses, tool_length, folder, name, as_json, quiet) -> None:
    """Write machine.toml and a MuJoCo model of a machine with these axes, ready to edit.

    \b
    Example: mjsim machine new --configuration "w-C'B'Y'bXZ-t" --direction B 0 1 1 -o nutating
    """
    from mjsim.campaign.new_machine import new_machine, with_senses
    from mjsim.errors import InputError
    from mjsim.machine.chain import SENSES, Placement, chain_of
    from mjsim.units import MM

    if tool_length is not None and not 0 < tool_length <= 5000:
        raise InputError(f"--tool-length {tool_length:g}; allowed: above 0 to 5000 mm")
    turned, moved = ({a: (x, y, z) for a, x, y, z in given} for given in (directions, offsets))
    sense = dict(senses)
    for axis, word in sense.items():
        if word not in SENSES:
            raise InputError(f"--sense {axis} {word}; allowed: {' or '.join(SENSES)}")
    placements = tuple(
        (a, Placement(turned.get(a), tuple(v * MM for v in moved.get(a, (0.0, 0.0, 0.0))), sense.get(a)))
        for a in sorted({*turned, *moved, *sense})
    )
    length = None if tool_length is None else tool_length * MM
    files = new_machine(folder, configuration, placements, length, name)
    chain = chain_of(configuration, with_senses(configuration, placements), length)
    if as_json:
        common.print_json(
            {"folder": str(folder), "files": [str(f) for f in files], "axes": list(chain.letters)}
            | {"sense": {a: chain.sense(a) for a in chain.rotary}}
            | {"location_errors": [e.name for e in chain.location_errors]}
        )
        return
    if quiet:
        return
    click.echo(f"{folder} has {', '.join(f.name for f in files)}. Next:\n")
    click.echo(f"  (edit {folder}/machine.toml: every number marked CHANGE)")
    if chain.spatial:
        click.echo(f"  python -m mujoco.viewer --mjcf={folder}/scene.xml")
    click.echo(f"  mjsim effects --machine {folder}/machine.toml")
