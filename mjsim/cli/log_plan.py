"""``mjsim plan`` where axis logs were recorded."""

from __future__ import annotations

import click

from mjsim.cli import common

#: JSON of a plan where nothing is to be separated.
NOTHING_OPEN = {"between": None, "test": None, "difference_um": None}
_INSTRUMENTS = {"axis_log": "axis log", "ball_bar": "ball bar"}


def plan_measurement(campaign, machine, between, threads: int, as_json: bool, quiet: bool) -> None:
    """Say which recording or ball-bar test to make next."""
    from mjsim.workflow.log_plan import plan_measurement

    with common.progress_bar(quiet) as progress:
        result = plan_measurement(campaign, machine, between, threads, progress)
    if as_json:
        common.print_json(result.to_json() if result else NOTHING_OPEN)
    elif quiet:
        return
    elif result is None:
        common.paragraph("Nothing to separate: no effect is ambiguous, and the logs know every number of the drives.")
    else:
        show(result.to_json(), str(campaign.folder))


def show(data: dict, folder: str) -> None:
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
