"""``mjsim plan``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.digits import expanded
from mjsim.importing.into_campaign import put_test, test_text
from mjsim.instruments.base import INSTRUMENTS
from mjsim.units import unit_of

#: JSON of a plan where nothing is to be separated.
_NOTHING_OPEN = {"between": None, "test": None, "difference_um": None}


@click.command("plan")
@click.argument("campaign", type=common.path_type(), required=False)
@common.machine_option
@click.option("--new", "whole", is_flag=True, help="Propose all tests of a new campaign, of --machine or --template.")
@click.option("--template", "template_name", help="With --new: a machine template (mjsim machine templates).")
@click.option(
    "--position-gain",
    type=float,
    help="With --new and --template: position gain of all axes, as set in the control, 1/s.",
)
@click.option(
    "--minutes", help="With --new: machine time, a number or full (default): 10 and 30 are usual.", default=None
)
@click.option(
    "--instrument",
    type=click.Choice([n for n, i in INSTRUMENTS.items() if i.in_motion]),
    help="With --new: what it is measured with (default: ball_bar).",
)
@common.folder_option("-o", "--out", help="With --new: new folder for the campaign.")
@click.option(
    "--between",
    nargs=2,
    metavar="A B",
    default=None,
    shell_complete=common.effect_ids,
    help="Two effects to separate; or one effect and the word nothing.",
)
@click.option(
    "--points", type=click.IntRange(4, 500), metavar="N", help="Propose N positions at which to probe a sphere."
)
@click.option(
    "--targets",
    metavar="AXIS",
    help="Propose targets of AXIS (XYZ: a diagonal) over --range; --points says how many.",
)
@click.option("--write", is_flag=True, help="With --points or --targets: put the table into campaign.toml.")
@common.sphere_option("With --points: centre of the sphere, mm in the work frame.")
@common.range_option("With --points or --targets: travel of an axis, degrees or mm.")
@common.as_is_option
@common.threads_option
@common.options
def command(
    campaign,
    machine,
    whole,
    template_name,
    position_gain,
    minutes,
    instrument,
    out,
    between,
    points,
    targets,
    write,
    sphere,
    ranges,
    threads,
    as_is,
) -> None:
    """Say which test to measure next: the one that best separates the effects that the data of CAMPAIGN cannot tell
    apart.

    Without --between the campaign is diagnosed first. If nothing is ambiguous, the test is one that shows an effect
    which this campaign cannot show. The best test separates two effects most clearly per minute of machine time.

    Where CAMPAIGN has axis logs, the answer is a motion to record: strokes, constant speeds, small steps or slow
    reversals, with the torque or a second velocity gain where positions are not enough. Where it has ball-bar tests as
    well, both instruments are compared.

    With --new, no campaign is there yet: the tests are chosen that tell most of the machine in some minutes, and it is
    said what they can and cannot tell. --instrument r_test chooses R-tests.

    With --points, the answer is a [[test]] with the positions at which to probe a sphere: those after which the
    location errors of the rotary axes are known best.

    With --targets, the answer is a [[test]] with targets of one axis for a laser, a scale or a rotary calibrator: as
    many as ISO 230-2 asks for, none in step with the screw or worm. Several letters, such as XYZ, are a diagonal.
    --write puts the table into campaign.toml.

    \b
    Example: mjsim plan examples/two-candidates --between servo_gain.C servo_delay.C
             mjsim plan --new --template trunnion-a-medium --minutes 10
             mjsim plan --new --machine my-machine/machine.toml --minutes 30 -o my-campaign
    """
    if whole:
        if campaign is not None or between is not None or as_is:
            raise click.UsageError("--new has no CAMPAIGN, --between or --as-is")
        if (machine is None) == (template_name is None):
            raise click.UsageError("--new needs either --machine or --template")
        if machine is not None and position_gain is not None:
            raise click.UsageError("--position-gain needs --template")
        _plan_new(machine, template_name, position_gain, minutes, instrument, out, threads)
        return
    if campaign is None:
        raise click.UsageError("Missing argument 'CAMPAIGN' (or --new)")
    if any(given is not None for given in (template_name, minutes, instrument, out, position_gain)):
        raise click.UsageError("--template, --position-gain, --minutes, --instrument and --out need --new")
    from mjsim.commands.plan import plan
    from mjsim.commands.plan_at_rest import MostTelling
    from mjsim.instruments.axis_log.measurement import LogTest

    if (sphere and points is None) or (ranges and points is None and targets is None):
        raise click.UsageError("--sphere needs --points, --range needs --points or --targets")
    if targets is not None and (sphere or between is not None):
        raise click.UsageError("--targets excludes --sphere and --between")
    if write and points is None and targets is None:
        raise click.UsageError("--write needs --points or --targets")
    at_rest = points is not None or targets is not None
    c, m = common.campaign_and_machine(campaign, machine, as_is=as_is, empty=at_rest)
    if targets is not None:
        from mjsim.commands.plan_at_rest import plan_targets

        aim = plan_targets(c, m, targets, {a: (low, high) for a, low, high in ranges}, points)
        _write_or_show(aim, campaign, write, show_targets)
        return
    if points is not None:
        from mjsim.commands.plan_at_rest import plan_points
        from mjsim.units import DEG, MM

        if between is not None:
            raise click.UsageError("--points and --between exclude each other")
        ends = {a: (low * DEG, high * DEG) for a, low, high in ranges}
        planned = plan_points(c, m, points, tuple(v * MM for v in sphere) if sphere else None, ends)
        _write_or_show(planned, campaign, write, show_points)
        return
    with common.progress_bar() as progress:
        result = plan(c, m, between, common.cores(threads), progress)
    recorded = LogTest.instrument in c.measured_parts
    if common.answered(
        result.to_json() if result else _NOTHING_OPEN | ({} if recorded else {"recordings": [], "at_rest": []})
    ):
        return
    if result is None:
        known = (
            "the logs know every number of the drives"
            if recorded
            else "every effect of the catalogue is testable with this campaign"
        )
        common.paragraph(f"Nothing to separate: no effect is ambiguous, and {known}.")
    elif isinstance(result, MostTelling):
        show_telling(result.to_json(), c)
    elif result.beside:
        show(result.bars, campaign)
        data = result.to_json()
        show_recordings(data["recordings"])
        show_at_rest(data["at_rest"])
    else:
        show_measurement(result.to_json(), c)


def _write_or_show(planned, campaign: Path, write: bool, show_planned) -> None:
    """Puts planned positions into campaign.toml where that is asked for, and says what they bring."""
    data = planned.to_json()
    if write:
        put_test(campaign, data["test"])
    if not common.answered(data):
        show_planned(planned, str(campaign), write)


def _plan_new(machine, template_name, position_gain, minutes, instrument, out, threads) -> None:
    """The tests of a new campaign."""
    from mjsim.campaign.machine_file import read_machine
    from mjsim.campaign.machine_templates import template_named
    from mjsim.campaign.new import check_new_folder, check_position_gain, machine_text, new_planned_campaign
    from mjsim.commands.plan import r_test_motions
    from mjsim.inference.planning.whole_campaign import CampaignPlanner
    from mjsim.instruments.r_test.measurement import SphereReading
    from mjsim.io.toml import read_text

    time = _minutes(minutes)
    check_position_gain(position_gain)
    if out is not None:
        check_new_folder(out, None, "campaign")
    if template_name is not None:
        template = template_named(template_name)
        text = machine_text(template.chain, template.name, template, position_gain)
        m = read_machine(Path("machine.toml"), text)
    else:
        m, text = read_machine(machine), read_text(machine)
    with common.progress_bar() as progress:
        tests = r_test_motions(m) if instrument == SphereReading.instrument else None
        plan = CampaignPlanner(m, common.cores(threads), progress, tests=tests).plan(time)
    data = plan.to_json()
    files = [] if out is None else new_planned_campaign(out, text, data["tests"], instrument)
    if common.answered(data | {"files": [str(f) for f in files]}):
        return
    show_new(data)
    if out is not None:
        click.echo(f"\n{out} has campaign.toml and machine.toml. Next:\n")
        how = "--points " if instrument == SphereReading.instrument else ""
        click.echo(f"  mjsim nc {out} -o programs.zip      (--dialect says for which control)")
        click.echo(f"  mjsim import FILE --campaign {out} {how}--test NAME")
        click.echo(f"  mjsim diagnose {out}")


def _minutes(text: str | None) -> float | None:
    """Minutes of a plan; ``None`` for a full one."""
    from mjsim.errors import InputError

    if text is None or text == "full":
        return None
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value <= 1000.0:
        raise InputError(f"--minutes {text[:40]!r}; allowed: a number from 1 to 1000, or full")
    return value


def show_new(data: dict) -> None:
    """The tests of a new campaign, and what they tell."""
    from mjsim.inference.planning.whole_campaign import told_sentences

    setups = len({t["setup"] for t in data["tests"]})
    common.paragraph(
        f"{len(data['tests'])} tests in {setups} set-up{'s' if setups > 1 else ''}, {data['minutes']:.0f} minutes with "
        "handling."
    )
    rows = [
        [t["name"], t["setup"], " ".join(f"{x:g}" for x in _ball(t)), f"{t['started_s'] / 60:.0f}"]
        for t in data["tests"]
    ]
    ball = "sphere mm" if "sphere_mm" in data["tests"][0] else "table ball mm"
    common.table(["test", "set-up", ball, "begins min"], rows, text=(0, 1, 2))
    click.echo()
    for sentence in told_sentences(data):
        common.paragraph(sentence)


def _ball(table: dict) -> list[float]:
    """Where the ball of a test is, mm."""
    return table["sphere_mm"] if "sphere_mm" in table else table["table_ball_mm"]


def show(result, campaign) -> None:
    """A plan as text: the verdict, the test as a table for campaign.toml, the runners-up, what to do next."""
    from mjsim.instruments.base import table_of

    data, name = result.to_json(), result.best.test.recording
    noun, how = INSTRUMENTS[result.best.test.instrument].noun, "--points " if result.best.test.component else ""
    a, b = data["between"]
    aim = f"whether the machine has {a} that its model lacks" if b == "nothing" else f"between {a} and {b}"
    common.paragraph(
        f"This test {_decides(data, aim)}: {name}. It takes {data['minutes']:.1f} min with handling. The expected "
        f"difference is "
        f"{data['difference_um']:.2f} µm RMS; separation over the whole test: {data['separation']:.0f} σ."
    )
    common.paragraph(data["reason"])
    speeds = ", ".join(f"{axis} {speed:.0f} {unit}" for axis, (speed, unit) in data["axis_speeds"].items())
    common.paragraph(f"Highest axis speeds: {speeds}.")
    click.echo(f"\n{test_text(table_of(result.best.test))}\n")
    rows = [data, *data["runners_up"]]
    common.table(
        ["test", "difference µm", "separation σ", "time min"],
        [
            [r["test"]["name"], f"{r['difference_um']:.2f}", f"{r['separation']:.0f}", f"{r['minutes']:.1f}"]
            for r in rows
        ],
    )
    if any(r["separation"] > data["separation"] for r in data["runners_up"]):
        common.paragraph(
            f"A separation of {data['enough']:.0f} σ decides. {data['plenty']:.0f} σ are certain: beyond that the "
            "shorter test is better."
        )
    common.next_steps(
        f"Paste the table above into {campaign}/campaign.toml.",
        f"mjsim nc {campaign} --test {name} -o {name}.nc",
        f"Run the program on the machine, and record it with the {noun}.",
        f"mjsim import FILE --campaign {campaign} {how}--test {name}",
        f"mjsim diagnose {campaign}",
    )


def _decides(data: dict, aim: str) -> str:
    """Whether a test decides what it is for, in words."""
    return f"decides {aim}" if data["decides"] else f"does not decide {aim}, but comes nearest"


def show_measurement(data: dict, campaign) -> None:
    """A plan's JSON as text."""
    between = data["between"]
    known = data.get("left") is not None
    aim = f"what only a combination is known of: {', '.join(between)}" if known else f"between {' and '.join(between)}"
    if not known and between[1] == "nothing":
        aim = f"whether the machine has {between[0]} that its model lacks"
    log = data["instrument"] == "axis_log"
    common.paragraph(
        f"This {_test_noun(data)} {_decides(data, aim)}: {data['test']['name']}. It takes "
        f"{data['minutes']:.1f} min with handling. {_effect(data)}."
    )
    common.paragraph(data["reason"])
    if log:
        common.paragraph(data["motion"])
        click.echo("\nNC program, from where the axis stands:\n")
        for line in data["program"]:
            click.echo(f"  {line}")
    click.echo()
    rows = [[_noun(r), r["test"]["name"], _effect(r), f"{r['minutes']:.1f}"] for r in [data, *data["runners_up"]]]
    common.table(["instrument", "test", "expected", "time min"], rows, text=(0, 1, 2))
    if log:
        name = data["test"]["name"]
        more = ", and its torque or current" if "torque" in name else ""
        common.next_steps(
            f"Run the program. Record command and position of the axis{more}.",
            f"mjsim import FILE --campaign {campaign.folder} --log --test {name}",
            f"mjsim diagnose {campaign.folder}",
        )
    else:
        _show_test(data, campaign)


def show_telling(data: dict, campaign) -> None:
    """A plan's JSON as text where no finding is open."""
    common.paragraph(
        f"This {_test_noun(data)} tells most: {data['test']['name']}. It takes {data['minutes']:.0f} min with handling."
    )
    common.paragraph(data["reason"])
    click.echo()
    rows = [
        [_noun(r), r["test"]["name"], f"{r['bits']:.1f}", f"{r['minutes']:.0f}", _known(r)]
        for r in [data, *data["runners_up"]]
    ]
    common.table(["instrument", "test", "bits", "time min", "makes known"], rows, text=(0, 1, 4))
    _show_test(data, campaign)


def _known(row: dict, most: int = 4) -> str:
    """Whose numbers a test makes known."""
    names = list(dict.fromkeys(k["id"] for k in row["known"]))
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _show_test(data: dict, campaign) -> None:
    """The table of a planned test, and what to do next."""
    name, folder, at_rest = data["test"]["name"], campaign.folder, INSTRUMENTS[data["instrument"]].at_rest
    click.echo("\nNext:")
    click.echo(f"  1. Put this table into {folder}/campaign.toml:\n")
    click.echo(test_text(data["test"]) + "\n")
    if data["instrument"] not in campaign.instruments:
        common.paragraph(
            f"The campaign has no {_noun(data)} yet: call its tables [instrument.NAME], and add one with kind = "
            f'"{data["instrument"]}".',
            "     ",
        )
    out, points = (f"{name}.csv", " --points") if at_rest else (f"{name}.nc", "")
    click.echo(f"  2. mjsim nc {folder} --test {name} -o {out}")
    click.echo(f"  3. Measure. mjsim import FILE --campaign {folder}{points} --test {name}")
    click.echo(f"  4. mjsim diagnose {folder}")


def _noun(row: dict) -> str:
    return INSTRUMENTS[row["instrument"]].noun


def _test_noun(row: dict) -> str:
    return "recording" if row["instrument"] == "axis_log" else INSTRUMENTS[row["instrument"]].test_noun


def show_recordings(rows: list[dict]) -> None:
    """Recordings that separate what a ball-bar test is to separate, below the test."""
    if not rows:
        return
    (axis,) = rows[0]["test"]["axes"]
    click.echo()
    common.paragraph(f"Or without the ball bar: record command and position of {axis} in the control.")
    common.table(
        ["motion to record", "expected", "time min"],
        [[r["motion"], _effect(r), f"{r['minutes']:.1f}"] for r in rows],
        text=(0, 1),
    )


def show_at_rest(rows: list[dict]) -> None:
    """Tests at rest that separate what a ball-bar test is to separate, below the test."""
    if not rows:
        return
    click.echo()
    common.paragraph("Or while the machine stands still:")
    common.table(
        ["instrument", "test", "expected", "time min"],
        [[_noun(r), r["test"]["name"], _effect(r), f"{r['minutes']:.1f}"] for r in rows],
        text=(0, 1, 2),
    )


def _effect(row: dict) -> str:
    """What a measurement is expected to bring."""
    if row.get("left") is not None:
        return f"{100.0 * row['left']:.2g} % of the uncertainty left"
    key = next(k for k in row if k.startswith("difference_"))
    size = f"{row[key]:.{'2g' if key.endswith('deg') else '2f'}} {unit_of(key)[1]}"
    return f"{size} RMS, {row['separation']:.0f} σ"


def show_points(planned, campaign: str, written: bool = False) -> None:
    """Positions to probe as text: what they bring, the table, what to do next."""
    data = planned.to_json()
    common.paragraph(
        f"{data['points']} points, each from a stated side, some with the spindle turned. With a noise of "
        f"{planned.noise * 1e6:g} µm for one centre, the location errors will be known so (95 %):"
    )
    _show_known("location error", data["location_errors"])
    there = f", in the place of that of {data['test']['name']}" if planned.there else ""
    _show_positions(
        data["test"],
        campaign,
        "" if written else f"Put the table above into {campaign}/campaign.toml{there}.",
        "the positions as a table",
        "Probe the sphere at each of them; write dx_um, dy_um, dz_um beside it.",
    )


def show_targets(planned, campaign: str, written: bool = False) -> None:
    """Planned targets as text: what they bring, the table, what to do next."""
    data, channel = planned.to_json(), planned.test.channel
    common.paragraph(
        f"{data['targets']} targets, {data['test']['runs']} runs from each side. With a noise of "
        f"{planned.noise / channel.size:g} {channel.unit} for one reading, this will be known so (95 %):"
    )
    _show_known("error", data["known"])
    line = "line_mm, where the beam runs" if "line_mm" in data["test"] else ""
    put = "" if written else f"Put the table above into {campaign}/campaign.toml{line and f'; correct {line}'}."
    _show_positions(
        data["test"],
        campaign,
        put or (line and f"Correct {line}, in {campaign}/campaign.toml."),
        "the targets in the order of measuring",
        "Measure. Overrun the first and the last target, so that each is approached from its side.",
    )


def _show_known(noun: str, known: list[dict]) -> None:
    """How well numbers are known today and after a test."""
    rows = []
    for k in known:
        halves = (expanded((-h, h)) for h in (k["class_half_width95"], k["half_width95"]))
        rows.append([k["id"], unit_of(k["parameter"])[1], *halves])
    common.table([noun, "unit", "today", "after"], rows, text=(0, 1, 2, 3))


def _show_positions(test: dict, campaign: str, first: str, what: str, measure: str) -> None:
    """The table of a planned test at rest, and what to do next.

    Args:
        test: The table.
        campaign: Folder of the campaign.
        first: What is to be done with the table; empty where it is done.
        what: ``mjsim nc`` writes.
        measure: The sentence on how it is measured.
    """
    name = test["name"]
    if first.startswith("Put"):
        click.echo(f"\n{test_text(test)}")
    else:
        click.echo(f'\n[[test]] "{name}" is in {campaign}/campaign.toml.')
    steps = (
        first,
        f"mjsim nc {campaign} --test {name} -o {name}.csv   writes {what}.",
        measure,
        f"mjsim import FILE --campaign {campaign} --points --test {name}",
        f"mjsim diagnose {campaign}",
    )
    common.next_steps(*(s for s in steps if s))
