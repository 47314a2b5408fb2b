"""``mjsim plan``."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.cli.log_plan import NOTHING_OPEN, plan_measurement, show_recordings


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
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, between, threads, as_is, as_json, quiet) -> None:
    """Say which test to measure next: the one that best separates the effects that the data of CAMPAIGN cannot tell
    apart.

    Without --between the campaign is diagnosed first. If nothing is ambiguous, the test is one that shows an effect
    which this campaign cannot show. The best test separates two effects most clearly per minute of machine time.

    Where CAMPAIGN has axis logs, the answer is a motion to record: strokes, constant speeds, small steps or slow
    reversals, with the torque or a second velocity gain where positions are not enough. Where it has ball-bar tests as
    well, both instruments are compared.

    \b
    Example: mjsim plan examples/two-candidates --between servo_gain.C servo_delay.C
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.workflow.log_plan import recordings_beside
    from mjsim.workflow.plan import plan

    c = read_campaign(campaign, as_is=as_is)
    m = machine_of(c, machine)
    if c.logs.recorded:
        plan_measurement(c, m, between, common.cores(threads), as_json, quiet)
        return
    with common.progress_bar(quiet) as progress:
        result = plan(c, m, between, common.cores(threads), progress)
        recordings = recordings_beside(result, m) if result else []
    if as_json:
        common.print_json({**(result.to_json() if result else NOTHING_OPEN), "recordings": recordings})
        return
    if quiet:
        return
    if result is None:
        common.paragraph(
            "Nothing to separate: no effect is ambiguous, and every effect of the catalogue is testable with this "
            "campaign."
        )
        return
    show(result, campaign)
    show_recordings(recordings)


def show(result, campaign) -> None:
    """A plan as text: the verdict, the test as a table for campaign.toml, the runners-up, what to do next."""
    import tomlkit

    from mjsim.campaign.files import test_table

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
