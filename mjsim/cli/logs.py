"""Axis logs on the terminal: what commands print of them, and ``mjsim import --log``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.import_show import show_remarks
from mjsim.cli.parameter_lines import finding_lines
from mjsim.digits import estimate, interval

#: What a check says of tests without a trace.
NOT_CHECKED = "Not checked, because campaign.toml names no trace for them: {}."


def import_logs(campaign: Path, pairs, signals, controller, options, force, preview, as_json, quiet) -> None:
    """``mjsim import --log``."""
    from mjsim.importing.logs import import_log

    done = [
        import_log(campaign, source, test, tuple(signals), controller, options, force, preview)
        for source, test in pairs
    ]
    if common.answered({"campaign": str(campaign), "logs": [d.to_json() for d in done]}, as_json, quiet):
        return
    for d in done:
        more = f", {len(d.tests)} logs, {d.tests[0]} to {d.tests[-1]}" if len(d.tests) > 1 else f": test {d.test}"
        common.paragraph(f"{d.source.name} → {d.target}{more}, {d.samples} samples at {d.rate:.6g} Hz")
        rows = [[str(c.place + 1), c.axis or "–", c.signal, c.unit or "?"] for c in d.columns]
        common.table(["column", "axis", "signal", "unit"], rows, text=(1, 2, 3))
        show_remarks(d.notes, d.questions)
    if preview:
        common.say("preview: nothing was written", quiet)


def show_check(data: dict) -> None:
    """A check's JSON as text."""
    rows = [
        [t["name"], " ".join(t["axes"]), str(t["samples"]), f"{t['rate_Hz']:g}", ", ".join(t["finding"])]
        for t in data["tests"]
    ]
    common.table(["log", "axes", "samples", "rate Hz", "finding"], rows, text=(0, 1, 4))
    click.echo()
    show_findings(data, "No mistake found: command and actual position, axes, units and time fit each other.")


def show_findings(data: dict, nothing: str) -> None:
    """What a check found, or that it found ``nothing``, and what it could not look at."""
    for finding in [*data["mistakes"], *data.get("signals", ())]:
        common.paragraph(finding["sentence"])
    if not data["mistakes"]:
        common.paragraph(nothing)
    if data["not_measured"]:
        common.paragraph(NOT_CHECKED.format(", ".join(data["not_measured"])))


def show_comparison(data: dict) -> None:
    """Tables of a comparison's JSON."""
    rows = []
    for t in data["tests"]:
        for a in t["axes"]:
            symbol = _symbol(a)
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
                f"{t['name']}: radial deviation on the circle, measured less simulated {r['rms_um']:.2f} µm RMS; "
                f"circular error {r['measured_circular_error_um']:.1f} µm measured, "
                f"{r['simulated_circular_error_um']:.1f} µm simulated"
            )
    show_left_out(data)


def show_left_out(data: dict) -> None:
    """Tests that a comparison leaves out."""
    if data["not_measured"]:
        common.paragraph(f"Not compared, because they have no trace: {', '.join(data['not_measured'])}.")


def _symbol(axis: dict) -> str:
    return "um" if "rms_um" in axis else "deg"


def change_of(e: dict) -> str:
    """RMS of an axis before and after a cause entered the model."""
    if "rms_before_deg" in e:
        return f"{e['rms_before_deg']:.3g} → {e['rms_after_deg']:.3g} °"
    return f"{e['rms_before_um']:.2f} → {e['rms_after_um']:.2f} µm"


_SENTENCE = {
    "identified": "Identified: the effects below are missing, and nothing else explains the logs as well.",
    "ambiguous": "Ambiguous: some effects below cannot be told from others by these logs.",
    "unknown": "Unknown: more is left than a sound machine leaves, and no effect of the catalogue explains it.",
    "nothing_found": "Nothing found: the model explains the logs within the data sheet's tolerances.",
}


def show_diagnosis(data: dict) -> None:
    """A diagnosis' JSON as text."""
    common.paragraph(_SENTENCE[data["verdict"]])
    is_first = data["unexplained"] and data["verdict"] == "unknown"
    if is_first:
        common.paragraph(data["unexplained"]["summary"])
        if data["effects"]:
            common.paragraph("The effects below describe a part of the error. The unknown cause may look like them.")
    if any(_symbol(a) == "um" for t in data["tests"] for a in t["axes"]):
        common.paragraph(
            f"residual RMS {data['rms_before_um']:.2f} µm as given, {data['rms_after_um']:.2f} µm with what was found; "
            f"noise {data['noise_um']:.3f} µm"
        )
    if "rms_before_deg" in data:
        before, after = data["rms_before_deg"], data["rms_after_deg"]
        common.paragraph(f"rotary axes: residual RMS {before:.3g}° as given, {after:.3g}° with what was found")
    show_effects(data)
    if data["without_support"]:
        common.paragraph(
            f"in the fit, and no findings: {', '.join(data['without_support'])}; chance, a sound machine or a cause "
            "that is in no catalogue may do as much"
        )
    click.echo()
    show_sheet(data)
    if data["unexplained"] and not is_first:
        click.echo()
        common.paragraph(data["unexplained"]["summary"])
    for e in data["encoders"]:
        symbol, unit = ("um", "µm") if "rms_after_um" in e else ("deg", "°")
        common.paragraph(
            f"load less motor encoder of {e['axis']}: residual RMS {e[f'rms_before_{symbol}']:.3g} {unit} as given, "
            f"{e[f'rms_after_{symbol}']:.3g} {unit} with what was found"
        )
    if data["not_testable"]:
        common.paragraph(f"not testable with these encoders: {', '.join(data['not_testable'])}")
    for f in data["signals"]:
        common.paragraph(f["sentence"])


def show_drive(data: dict) -> None:
    """The data sheet of a diagnosis' JSON, then its effects."""
    show_sheet(data)
    click.echo()
    show_effects(data)


def show_effects(data: dict) -> None:
    """The effects found, and the errors per axis with them."""
    for e in data["effects"]:
        click.echo(f"  {e['id']}   {change_of(e)}")
        for line in finding_lines(e):
            common.paragraph(line, "    ")
    click.echo()
    show_axes(data["tests"], "with all of them")


def show_axes(tests: list[dict], title: str) -> None:
    """What is left in every axis of every log."""
    rows = []
    for t in tests:
        for a in t["axes"]:
            symbol = _symbol(a)
            unit = {"um": "µm", "deg": "°"}[symbol]
            radial = f"{t['radial']['rms_um']:.2f}" if t["radial"] else "–"
            sizes = [f"{a[f'{n}_{symbol}']:.4g} {unit}" for n in ("rms", "max", "noise")]
            rows.append([t["name"], a["axis"], *sizes, radial])
    common.table([title, "axis", "RMS", "max", "noise", "radial µm"], rows, text=(0, 1))


def show_sheet(data: dict) -> None:
    """The data sheet as stated and as found, and what cannot be separated."""
    from mjsim.machine.sheet_names import sheet_name

    rows = []
    for s in data["data_sheet"]:
        name, unit = sheet_name(s["name"])
        known = "recorded output" if s["source"] == "recorded output" else "motion" if s["known"] else "the sheet"
        label = f"{s['axis']} {name}" + (f" ({s['controller']})" if s["controller"] else "")
        found = [estimate(s["found"], s["ci95"]), interval(s["ci95"])]
        numbers = [f"{s['stated']:.4g}", *(found if known != "the sheet" else ["not determined", "–"])]
        rows.append([label, *numbers, unit, known])
    if rows:
        common.table(["data sheet", "stated", "found", "95 %", "unit", "known from"], rows, text=(0, 3, 4, 5))
    for i in data["not_separable"]:
        if len(i["numbers"]) == 1:
            common.paragraph(f"{i['axis']}: the logs say little about {i['numbers'][0]}; {i['remedy']}")
        else:
            common.paragraph(f"{i['axis']}: only a combination of {', '.join(i['numbers'])} is known; {i['remedy']}")


def show_beside(data: dict) -> None:
    """What the logs add to a diagnosis of ball-bar tests."""
    click.echo()
    show_axes(data["tests"], "axis log")
    click.echo()
    show_sheet(data)
    if data["unexplained"]:
        common.paragraph(data["unexplained"]["summary"])
