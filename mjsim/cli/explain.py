"""``mjsim explain``."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.cli.diagnose import parameter_lines, say_cached

#: Most effects that look alike on the terminal, and the cosine from which one is worth a line.
_MOST, _LEAST = 6, 0.2


@click.command("explain")
@common.campaign_argument
@click.argument("effect", shell_complete=common.effect_ids)
@common.machine_option
@common.file_option("--out", help="Plot file (default: .mjsim/explain-EFFECT.png in the campaign).")
@click.option("--no-plots", is_flag=True, help="Numbers only.")
@click.option("--force", is_flag=True, help="Replace the file named by --out.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, effect, machine, out, no_plots, force, threads, as_is) -> None:
    """Show EFFECT (an id such as backlash.A) in detail: its signature over the traces of CAMPAIGN, test by test, what
    else looks like it, and why the diagnosis has named it or not.

    \b
    Example: mjsim explain examples/hidden-backlash backlash.A
    """
    from mjsim.commands.explain import explain
    from mjsim.effects import registry
    from mjsim.io.files import check_writable
    from mjsim.plots.output import explanation_plot

    c, m = common.campaign_and_machine(campaign, machine, as_is=as_is)
    registry.effect_class(effect, m.chain)
    plot = None if no_plots else out or c.state_folder / f"explain-{effect}.png"
    if plot is not None:
        check_writable(plot, force or out is None)
    with common.progress_bar() as progress:
        result = explain(c, m, effect, common.cores(threads), progress)
    say_cached()
    if plot is not None and result.tests:
        explanation_plot(result, plot)
    data = result.to_json() | {"plot": str(plot) if plot is not None and result.tests else None}
    if common.answered(data):
        return
    show(data)
    if data["plot"]:
        common.say(f"plot in {plot}")


_ROLES = {
    "named": "Named",
    "calibrated": "Calibrated within its tolerance",
    "in the machine file": "In the machine file",
    "not named": "Not named",
    "not testable": "Not testable with these tests",
}


def show(data: dict) -> None:
    """An explanation's JSON as text."""
    from mjsim.commands.explain import DEPARTURES

    click.echo(f"{data['id']}: {data['title']}")
    common.paragraph(f"{_ROLES[data['role']]}. {data['reason']}")
    if data["ci95"]:
        click.echo("\n  estimate beside everything else in the model")
        for line in parameter_lines(data["parameters"], data["ci95"]):
            common.paragraph(line, "    ")
    if data["tests"]:
        departs = data["role"] in DEPARTURES
        fitted = "its departure from the file" if departs else "its fitted size"
        typical = "a typical departure from the file, to " if departs else "a typical size: "
        size = fitted if data["shown_at_fitted_size"] else typical + _values(data["shown_at"])
        click.echo()
        common.paragraph(f"Its signature in each test once the set-up is fitted, at {size}:")
        common.table(
            ["test", "signature RMS µm", "left without it µm", "left with it µm"],
            [[t["name"], *map(_um, (t["signature_um"], t["rms_without_um"], t["rms_with_um"]))] for t in data["tests"]],
        )
        common.paragraph(
            f"Set-up errors take up {100.0 * data['taken_up_by_setup']:.1f} % of its squared signature. The noise of "
            f"what is compared is {data['noise_um']:.3f} µm RMS."
        )
    alike = [row for row in data["alike"] if row["cosine"] >= _LEAST][:_MOST]
    if data["tests"]:
        click.echo()
        if alike:
            common.paragraph("What looks like it (cosine of the signatures once the set-up is fitted, 1 is the same):")
            common.table(["effect", "cosine"], [[row["id"], f"{row['cosine']:.2f}"] for row in alike])
        else:
            common.paragraph(f"Nothing looks like it: no other signature has a cosine of {_LEAST:g} or more with it.")


def _values(values: dict) -> str:
    return ", ".join(f"{k} = {v:.4g}" if isinstance(v, float) else f"{k} = {v}" for k, v in values.items())


def _um(x: float | None) -> str:
    return "–" if x is None else f"{x:.3f}"
