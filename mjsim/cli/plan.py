"""``mjsim plan``."""

from __future__ import annotations

import click

from mjsim.cli import common

#: JSON of a plan where nothing is to be separated.
_NOTHING_OPEN = {"between": None, "test": None, "difference_um": None}
_INSTRUMENTS = {"axis_log": "axis log", "ball_bar": "ball bar"}


@click.command("plan")
@common.campaign_argument
@common.machine_option
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
    "--sphere",
    nargs=3,
    type=common.NUMBER,
    metavar="X Y Z",
    default=None,
    help="With --points: centre of the sphere, mm in the work frame.",
)
@click.option(
    "--range",
    "ranges",
    type=(str, common.NUMBER, common.NUMBER),
    multiple=True,
    metavar="AXIS LOW HIGH",
    help="With --points: travel of a rotary axis, degrees.",
)
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, between, points, sphere, ranges, threads, as_is, as_json, quiet) -> None:
    """Say which test to measure next: the one that best separates the effects that the data of CAMPAIGN cannot tell
    apart.

    Without --between the campaign is diagnosed first. If nothing is ambiguous, the test is one that shows an effect
    which this campaign cannot show. The best test separates two effects most clearly per minute of machine time.

    Where CAMPAIGN has axis logs, the answer is a motion to record: strokes, constant speeds, small steps or slow
    reversals, with the torque or a second velocity gain where positions are not enough. Where it has ball-bar tests as
    well, both instruments are compared.

    With --points, the answer is a [[test]] with the positions at which to probe a sphere: those after which the
    location errors of the rotary axes are known best.

    \b
    Example: mjsim plan examples/two-candidates --between servo_gain.C servo_delay.C
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.instruments.axis_log.measurement import LogTest
    from mjsim.workflow.plan import plan

    if (sphere or ranges) and points is None:
        raise click.UsageError("--sphere and --range need --points")
    c = read_campaign(campaign, as_is=as_is)
    m = machine_of(c, machine)
    if points is not None:
        from mjsim.cli.points import show_plan
        from mjsim.units import DEG, MM
        from mjsim.workflow.plan_points import plan_points

        if between is not None:
            raise click.UsageError("--points and --between exclude each other")
        ends = {a: (low * DEG, high * DEG) for a, low, high in ranges}
        planned = plan_points(c, m, points, tuple(v * MM for v in sphere) if sphere else None, ends)
        if as_json:
            common.print_json(planned.to_json())
        elif not quiet:
            show_plan(planned, str(campaign))
        return
    with common.progress_bar(quiet) as progress:
        result = plan(c, m, between, common.cores(threads), progress)
    recorded = LogTest.instrument in c.measured_parts
    if as_json:
        common.print_json(result.to_json() if result else _NOTHING_OPEN | ({} if recorded else {"recordings": []}))
    elif quiet:
        return
    elif result is None:
        known = (
            "the logs know every number of the drives"
            if recorded
            else "every effect of the catalogue is testable with this campaign"
        )
        common.paragraph(f"Nothing to separate: no effect is ambiguous, and {known}.")
    elif result.beside:
        show(result.bars, campaign)
        show_recordings(result.to_json()["recordings"])
    else:
        show_recording(result.to_json(), str(c.folder))


def show(result, campaign) -> None:
    """A plan as text: the verdict, the test as a table for campaign.toml, the runners-up, what to do next."""
    import tomlkit

    from mjsim.instruments.ball_bar.files import test_table

    data, name = result.to_json(), result.best.test.name
    a, b = data["between"]
    verdict = "decides" if data["decides"] else "does not decide, but comes nearest"
    aim = f"whether the machine has {a}" if b == "nothing" else f"between {a} and {b}"
    common.paragraph(
        f"This test {verdict} {aim}: {name}. It takes {data['minutes']:.1f} min with handling. The expected "
        f"difference is "
        f"{data['difference_um']:.2f} µm RMS; separation over the whole test: {data['separation']:.0f} σ."
    )
    common.paragraph(data["reason"])
    speeds = ", ".join(f"{axis} {speed:.0f} {unit}" for axis, (speed, unit) in data["axis_speeds"].items())
    common.paragraph(f"Highest axis speeds: {speeds}.")
    click.echo("\n[[test]]\n" + tomlkit.dumps(test_table(result.best.test)).rstrip() + "\n")
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
    click.echo("\nNext:")
    for number, step in enumerate(
        (
            f"Paste the table above into {campaign}/campaign.toml.",
            f"mjsim nc {campaign} --test {name} -o {name}.nc",
            "Run the program on the machine, and record it with the ball bar.",
            f"mjsim import FILE --campaign {campaign} --test {name}",
            f"mjsim diagnose {campaign}",
        ),
        start=1,
    ):
        click.echo(f"  {number}. {step}")


def show_recording(data: dict, folder: str) -> None:
    """A plan's JSON as text."""
    import tomlkit

    verdict = "decides" if data["decides"] else "does not decide, but comes nearest"
    between = data["between"]
    known = data.get("left") is not None
    aim = f"what only a combination is known of: {', '.join(between)}" if known else f"between {' and '.join(between)}"
    log = data["instrument"] == "axis_log"
    common.paragraph(
        f"This {'recording' if log else 'ball-bar test'} {verdict} {aim}: {data['test']['name']}. It takes "
        f"{data['minutes']:.1f} min with handling. {_effect(data)}."
    )
    common.paragraph(data["reason"])
    if log:
        common.paragraph(data["motion"])
        click.echo("\nNC program, from where the axis stands:\n")
        for line in data["program"]:
            click.echo(f"  {line}")
    click.echo()
    rows = [
        [_INSTRUMENTS[r["instrument"]], r["test"]["name"], _effect(r), f"{r['minutes']:.1f}"]
        for r in [data, *data["runners_up"]]
    ]
    common.table(["instrument", "test", "expected", "time min"], rows, text=(0, 1, 2))
    name = data["test"]["name"]
    click.echo("\nNext:")
    if log:
        more = ", and its torque or current" if "torque" in name else ""
        click.echo(f"  1. Run the program. Record command and position of the axis{more}.")
        click.echo(f"  2. mjsim import FILE --campaign {folder} --log --test {name}")
    else:
        click.echo("  1. Measure the ball-bar test; its table for campaign.toml:\n")
        click.echo("[[test]]\n" + tomlkit.dumps(data["test"]).rstrip() + "\n")
        click.echo(f"  2. mjsim import FILE --campaign {folder} --test {name}")
    click.echo(f"  3. mjsim diagnose {folder}")


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


def _effect(row: dict) -> str:
    """What a measurement is expected to bring."""
    if row.get("left") is not None:
        return f"{100.0 * row['left']:.2g} % of the uncertainty left"
    size = f"{row['difference_um']:.2f} µm" if "difference_um" in row else f"{row['difference_deg']:.2g} °"
    return f"{size} RMS, {row['separation']:.0f} σ"
