"""``mjsim control``: a real control runs a test's program, and what it tells the axes is recorded."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli import nc_options as options


@click.group("control")
def command() -> None:
    """Let a real control run the program of a test, and record what it tells the axes.

    \b
    Example: mjsim control linuxcnc examples/healthy \\
                 --test cone15-x50-ccw -o cone.csv
    """


@command.command("linuxcnc", short_help="LinuxCNC, without a machine and without a window.")
@common.campaign_argument
@click.option("--test", "name", required=True, shell_complete=common.test_names, help="Test to run.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The record: an axis log (.csv).",
)
@click.option(
    "--program",
    type=click.Path(path_type=Path),
    help="NC file of the dialect linuxcnc (default: what mjsim writes for the test).",
)
@click.option("--tool-centre", is_flag=True, help="Tool centre point control (xyzac-trt-kins, xyzbc-trt-kins).")
@click.option("--step-deg", type=common.NUMBER, default=0.1, show_default=True, help="Angle φ from block to block.")
@options.acceleration
@click.option(
    "--corrections",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of `mjsim compensate --control linuxcnc`.",
)
@click.option(
    "--speed",
    type=common.NUMBER,
    default=20.0,
    show_default=True,
    help="Times real time (needs a C compiler; without one 1).",
)
@options.force
@common.options
def linuxcnc(
    campaign, name, out, program, tool_centre, step_deg, acceleration, corrections, speed, force, as_json, quiet
) -> None:
    """Have LinuxCNC run the program of a test, and record at 1 kHz what it tells the axes.

    The record is an axis log. `driven_by = "FILE"` in the test's table of campaign.toml makes it the commanded motion
    of the test. The feed over the path is held against the model of `mjsim nc feed --like linuxcnc`. Needs the Debian
    package linuxcnc-uspace. Joints are simulated, nothing moves.

    \b
    Example: mjsim control linuxcnc examples/healthy \\
                 --test cone15-x50-ccw -o cone.csv
    """
    from dataclasses import replace

    from mjsim.io.files import check_writable, write_whole
    from mjsim.linuxcnc.configuration import Settings
    from mjsim.linuxcnc.held import held_against, program_of
    from mjsim.linuxcnc.run import run_program
    from mjsim.nc.write import Options

    test = replace(options.find_test(campaign, name)[1], commanded=None)
    check_writable(out, force)
    settings = Settings(dict(acceleration), speed, corrections)
    how = Options(dialect="linuxcnc", feed="tcp" if tool_centre else "", step_deg=step_deg)
    nc = program_of(test, how, program)
    record = run_program(nc.text, test.chain, settings, nc.motion.tip)
    held = held_against(test, nc.motion, record, settings)
    write_whole(out, record.to_csv(), force)
    data = {"file": str(out), "test": name, "program": str(program) if program else None}
    data |= {"rows": len(record.told), "seconds": round(record.seconds, 2), **held.to_json()}
    if as_json:
        common.print_json(data)
        return
    if quiet:
        return
    common.table(["", "LinuxCNC", "model"], held.rows(), text=(0, 1, 2))
    common.paragraph(
        f"{len(nc.motion.seconds)} blocks, {held.by_f:.3f} s by their F; run in {record.seconds:.1f} s. Joints are "
        f"simulated and follow at once."
    )
    common.say(f"written to {out}", quiet)
