"""``mjsim import``. The command's name is a keyword: the module is loaded by name only."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.import_show import model_effects, runs_json, show_features, show_remarks, show_runs, show_traces
from mjsim.cli.nc_options import kept
from mjsim.importing.into_campaign import options as option_names
from mjsim.instruments.ball_bar.kinds import KINDS, all_keys
from mjsim.machine.chain import CHAINS
from mjsim.units import unit_of


def _key(name: str, **more):
    return click.option(option_names()[name], name, **more)


def _specific():
    """Options for the keys that belong to some kinds of tests only, as the kinds describe them."""
    for name, keys in all_keys().items():
        words = sorted({w for k in keys for chain in CHAINS for w in k.words_of(chain)})  # the campaign checks its own
        kinds = [k.name for k in KINDS.values() if name in (key.name for key in k.keys)]
        value = click.Choice(words) if words else common.NUMBER if keys[0].unit is not None else int
        yield click.option(
            keys[0].flag, name, type=value, help=f"{', '.join(kinds)}: {keys[0].help[:1].lower()}{keys[0].help[1:]}"
        )


_TEST = kept(
    click.option(
        "--test", "name", shell_complete=common.test_names, help="Its test in campaign.toml (default: the file's name)."
    ),
    _key("kind", type=click.Choice(sorted(KINDS)), help="For a new test, as all below down to --spindle."),
    *_specific(),
    _key(
        "table_ball_mm",
        nargs=3,
        type=common.NUMBER,
        metavar="X Y Z",
        default=None,
        help="Table ball, mm from the origin of the work frame.",
    ),
    _key("bar_length_mm", type=common.NUMBER, help="Length of the bar, mm."),
    _key("feed_mm_min", type=common.NUMBER, help="Feed on the circle, mm/min."),
    _key("setup", help="Word that tests of one set-up share."),
    _key("started_s", type=common.NUMBER, help="Start on the campaign's clock, s."),
    _key("spindle_deg", type=common.NUMBER, help="Angle at which the spindle is held, ° (default 0)."),
)
_COLUMNS = kept(
    click.option("--time", metavar="COLUMN", help="Column of the time: name or number from 1."),
    click.option("--angle", metavar="COLUMN", help="Column of the angle, in place of a time."),
    click.option("--rate", type=common.NUMBER, metavar="HZ", help="Samples per second, where there is neither."),
    click.option("--deviation", metavar="COLUMN", help="Column of the deviation."),
    click.option("--time-unit", type=click.Choice(["s", "ms", "us"])),
    click.option("--angle-unit", type=click.Choice(["deg", "rad"])),
    click.option("--deviation-unit", type=click.Choice(["um", "mm", "inch", "mil", "uin", "V"])),
    click.option(
        "--scale", "um_per_volt", type=common.NUMBER, metavar="UM", help="µm per volt, with --deviation-unit V."
    ),
    click.option(
        "--sign",
        type=click.Choice(["outward", "inward"]),
        default="outward",
        help="What is positive (default: outward).",
    ),
    click.option("--absolute/--relative", "absolute", default=None, help="Lengths of the bar, or deviations."),
    click.option(
        "--clock", type=click.Choice(["program", "trace"]), help="Time counts from the program's start, or the trace's."
    ),
    click.option("--separator", type=click.Choice(["semicolon", "tab", "comma", "space"])),
    click.option("--decimal", type=click.Choice(["point", "comma"])),
    click.option(
        "--rows", nargs=2, type=int, metavar="FIRST LAST", default=None, help="Only these lines: one run of several."
    ),
)
_ANGLES = kept(
    click.option(
        "--angle-zero", type=common.NUMBER, default=0.0, metavar="DEG", help="The file's angle at φ = 0 (default 0)."
    ),
    click.option("--angle-sense", type=click.Choice(["ccw", "cw"]), help="Which way the file's angle counts."),
    click.option("--start-angle", type=common.NUMBER, metavar="DEG", help="φ of the first sample, where it is not 0."),
)


@click.command("import")
@click.argument("files", nargs=-1, type=common.path_type())
@common.path_option("--campaign", required=True, help="Folder of the campaign.")
@_TEST
@_COLUMNS
@_ANGLES
@click.option("--log", "as_log", is_flag=True, help="The files are axis logs: command and actual positions.")
@click.option(
    "--points", "as_points", is_flag=True, help="The files were measured at rest: a probed sphere, a laser, a level."
)
@click.option("--temperatures", "as_temperatures", is_flag=True, help="The file is the record of a temperature logger.")
@click.option(
    "--start",
    metavar="TIME",
    help="With --temperatures: date and time of 0 s of the campaign, as the file writes them.",
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
    as_temperatures,
    start,
    sphere,
    signals,
    axes,
    controller,
    preview,
    no_check,
    show,
    force,
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

    With --temperatures, the file is the record of a temperature logger: dates and times, times of day, or seconds, and
    a column for each sensor, in °C, °F or K. It becomes temperature.csv. --start says from which instant the campaign
    counts.

    \b
    Example: mjsim import run1.csv --campaign my-machine --test circle-xy-ccw
             mjsim import a.csv=circle-xy-ccw b.csv=circle-xy-cw \\
                 --campaign my-machine
             mjsim import run2.txt --campaign my-machine --angle 1
                 --deviation 2 --deviation-unit mm --plane YZ --direction CW
                 --feed 1000 --length 100 --table-ball 0 0 155 --preview
             mjsim import logger.csv --campaign my-machine --temperatures
                 --start "2026-03-02 08:00:00"
    """
    from mjsim.errors import InputError
    from mjsim.importing.b5r import looks_like_xml, read_recorded
    from mjsim.importing.features import import_features, imported_features, read_features
    from mjsim.importing.importer import import_traces
    from mjsim.importing.into_campaign import campaign_file
    from mjsim.io.files import check_writable

    if not files and not show:
        raise click.UsageError("Missing argument 'FILES...' (or --show)")
    name, keys, options = _read(given)
    if as_log:
        from dataclasses import replace

        if any("=" not in a for a in axes):
            raise click.UsageError("--file-axis: allowed: NAME=LETTER, such as 7=C")
        options = replace(options, axes=tuple((n, letter) for n, _, letter in (a.rpartition("=") for a in axes)))
        pairs = [(f, t or name) for f, t in map(_file_and_test, files)]
        _import_logs(campaign, pairs, signals, controller, options, force, preview)
        return
    if controller or axes or (signals and not as_points):
        raise click.UsageError("--signal needs --log or --points, --file-axis and --controller need --log")
    if as_points:
        if keys:
            raise click.UsageError(f"{option_names()[next(iter(keys))]} has no meaning with --points")
        pairs = [(f, t or name) for f, t in map(_file_and_test, files)]
        _import_points(campaign, pairs, signals, sphere or None, options, force, preview)
        return
    if sphere:
        raise click.UsageError("--sphere needs --points")
    if start is not None and not as_temperatures:
        raise click.UsageError("--start needs --temperatures")
    if as_temperatures:
        if len(files) != 1 or name or keys:
            raise click.UsageError("--temperatures takes one FILE, and no test")
        _import_temperatures(campaign, files[0], start, options, force, preview)
        return
    pairs = [_file_and_test(f) for f in files]
    other = list(dict.fromkeys(f for f, _ in pairs if looks_like_xml(f)))
    if name and any(test for _, test in pairs):
        raise click.UsageError("--test and FILE=TEST exclude each other")
    campaign_file(campaign)
    recorded = [read_recorded(f) for f in other]
    empty = [r.path for r in recorded if not r.runs]
    for path, test in pairs:
        if path in empty and (keys or name or test):
            option = "--test" if name else f"the test {test!r}" if test else option_names()[next(iter(keys))]
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
    rows = (
        show_features(known, model_effects(campaign), silent=common.wants_json() or common.is_quiet())
        if known or show
        else []
    )
    headers = [{"source": i.source, **i.header} for i in known]
    runs = [run for r in recorded for run in runs_json(r, options)]
    found = {"traces": [t.to_json() for t in traces], "runs": runs, "headers": headers, "features": rows}
    if common.wants_json():
        common.print_json({"campaign": str(campaign), **found})
        return
    if not common.is_quiet():
        for r in recorded:
            made = [t for t in traces if t.source == r.path]
            show_runs(r, options, made, named=bool(name or dict(pairs).get(r.path)))
        show_traces(traces)
    for t in traces:
        for question in t.questions:
            common.say(f"{t.source.name}: {question}")
    if preview:
        common.say("preview: nothing was written")
    elif other:
        common.say(f"features kept in {Path(campaign_file(campaign)).parent / 'imported'}")


def _file_and_test(given: Path) -> tuple[Path, str | None]:
    """``FILE=TEST`` as a file and the name of its test; a file whose own name has a ``=`` stays one."""
    file, equals, test = str(given).rpartition("=")
    return (Path(file), test) if equals and file and test and not given.exists() else (given, None)


def _import_logs(campaign: Path, pairs, signals, controller, options, force, preview) -> None:
    """``mjsim import --log``."""
    from mjsim.importing.logs import import_log

    done = [
        import_log(campaign, source, test, tuple(signals), controller, options, force, preview)
        for source, test in pairs
    ]
    if common.answered({"campaign": str(campaign), "logs": [d.to_json() for d in done]}):
        return
    for d in done:
        more = f", {len(d.tests)} logs, {d.tests[0]} to {d.tests[-1]}" if len(d.tests) > 1 else f": test {d.test}"
        common.paragraph(f"{d.source.name} → {d.target}{more}, {d.samples} samples at {d.rate:.6g} Hz")
        rows = [[str(c.place + 1), c.axis or "–", c.signal, c.unit or "?"] for c in d.columns]
        common.table(["column", "axis", "signal", "unit"], rows, text=(1, 2, 3))
        show_remarks(d.notes, d.questions)
    if preview:
        common.say("preview: nothing was written")


def _import_points(campaign: Path, pairs, signals, sphere, options, force, preview) -> None:
    """``mjsim import --points``."""
    from mjsim.importing.points import import_points

    done = [import_points(campaign, f, test, tuple(signals), sphere, options, force, preview) for f, test in pairs]
    if common.answered({"campaign": str(campaign), "points": [d.to_json() for d in done]}):
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
        common.say("preview: nothing was written")


def _import_temperatures(campaign: Path, source, start, options, force, preview) -> None:
    """``mjsim import --temperatures``."""
    from mjsim.importing.temperatures import import_temperatures

    done = import_temperatures(campaign, source, start, options, force, preview)
    data = done.to_json()
    if common.answered({"campaign": str(campaign), "temperatures": data}):
        return
    common.paragraph(
        f"{source.name} → {done.target}: {data['samples']} samples from {data['from_s']:g} to {data['to_s']:g} s"
    )
    rows = [[name, f"{low:.2f}", f"{high:.2f}"] for name, (low, high) in data["sensors_degC"].items()]
    common.table(["sensor", "from °C", "to °C"], rows)
    show_remarks(done.notes, ())
    if preview:
        common.say("preview: nothing was written")


def _read(given: dict):
    """Test name, keys of its table, and reading options from the command line's values."""
    from mjsim.importing.reading import Options
    from mjsim.units import DEG

    name = given.pop("name")
    keys = {k: given.pop(k) for k in option_names() if k in given}
    keys = {k: list(v) if isinstance(v, tuple) else v for k, v in keys.items() if v is not None}
    inward = given.pop("sign") == "inward"
    zero, start = given.pop("angle_zero") * DEG, given.pop("start_angle")
    return (
        name,
        keys,
        Options(**given, inward=inward, angle_zero=zero, start_angle=None if start is None else start * DEG),
    )
