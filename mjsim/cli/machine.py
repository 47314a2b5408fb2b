"""``mjsim machine``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.group("machine")
def command() -> None:
    """The machine: its axes and its model.

    \b
    Example: mjsim machine templates
             mjsim machine new --template trunnion-a-medium -o my-machine
             mjsim machine new --configuration "w-C'bXYZB-t" --tool-length 250 -o my-machine
    """


@command.command("templates", short_help="List the machines that a file can begin with.")
@common.options
def templates() -> None:
    """List the templates of machines: layouts of axes, each in three sizes.

    A template has typical numbers for what nobody knows of a machine, such as inertias. The machine file says that they
    are right within a factor only, and the diagnosis fits them.

    \b
    Example: mjsim machine templates
    """
    from mjsim.campaign.machine_templates import FACTOR, LAYOUTS, SIZES, TEMPLATES

    if common.answered({"templates": [t.to_json() for t in TEMPLATES.values()]}):
        return
    common.table(
        ["layout", "axes", "what it is"], [[x.name, x.configuration, x.words] for x in LAYOUTS], text=(0, 1, 2)
    )
    click.echo()
    rows = []
    for size in SIZES:
        a, b = size.linear, size.rotary
        pairs = ((a.inertia, b.inertia), (a.velocity_gain, b.velocity_gain), (a.coulomb, b.coulomb))
        rows.append([size.name, *(f"{x:g}, {y:g}" for x, y in pairs), size.words])
    heads = ["size", "inertia kg·m²", "Kvp N·m·s/rad", "friction N·m", "what it is"]
    common.table(heads, rows, text=(0, 1, 2, 3, 4))
    click.echo()
    common.paragraph(
        f"Numbers are at the motor: of a linear, and of a rotary axis. All are assumed, and believed within a factor "
        f"of {FACTOR:g}. A template is a layout and a size:"
    )
    click.echo("\n  mjsim machine new --template trunnion-a-medium --position-gain 45 -o my-machine")


@command.command("new", short_help="Write machine file and MuJoCo model of any chain of axes.")
@click.option("--configuration", help="Axes from workpiece to tool, e.g. \"w-C'A'Y'bXZ-t\".")
@click.option("--template", "template_name", help="Layout and size instead, e.g. trunnion-a-medium (see templates).")
@click.option(
    "--position-gain", type=float, help="With --template: position gain of all axes, as set in the control, 1/s."
)
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
@common.folder_option("-o", "--out", "folder", required=True, help="New folder.")
@click.option("--name", help="Name of the machine (default: the folder's).")
@common.options
def new(configuration, template_name, position_gain, directions, offsets, senses, tool_length, folder, name) -> None:
    """Write machine.toml and a MuJoCo model of a machine with these axes, ready to edit.

    With --template the numbers are typical of its size, and believed within a factor only.

    \b
    Example: mjsim machine new --template head-table-b-large --position-gain 33 -o my-machine
             mjsim machine new --configuration "w-C'B'Y'bXZ-t" --direction B 0 1 1 -o nutating
    """
    from mjsim.campaign.machine_templates import template_named
    from mjsim.campaign.new import check_position_gain, new_machine, with_senses
    from mjsim.errors import InputError
    from mjsim.machine.chain import SENSES, Placement, chain_of
    from mjsim.units import MM

    if (configuration is None) == (template_name is None):
        raise click.UsageError("Give either --configuration or --template.")
    template = None if template_name is None else template_named(template_name)
    if template is None and position_gain is not None:
        raise click.UsageError("--position-gain needs --template.")
    check_position_gain(position_gain)
    if tool_length is not None and not 0 < tool_length <= 5000:
        raise InputError(f"--tool-length {tool_length:g}; allowed: above 0 to 5000 mm")
    turned, moved = ({a: (x, y, z) for a, x, y, z in given} for given in (directions, offsets))
    sense = dict(senses)
    for axis, word in sense.items():
        if word not in SENSES:
            raise InputError(f"--sense {axis} {word}; allowed: {' or '.join(SENSES)}")
    placements = {
        a: Placement(turned.get(a), tuple(v * MM for v in moved.get(a, (0.0, 0.0, 0.0))), sense.get(a))
        for a in {*turned, *moved, *sense}
    }
    if template is not None:
        configuration = template.layout.configuration
        placements = dict(template.layout.placements) | placements
    placed = tuple(sorted(placements.items()))
    length = None if tool_length is None else tool_length * MM
    files = new_machine(folder, configuration, placed, length, name, template, position_gain)
    chain = chain_of(configuration, with_senses(configuration, placed), length)
    if common.answered(
        {"folder": str(folder), "files": [str(f) for f in files], "axes": list(chain.letters)}
        | {"sense": {a: chain.sense(a) for a in chain.rotary}}
        | {"location_errors": [e.name for e in chain.location_errors]}
    ):
        return
    click.echo(f"{folder} has {', '.join(f.name for f in files)}. Next:\n")
    click.echo(f"  (edit {folder}/machine.toml: every number marked CHANGE)")
    if chain.spatial:
        click.echo(f"  python -m mujoco.viewer --mjcf={folder}/scene.xml")
    click.echo(f"  mjsim effects --machine {folder}/machine.toml")
