"""``mjsim identify``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.compare import show_sheet
from mjsim.cli.diagnose import show_axes, show_effect
from mjsim.digits import estimate, expanded
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.axis import TURNING


@click.group("identify")
def command() -> None:
    """Numbers of one effect, from the tests that were made for it."""


@command.command("pitch-error")
@common.campaign_argument
@click.option("--axis", type=click.Choice(TURNING), help="Rotary axis (default: every one that has tangential tests).")
@common.machine_option
@click.option("--per-direction", is_flag=True, help="Keep CW and CCW apart even where they agree.")
@common.file_option("--write", help="Save the machine with the pitch errors put in.")
@common.folder_option("--out", help="Folder for plots (default: .mjsim/identify in the campaign).")
@click.option("--no-plots", is_flag=True, help="Numbers only.")
@click.option("--force", is_flag=True, help="Replace the file named by --write and plots in the folder named by --out.")
@common.as_is_option
@common.threads_option
@common.options
def pitch_error(campaign, axis, machine, per_direction, write, out, no_plots, force, threads, as_is) -> None:
    """Pitch errors of the rotary axes of CAMPAIGN: orders, amplitudes and phases per direction, from tangential tests.

    Without such tests, from axis logs that recorded the load side of an axis as well: a second encoder, or a guide log
    of a telescope mount.

    \b
    Example: mjsim identify pitch-error examples/kato2013 --axis C
    """
    from mjsim.campaign.machine_file import write_machine
    from mjsim.inference.pitch.encoders import axes_with_two_encoders
    from mjsim.inference.pitch.identify import (
        identified_machine,
        identify_pitch_errors,
        tangential_tests,
        testable_axes,
    )
    from mjsim.io.files import check_writable
    from mjsim.plots.output import pitch_plot_files, pitch_plots

    whole, m = common.campaign_and_machine(campaign, machine, as_is=as_is)
    logged = axes_with_two_encoders(whole.of(LogTest.instrument))
    if logged and not any(tangential_tests(whole, a) for a in ((axis,) if axis else logged)):
        _from_encoders(whole, m, (axis,) if axis else logged, write, force)
        return
    c = whole.of(BallBarTest.instrument)
    axes = (axis,) if axis else testable_axes(c)
    folder = out or c.state_folder / "identify"
    if write is not None:
        check_writable(write, force)
    if not no_plots:
        for file in pitch_plot_files(axes, folder):
            check_writable(file, force or out is None)
    with common.progress_bar() as progress:
        results = identify_pitch_errors(c, m, axes, per_direction, common.cores(threads), progress)
        plots = [] if no_plots else pitch_plots(c.name, results, folder)
    if write is not None:
        write_machine(identified_machine(m, results), m.file, write, force=force)
    data = {
        "campaign": c.name,
        "axes": {a: r.to_json() for a, r in results.items()},
        "effects": [{"id": e.id, **e.values} for r in results.values() for e in r.effects],
        "plots": [str(p) for p in plots],
    }
    if common.answered(data):
        return
    for i, (a, result) in enumerate(data["axes"].items()):
        if i:
            click.echo()
        show(a, result)
    if plots:
        common.say(f"plots in {folder}")
    if write is not None:
        common.say(f"machine with the pitch errors written to {write}")


def _from_encoders(campaign, machine, axes, write: Path | None, force: bool) -> None:
    """Pitch errors from the two encoders of each axis: printed, and written into a machine file."""
    from mjsim.campaign.machine_file import write_machine
    from mjsim.inference.pitch.encoders import identify_from_encoders, machine_with_waves
    from mjsim.io.files import check_writable

    if write is not None:
        check_writable(write, force)
    with common.progress_bar() as progress:
        found = {}
        for i, axis in enumerate(axes):
            progress(f"looking for waves of {axis}", i, len(axes))
            found[axis] = identify_from_encoders(campaign.of(LogTest.instrument), axis)
    if write is not None:
        write_machine(machine_with_waves(machine, found), machine.file, write, force=force)
    if common.answered({"campaign": campaign.name, "axes": {a: r.to_json() for a, r in found.items()}}):
        return
    for data in (r.to_json() for r in found.values()):
        show_encoders(data)
    if write is not None:
        common.say(f"machine with the pitch errors written to {write}")


def show_encoders(data: dict) -> None:
    """One axis' waves between its two encoders as text."""
    rate, worm = data["rate_deg_per_s"], data["worm"]
    click.echo(f"{data['axis']}, load side less motor: {', '.join(data['tests'])}")
    common.paragraph(
        f"arc {data['arc_deg']:.4g}°: waves of fewer than four turns in it are taken for drift; RMS "
        f"{1e3 * data['rms_deg']['raw']:.4g}, {1e3 * data['rms_deg']['residual']:.4g} without the waves (10⁻³ °)",
        "  ",
    )
    rows = [
        [
            f"{w['order']:.2f}",
            f"±{1.96 * w['order_sd']:.2f}",
            f"{360.0 / w['order'] / rate:.2f}" if rate else "–",
            f"{1e3 * w['amplitude_deg']:.4g}",
            f"±{1.96e3 * w['amplitude_sd_deg']:.2g}",
            f"{3600 * w['amplitude_deg']:.3g}",
            f"{w['phase_deg']:.0f}",
            f"{w['turns']:.1f}",
        ]
        for w in data["components"]
    ]
    if not rows:
        common.paragraph("no wave stands out of the noise", "  ")
        return
    common.table(["order", "95 %", "period s", "10⁻³ °", "95 %", "″", "phase °", "turns"], rows, text=())
    half = 1.96 * worm["sd"]
    harmonics = [h for h in worm["harmonics"] if h > 1]
    more = f"; found with its multiple{'s' if len(harmonics) > 1 else ''} {', '.join(map(str, harmonics))}"
    period = f", one wave in {worm['period_s']:.2f} s" if worm["period_s"] else ""
    common.paragraph(
        f"lowest order {worm['order']:.2f} ± {half:.2f} (95 %){period}{more if harmonics else ''}. Of a worm gear, "
        f"it is the number of teeth of the wheel."
    )


@command.command("drive")
@common.campaign_argument
@common.machine_option
@common.file_option("--write", help="Save the machine with the numbers found.")
@click.option(
    "--max-effects", type=click.IntRange(0, 20), default=8, show_default=True, help="At most so many causes per axis."
)
@common.test_option
@click.option("--force", is_flag=True, help="Replace the file named by --write.")
@common.threads_option
@common.options
def drive(campaign, machine, write, max_effects, only, force, threads) -> None:
    """Numbers of the drives from the axis logs of CAMPAIGN: gains, inertia, friction, each with its interval.

    A table [identify] in the machine file says how far the data sheet is believed. Numbers that the logs cannot
    separate are listed, with the motion that separates them.

    \b
    Example: mjsim identify drive my-table --write identified.toml
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of, write_machine
    from mjsim.commands.axis_log.diagnose import diagnose_logs
    from mjsim.errors import InputError
    from mjsim.io.files import check_writable

    c = read_campaign(campaign).only(only).of(LogTest.instrument)
    if not c.measured:
        raise InputError(f"{c.folder / 'campaign.toml'}: no test of the kind log has a trace; drives need axis logs")
    m = machine_of(c, machine)
    if write is not None:
        check_writable(write, force)
    with common.progress_bar() as progress:
        result = diagnose_logs(c, m, max_effects, common.cores(threads), progress)
    if write is not None:
        write_machine(result.machine, m.file, write, force=force)
    data = result.to_json()
    if not common.answered(data):
        show_sheet(data)
        for effect in data["effects"]:
            show_effect(effect)
        click.echo()
        show_axes(data["tests"], "with all of them")
        if write is not None:
            common.say(f"machine with the numbers found written to {write}")


def show(axis: str, data: dict) -> None:
    """One axis' JSON as text."""
    for way, d in data["directions"].items():
        click.echo(f"{axis} {way}: {', '.join(d['tests'])}")
        common.paragraph(
            f"arc {d['arc_deg']:.0f}°: orders closer than {d['resolution_per_rev']:.2g} per revolution cannot be "
            f"told apart; noise makes "
            f"{1e3 * d['noise_floor_deg']:.2g}, a component needs {1e3 * d['detection_limit_deg']:.2g} (10⁻³ °)",
            "  ",
        )
        for f in d["local_faults"]:
            common.paragraph(
                f"local fault taken out: {1e3 * f['height_deg']:+.2f}·10⁻³ ° at {f['centre_deg']:.1f}°, width "
                f"{f['width_deg']:.2g}°",
                "  ",
            )
        if d["components"]:
            _table(d)
            rms = d["rms_deg"]
            common.paragraph(
                f"RMS (10⁻³ °): raw {1e3 * rms['raw']:.3f}, modified {1e3 * rms['modified']:.3f}, left "
                f"{1e3 * rms['residual']:.3f}, "
                f"{1e3 * rms['residual_away_from_reversals']:.3f} where no linear axis turns back",
                "  ",
            )
        else:
            click.echo("  no component stands out of the noise")
        if d["advice"]:
            common.paragraph(f"phase limited by the trigger: {d['advice']}", "  ")
        click.echo()
    if data["directions_agree"]:
        common.paragraph("CW and CCW agree within their uncertainty: one effect for both directions")
    for note in data["notes"]:
        common.paragraph(note)
    common.paragraph(f"noise {data['noise_um']:.3f} µm ({data['noise_source']})")


def _table(d: dict) -> None:
    rows = []
    for c, a in zip(d["components"], d["alternating"], strict=True):
        amplitude, phase = [1e3 * x for x in c["ci95"]["amplitude_deg"]], c["ci95"]["phase_deg"]
        order = f"{c['order']:g}" if c["order_known"] else f"{c['order']:.2f}"
        mark = (
            "with " + ", ".join(f"{n:g}" for n in c["not_separable_from"])
            if not c["separable"]
            else "teeth"
            if c["multiple_of_teeth"]
            else ""
        )
        rows.append(
            [
                order,
                estimate(1e3 * c["amplitude_deg"], amplitude),
                expanded(amplitude),
                estimate(c["phase_deg"], phase),
                expanded(phase),
                f"{1e3 * a['amplitude_deg']:.3f}",
                f"{a['phase_deg']:.1f}",
                mark,
            ]
        )
    common.table(["order", "10⁻³ °", "95 %", "phase °", "95 %", "altern. 10⁻³ °", "phase °", ""], rows, text=(7,))
