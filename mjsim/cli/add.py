"""``mjsim add``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("add")
@common.campaign_argument
@click.argument("effect", shell_complete=common.effect_ids)
@common.machine_option
@click.option("--force", is_flag=True, help="Add the effect even if the residual gets larger with it.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, effect, machine, force, threads, as_is) -> None:
    """Fit EFFECT (an id such as backlash.A, or the path of your own effect file) to CAMPAIGN and put it into the
    machine file.

    Comments and order of the file stay. Its former text is kept in the campaign's .mjsim folder. An effect that makes
    the residual larger is refused.

    \b
    Example: mjsim add examples/hidden-backlash backlash.A
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.commands.edit import add

    c = read_campaign(campaign, as_is=as_is)
    with common.progress_bar() as progress:
        change = add(c, effect, machine, common.cores(threads), progress, force=force)
    data = change_json(change)
    if common.answered(data):
        return
    show_change("added", data)
    common.say(f"{change.machine.path} now has {change.id}; `mjsim remove {campaign} {change.id}` takes it out again")


def change_json(change) -> dict:
    """JSON of ``add`` and ``remove``."""
    after = change.after.to_json()
    unknown = {"rms_um": None, "tests": [{"rms_um": None}] * len(after["tests"])}
    before = change.before.to_json() if change.before else unknown
    return {
        "effect": {"id": change.id, "parameters": change.effect.values if change.effect else {}, "ci95": change.ci95},
        "machine_file": str(change.machine.path),
        "noise_um": after["noise_um"],
        "rms_before_um": before["rms_um"],
        "rms_after_um": after["rms_um"],
        "tests": [
            {"name": a["name"], "rms_before_um": b["rms_um"], "rms_after_um": a["rms_um"]}
            for b, a in zip(before["tests"], after["tests"], strict=True)
        ],
    }


def show_change(word: str, data: dict) -> None:
    """Table of the error before and after."""
    from mjsim.cli.diagnose import parameter_lines

    e = data["effect"]
    click.echo(f"{word} {e['id']}")
    for line in parameter_lines(e["parameters"], e["ci95"]):
        common.paragraph(line, "  ")
    rows = [[t["name"], _number(t["rms_before_um"]), _number(t["rms_after_um"])] for t in data["tests"]]
    click.echo()
    common.table(
        ["test", "RMS before µm", "after µm"],
        [*rows, ["all tests", _number(data["rms_before_um"]), _number(data["rms_after_um"])]],
    )
    click.echo(f"\nnoise {data['noise_um']:.3f} µm")


def _number(rms_um: float | None) -> str:
    return "unknown" if rms_um is None else f"{rms_um:.3f}"
