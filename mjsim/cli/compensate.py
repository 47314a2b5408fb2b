"""``mjsim compensate``."""

from __future__ import annotations

import click

from mjsim.cli import common

#: Controls that corrections are written for.
CONTROLS = ("linuxcnc", "sinumerik", "heidenhain", "fanuc", "csv")


@click.command("compensate")
@common.campaign_argument
@click.option("--control", type=click.Choice(CONTROLS), required=True, help="Control that gets the corrections.")
@common.folder_option("-o", "--out", required=True, help="Folder for the files.")
@common.machine_option
@click.option(
    "--programs",
    type=click.Choice(("tcp", "axes")),
    default="tcp",
    show_default=True,
    help="Forecast for programs with tool centre point control, or with axis positions.",
)
@common.range_option("Positions that the tables of an axis cover, mm or degrees (default: those of the tests).")
@click.option(
    "--detection-unit",
    type=click.FloatRange(1e-7, 0.1),
    default=1e-4,
    show_default=True,
    help="Of Fanuc, mm or degrees.",
)
@click.option(
    "--acceleration",
    type=(str, common.NUMBER),
    multiple=True,
    metavar="AXIS VALUE",
    help="MAX_ACCELERATION of LinuxCNC, mm/s² or °/s².",
)
@click.option(
    "--friction",
    is_flag=True,
    help="Tune the friction (quadrant) compensation as well; the tests have to be measured with it off.",
)
@click.option("--force", is_flag=True, help="Replace files that are there.")
@common.as_is_option
@common.threads_option
@common.options
def command(
    campaign, control, out, machine, programs, ranges, detection_unit, acceleration, friction, force, threads, as_is
) -> None:
    """Turn what was found about the machine of CAMPAIGN into what its control can take, and say what it will bring.

    It uses the diagnosis that is kept beside the campaign, or makes one. Ambiguous effects and sizes below their own
    uncertainty are left out. What a table cannot express is listed.

    \b
    Example: mjsim compensate examples/hidden-backlash --control linuxcnc -o corrections
    """
    from mjsim.compensation.compensate import compensate, write_compensation
    from mjsim.compensation.controls import Settings
    from mjsim.compensation.tables import scale
    from mjsim.errors import InputError
    from mjsim.plots.forecast import forecast_figure
    from mjsim.plots.save import encode

    c, m = common.campaign_and_machine(campaign, machine, as_is=as_is)
    chain = m.chain
    for axis in [r[0] for r in ranges] + [a[0] for a in acceleration]:
        if axis not in chain.letters:
            raise InputError(f"axis {axis!r}; allowed: {', '.join(chain.letters)}")
    if any(a <= 0 for _, a in acceleration):
        raise InputError("--acceleration: allowed: values above 0")
    settings = Settings(detection_unit, {a: v * scale(chain, a) for a, v in acceleration}, programs == "tcp")
    spans = {a: (low * scale(chain, a), high * scale(chain, a)) for a, low, high in ranges}
    with common.progress_bar() as progress:
        result = compensate(c, m, control, settings, spans, common.cores(threads), progress, friction=friction)
    picture = encode(forecast_figure(result.forecast), "png")
    paths = write_compensation(result, out, force, {"forecast.png": picture})
    data = result.to_json()
    if common.answered({**data, "written": [str(p) for p in paths]}):
        return
    show(data, result)
    common.say(f"files in {out}: {', '.join(p.name for p in paths)}")


def show(data: dict, result) -> None:
    """A compensation as text: what is corrected, what is left, the forecast."""
    from mjsim.compensation.result import pulse_lines, size_lines

    done = {row["id"] for row in data["corrects"]}
    click.echo("Corrected:")
    for w in result.worth:
        if w.effect.key in done:
            for line in size_lines(w):
                common.paragraph(line.strip(), "  ")
    for line in pulse_lines(result.corrections):
        common.paragraph(line.strip(), "  ")
    if not done and not result.corrections.pulses:
        click.echo("  nothing")
    if data["leaves"]:
        click.echo("\nLeft:")
        for row in data["leaves"]:
            common.paragraph(f"{row['id']}: {row['reason']}", "  ")
    if data["unexplained"]:
        common.paragraph(f"Unexplained: {data['unexplained']}")
    f = data["forecast"]
    click.echo(f"\nForecast, RMS about the set-up, programs with {f['programs']}:")
    rows = [[t["name"], *(f"{t[k]:.3f}" for k in ("before_um", "after_um", "perfect_um"))] for t in f["tests"]]
    rows.append(["all tests", *(f"{f[k]:.3f}" for k in ("rms_before_um", "rms_after_um", "rms_perfect_um"))])
    common.table(["test", "as it is µm", "forecast µm", "perfect µm"], rows)
    if f["gone"] is not None:
        common.paragraph(f"{100.0 * f['gone']:.1f} % of the squared error of the corrected causes will be gone.")
