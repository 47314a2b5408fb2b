"""What a probed sphere shows, as text."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.import_show import show_remarks
from mjsim.digits import decimals_of, estimate, expanded, fixed, interval
from mjsim.instruments.base import INSTRUMENTS, Instrument
from mjsim.machine.chain import is_rotary
from mjsim.units import unit_of

_SOURCES = {"repeated points": "from repeated points", "stated": "as stated", "assumed": "assumed: nobody states it"}


def show_points(data: dict, found: dict[str, dict], instrument: Instrument, first: bool = True) -> None:
    """The part of a diagnosis that is of an instrument that measures at rest.

    Args:
        data: Its JSON.
        instrument: That instrument.
        first: Whether no other one came before, which has said what is common to all of them.
        found: Parameters and 95 % intervals of all fitted effects, by id: dicts with ``parameters`` and ``ci95``.
    """
    click.echo()
    common.paragraph(
        f"{instrument.noun}: residual RMS {data['rms_before_um']:.3f} µm as given, {data['rms_after_um']:.3f} µm with "
        f"what was fitted; noise of one value {data['noise_um']:.3f} µm, {_SOURCES[data['noise_source']]}"
    )
    if data["left_um"] > 0.0 and first:
        common.paragraph(
            f"What is in no model is {data['left_um']:.2f} µm; the probability that it is more than the noise is "
            f"{100.0 * data['misfit']:.0f} %. The intervals have grown by it."
        )
        if data["misfit"] >= 0.5:
            common.paragraph(
                "Either the values repeat worse than the noise says (measure some of them twice, or state "
                "repeatability_um), or the machine has errors that are in no model: trust the numbers within their "
                "intervals, and look for the cause."
            )
    if data["joint"] and first:
        common.paragraph(data["joint"])
    rows = []
    for row in data["classical"]:
        known = found.get(row["id"])
        name = next(iter(known["ci95"])) if known else None
        if known is None or name is None:
            continue
        ends = known["ci95"][name]
        numbers = [estimate(known["parameters"][name], ends, "+"), interval(ends, sign="+")]
        rows.append([row["id"], unit_of(name)[1], *numbers, fixed(row["value"], decimals_of(None, ends), "+")])
    if rows:
        click.echo()
        head = ["error", "unit", "fitted", "95 % interval", instrument.by_itself_noun]
        common.table(head, rows, text=(0, 1, 3))
        common.paragraph(instrument.by_itself_note)
    click.echo()
    common.table(
        ["set-up and instrument", "value", "95 % interval"],
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
        largest = next((k, v) for k, v in data.items() if k.startswith("largest_"))
        common.paragraph(
            f"{d.source.name} → {d.target}: test {data['test']}, {data['points']} values, deviations up to "
            f"{largest[1]:g} {unit_of(largest[0])[1]}"
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
        rows.append([row["id"], unit, *(expanded((-h, h)) for h in (row["class_half_width95"], row["half_width95"]))])
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


def show_targets(planned, campaign: str) -> None:
    """Planned targets as text: what they bring, the table, what to do next."""
    import tomlkit

    data = planned.to_json()
    common.paragraph(
        f"{data['targets']} targets, {data['test']['runs']} runs from each side. With a noise of {planned.noise:g} "
        f"{planned.unit} for one reading, this will be known so (95 %):"
    )
    rows = []
    for row in data["known"]:
        unit = unit_of(row["parameter"])[1]
        rows.append([row["id"], unit, *(expanded((-h, h)) for h in (row["class_half_width95"], row["half_width95"]))])
    common.table(["error", "unit", "today", "after"], rows, text=(0, 1, 2, 3))
    click.echo("\n[[test]]\n" + tomlkit.dumps(data["test"]).rstrip())
    name = data["test"]["name"]
    click.echo("\nNext:")
    for number, step in enumerate(
        (
            f"Put the table above into {campaign}/campaign.toml"
            + ("; correct line_mm, where the beam runs." if "line_mm" in data["test"] else "."),
            f"mjsim nc {campaign} --test {name} -o {name}.csv   writes the targets in the order of measuring.",
            "Measure. Overrun the first and the last target, so that each is approached from its side.",
            f"mjsim import FILE --campaign {campaign} --points --test {name}",
            f"mjsim diagnose {campaign}",
        ),
        start=1,
    ):
        click.echo(f"  {number}. {step}")


def write_positions(test, out: Path, campaign, force: bool, as_json: bool, quiet: bool) -> None:
    """``mjsim nc`` of a test that is measured at rest: the table of its positions, to which what was found is added."""
    from mjsim.errors import InputError
    from mjsim.io.files import write_whole

    instrument = INSTRUMENTS[test.instrument]
    text = instrument.planned_text(test)
    if not text:
        raise InputError(
            f'{campaign.folder / "campaign.toml"}: [[test]] "{test.name}" says no positions; `mjsim plan '
            f"{campaign.folder}` with {instrument.plan_option} proposes some"
        )
    write_whole(out, text, force=force)
    rows, wanted = len(text.splitlines()) - 1, ", ".join(instrument.found_columns(test))
    if as_json:
        common.print_json({"file": str(out), "test": test.name, "points": rows})
    else:
        common.say(f"{rows} positions written to {out}; add what is found: {wanted}", quiet)


def write_probing(
    test, out: Path, sizes_mm: dict, limits, machine: str, campaign, force: bool, as_json: bool, quiet: bool
) -> None:
    """``mjsim nc`` of a sphere test for LinuxCNC: the program that probes it.

    Args:
        test: With its positions.
        out: The file.
        sizes_mm: Attributes of :class:`mjsim.nc.probing.Probing` in mm.
        limits: Of the axes.
        machine: Name of the machine.
        campaign: Folder of the campaign.
        force: Replace a file that is there.
        as_json: Print JSON.
        quiet: Print nothing.
    """
    from mjsim.errors import InputError
    from mjsim.instruments.sphere.touches import sides_of_points
    from mjsim.io.files import write_whole
    from mjsim.nc.probing import Probing, probing_program
    from mjsim.units import MM

    for name, value in sizes_mm.items():
        if not 0.0 < value <= 1000.0:
            raise InputError(f"--{name} {value:g}; allowed: above 0, up to 1000 mm")
    text, _ = probing_program(test, Probing(**{k: v * MM for k, v in sizes_mm.items()}), limits, machine)
    write_whole(out, text, force=force)
    touches = sum(map(len, sides_of_points(test)))
    if as_json:
        common.print_json({"file": str(out), "test": test.name, "points": len(test.angles), "touches": touches})
        return
    common.say(
        f"{len(test.angles)} positions with {touches} touches written to {out}; LinuxCNC writes what it finds into "
        f"{test.name}.txt: mjsim import {test.name}.txt --campaign {campaign} --points --test {test.name}",
        quiet,
    )
