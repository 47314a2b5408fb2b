"""``mjsim compare``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.ballbar.kinds import KINDS
from mjsim.cli import common
from mjsim.cli.import_show import show_features
from mjsim.cli.joint import compare_logs as compare_beside
from mjsim.cli.joint import has_both, show_compared
from mjsim.cli.logs import chosen, is_log_campaign, test_option
from mjsim.cli.logs import compare as compare_logs
from mjsim.units import UM, unit_of


@click.command("compare")
@common.campaign_argument
@common.machine_option
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for plots (default: .mjsim/compare in the campaign).",
)
@click.option(
    "--calibrate",
    "calibrated",
    is_flag=True,
    help="Fit what the machine file has a tolerance for first, and compare that machine.",
)
@test_option
@click.option("--no-plots", is_flag=True, help="Numbers only.")
@click.option("--force", is_flag=True, help="Replace plots in the folder named by --out.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, out, calibrated, only, no_plots, force, threads, as_is, as_json, quiet) -> None:
    """Lay the simulation over the measurement of CAMPAIGN, test by test.

    The ball offsets of every set-up, the bar's length and each trigger are fitted with their priors and shown. The
    machine is taken as it is. With --calibrate, the effects in the [tolerance] table of the machine file are fitted
    first. Nothing else is looked for.

    \b
    Example: mjsim compare examples/hidden-backlash
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.importing.features import circles_of, imported_features
    from mjsim.io.files import check_writable
    from mjsim.plots.logs import log_plot_files
    from mjsim.plots.output import comparison_plots, plot_files
    from mjsim.workflow.calibrate import calibrate
    from mjsim.workflow.compare import compare
    from mjsim.workflow.diagnosis import calibration_json

    c = chosen(read_campaign(campaign, as_is=as_is), only)
    m = machine_of(c, machine)
    if is_log_campaign(c):
        folder = out or c.state_folder / "compare"
        compare_logs(c, m, folder, not no_plots, force or out is None, common.cores(threads), as_json, quiet)
        return
    imported = imported_features(c)
    if not no_plots:
        folder = out or c.state_folder / "compare"
        for file in (*plot_files(c.measured, folder), *(log_plot_files(c, folder) if has_both(c) else ())):
            check_writable(file, force or out is None)
    with common.progress_bar(quiet) as progress:
        fitted = calibrate(c, m, common.cores(threads), progress) if calibrated else None
        result = fitted.after if fitted else compare(c, m, common.cores(threads), progress)
        folder = out or c.state_folder / "compare"
        plots = [] if no_plots else comparison_plots(result, folder, progress)
        logs = compare_beside(c, m, folder, not no_plots, common.cores(threads), progress) if has_both(c) else None
    data, found = result.to_json(), {}
    if logs:
        data, plots = data | {"axis_logs": logs[0]}, [*plots, *logs[1]]
    if fitted:
        data |= {"rms_as_given_um": round(fitted.before.rms / UM, 4)} | calibration_json(
            fitted.calibration, fitted.shares, fitted.combinations
        )
    if imported:
        found = {e.id: e.values for e in m.effects}
        data["imported"] = show_features(imported, found, circles_of(c, data), silent=True)
    if as_json:
        common.print_json({**data, "plots": [str(p) for p in plots]})
        return
    if quiet:
        return
    if fitted:
        common.paragraph(
            f"residual RMS {data['rms_as_given_um']:.3f} µm as given, {data['rms_um']:.3f} µm calibrated within "
            "tolerance"
        )
        common.paragraph(calibration_sentence(data))
        show_combinations(data)
        show_beyond(m, fitted.calibration)
        click.echo()
    show(data)
    show_compared(data)
    for warning in data["warnings"]:
        common.say(f"warning: {warning}", quiet)
    if imported:
        click.echo("\nwhat the other system found:")
        show_features(imported, found, circles_of(c, data))
    if plots:
        common.say(f"plots in {plots[0].parent}", quiet)


def left_out_sentence(rows: list[dict], total: int) -> str:
    """How much of the data was left out, and of which tests.

    Args:
        rows: ``test``, ``samples`` left out, ``of`` how many, ``disturbances`` found, samples at the sensor's stop
            (``saturated``).
        total: samples of all tests.
    """
    out = sum(r["samples"] for r in rows)
    parts = []
    for r in rows:
        knocks = r["disturbances"]
        why = [f"{knocks} knock{'s' if knocks > 1 else ''}"] if knocks else []
        why += [f"{r['saturated']} at the sensor's stop"] if r["saturated"] else []
        share = f"{r['samples']} of {r['of']}"
        parts.append(f"{r['test']} {share}" + (f" ({', '.join(why)})" if why else ""))
    return (
        f"Left out as disturbed or missing: {out} of {total} samples ({100.0 * out / total:.2g} %): {'; '.join(parts)}."
    )


def show_beyond(machine, calibration) -> None:
    """One line for each calibrated number that lies beyond its limit."""
    from mjsim.report.causes import rows_of

    for r in rows_of(machine, calibration):
        if r.beyond:
            common.paragraph(
                f"Beyond its limit: {r.effect_id} {r.name} = {r.value:.4g} {r.unit} [{r.low:.4g}, {r.high:.4g}], "
                f"limit {r.expected:.4g} ± {r.limit:.4g} {r.unit}. `mjsim diagnose` says what else there is."
            )


def percent(share: float) -> str:
    """A share between 0 and 1 in per cent, as finely as one reads it."""
    return "< 0.1 %" if share < 0.001 else f"{100.0 * share:.{1 if share < 0.1 else 0}f} %"


def calibration_sentence(data: dict) -> str:
    """One line on what was fitted within the tolerance of the machine file."""
    rows = data["calibration"]
    seen = sum(row["observable"] for row in rows)
    inside = {row["id"].partition(".")[0] for row in rows}
    share = sum(row["share"] for row in data["shares"] if row["id"].removesuffix(".*") in inside and "*" in row["id"])
    largest = sorted(rows, key=lambda row: -row["rms_um"])[:3]
    names = ", ".join(f"{row['id']} ({row['rms_um']:.2f} µm)" for row in largest)
    return (
        f"Calibrated within tolerance: {len(rows)} effects, {percent(share)} of the error, {seen} of them observable "
        f"with these tests. Largest in the readings: {names}."
    )


def show_combinations(data: dict) -> None:
    """One line for each sum that is determined where its numbers are not."""
    for row in data["combinations"]:
        first, *others = row["terms"]
        text = first["id"] + "".join(
            f" {'-' if t['factor'] < 0 else '+'} {abs(t['factor']):.3g} {t['id']}" for t in others
        )
        unit, (low, high) = unit_of(first["parameter"])[1], row["ci95"]
        units = ", ".join(dict.fromkeys(unit_of(t["parameter"])[1] for t in row["terms"]))
        common.paragraph(
            f"Only this combination is determined: {text} = {row['value']:.3g} {unit} [{low:.3g}, {high:.3g}] "
            f"(numbers in {units})."
        )


def show(data: dict) -> None:
    """Tables of a comparison's JSON."""
    if data["not_measured"]:
        common.paragraph(
            f"Not compared, because campaign.toml names no trace for them: {', '.join(data['not_measured'])}."
        )
    left = [
        {
            "test": t["name"],
            "samples": t["samples_left_out"],
            "of": t["samples"],
            "disturbances": t["outliers"],
            "saturated": 0,
        }
        for t in data["tests"]
        if t["samples_left_out"]
    ]
    if left:
        common.paragraph(left_out_sentence(left, sum(t["samples"] for t in data["tests"])))
    if data["not_measured"] or left:
        click.echo()
    rows = []
    for t in data["tests"]:
        iso = t["iso230_4"]
        g = [f"{iso[k]['circular_error_um']:.2f}" if iso else "–" for k in ("measured", "simulated")]
        angle = t["worst_plot_angle_deg"] if KINDS[t["kind"]].goes_round else t["worst_phi_deg"]
        reverses = t["worst_event"].removeprefix("reversal of ")
        rows.append(
            [
                t["name"],
                f"{t['rms_um']:.3f}",
                f"{t['max_um']:.2f}",
                *g,
                f"{angle:.0f}°",
                "–" if reverses == t["worst_event"] else reverses,
            ]
        )
    common.table(["test", "RMS µm", "max µm", "G meas.", "G sim.", "worst at", "reverses"], rows)
    ratio = f"{data['rms_um'] / data['noise_um']:.2f}" if data["noise_um"] else "–"
    click.echo(f"\nresidual RMS {data['rms_um']:.3f} µm, noise {data['noise_um']:.3f} µm: ratio {ratio}")
    for t in data["tests"]:
        if t["samples_saturated"]:
            common.paragraph(
                f"{t['name']}: the sensor stood at its stop, or beyond its range, in {t['samples_saturated']} of "
                f"{t['samples']} samples. They are left out. The largest errors of this test are not known."
            )
    common.paragraph(
        f"RMS and max: measured less simulated; G: circular error (ISO 230-4), µm. Worst: angle φ (rotary tests: axis "
        f"angle), and the axis that reverses there. Noise: {data['noise_source']}."
    )
    click.echo()
    rows = [
        [k, *(f"{x:+.1f}" for x in v["table_ball_um"]), *(f"{x:+.1f}" for x in v["spindle_ball_um"])]
        for k, v in data["setups"].items()
    ]
    common.table(["set-up (µm)", "table ball x", "y", "z", "spindle ball x", "y", "z"], rows)
    shifts = ", ".join(f"{t['name']} {t['trigger_ms']:+.1f}" for t in data["tests"])
    click.echo(f"\nbar length {data['length_um']:+.2f} µm")
    common.paragraph(f"trigger shifts (ms): {shifts}")
    for b in data["iso230_4_bidirectional"]:
        m, s = b["measured"], b["simulated"]
        common.paragraph(
            f"{b['ccw']} with {b['cw']}: G(b) {m['circular_error_um']:.2f} µm measured, "
            f"{s['circular_error_um']:.2f} simulated; "
            f"D {m['mean_radial_error_um']:.2f} and {s['mean_radial_error_um']:.2f} µm"
        )
    if data["acceptance"]:
        click.echo("\nacceptance (ISO 14253-1: a figure within the guard band neither passes nor fails):")
        rows = [
            [
                " / ".join(a["tests"]),
                a["figure"].replace("_", " "),
                f"{a['value_um']:.2f}",
                f"{a['limit_um']:g}",
                f"{a['guard_band_um']:.2f}",
                a["decision"],
            ]
            for a in data["acceptance"]
        ]
        common.table(["test", "figure", "value µm", "limit µm", "guard µm", "decision"], rows, (0, 1, 5))
        for source in dict.fromkeys(a["source"] for a in data["acceptance"]):
            common.paragraph(f"limits: {source}")
