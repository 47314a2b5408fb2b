"""``mjsim diagnose``."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

import click

from mjsim.cli import common
from mjsim.cli.compare import (
    calibration_sentence,
    left_out_sentence,
    share_text,
    show_combinations,
    show_conformity,
    show_sheet,
    symbol_of,
)
from mjsim.cli.import_show import show_features
from mjsim.digits import decimals_of, estimate, expanded, fixed, interval, wave_ends, with_interval
from mjsim.effects.registry import kinds
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS, Instrument
from mjsim.machine.effect import UNKNOWN
from mjsim.units import percent, unit_of

#: Findings that are shown in full; the smaller ones follow one a line.
_DETAILED = 4
#: Seconds above which it is said how long a diagnosis will take.
_LONG_S = 5.0


@click.command("diagnose")
@common.campaign_argument
@common.machine_option
@common.file_option(
    "--write",
    help="Save the machine with the effects found, the curve of what is unexplained, and the calibrated data sheet.",
)
@common.max_effects_option
@common.test_option
@click.option("--budget", is_flag=True, help="Show where the uncertainty of every number comes from.")
@click.option("--force", is_flag=True, help="Replace the file named by --write.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, write, max_effects, only, budget, force, threads, as_is) -> None:
    """Say which effects are missing from the machine model of CAMPAIGN.

    It also says if none is missing, if two effects cannot be told apart, and if the cause is not in the catalogue.
    Where CAMPAIGN has ball-bar tests and axis logs, both decide, and the answer says which of them did.

    \b
    Example: mjsim diagnose examples/hidden-backlash --write fitted.toml
    """
    from mjsim.campaign.machine_file import write_machine
    from mjsim.commands.diagnose import diagnose
    from mjsim.commands.diagnosis import write_effect_file
    from mjsim.commands.edit import with_effect_file
    from mjsim.commands.saved import keep
    from mjsim.errors import InputError
    from mjsim.importing.features import circles_of, imported_features
    from mjsim.io.files import check_writable
    from mjsim.plots.output import unexplained_plot

    c, m = common.campaign_and_machine(campaign, machine, as_is=as_is)
    c = c.only(only)
    imported = imported_features(c)
    if write is not None:
        check_writable(write, force)
    bars_alone = set(c.measured_parts) == {BallBarTest.instrument}  # whose pace is known
    done = say_how_long(c.in_motion) if bars_alone else None
    with common.progress_bar() as progress:
        result = diagnose(c, m, max_effects, common.cores(threads), progress)
    if done is not None:
        done()
    say_cached()
    try:
        result = unexplained_plot(write_effect_file(result, c.state_folder), c.state_folder)
        if result.posterior is not None:
            keep(result, m)
    except InputError as error:
        common.say(f"the diagnosis was not kept beside the campaign: {error}")
    rest = result.unexplained.effect_file if result.unexplained else None
    if write is not None:
        fitted = with_effect_file(result.machine, rest) if rest else result.machine
        write_machine(fitted, m.file, write, force=force)
    data, found, circles = result.to_json(), {}, []
    if imported and result.has_bars:
        found = {e.id: e.values for e in m.effects} | {e["id"]: e["parameters"] for e in data["effects"]}
        circles = circles_of(c, result.before.to_json())
        data["imported"] = show_features(imported, found, circles, silent=True)
    if common.answered(data):
        return
    show(data, str(campaign), result.has_bars)
    fitted = {row["id"]: row for row in [*data.get("calibration", ()), *data["effects"]]}
    for rest in result.at_rest:
        instrument = INSTRUMENTS[rest.after.instrument]
        show_at_rest(data[instrument.beside], fitted, instrument, rest is result.at_rest[0])
    if (beside := INSTRUMENTS[LogTest.instrument].beside) in data:
        click.echo()
        show_logs(data[beside], "axis log")
    if budget:
        show_budget(data.get("budget", []), c)
    for axis in _identifiable(c, data):
        common.paragraph(
            f"Pitch errors of many orders can look like this. Look for them in the tangential tests of {axis} first: "
            f"mjsim identify pitch-error {campaign} --axis {axis}"
        )
    if "imported" in data:
        click.echo("\nwhat the other system found, beside the effects of the model and the ones found:")
        show_features(imported, found, circles)
    if write is not None:
        beside = f", with the empirical curve of {rest}" if rest else ""
        common.say(f"fitted machine written to {write}{beside}")


def _identifiable(campaign, data: dict) -> list[str]:
    """Rotary axes of an unexplained rest that depends on position, where it shows in a tangential test."""
    rest, bars = data["unexplained"], campaign.in_motion
    if not rest or rest["variable"] != "position":
        return []
    tests = {kind_of(t).turns(t) for t in bars.measured if t.sensitive == "tangential" and t.name in rest["tests"]}
    return [axis for axis in rest["axes"] if axis in tests]


def say_cached() -> None:
    """Say that a diagnosis was not computed but taken from the cache."""
    from mjsim.io.cache import store

    kept = store()
    if kept is not None and kept.hits["diagnoses"] and not common.wants_json():
        common.say("this campaign was diagnosed before: taken from the cache (--no-cache repeats it)")


def say_how_long(campaign) -> Callable[[], None]:
    """Say how long a diagnosis will take, by the last one on this computer.

    Returns:
        To be called when it is done, so that the next one knows.
    """
    from mjsim.io.cache import store

    kept, begun = store(), time.monotonic()
    measured = sum(float(t.time[-1] - t.time[0]) for t in campaign.traces.values())
    pace = kept.seconds("diagnose") if kept else None
    if pace and pace * measured > _LONG_S and not common.wants_json():
        tests = f"{len(campaign.measured)} test{'s' if len(campaign.measured) > 1 else ''}"
        common.say(f"a diagnosis of {tests} takes about {pace * measured:.0f} s, by the last one")

    def done() -> None:
        if kept is not None and measured and not kept.hits["diagnoses"]:
            kept.took("diagnose", (time.monotonic() - begun) / measured)

    return done


def show(data: dict, campaign: str = "CAMPAIGN", explained: bool = True) -> None:
    """A diagnosis' JSON as text: what matters first, then the calibration, then where to look.

    Args:
        data: As :meth:`mjsim.commands.diagnosis.Diagnosis.to_json` gives it, of any instrument.
        campaign: Its folder, for the commands that are proposed.
        explained: Whether ``mjsim explain`` knows the campaign: it needs ball-bar tests.
    """
    from mjsim.commands.axis_log.diagnosis import MORE_IS_LEFT
    from mjsim.commands.diagnosis import VERDICTS, told_beside

    calibration = data.get("calibration", ())
    left_first = data["verdict"] == "unknown" and "data_sheet" in data  # of axis logs, what is left comes first
    common.paragraph(f"Unknown: {MORE_IS_LEFT}." if left_first else VERDICTS[data["verdict"]])
    if left_first:
        _show_rest(data)
    found = "with what was found" if data["effects"] or data.get("unexplained") else "with the data sheet fitted"
    fitted = "with everything that was found and calibrated" if calibration else found
    if data["rms_before_um"] or data["noise_um"]:
        common.paragraph(
            f"residual RMS {data['rms_before_um']:.3f} µm as given, {data['rms_after_um']:.3f} µm {fitted}; noise "
            f"{data['noise_um']:.3f} µm"
        )
    if "rms_before_deg" in data:
        before, after = data["rms_before_deg"], data["rms_after_deg"]
        common.paragraph(f"rotary axes: residual RMS {before:.3g}° as given, {after:.3g}° {fitted}")
    if data.get("left_out"):
        common.paragraph(left_out_sentence(data["left_out"], data["samples"]))
    shares = {row["id"]: row["share"] for row in data.get("shares", ())}
    detailed = _DETAILED if shares else len(data["effects"])
    for e in data["effects"][:detailed]:
        show_effect(e, shares.get(_key(e)))
    _show_smaller(data["effects"][detailed:], shares)
    if data.get("without_support"):
        common.paragraph(
            f"in the fit, and no findings: {', '.join(data['without_support'])}; chance, a sound machine or a cause "
            "that is in no catalogue may do as much"
        )
    if calibration:
        click.echo()
        common.paragraph(calibration_sentence(data))
        show_combinations(data)
        show_conformity(data.get("budget", []))
    if data["unexplained"] and not left_first:
        click.echo()
        _show_rest(data)
    if data.get("further_curves"):
        click.echo()
        within = "In the model, and not shown to be larger than a machine of its class may have:"
        more = data["unexplained"] or any("frequency_Hz" in curve for curve in data["further_curves"])
        common.paragraph("Also in the model, and still in the residual above:" if more else within)
        for curve in data["further_curves"]:
            common.paragraph(curve["summary"], "  ")
    for sentence in told_beside(data, (c["id"] for c in calibration)):
        click.echo()
        common.paragraph(sentence)
    if "data_sheet" in data:
        click.echo()
        show_logs(data | {"unexplained": None}, "with all of them")
    following = data["next_test"]
    if following and following["difference_um"] is not None:
        a, b = following["between"]
        click.echo()
        common.paragraph(
            f"next test to tell {a} from {b}: {following['test']['name']}, expected difference "
            f"{following['difference_um']:.2f} µm RMS"
            + ("" if following["decides"] else " (not enough to decide)")
            + "; `mjsim plan` prints it as a table for campaign.toml"
        )
    if data["not_testable"]:
        click.echo()
        common.paragraph(f"not testable with this campaign: {', '.join(data['not_testable'])}")
    if data["effects"] or calibration:
        click.echo("\nWhere to look:")
        for e in data["effects"][:_DETAILED]:
            common.paragraph(f"{e['id']}: {remedy_text(e['id'])}", "  ")
        if explained:
            which = data["effects"][0]["id"] if data["effects"] else "EFFECT"
            common.paragraph(f"mjsim explain {campaign} {which}   shows its signature, and what looks like it", "  ")
        table = "the calibration against its limits and " if calibration else ""
        common.paragraph(f"mjsim report {campaign}   shows {table}the error by cause", "  ")


def _show_rest(data: dict) -> None:
    """What no effect of the catalogue explains."""
    if data["unexplained"]:
        _show_unexplained(data["unexplained"])
        if data["verdict"] == "unknown" and data["effects"]:
            common.paragraph("The effects describe a part of the error. The unknown cause may look like them.")


def _show_unexplained(rest: dict) -> None:
    common.paragraph(rest["summary"])
    if rest["effect_file"]:
        common.paragraph(f"an effect file in that form, ready to edit: {rest['effect_file']}")
    if rest.get("plot"):
        common.paragraph(f"its curve: {rest['plot']}")


def show_logs(data: dict, title: str) -> None:
    """What axis logs show beside the effects: errors of every axis, data sheet, encoders, channels.

    Args:
        data: Their part of a diagnosis' JSON.
        title: Of the table of errors.
    """
    show_axes(data["tests"], title)
    click.echo()
    show_sheet(data)
    if data["unexplained"]:
        common.paragraph(data["unexplained"]["summary"])
    for e in data.get("encoders", ()):
        symbol, unit = ("um", "µm") if "rms_after_um" in e else ("deg", "°")
        common.paragraph(
            f"load less motor encoder of {e['axis']}: residual RMS {e[f'rms_before_{symbol}']:.3g} {unit} as given, "
            f"{e[f'rms_after_{symbol}']:.3g} {unit} with what was found"
        )
    for f in data.get("signals", ()):
        common.paragraph(f["sentence"])


def show_axes(tests: list[dict], title: str) -> None:
    """What is left in every axis of every log."""
    rows = []
    for t in tests:
        for a in t["axes"]:
            symbol = symbol_of(a)
            unit = {"um": "µm", "deg": "°"}[symbol]
            radial = f"{t['radial']['rms_um']:.2f}" if t["radial"] else "–"
            sizes = [f"{a[f'{n}_{symbol}']:.4g} {unit}" for n in ("rms", "max", "noise")]
            rows.append([t["name"], a["axis"], *sizes, radial])
    common.table([title, "axis", "RMS", "max", "noise", "radial µm"], rows, text=(0, 1))


_SOURCES = {"repeated points": "from repeated points", "stated": "as stated", "assumed": "assumed: nobody states it"}


def show_at_rest(data: dict, found: dict[str, dict], instrument: Instrument, first: bool = True) -> None:
    """The part of a diagnosis that is of an instrument that measures at rest.

    Args:
        data: Its JSON.
        instrument: That instrument.
        first: Whether no other one came before, which has said what is common to all of them.
        found: Parameters and 95 % intervals of all fitted effects, by id: dicts with ``parameters`` and ``ci95``.
    """
    click.echo()
    common.paragraph(
        f"{instrument.noun}: residual RMS {data['rms_before_um']:.3f} µm as given, {data['rms_after_um']:.3f} µm with "
        f"what was fitted; noise of one value {data['noise_um']:.3f} µm, {_SOURCES[data['noise_source']]}"
    )
    if data["left_um"] > 0.0 and first:
        common.paragraph(
            f"What is in no model is {data['left_um']:.2f} µm; the probability that it is more than the noise is "
            f"{100.0 * data['misfit']:.0f} %. The intervals have grown by it."
        )
        if data["misfit"] >= 0.5:
            common.paragraph(
                "Either the values repeat worse than the noise says (measure some of them twice, or state "
                "repeatability_um), or the machine has errors that are in no model: trust the numbers within their "
                "intervals, and look for the cause."
            )
    if data["joint"] and first:
        common.paragraph(data["joint"])
    rows = []
    for row in data["classical"]:
        known = found.get(row["id"])
        name = next(iter(known["ci95"])) if known else None
        if known is None or name is None:
            continue
        ends = known["ci95"][name]
        numbers = [estimate(known["parameters"][name], ends, "+"), interval(ends, sign="+")]
        rows.append([row["id"], unit_of(name)[1], *numbers, fixed(row["value"], decimals_of(None, ends), "+")])
    if rows:
        click.echo()
        head = ["error", "unit", "fitted", "95 % interval", instrument.by_itself_noun]
        common.table(head, rows, text=(0, 1, 3))
        common.paragraph(instrument.by_itself_note)
    click.echo()
    common.table(
        ["set-up and instrument", "value", "95 % interval"],
        [[r["name"], estimate(r["value"], r["ci95"], "+"), interval(r["ci95"], sign="+")] for r in data["set_up"]],
        text=(0, 2),
    )


def remedy_text(effect_id: str) -> str:
    """What can be done about a cause, as it fits its axis: a screw and a nut, or a worm and a bearing."""
    kind, _, subject = effect_id.partition(".")
    known = kinds().get(kind)
    return (known.remedy.on(subject) if known else UNKNOWN).text


def _key(e: dict) -> str:
    """Key of an effect of the JSON: its id, and its direction or sensor where it has one."""
    one_of_many = e["parameters"].get("direction") or e["parameters"].get("sensor")
    return f"{e['id']}[{one_of_many}]" if one_of_many else e["id"]


def _show_smaller(effects: list[dict], shares: dict[str, float]) -> None:
    """The findings behind the largest ones, one line each."""
    if not effects:
        return
    click.echo()
    rows = [
        [", or ".join([e["id"], *e["alternative_ids"]]), share_text(shares.get(_key(e), 0.0)), *_size(e)]
        for e in effects
    ]
    common.table(["smaller findings", "of the error", "size", "95 % interval"], rows, text=(0, 2, 3))


def _size(e: dict) -> tuple[str, str]:
    """The first fitted number of a finding, or its largest wave, with its interval."""
    name = next((n for n in e["parameters"] if n in e["ci95"]), None)
    if name is None:
        return "–", "–"
    value, ends = e["parameters"][name], e["ci95"][name]
    if name == "components":
        i = max(range(len(value)), key=lambda k: value[k][1])
        more = f" and {len(value) - 1} more" if len(value) > 1 else ""
        ends = wave_ends(ends, i, 1)
        return f"order {value[i][0]:g}: {estimate(value[i][1], ends)}{more}", interval(ends)
    return f"{name} = {estimate(value, ends)}", interval(ends)


def show_budget(rows: list[dict], campaign) -> None:
    """Where the uncertainty of every number comes from, and whether it is within its limit."""
    from mjsim.inference.budget import NAMES

    click.echo()
    if not rows:
        common.paragraph("There is no uncertainty budget: no number was fitted.")
        return
    common.paragraph(
        "Uncertainty budget: every number with its expanded uncertainty (k = 2), and its standard uncertainty by "
        "source. Of set-up, instrument, data sheet and other errors it is what would go if these were known exactly. "
        "They depend on each other, so the squares need not add up."
    )
    for b in rows:
        half = b["expanded_uncertainty"]
        ends = b["value"] - half, b["value"] + half
        unit, digits = b["unit"], decimals_of(b["value"], ends)
        parts = sorted(b["parts"].items(), key=lambda row: -row[1])
        told = [f"{NAMES[row]} {fixed(size, digits)}" for row, size in parts if float(fixed(size, digits))]
        chance = b["probability_beyond"]
        limit = "" if chance is None else f", beyond its limit of {b['limit']:.4g} {unit} with {percent(chance)}"
        value = f"{estimate(b['value'], ends)} {expanded(ends)} {unit}".rstrip()
        common.paragraph(f"{b['id']} {b['number']} = {value}{limit}: {', '.join(told)}", "  ")
    click.echo()
    for b in rows[:_DETAILED]:
        common.paragraph(f"{b['id']} {b['number']}: {b['sentence']}")
    bar = campaign.instruments.get(BallBarTest.instrument)
    if bar is not None:
        common.paragraph(f"The errors of the ball bar are known from: {bar.source}.")


def show_effect(e: dict, share: float | None = None) -> None:
    """One finding: its share of the explained squared error, its parameters, and where it shows."""
    part = "" if share is None else f"   {share_text(share)} of the error"
    if "rms_before_deg" in e:
        change = f"{e['rms_before_deg']:.3g} → {e['rms_after_deg']:.3g} °"
    else:
        change = f"{e['rms_before_um']:.3f} → {e['rms_after_um']:.3f} µm"
    click.echo(f"\n  {e['id']}{part}   {change}")
    for line in finding_lines(e):
        common.paragraph(line, "    ")


def parameter_lines(parameters: dict, intervals: dict, undetermined: Collection[str] = ()) -> list[str]:
    """``name = value  [low, high]`` per parameter, components one by one; no value of one that is not determined."""
    lines = []
    for name, value in parameters.items():
        if name in undetermined:
            lines.append(f"{name}: not determined by the data")
            continue
        ci = intervals.get(name)
        if name == "components":
            for i, (order, amplitude, phase) in enumerate(value):
                size = with_interval(amplitude, wave_ends(ci, i, 1))
                lines.append(f"order {order:g}: amplitude {size}, phase {estimate(phase, wave_ends(ci, i, 2))}°")
        elif isinstance(value, str):
            lines.append(f"{name} = {value}")
        else:
            lines.append(f"{name} = {with_interval(value, ci)}" + (" (95 %)" if ci else ""))
    return lines


def _with(probability: float | None) -> str:
    return "" if probability is None else f" ({percent(probability)})"


def finding_lines(finding: dict) -> list[str]:
    """What stands below the name of a finding: its parameters, what looks like it, and where it shows."""
    lines = parameter_lines(finding["parameters"], finding["ci95"], finding.get("undetermined", ()))
    if finding.get("known_together"):
        lines.append(finding["known_together"]["sentence"])
    if finding["probability"] is not None:
        lines.append(f"probability: {percent(finding['probability'])}")
    if finding["alternatives"]:
        others = (f"{a['id']}" + _with(a["probability"]) for a in finding["alternatives"])
        lines.append(f"cannot be told from: {', '.join(others)}")
    if finding["tests"]:
        lines.append(f"shows in: {', '.join(finding['tests'])}")
    if finding.get("evidence"):
        lines.append(finding["evidence"])
    return lines
