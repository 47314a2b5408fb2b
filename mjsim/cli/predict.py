"""``mjsim predict``."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.cli.nc_options import how_read, kept, reading
from mjsim.digits import estimate, interval

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


@click.command("predict")
@click.argument("program")
@common.path_option("--campaign", help="Campaign whose diagnosis says how the machine is.")
@common.machine_option
@PART
@common.file_option("-o", "--out", help="Picture (.png or .svg).")
@common.file_option("--csv", "table", help="Deviation along the path.")
@click.option("--force", is_flag=True, help="Replace files that are there.")
@common.threads_option
@common.options
def command(program, campaign, machine, tolerance, tool, zero, feed, out, table, force, threads, **how) -> None:
    """Predict the error that a part will have: deviation of the tool's tip from the programmed path of PROGRAM.

    PROGRAM is an NC file, or a built-in part: cone, s-shape, sphere, boss, pocket. The machine is that of a diagnosed
    campaign, or a machine file. Cutting forces are not included.

    \b
    Example: mjsim predict cone --campaign examples/hidden-backlash
             --tolerance 20 -o cone.png
    """
    from mjsim.campaign.machine_file import read_machine
    from mjsim.commands.diagnose import diagnose
    from mjsim.commands.saved import keep, read_saved
    from mjsim.errors import InputError
    from mjsim.io.files import check_writable, write_whole
    from mjsim.plots.part import part_figure
    from mjsim.plots.save import encoded

    if campaign is None and machine is None:
        raise InputError("no machine is given; give --campaign FOLDER or --machine FILE")
    (run,) = part_runs((program,), tolerance, tool, zero, feed, **how)
    for file in (out, table):
        if file is not None:
            check_writable(file, force)
    saved = None
    if campaign is not None:
        c, m = common.campaign_and_machine(campaign, machine)
        saved = read_saved(c, m)
        if saved is None:
            c.in_motion.need_traces("what a prediction leaves uncertain follows from ball-bar tests")
            with common.progress_bar() as progress:
                saved = keep(diagnose(c, m, threads=common.cores(threads), progress=progress), m)
    else:
        m = read_machine(machine)
    result = run.on(m, saved)
    if out is not None:
        write_whole(out, encoded(part_figure(result), out), force)
    if table is not None:
        write_whole(table, result.to_csv(), force)
    data = result.to_json()
    if not common.answered(data):
        show(data)


def show(data: dict) -> None:
    """A prediction as text."""
    ends = data["largest_ci95_um"]
    common.paragraph(
        f"{data['program']} on {data['machine']}: largest deviation normal to the path "
        f"{estimate(data['largest_um'], ends)} µm (95 %: {interval(ends)} µm) at line {data['worst_line']}, "
        f"RMS {data['rms_um']:.2f} µm; the tip is up to {data['lag_um']:.0f} µm behind along the path. The program "
        f"takes {data['duration_s']:.1f} s."
    )
    common.paragraph(f"The interval follows from {data['basis']}. Cutting forces are not included.")
    if data["verdict"]:
        reason = data["reason"][:1].upper() + data["reason"][1:]
        common.paragraph(f"Allowed {data['tolerance_um']:g} µm: {data['verdict']}. {reason}.")
        passed, failed, open_ = data["blocks_by_verdict"].values()
        common.paragraph(f"Of {len(data['blocks'])} blocks {passed} pass, {failed} fail, {open_} cannot be decided.")
    for note in data["notes"]:
        common.paragraph(note)
    if len(data["paths"]) > 1:
        rows = [
            [
                f"{c['first_line']} to {c['last_line']}",
                estimate(c["largest_um"], c["largest_ci95_um"]),
                interval(c["largest_ci95_um"]),
                c.get("verdict", "").partition(" with ")[0],
            ]
            for c in data["paths"]
        ]
        click.echo()
        common.table(["path, lines", "largest µm", "95 %", ""], rows, text=(0, 3))
    rows = [[c["id"], f"{c['rms_um']:.2f}", f"{c['at_worst_um']:+z.2f}"] for c in data["by_axis"]]
    click.echo()
    common.table(["axis", "RMS µm", "at the worst place µm"], rows)
    rows = [[c["id"], f"{c['rms_um']:.2f}", f"{c['at_worst_um']:+z.2f}"] for c in data["causes"][:12]]
    click.echo()
    common.table(["cause", "RMS µm", "at the worst place µm"], rows)
