"""``mjsim compare``."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.cli.import_show import show_features
from mjsim.digits import decimals_of, estimate, fixed, interval, with_interval
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.units import DEG, UM, percent, unit_of

#: Most numbers that are named of those which are not within their limits.
_CONFORMITY = 4


@click.command("compare")
@common.campaign_argument
@common.machine_option
@common.folder_option("--out", help="Folder for plots (default: .mjsim/compare in the campaign).")
@click.option(
    "--calibrate",
    "calibrated",
    is_flag=True,
    help="Fit what the machine file has a tolerance for first, and compare that machine.",
)
@common.test_option
@click.option("--no-plots", is_flag=True, help="Numbers only.")
@click.option("--force", is_flag=True, help="Replace plots in the folder named by --out.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, out, calibrated, only, no_plots, force, threads, as_is) -> None:
    """Lay the simulation over the measurement of CAMPAIGN, test by test.

    The ball offsets of every set-up, the bar's length and each trigger are fitted with their priors and shown. The
    machine is taken as it is. With --calibrate, the effects in the [tolerance] table of the machine file are fitted
    first. Nothing else is looked for.

    \b
    Example: mjsim compare examples/hidden-backlash
    """
    from mjsim.commands.calibrate import calibrate
    from mjsim.commands.compare import compare
    from mjsim.importing.features import circles_of, imported_features
    from mjsim.io.files import check_writable
    from mjsim.plots.comparison import comparison_plots, plot_files

    c, m = common.campaign_and_machine(campaign, machine, as_is=as_is)
    c = c.only(only)
    imported = imported_features(c)
    folder = out or c.state_folder / "compare"
    for file in [] if no_plots else plot_files(c, folder):
        check_writable(file, force or out is None)
    with common.progress_bar() as progress:
        fitted = calibrate(c, m, common.cores(threads), progress) if calibrated else None
        result = fitted.after if fitted else compare(c, m, common.cores(threads), progress)
        plots = [] if no_plots else comparison_plots(result, folder, progress)
    data, found = result.to_json(), {}
    if fitted:
        _add_calibration(data, fitted)
    if imported and result.of(BallBarTest.instrument):
        found = {e.id: e.values for e in m.effects}
        data["imported"] = show_features(imported, found, circles_of(c, data), silent=True)
    if common.answered({**data, "plots": [str(p) for p in plots]}):
        return
    for part, mine in common.each_part(result.parts, data):
        if fitted:
            _show_calibration(mine, m, fitted)
        _SHOW.get(part.instrument, show_channels)(mine)
    for warning in result.warnings:
        common.say(f"warning: {warning}")
    if "imported" in data:
        click.echo("\nwhat the other system found:")
        show_features(imported, found, circles_of(c, data))
    if plots:
        common.say(f"plots in {plots[0].parent}")


def _add_calibration(data: dict, fitted) -> None:
    """What was calibrated, in the JSON of the instrument whose tests it was fitted to."""
    from mjsim.commands.comparison import apart, significant
    from mjsim.commands.diagnosis import calibration_json
    from mjsim.commands.finding import rounded

    for part, mine in apart(fitted.before.parts, data):
        if "rms_um" in mine:
            mine["rms_as_given_um"] = round(part.rms / UM, 4)
        if "rms_deg" in mine:
            mine["rms_as_given_deg"] = significant(part.rms_rotary / DEG)
        if INSTRUMENTS[part.instrument].in_motion:
            mine |= calibration_json(fitted.calibration, fitted.shares, fitted.combinations)
            mine["budget"] = [rounded(b.to_json()) for b in fitted.budget]
        elif part.instrument == LogTest.instrument:
            mine |= {"data_sheet": [n.to_json() for n in fitted.sheet], "not_separable": []}


def _show_calibration(data: dict, machine, fitted) -> None:
    """The error before and after a calibration, and what was calibrated."""
    if data.get("rms_as_given_um"):
        common.paragraph(
            f"residual RMS {data['rms_as_given_um']:.3f} µm as given, {data['rms_um']:.3f} µm calibrated within "
            "tolerance"
        )
    if "rms_as_given_deg" in data:
        common.paragraph(
            f"rotary axes: residual RMS {data['rms_as_given_deg']:.3g}° as given, {data['rms_deg']:.3g}° calibrated"
        )
    if "calibration" in data:
        common.paragraph(calibration_sentence(data))
        show_combinations(data)
        show_conformity(data["budget"])
        show_beyond(machine, fitted.calibration)
    if "data_sheet" in data:
        show_sheet(data)
    click.echo()


def show_channels(data: dict) -> None:
    """Table of a comparison's JSON, of an instrument without a table of its own."""
    rows = []
    for t in data["tests"]:
        for c in t["channels"]:
            suffix = next(k for k in c if k.startswith("rms_")).removeprefix("rms_")
            rows.append([t["name"], c["name"], suffix, *(f"{c[f'{n}_{suffix}']:.4g}" for n in ("rms", "max", "noise"))])
    common.table(["test", "channel", "unit", "RMS", "max", "noise"], rows, text=(0, 1, 2))
    click.echo()
    common.paragraph("RMS and max: measured less simulated.")
    for t in data["tests"]:
        fitted = ", ".join(f"{k} {v:+.4g}" for k, v in t["set_up"].items())
        common.paragraph(f"{t['name']}: fitted of the set-up: {fitted}")
        for who, figures in t["figures"].items():
            common.paragraph(f"{t['name']}: {who}: " + ", ".join(f"{k} {v:.4g}" for k, v in figures.items()))
    show_left_out(data)


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


def show_conformity(budget: list[dict]) -> None:
    """How many numbers lie within their limits, and the others with the probability that they are beyond."""
    rows = [b for b in budget if b["probability_beyond"] is not None]
    if not rows:
        return
    said = []
    for decision in ("beyond", "open"):
        found = sorted((b for b in rows if b["decision"] == decision), key=lambda b: -b["probability_beyond"])
        names = [f"{b['id']} {b['number']} ({percent(b['probability_beyond'])})" for b in found[:_CONFORMITY]]
        more = f" and {len(found) - len(names)} more" if len(found) > len(names) else ""
        said.append(f"{len(found)} {decision}" + (f": {', '.join(names)}{more}" if names else ""))
    within = sum(b["decision"] == "within" for b in rows)
    common.paragraph(
        f"Of {len(rows)} numbers with a limit, {within} lie within it with at least 95 %; {'; '.join(said)}. The "
        "percentages are probabilities to be beyond."
    )


def show_beyond(machine, calibration) -> None:
    """One line for each calibrated number that lies beyond its limit."""
    from mjsim.report.causes import rows_of

    for r in rows_of(machine, calibration):
        if r.beyond:
            common.paragraph(
                f"Beyond its limit: {r.effect_id} {r.name} = {with_interval(r.value, (r.low, r.high), r.unit)}, "
                f"limit {r.expected:.4g} ± {r.limit:.4g} {r.unit}. `mjsim diagnose` says what else there is."
            )


def share_text(share: float) -> str:
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
        f"Calibrated within tolerance: {len(rows)} effects, {share_text(share)} of the error, {seen} of them "
        f"observable with these tests. Largest in the readings: {names}."
    )


def show_combinations(data: dict) -> None:
    """One line for each sum that is determined where its numbers are not."""
    for row in data["combinations"]:
        first, *others = row["terms"]
        text = first["id"] + "".join(
            f" {'-' if t['factor'] < 0 else '+'} {abs(t['factor']):.3g} {t['id']}" for t in others
        )
        unit = unit_of(first["parameter"])[1]
        units = ", ".join(dict.fromkeys(unit_of(t["parameter"])[1] for t in row["terms"]))
        common.paragraph(
            f"Only this combination is determined: {text} = {with_interval(row['value'], row['ci95'], unit)} "
            f"(numbers in {units})."
        )


def show_bars(data: dict) -> None:
    """Tables of a comparison's JSON, of a ball bar or of an R-test."""
    sphere = list(data.get("nest", {}).items())
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
        iso = t.get("iso10791_6") or t["iso230_4"]
        name = "range_um" if sphere else "circular_error_um"
        g = [f"{iso[k][name]:.2f}" if iso else "–" for k in ("measured", "simulated")]
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
    figure = "range" if sphere else "G"
    common.table(["test", "RMS µm", "max µm", f"{figure} meas.", f"{figure} sim.", "worst at", "reverses"], rows)
    ratio = f"{data['rms_um'] / data['noise_um']:.2f}" if data["noise_um"] else "–"
    click.echo(f"\nresidual RMS {data['rms_um']:.3f} µm, noise {data['noise_um']:.3f} µm: ratio {ratio}")
    for t in data["tests"]:
        if t["samples_saturated"]:
            common.paragraph(
                f"{t['name']}: the sensor stood at its stop, or beyond its range, in {t['samples_saturated']} of "
                f"{t['samples']} samples. They are left out. The largest errors of this test are not known."
            )
    said = (
        "range: of the coordinate, without what the places of sphere and nest make of it (ISO 10791-6), µm. Worst: "
        "angle of the axis, and the axis that reverses there"
        if sphere
        else "G: circular error (ISO 230-4), µm. Worst: angle φ (rotary tests: axis angle), and the axis that reverses "
        "there"
    )
    common.paragraph(f"RMS and max: measured less simulated; {said}. Noise: {data['noise_source']}.")
    click.echo()
    rows = [
        [k, *(f"{x:+.1f}" for x in v["table_ball_um"]), *(f"{x:+.1f}" for x in v["spindle_ball_um"])]
        for k, v in data["setups"].items()
    ]
    balls = ("sphere x", "nest x") if sphere else ("table ball x", "spindle ball x")
    common.table(["set-up (µm)", balls[0], "y", "z", balls[1], "y", "z"], rows)
    click.echo()
    if sphere:
        unit = {"mrad": "mrad", "percent": "%"}
        parts = (f"{k.rpartition('_')[0].replace('_', ' ')} {v:+.2f} {unit[k.rpartition('_')[2]]}" for k, v in sphere)
        common.paragraph(f"nest: {', '.join(parts)}")
    else:
        click.echo(f"bar length {data['length_um']:+.2f} µm")
    shifts = {t["name"].rpartition(".d")[0] if sphere else t["name"]: t["trigger_ms"] for t in data["tests"]}
    common.paragraph(f"trigger shifts (ms): {', '.join(f'{name} {ms:+.1f}' for name, ms in shifts.items())}")
    for b in data["iso230_4_bidirectional"]:
        m, s = b["measured"], b["simulated"]
        common.paragraph(
            f"{b['ccw']} with {b['cw']}: G(b) {m['circular_error_um']:.2f} µm measured, "
            f"{s['circular_error_um']:.2f} simulated; "
            f"D {m['mean_radial_error_um']:.2f} and {s['mean_radial_error_um']:.2f} µm"
        )
    if data["acceptance"]:
        click.echo("\nacceptance (ISO 14253-1: a figure within the guard band neither passes nor fails):")

        def known(a: dict) -> tuple[float, float]:
            half = 2.0 * a["standard_uncertainty_um"]
            return a["value_um"] - half, a["value_um"] + half

        rows = [
            [
                " / ".join(a["tests"]),
                a["figure"].replace("_", " "),
                estimate(a["value_um"], known(a)),
                f"{a['limit_um']:g}",
                fixed(a["guard_band_um"], decimals_of(None, known(a))),
                a["decision"],
                share_text(a["probability_beyond"]),
            ]
            for a in data["acceptance"]
        ]
        common.table(["test", "figure", "value µm", "limit µm", "guard µm", "decision", "P(beyond)"], rows, (0, 1, 5))
        for source in dict.fromkeys(a["source"] for a in data["acceptance"]):
            common.paragraph(f"limits: {source}")


def show_log_errors(data: dict) -> None:
    """Tables of a comparison's JSON."""
    rows = []
    for t in data["tests"]:
        for a in t["axes"]:
            symbol = symbol_of(a)
            place = next(k for k in a if k.startswith("worst_position"))
            where = f"{a['worst_time_s']:.3f} s, {a[place]:.2f} {'°' if place.endswith('deg') else 'mm'}"
            numbers = [f"{a[f'{n}_{symbol}']:.4g}" for n in ("following_error", "rms", "max", "noise")]
            rows.append([t["name"], a["axis"], *numbers, where, f"{a['shift_ms']:+.3f}"])
    head = ["test", "axis", "following", "RMS", "max", "noise", "worst at", "shift ms"]
    common.table(head, rows, text=(0, 1, 6))
    click.echo()
    common.paragraph(
        "RMS and max: measured less simulated position, µm (rotary axes °). Following: command less measured, RMS. "
        f"Shift: fitted between recording and simulation. Noise: {data['noise_source']}."
    )
    for t in data["tests"]:
        for a in (a for a in t["axes"] if a["shift_at_limit"]):
            common.paragraph(
                f"{t['name']}: the time shift of {a['axis']} is at its limit, {a['shift_ms']:+.3g} ms: no recorder is "
                f"so late or early. Look for a delay in the control (loop_delay_s), a filter of the command, wrong "
                f"gains or a wrong command."
            )
        if t["radial"]:
            r = t["radial"]
            common.paragraph(
                f"{t['name']}: radial error on the circle, measured less simulated {r['rms_um']:.2f} µm RMS; "
                f"circular error {r['measured_circular_error_um']:.1f} µm measured, "
                f"{r['simulated_circular_error_um']:.1f} µm simulated"
            )
    show_left_out(data)


def show_left_out(data: dict) -> None:
    """Tests that a comparison leaves out."""
    if data["not_measured"]:
        common.paragraph(f"Not compared, because they have no trace: {', '.join(data['not_measured'])}.")


def show_sheet(data: dict) -> None:
    """The data sheet as stated and as found, and what cannot be separated."""
    from mjsim.commands.axis_log.diagnosis import little_known
    from mjsim.machine.model import sheet_name

    rows = []
    for s in data["data_sheet"]:
        name, unit = sheet_name(s["name"])
        label = f"{s['axis']} {name}" + (f" ({s['controller']})" if s["controller"] else "")
        found = [estimate(s["found"], s["ci95"]), interval(s["ci95"])] if s["known"] else ["not determined", "–"]
        rows.append([label, f"{s['stated']:.4g}", *found, unit, s["source"] if s["known"] else "the sheet"])
    if rows:
        common.table(["data sheet", "stated", "found", "95 %", "unit", "known from"], rows, text=(0, 3, 4, 5))
    for i in data["not_separable"]:
        common.paragraph(f"{little_known(i['axis'], i['numbers'])}; {i['remedy']}")


def symbol_of(axis: dict) -> str:
    """In which unit the JSON has the errors of an axis."""
    return "um" if "rms_um" in axis else "deg"


#: What is printed of an instrument, where it is more than the errors of its channels.
_SHOW = {**{n: show_bars for n, i in INSTRUMENTS.items() if i.in_motion}, LogTest.instrument: show_log_errors}
