"""``mjsim control``: a real control runs a test's program, and what it tells the axes is recorded."""

from __future__ import annotations

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
@common.file_option("-o", "--out", required=True, help="The record: an axis log (.csv).")
@common.path_option("--program", help="NC file of the dialect linuxcnc (default: what mjsim writes for the test).")
@click.option("--tool-centre", is_flag=True, help="Tool centre point control (xyzac-trt-kins, xyzbc-trt-kins).")
@click.option("--step-deg", type=common.NUMBER, default=0.1, show_default=True, help="Angle φ from block to block.")
@options.acceleration
@common.folder_option("--corrections", help="Folder of `mjsim compensate --control linuxcnc`.")
@click.option("--drives", is_flag=True, help="Actual positions by the drives of the campaign's machine.")
@common.machine_option
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
    campaign, name, out, program, tool_centre, step_deg, acceleration, corrections, drives, machine, speed, force
) -> None:  # fmt: skip
    """Have LinuxCNC run the program of a test, and record at 1 kHz what it tells the axes.

    The record is an axis log. `driven_by = "FILE"` in the test's table of campaign.toml makes it the commanded motion
    of the test. The feed over the path is held against the model of `mjsim nc feed --like linuxcnc`. Needs the Debian
    package linuxcnc-uspace. Joints are simulated, nothing moves.

    \b
    Example: mjsim control linuxcnc examples/healthy \\
                 --test cone15-x50-ccw -o cone.csv
    """
    from dataclasses import replace

    import numpy as np

    from mjsim.campaign.machine_file import machine_of
    from mjsim.io.files import check_writable, write_whole
    from mjsim.linuxcnc.configuration import CYCLE, Settings
    from mjsim.linuxcnc.record import held_against, program_of
    from mjsim.linuxcnc.run import run_program
    from mjsim.machine.model import build
    from mjsim.nc.write import Options
    from mjsim.simulation.axes import motor_of

    if machine and not drives:
        raise click.UsageError("--machine needs --drives")
    c, test = options.find_test(campaign, name)
    test = replace(test, commanded=None)
    check_writable(out, force)
    settings = Settings(dict(acceleration), speed, corrections)
    how = Options(dialect="linuxcnc", feed="tcp" if tool_centre else "", step_deg=step_deg)
    nc = program_of(test, how, program)
    record = run_program(nc.text, test.chain, settings, bool(np.any(nc.motion.tip)))
    held = held_against(test, nc.motion, record, settings)
    actual = None
    if drives:
        plant = build(machine_of(c, machine))
        time = np.arange(len(record.told)) * CYCLE
        each = [motor_of(plant.axes[a], time, record.told[:, i]) for i, a in enumerate(test.chain.letters)]
        actual = np.column_stack(each)
    write_whole(out, record.to_csv(actual), force)
    data = {"file": str(out), "test": name, "program": str(program) if program else None}
    data |= {"rows": len(record.told), "seconds": round(record.seconds, 2), "drives": drives, **held.to_json()}
    if common.answered(data):
        return
    common.table(["", "LinuxCNC", "model"], held.rows(), text=(0, 1, 2))
    common.paragraph(
        f"{len(nc.motion.seconds)} blocks, {held.by_f:.3f} s by their F; run in {record.seconds:.1f} s. "
        + ("Actual positions are those of the simulated drives." if drives else "Joints follow at once.")
    )
    common.say(f"written to {out}")
