"""``mjsim predict``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common


@click.command("predict")
@click.argument("program")
@click.option("--campaign", type=click.Path(path_type=Path), help="Campaign whose diagnosis says how the machine is.")
@common.machine_option
@click.option("--tolerance", type=common.NUMBER, help="Allowed deviation normal to the path, µm: gives a verdict.")
@click.option("--tool", type=common.NUMBER, default=0.0, help="Tool's length less that of the ball's holder, mm.")
@click.option(
    "--zero",
    type=(common.NUMBER, common.NUMBER, common.NUMBER),
    default=(0.0, 0.0, 0.0),
    metavar="X Y Z",
    help="Zero point of the part, mm from where the rotary centrelines meet.",
)
@click.option("--feed", type=common.NUMBER, default=1000.0, show_default=True, help="Of a built-in part, mm/min.")
@click.option(
    "--dialect",
    type=click.Choice(("fanuc", "siemens", "linuxcnc")),
    default="fanuc",
    show_default=True,
    help="Of an NC file.",
)
@click.option("-o", "--out", type=click.Path(path_type=Path, dir_okay=False), help="Picture (.png or .svg).")
@click.option("--csv", "table", type=click.Path(path_type=Path, dir_okay=False), help="Deviation along the path.")
@click.option("--force", is_flag=True, help="Replace files that are there.")
@common.threads_option
@common.options
def command(
    program, campaign, machine, tolerance, tool, zero, feed, dialect, out, table, force, threads, as_json, quiet
) -> None:
    """Predict the error that a part will have: deviation of the tool's tip from the programmed path of PROGRAM.

    PROGRAM is an NC file, or a built-in part: cone, s-shape, sphere, boss, pocket. The machine is that of a diagnosed
    campaign, or a machine file. Cutting forces are not included.

    \b
    Example: mjsim predict cone --campaign examples/hidden-backlash
             --tolerance 20 -o cone.png
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.errors import InputError
    from mjsim.io.files import check_writable, write_whole
    from mjsim.plots.part import part_figure
    from mjsim.plots.save import encoded
    from mjsim.prediction.predict import predict
    from mjsim.prediction.program import program_of
    from mjsim.units import MM, UM
    from mjsim.workflow.diagnose import diagnose
    from mjsim.workflow.edit import machine_of
    from mjsim.workflow.saved import keep, read_saved

    if campaign is None and machine is None:
        raise InputError("which machine? give --campaign FOLDER, or --machine FILE")
    if tolerance is not None and tolerance <= 0:
        raise InputError(f"--tolerance {tolerance:g}; allowed: above 0 µm")
    if feed <= 0:
        raise InputError(f"--feed {feed:g}; allowed: above 0 mm/min")
    for file in (out, table):
        if file is not None:
            check_writable(file, force)
    saved = None
    if campaign is not None:
        c = read_campaign(campaign)
        m = machine_of(c, machine)
        saved = read_saved(c, m)
        if saved is None:
            with common.progress_bar(quiet) as progress:
                saved = keep(diagnose(c, m, threads=common.cores(threads), progress=progress), m)
    else:
        m = read_machine(machine)
    place = (zero[0] * MM, zero[1] * MM, zero[2] * MM)
    name, motion, lines = program_of(program, m.chain, place, feed * MM / 60.0, dialect)
    result = predict(motion, m, name, saved, None if tolerance is None else tolerance * UM, tool * MM, place, lines)
    if out is not None:
        write_whole(out, encoded(part_figure(result), out), force)
    if table is not None:
        write_whole(table, result.to_csv(), force)
    data = result.to_json()
    if as_json:
        common.print_json(data)
    elif not quiet:
        show(data)


def show(data: dict) -> None:
    """A prediction as text."""
    low, high = data["largest_ci95_um"]
    common.paragraph(
        f"{data['program']} on {data['machine']}: largest deviation normal to the path {data['largest_um']:.2f} µm "
        f"(95 %: {low:.2f} to {high:.2f} µm) at line {data['worst_line']}, RMS {data['rms_um']:.2f} µm; the tip is up "
        f"to {data['lag_um']:.0f} µm behind along the path. The program takes {data['duration_s']:.1f} s."
    )
    common.paragraph(f"The interval follows from {data['basis']}. Cutting forces are not included.")
    if data["verdict"]:
        common.paragraph(f"Allowed {data['tolerance_um']:g} µm: {data['verdict']}. {data['reason'].capitalize()}.")
    rows = [[c["id"], f"{c['rms_um']:.2f}", f"{c['at_worst_um']:+.2f}"] for c in data["causes"][:12]]
    click.echo()
    common.table(["cause", "RMS µm", "at the worst place µm"], rows)
