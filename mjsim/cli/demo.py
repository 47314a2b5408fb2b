"""``mjsim demo``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.units import UM


@click.command("demo")
@common.folder_option(
    "--out", default=Path("mjsim-demo"), show_default=True, help="Folder for the working copy and the report."
)
@common.threads_option
@common.options
def command(out, threads) -> None:
    """Walk through a campaign with a hidden effect: compare, diagnose, add it, watch the error fall, report.

    \b
    Example: mjsim demo --out my-demo
    """
    from mjsim.cli.diagnose import show as show_diagnosis
    from mjsim.cli.history import show as show_ladder
    from mjsim.report.demo import first_look, prepare, walk

    folder = prepare(out)
    common.say(
        "A five-axis machine was measured with a ball bar in 13 tests. Something is wrong with it; its model does "
        "not know what."
    )
    common.say("When mjsim runs for the first time, it compiles the simulation, which takes some ten seconds.")
    with common.progress_bar() as progress:
        given, picture = first_look(folder, common.cores(threads), progress)
    difference = (
        f"Measured and simulated differ by {given.rms / UM:.3f} µm RMS. The noise is {given.noise / UM:.3f} µm."
    )
    common.say(f"{difference}\npicture: {picture.resolve()}")
    with common.progress_bar() as progress:
        demo = walk(folder, common.cores(threads), progress)
    data = demo.diagnosis.to_json()
    if common.answered(
        {
            "report": str(demo.report) if demo.report else None,
            "pictures": [str(picture), str(demo.picture)],
            "diagnosis": data,
            "steps": [{**vars(s), "effects": list(s.effects)} for s in demo.steps],
        }
    ):
        return
    show_diagnosis(data)
    click.echo("\nThe error ladder:")
    show_ladder(demo.steps)
    click.echo(f"\npictures: {picture.resolve()}")
    click.echo(f"          {demo.picture.resolve()}")
    click.echo(f"report:   {demo.report.resolve()}" if demo.report else demo.no_report)
