"""``mjsim import``. The command's name is a keyword: the module is loaded by name only."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common, import_options
from mjsim.cli.import_show import model_effects, runs_json, show_features, show_runs, show_traces


@click.command("import")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option("--campaign", type=click.Path(path_type=Path), required=True, help="Folder of the campaign.")
@import_options.test
@import_options.columns
@import_options.angles
@click.option("--log", "as_log", is_flag=True, help="The files are axis logs: command and actual positions.")
@click.option(
    "--points", "as_points", is_flag=True, help="The files were measured at rest: a probed sphere, a laser, a level."
)
@common.sphere_option("With --points, for a new test: centre of the sphere, mm in the work frame.")
@click.option(
    "--signal",
    "signals",
    multiple=True,
    metavar="AXIS_SIGNAL=COLUMN:UNIT",
    help="With --log or --points: a column, X_actual=3:mm, dx=5:um.",
)
@click.option(
    "--file-axis", "axes", multiple=True, metavar="NAME=LETTER", help="With --log: what the file calls an axis, 7=C."
)
@click.option("--controller", help="With --log: name of the controller that ran.")
@click.option("--preview", is_flag=True, help="Show what would be done; write nothing.")
@click.option("--no-check", is_flag=True, help="Do not compare the trace's size with the model's.")
@click.option(
    "--show", "show", is_flag=True, help="What was imported of other systems' findings, beside the model's effects."
)
@click.option("--force", is_flag=True, help="Replace traces that are there.")
@common.options
def command(
    files,
    campaign,
    as_log,
    as_points,
    sphere,
    signals,
    axes,
    controller,
    preview,
    no_check,
    show,
    force,
    as_json,
    quiet,
    **given,
) -> None:
    """Bring measurement FILES of other systems into a campaign.

    Tables as text (CSV, TXT): separator, decimal sign and byte order mark are found. Columns and units come from the
    header or from options. Feed, bar length, plane and direction are read from English and German headers. The trace
    goes to traces/; a test that campaign.toml does not have yet is added. FILE=TEST names the test of each of several
    files.

    Renishaw .b5r: header and diagnosed features go to imported/ and are shown beside mjsim's findings. Its recorded
    runs become the traces of the tests that fit the header, or that FILE=TEST names. The format is not published: look
    at --preview first.

    With --log, FILES are axis logs: tables as text, spreadsheets (.xlsx), exports of TwinCAT Scope, SINUMERIK traces
    (.xml) and Edge captures (.json), TNCscope (.sco), halsampler, MATLAB (.mat), EPICS, PHD2 guide logs. Columns are
    found by words such as soll, ist, command and actual beside the letter of an axis. --signal says it otherwise:
    command, actual, load (second encoder), lag (command less actual), velocity_command, velocity, torque, force,
    current, control.

    With --points, FILES were measured at rest. Of a sphere they have one row for each centre: angles of the rotary
    axes, and dx, dy, dz (measured less commanded) or x_measured, y_measured, z_measured. Of an R-test, along a motion,
    they have time, dx, dy, dz. Of a laser, scale or level
    they have target and deviation or measured; or one row a target, and columns up_1, down_1, up_2 ... --signal names
    columns that the header does not.

    \b
    Example: mjsim import run1.csv --campaign my-machine --test circle-xy-ccw
             mjsim import a.csv=circle-xy-ccw b.csv=circle-xy-cw \\
                 --campaign my-machine
             mjsim import run2.txt --campaign my-machine --angle 1
                 --deviation 2 --deviation-unit mm --plane YZ --direction CW
                 --feed 1000 --length 100 --table-ball 0 0 155 --preview
    """
    from mjsim.errors import InputError
    from mjsim.importing.b5r import looks_like_xml
    from mjsim.importing.b5r_runs import read_recorded
    from mjsim.importing.features import import_features, imported_features, read_features
    from mjsim.importing.importer import import_traces
    from mjsim.importing.into_campaign import campaign_file
    from mjsim.io.files import check_writable

    if not files and not show:
        raise click.UsageError("Missing argument 'FILES...' (or --show)")
    name, keys, options = import_options.read(given)
    if as_log:
        from dataclasses import replace

        from mjsim.cli.logs import import_logs

        if any("=" not in a for a in axes):
            raise click.UsageError("--file-axis: allowed: NAME=LETTER, such as 7=C")
        options = replace(options, axes=tuple((n, letter) for n, _, letter in (a.rpartition("=") for a in axes)))
        pairs = [(f, t or name) for f, t in map(_file_and_test, files)]
        import_logs(campaign, pairs, signals, controller, options, force, preview, as_json, quiet)
        return
    if controller or axes or (signals and not as_points):
        raise click.UsageError("--signal needs --log or --points, --file-axis and --controller need --log")
    if as_points:
        from mjsim.cli.points import import_all

        if keys:
            raise click.UsageError(f"{import_options.options()[next(iter(keys))]} has no meaning with --points")
        pairs = [(f, t or name) for f, t in map(_file_and_test, files)]
        import_all(campaign, pairs, signals, sphere or None, options, force, preview, as_json, quiet)
        return
    if sphere:
        raise click.UsageError("--sphere needs --points")
    pairs = [_file_and_test(f) for f in files]
    other = list(dict.fromkeys(f for f, _ in pairs if looks_like_xml(f)))
    if name and any(test for _, test in pairs):
        raise click.UsageError("--test and FILE=TEST exclude each other")
    campaign_file(campaign)
    recorded = [read_recorded(f) for f in other]
    empty = [r.path for r in recorded if not r.runs]
    for path, test in pairs:
        if path in empty and (keys or name or test):
            option = "--test" if name else f"the test {test!r}" if test else import_options.options()[next(iter(keys))]
            raise InputError(
                f"{path}: brings no trace, so that {option} has no meaning; allowed: --preview, --show, --force"
            )
    # features are read, and their places looked at, before anything is written: one wrong file stops all
    read = read_features(campaign, other)
    for path in () if preview else read:
        check_writable(path, force)
    pairs = [(f, test) for f, test in pairs if f not in empty]
    names = name or [test for _, test in pairs]
    traces = (
        import_traces(campaign, [f for f, _ in pairs], names, keys, options, force, preview, not no_check)
        if pairs
        else []
    )
    if other and not preview:
        import_features(campaign, other, force)
    known = imported_features(campaign) if show else list(read.values())
    rows = show_features(known, model_effects(campaign), silent=as_json or quiet) if known or show else []
    if as_json:
        headers = [{"source": i.source, **i.header} for i in known]
        runs = [run for r in recorded for run in runs_json(r, options)]
        found = {"traces": [t.to_json() for t in traces], "runs": runs, "headers": headers, "features": rows}
        common.print_json({"campaign": str(campaign), **found})
        return
    if not quiet:
        for r in recorded:
            made = [t for t in traces if t.source == r.path]
            show_runs(r, options, made, named=bool(name or dict(pairs).get(r.path)))
        show_traces(traces)
    for t in traces:
        for question in t.questions:
            common.say(f"{t.source.name}: {question}", quiet)
    if preview:
        common.say("preview: nothing was written", quiet)
    elif other:
        common.say(f"features kept in {Path(campaign_file(campaign)).parent / 'imported'}", quiet)


def _file_and_test(given: Path) -> tuple[Path, str | None]:
    """``FILE=TEST`` as a file and the name of its test; a file whose own name has a ``=`` stays one."""
    file, equals, test = str(given).rpartition("=")
    return (Path(file), test) if equals and file and test and not given.exists() else (given, None)
