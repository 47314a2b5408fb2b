"""``mjsim export``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.compensate import CONTROLS

#: Options that say more of a map of the volume, and their names in messages.
_OF_MAP = {"control": "--control", "ranges": "--range", "step": "--step", "rotary": "--rotary", "tool": "--tool-length"}


@click.command("export")
@common.campaign_argument
@common.machine_option
@common.names_option
@common.folder_option("--out", required=True, help="Folder for the CSV files.")
@click.option("--decimal-comma", is_flag=True, help="Semicolons and decimal commas, for spreadsheets that expect them.")
@click.option("--volumetric", is_flag=True, help="Write the error of the tool over the volume instead.")
@click.option(
    "--control",
    type=click.Choice(CONTROLS),
    help="With --volumetric: also with the corrections of this control.",
)
@common.range_option("With --volumetric: places along a linear axis, mm (default: those of the tests).")
@click.option("--step", type=click.FloatRange(0.1, 1000.0), help="With --volumetric: distance of places, mm (25).")
@click.option(
    "--rotary",
    type=(str, common.NUMBER),
    multiple=True,
    metavar="AXIS DEG",
    help="With --volumetric: where a rotary axis stands (0).",
)
@click.option(
    "--tool-length",
    "tool",
    type=click.FloatRange(-1000.0, 1000.0),
    help="With --volumetric: of the tool less that of the spindle ball's holder, mm (0).",
)
@click.option("--force", is_flag=True, help="Replace files that exist.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, names, out, decimal_comma, volumetric, force, threads, as_is, **of_map) -> None:
    """Write the compared traces and their figures as CSV.

    <test>.csv has time_s, phi_deg, measured_um, simulated_um, residual_um and valid (0: missing or left out);
    figures.csv the ISO 230-4 figures of both traces per test, figures-both-directions.csv G(b) and D.
    Of axis logs, <test>-<axis>.csv has command, measured and simulated position, speed and torque.

    With --volumetric it writes volumetric.csv, .vtk and .png: the error of the tool over the volume, as the diagnosis
    knows the machine, with expanded uncertainty (k = 2), and with the corrections of a control.

    \b
    Example: mjsim export examples/hidden-backlash --out tables
             mjsim export my-campaign --volumetric --control csv --out map
    """
    from mjsim.commands.export import export
    from mjsim.errors import InputError

    c, m = common.campaign_and_machine(campaign, machine, as_is=as_is)
    given = [option for name, option in _OF_MAP.items() if of_map[name] not in (None, ())]
    if given and not volumetric:
        raise InputError(f"{given[0]}; allowed: with --volumetric")
    with common.progress_bar() as progress:
        if volumetric:
            if names or decimal_comma:
                raise InputError("--volumetric has no tests and no decimal comma; leave --test and --decimal-comma out")
            data = _map(c, m, Path(out), force, common.cores(threads), progress, **of_map)
        else:
            files = export(c, m, out, names, decimal_comma, force, common.cores(threads), progress)
            data = {"files": [str(f) for f in files]}
    if common.wants_json():
        common.print_json({"campaign": c.name, "machine": m.name, **data})
        return
    if volumetric and not common.is_quiet():
        show_map(data)
    common.say(f"{len(data['files'])} files written to {out}")


def show_map(data: dict) -> None:
    """What a map of the volume says, as text."""
    click.echo(f"Error of the tool, {data['basis']}, {data['places']} places:")
    states = [k for k in ("as_it_is", "corrected") if k in data]
    rows = [[k.replace("_", " "), f"{data[k]['rms_um']:.2f}", f"{data[k]['largest_um']:.2f}"] for k in states]
    common.table(["", "RMS µm", "largest µm"], rows)
    common.paragraph(f"Expanded uncertainty of a component (k = 2): at most {data['largest_U95_um']:.2f} µm.")


def _map(campaign, machine, out, force, threads, progress, control, ranges, step, rotary, tool) -> dict:
    """Write the map of the volume; what is said of it."""
    from mjsim.io.files import check_writable, write_all
    from mjsim.plots.save import encode
    from mjsim.plots.volumetric import volumetric_figure
    from mjsim.prediction.volumetric import STEP, volume_of
    from mjsim.units import DEG, MM, UM

    names = [out / f"volumetric.{kind}" for kind in ("csv", "vtk", "png")]
    for name in names:
        check_writable(name, force)
    spans = {a: (low * MM, high * MM) for a, low, high in ranges}
    places, stand = STEP if step is None else step * MM, {a: x * DEG for a, x in rotary}
    length = 0.0 if tool is None else tool * MM
    found = volume_of(campaign, machine, control, spans, places, stand, length, threads, progress)
    picture = encode(volumetric_figure(found.error, f"{machine.name}: error of the tool over the volume"), "png")
    write_all(
        dict(zip(names, (found.error.csv_text(), found.error.vtk_text(machine.name), picture), strict=True)), force
    )
    parts = {"as_it_is": found.error.sizes(), "corrected": found.error.corrected_sizes()}
    sizes = {k: {"rms_um": v[0] / UM, "largest_um": v[1] / UM} for k, v in parts.items() if v is not None}
    return {
        "basis": found.basis,
        "places": len(found.error.shift),
        **sizes,
        "largest_U95_um": found.error.largest_uncertainty / UM,
        "files": [str(n) for n in names],
    }
