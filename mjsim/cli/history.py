"""``mjsim history``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("history")
@common.campaign_argument
@common.file_option("--out", help="Plot file (default: .mjsim/ladder.png in the campaign).")
@click.option("--force", is_flag=True, help="Replace the file named by --out.")
@common.options
def command(campaign, out, force) -> None:
    """The ladder of CAMPAIGN: every model tried, its effects, its error per test.

    \b
    Example: mjsim history examples/hidden-backlash
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.commands.history import read_history
    from mjsim.errors import InputError
    from mjsim.io.files import check_writable
    from mjsim.plots.output import ladder_plot

    c = read_campaign(campaign, traces=False)
    steps = read_history(c)
    if not steps:
        raise InputError(
            f"{c.folder}: no model has been tried yet; `mjsim add {campaign} EFFECT` records the first steps"
        )
    plot = out or c.state_folder / "ladder.png"
    check_writable(plot, force or out is None)
    ladder_plot(steps, plot)
    rows = [{**{k: v for k, v in vars(s).items() if k != "model"}, "effects": list(s.effects)} for s in steps]
    if common.answered({"campaign": c.name, "steps": rows, "plot": str(plot)}):
        return
    show(steps)
    common.say(f"plot in {plot}")


def show(steps: list) -> None:
    """The ladder as a table."""
    common.table(
        ["model", "effects", "RMS µm", "× noise", "worst test"],
        [[s.label, str(len(s.effects)), f"{s.rms_um:.3f}", _times(s), _worst(s)] for s in steps],
    )


def _times(step) -> str:
    return f"{step.rms_um / step.noise_um:.2f}" if step.noise_um else "–"


def _worst(step) -> str:
    if not step.tests:
        return "–"
    name = max(step.tests, key=step.tests.get)
    return f"{step.tests[name]:.3f} {name}"
