"""``mjsim diagnose``."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.compare import calibration_sentence, left_out_sentence, percent, show_combinations, show_conformity
from mjsim.cli.import_show import show_features
from mjsim.cli.logs import change_of, show_beside, show_diagnosis
from mjsim.cli.parameter_lines import finding_lines
from mjsim.cli.points import show_points
from mjsim.digits import decimals_of, estimate, expanded, fixed, interval, wave_ends
from mjsim.effects.registry import kinds
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.remedy import UNKNOWN
from mjsim.units import percent as probability

#: Findings that are shown in full; the smaller ones follow one a line.
_DETAILED = 4
#: Seconds above which it is said how long a diagnosis will take.
_LONG_S = 5.0


@click.command("diagnose")
@common.campaign_argument
@common.machine_option
@click.option(
    "--write",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Save the machine with the effects found, the curve of what is unexplained, and the calibrated data sheet.",
)
@common.max_effects_option
@common.test_option
@click.option("--budget", is_flag=True, help="Show where the uncertainty of every number comes from.")
@click.option("--force", is_flag=True, help="Replace the file named by --write.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, write, max_effects, only, budget, force, threads, as_is, as_json, quiet) -> None:
    """Say which effects are missing from the machine model of CAMPAIGN.

    It also says if none is missing, if two effects cannot be told apart, and if the cause is not in the catalogue.
    Where CAMPAIGN has ball-bar tests and axis logs, both decide, and the answer says which of them did.

    \b
    Example: mjsim diagnose examples/hidden-backlash --write fitted.toml
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of, write_machine
    from mjsim.errors import InputError
    from mjsim.importing.features import circles_of, imported_features
    from mjsim.io.files import check_writable
    from mjsim.plots.output import unexplained_plot
    from mjsim.workflow.diagnose import diagnose
    from mjsim.workflow.diagnosis import write_effect_file
    from mjsim.workflow.edit import with_effect_file
    from mjsim.workflow.saved import keep

    c = read_campaign(campaign, as_is=as_is).only(only)
    m = machine_of(c, machine)
    imported = imported_features(c)
    if write is not None:
        check_writable(write, force)
    bars_alone = set(c.measured_parts) == {BallBarTest.instrument}  # whose pace is known
    done = say_how_long(c.of(BallBarTest.instrument), quiet or as_json) if bars_alone else None
    with common.progress_bar(quiet) as progress:
        result = diagnose(c, m, max_effects, common.cores(threads), progress)
    if done is not None:
        done()
    say_cached(quiet or as_json)
    try:
        result = unexplained_plot(write_effect_file(result, c.state_folder), c.state_folder)
        if result.posterior is not None:
            keep(result, m)
    except InputError as error:
        common.say(f"the diagnosis was not kept beside the campaign: {error}", quiet)
    rest = result.unexplained.effect_file if result.unexplained else None
    if write is not None:
        fitted = with_effect_file(result.machine, rest) if rest else result.machine
        write_machine(fitted, m.file, write, force=force)
    data, found, circles = result.to_json(), {}, []
    if imported and result.has_bars:
        found = {e.id: e.values for e in m.effects} | {e["id"]: e["parameters"] for e in data["effects"]}
        circles = circles_of(c, result.before.to_json())
        data["imported"] = show_features(imported, found, circles, silent=True)
    if common.answered(data, as_json, quiet):
        return
    if not result.has_bars and not result.at_rest:
        show_diagnosis(data)
    else:
        show(data, str(campaign), result.has_bars)
        fitted = {row["id"]: row for row in [*data["calibration"], *data["effects"]]}
        for rest in result.at_rest:
            instrument = INSTRUMENTS[rest.after.instrument]
            show_points(data[instrument.beside], fitted, instrument, rest is result.at_rest[0])
        if result.logs is not None:
            show_beside(data[INSTRUMENTS[LogTest.instrument].beside])
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
        common.say(f"fitted machine written to {write}{beside}", quiet)


def _identifiable(campaign, data: dict) -> list[str]:
    """Rotary axes of an unexplained rest that depends on position, where it shows in a tangential test."""
    rest, bars = data["unexplained"], campaign.of(BallBarTest.instrument)
    if not rest or rest["variable"] != "position":
        return []
    tests = {kind_of(t).turns(t) for t in bars.measured if t.sensitive == "tangential" and t.name in rest["tests"]}
    return [axis for axis in rest["axes"] if axis in tests]


def say_cached(quiet: bool) -> None:
    """Say that a diagnosis was not computed but taken from the cache."""
    from mjsim.io.cache import store

    kept = store()
    if kept is not None and kept.hits["diagnoses"]:
        common.say("this campaign was diagnosed before: taken from the cache (--no-cache repeats it)", quiet)


def say_how_long(campaign, quiet: bool) -> Callable[[], None]:
    """Say how long a diagnosis will take, by the last one on this computer.

    Returns:
        To be called when it is done, so that the next one knows.
    """
    from mjsim.io.cache import store

    kept, begun = store(), time.monotonic()
    measured = sum(float(t.time[-1] - t.time[0]) for t in campaign.traces.values())
    pace = kept.seconds("diagnose") if kept else None
    if pace and pace * measured > _LONG_S:
        tests = f"{len(campaign.measured)} test{'s' if len(campaign.measured) > 1 else ''}"
        common.say(f"a diagnosis of {tests} takes about {pace * measured:.0f} s, by the last one", quiet)

    def done() -> None:
        if kept is not None and measured and not kept.hits["diagnoses"]:
            kept.took("diagnose", (time.monotonic() - begun) / measured)

    return done


#: What the final model has, for the sentence about the residual.
_FITTED = {True: "with everything that was found and calibrated", False: "with what was found"}


def show(data: dict, campaign: str = "CAMPAIGN", explained: bool = True) -> None:
    """A diagnosis' JSON as text: what matters first, then the calibration, then where to look.

    Args:
        data: as :meth:`mjsim.workflow.diagnosis.Diagnosis.to_json` gives it.
        campaign: its folder, for the commands that are proposed.
        explained: whether ``mjsim explain`` knows the campaign: it needs ball-bar tests.
    """
    from mjsim.workflow.diagnosis import VERDICTS

    common.paragraph(VERDICTS[data["verdict"]])
    common.paragraph(
        f"residual RMS {data['rms_before_um']:.3f} µm as given, "
        f"{data['rms_after_um']:.3f} µm {_FITTED[bool(data['calibration'])]}; noise {data['noise_um']:.3f} µm"
    )
    if data["left_out"]:
        common.paragraph(left_out_sentence(data["left_out"], data["samples"]))
    shares = {row["id"]: row["share"] for row in data["shares"]}
    for e in data["effects"][:_DETAILED]:
        _show_effect(e, shares.get(_key(e)))
    _show_smaller(data["effects"][_DETAILED:], shares)
    if data["calibration"]:
        click.echo()
        common.paragraph(calibration_sentence(data))
        show_combinations(data)
        show_conformity(data.get("budget", []))
    if data["unexplained"]:
        click.echo()
        common.paragraph(data["unexplained"]["summary"])
        if data["unexplained"]["effect_file"]:
            common.paragraph(f"an effect file in that form, ready to edit: {data['unexplained']['effect_file']}")
        if data["unexplained"]["plot"]:
            common.paragraph(f"its curve: {data['unexplained']['plot']}")
    if data["next_test"]:
        following = data["next_test"]
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
    if data["effects"] or data["calibration"]:
        click.echo("\nWhere to look:")
        for e in data["effects"][:_DETAILED]:
            common.paragraph(f"{e['id']}: {remedy_text(e['id'])}", "  ")
        if explained:
            which = data["effects"][0]["id"] if data["effects"] else "EFFECT"
            common.paragraph(f"mjsim explain {campaign} {which}   shows its signature, and what looks like it", "  ")
        table = "the calibration against its limits and " if data["calibration"] else ""
        common.paragraph(f"mjsim report {campaign}   shows {table}the error by cause", "  ")


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
        [", or ".join([e["id"], *e["alternative_ids"]]), percent(shares.get(_key(e), 0.0)), *_size(e)] for e in effects
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
    from mjsim.estimation.budget import NAMES

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
        limit = "" if chance is None else f", beyond its limit of {b['limit']:.4g} {unit} with {probability(chance)}"
        value = f"{estimate(b['value'], ends)} {expanded(ends)} {unit}".rstrip()
        common.paragraph(f"{b['id']} {b['number']} = {value}{limit}: {', '.join(told)}", "  ")
    click.echo()
    for b in rows[:_DETAILED]:
        common.paragraph(f"{b['id']} {b['number']}: {b['sentence']}")
    bar = campaign.instruments.get(BallBarTest.instrument)
    if bar is not None:
        common.paragraph(f"The errors of the ball bar are known from: {bar.source}.")


def _show_effect(e: dict, share: float | None) -> None:
    """One finding: its share of the explained squared error, its parameters, and where it shows."""
    part = "" if share is None else f"   {percent(share)} of the error"
    change = change_of(e) if "rms_before_um" not in e else f"{e['rms_before_um']:.3f} → {e['rms_after_um']:.3f} µm"
    click.echo(f"\n  {e['id']}{part}   {change}")
    for line in finding_lines(e):
        common.paragraph(line, "    ")
