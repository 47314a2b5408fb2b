"""How imported traces and other systems' findings are shown; ``compare`` and ``diagnose`` show the findings too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click

from mjsim.cli import common


def show_traces(traces: list) -> None:
    """A summary of every imported trace."""
    for t in traces:
        d = t.to_json()
        new = (
            "a new test in campaign.toml"
            if d["new_test"]
            else "its trace is new in campaign.toml"
            if d["added"]
            else ""
        )
        click.echo(f"{t.source.name} → test {d['test']}" + (f" ({new})" if new else ""))
        missing = f", {d['samples_missing']} of them missing or beyond the range" if d["samples_missing"] else ""
        common.paragraph(
            f"{d['samples']} samples{missing}, {d['rate_Hz']:g} Hz; {d['duration_s']:.2f} s, the program "
            f"{d['program_s']:.2f} s",
            "  ",
        )
        common.paragraph(
            f"{d['min_um']:.2f} to {d['max_um']:.2f} µm, RMS about the mean {d['rms_um']:.2f} µm; in the file: "
            f"{d['unit']}",
            "  ",
        )
        for note in d["notes"]:
            common.paragraph(f"- {note}", "  ")
        click.echo()
        rows = [[f"{r['time_s']:.6f}", f"{r['phi_deg']:.4f}", f"{r['deviation_um']:.4f}"] for r in d["first_rows"]]
        common.table(["time_s", "φ °", "deviation_um"], rows, text=())
        click.echo()


def runs_json(recorded, options) -> list[dict]:
    """The runs of a ``.b5r`` file as plain data; ``um_per_reading`` is ``None`` where the unit is not known."""
    from mjsim.errors import InputError

    out = []
    for run in recorded.runs:
        try:
            um, why = recorded.unit(run, options)
        except InputError as error:
            um, why = None, str(error)
        out.append(
            {
                "source": str(recorded.path),
                "direction": run.direction,
                "readings": len(run.readings),
                "min": float(run.readings.min()),
                "max": float(run.readings.max()),
                "without_eccentricity": run.spread,
                "circularity_um": run.circularity,
                "um_per_reading": um,
                "unit": why,
            }
        )
    return out


def show_runs(recorded, options, traces: list, named: bool) -> None:
    """What a ``.b5r`` file holds as runs, and which of them found no test; nothing of that where the user named the
    test.
    """
    runs = runs_json(recorded, options)
    if not runs:
        return
    click.echo(f"{recorded.path.name}: {len(runs)} recorded run{'s' if len(runs) > 1 else ''}")
    rows = [
        [
            r["direction"],
            str(r["readings"]),
            f"{r['min']:.4g} to {r['max']:.4g}",
            f"{r['without_eccentricity']:.4g}",
            _of_file(r),
        ]
        for r in runs
    ]
    common.table(["run", "readings", "range in the file", "without eccentricity", "circularity"], rows, text=(0,))
    for r in runs:
        common.paragraph(f"- {r['direction']}: {r['unit']}", "  ")
    if recorded.said:
        common.paragraph(f"- also in the file, not used: {'; '.join(recorded.said)}", "  ")
    common.paragraph(
        "- no real file has been tried: check the range, the first angle and the sense of the traces", "  "
    )
    directions = {t.test.direction for t in traces}
    left = [r["direction"] for r in runs if r["direction"] not in directions]
    if left and not named:
        common.paragraph(
            f"- no trace made of {' and '.join(left)}: no test of the campaign has the plane, direction, length and "
            "feed of the file. FILE=TEST names one. --table-ball and the keys that the file lacks describe a new one.",
            "  ",
        )
    click.echo()


def _of_file(run: dict) -> str:
    return "–" if run["circularity_um"] is None else f"{run['circularity_um']:.4g} µm"


def show_features(imported: list, found: dict, circles: Iterable = (), silent: bool = False) -> list[dict]:
    """Table of other systems' findings beside mjsim's; the rows as plain data.

    Args:
        imported: what :func:`mjsim.importing.features.imported_features` gives. found: id -> parameters, of the effects
            to compare with.
        circles: circular errors, see :func:`mjsim.importing.features.beside`. silent: print nothing.
    """
    from mjsim.importing.features import beside

    rows = beside(imported, found, circles)
    if silent:
        return rows
    if not rows:
        click.echo("no findings of other systems were imported")
        return rows
    for i in imported:
        said = ", ".join(f"{k.replace('_', ' ')} {v}" for k, v in i.header.items())
        common.paragraph(f"{i.source}: {said or 'no header'}")
    known = [r for r in rows if r["causes"] is not None]
    click.echo()
    common.table(
        ["feature", "run", "value", "cause in mjsim", "mjsim's own"],
        [
            [_short(r), r["run"] or "–", _value(r), ", ".join(r["causes"]) or "–", ", ".join(r["mjsim"]) or "–"]
            for r in known
        ],
        text=(0, 1, 3, 4),
    )
    unknown = [f"{r['feature']} {_value(r)}" for r in rows if r["causes"] is None]
    if unknown:
        common.paragraph(f"kept, although their meaning is not known: {', '.join(unknown)}")
    common.paragraph(
        "The values are the other system's, as its file has them; its signs are not published and are not "
        "compared. What such files look "
        "like is known from public parsers only: no real file has been tried."
    )
    click.echo()
    return rows


def _short(row: dict) -> str:
    return row["feature"].removeprefix("AF_").lower().replace("_", " ")


def _value(row: dict) -> str:
    value = row["value"]
    return f"{value:g} {row['unit']}".strip() if isinstance(value, (int, float)) else str(value)


def model_effects(campaign) -> dict:
    """Effects of the campaign's machine; none where it cannot be read, as an import needs no machine."""
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.errors import InputError

    try:
        return {e.id: e.values for e in read_machine(read_campaign(campaign, traces=False).machine_file).effects}
    except InputError:
        return {}


def show_remarks(notes: Sequence[str], questions: Sequence[str]) -> None:
    """What an import says of a file, and what the user has to look at."""
    for note in notes:
        common.paragraph(note, "  ")
    for question in questions:
        common.paragraph(f"look at this: {question}")
