"""What a probed sphere shows, as text."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.import_show import show_remarks
from mjsim.digits import decimals_of, estimate, fixed, interval
from mjsim.machine.chain import is_rotary

_SOURCES = {"repeated points": "from repeated points", "stated": "as stated", "assumed": "assumed: nobody states it"}


def show_points(data: dict, found: dict[str, dict]) -> None:
    """The part of a diagnosis that is of a probed sphere.

    Args:
        data: Its JSON.
        found: Parameters and 95 % intervals of all fitted effects, by id: dicts with ``parameters`` and ``ci95``.
    """
    click.echo()
    common.paragraph(
        f"probed sphere: residual RMS {data['rms_before_um']:.3f} µm as given, {data['rms_after_um']:.3f} µm with what "
        f"was fitted; noise of one centre {data['noise_um']:.3f} µm, {_SOURCES[data['noise_source']]}"
    )
    if data["left_um"] > 0.0:
        common.paragraph(
            f"What is in no model is {data['left_um']:.2f} µm; the probability that it is more than the noise is "
            f"{100.0 * data['misfit']:.0f} %. The intervals have grown by it."
        )
        if data["misfit"] >= 0.5:
            common.paragraph(
                "Either the probe repeats worse than the noise says (measure some points twice, or state "
                "repeatability_um), or the machine has errors that are in no model: trust the numbers within their "
                "intervals, and look for the cause."
            )
    if data["joint"]:
        common.paragraph(data["joint"])
    rows = []
    for row in data["classical"]:
        known = found.get(row["id"])
        name = next(iter(known["ci95"])) if known else None
        if known is None or name is None:
            continue
        ends = known["ci95"][name]
        unit = "µrad" if name.endswith("urad") else "µm"
        numbers = [estimate(known["parameters"][name], ends, "+"), interval(ends, sign="+")]
        rows.append([row["id"], unit, *numbers, fixed(row["value"], decimals_of(None, ends), "+")])
    if rows:
        click.echo()
        common.table(["location error", "unit", "fitted", "95 % interval", "from circles"], rows, text=(0, 1, 3))
        common.paragraph(
            "From circles: centre and direction of each axis as the cycles of controls compute them, with linear axes "
            "and probe taken for perfect."
        )
    click.echo()
    common.table(
        ["set-up and probe", "value", "95 % interval"],
        [[r["name"], estimate(r["value"], r["ci95"], "+"), interval(r["ci95"], sign="+")] for r in data["set_up"]],
        text=(0, 2),
    )


def import_all(campaign: Path, pairs, signals, sphere, options, force, preview, as_json, quiet) -> None:
    """``mjsim import --points``."""
    from mjsim.importing.points import import_points

    done = [import_points(campaign, f, test, tuple(signals), sphere, options, force, preview) for f, test in pairs]
    if as_json:
        common.print_json({"campaign": str(campaign), "points": [d.to_json() for d in done]})
        return
    if quiet:
        return
    for d in done:
        data = d.to_json()
        common.paragraph(
            f"{d.source.name} → {d.target}: test {data['test']}, {data['points']} points, deviations up to "
            f"{data['largest_um']:g} µm"
        )
        common.table(
            ["column", "is", "unit"],
            [[str(c["column"]), c["is"], c["unit"] or "–"] for c in data["columns"]],
            text=(1, 2),
        )
        click.echo()
        for line in data["first_rows"]:
            click.echo(f"  {line}")
        show_remarks(d.notes, d.questions)
    if preview:
        common.say("preview: nothing was written", quiet)


def show_plan(planned, campaign: str) -> None:
    """Positions to probe as text: what they bring, the table, what to do next."""
    data = planned.to_json()
    rows = []
    for row in data["location_errors"]:
        unit = "µrad" if is_rotary(row["id"].partition(".")[2][1]) else "µm"
        rows.append([row["id"], unit, f"± {row['class_half_width95']:g}", f"± {row['half_width95']:g}"])
    common.paragraph(
        f"{data['points']} points, each from a stated side, some with the spindle turned. With a noise of "
        f"{planned.noise * 1e6:g} µm for one centre, the location errors will be known so (95 %):"
    )
    common.table(["location error", "unit", "today", "after"], rows, text=(0, 1, 2, 3))
    click.echo("\n[[test]]")
    for key, value in data["test"].items():
        if isinstance(value, list) and value and isinstance(value[0], list):
            lines = [str(value[i : i + 8])[1:-1] for i in range(0, len(value), 8)]
            click.echo(f"{key} = [\n  " + ",\n  ".join(lines) + ",\n]")
        else:
            click.echo(f"{key} = {value!r}".replace("'", '"'))
    name = data["test"]["name"]
    click.echo("\nNext:")
    for number, step in enumerate(
        (
            f"Put the table above into {campaign}/campaign.toml"
            + (f", in the place of that of {name}." if planned.there else "."),
            f"mjsim nc {campaign} --test {name} -o {name}.csv   writes the positions as a table.",
            "Probe the sphere at each of them; write dx_um, dy_um, dz_um beside it.",
            f"mjsim import FILE --campaign {campaign} --points --test {name}",
            f"mjsim diagnose {campaign}",
        ),
        start=1,
    ):
        click.echo(f"  {number}. {step}")


def write_positions(test, out: Path, campaign, force: bool, as_json: bool, quiet: bool) -> None:
    """``mjsim nc`` of a probed sphere: the table of the positions, to which what was found is added."""
    from mjsim.errors import InputError
    from mjsim.instruments.sphere.files import positions_text
    from mjsim.io.files import write_whole

    if not test.angles:
        raise InputError(
            f'{campaign.folder / "campaign.toml"}: [[test]] "{test.name}" has no angles_deg; `mjsim plan '
            f"{campaign.folder} --points 30` proposes some"
        )
    write_whole(out, positions_text(test), force=force)
    if as_json:
        common.print_json({"file": str(out), "test": test.name, "points": len(test.angles)})
    else:
        common.say(f"{len(test.angles)} positions written to {out}; add the columns dx_um, dy_um, dz_um", quiet)
