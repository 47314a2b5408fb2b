"""``mjsim nc``: write an NC program, read one, the feed that it really gives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli import nc_options as options
from mjsim.machine.chain import FIVE_AXIS, is_rotary


class _NC(click.Group):
    """``mjsim nc CAMPAIGN …`` writes; ``read`` and ``feed`` are named (a campaign folder of such a name is given as
    ./read).
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands:
            args = ["--help"] if set(args) & {"-h", "--help"} else ["write", *args]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        formatter.write_usage("mjsim nc", "CAMPAIGN --test NAME -o FILE.nc [OPTIONS]", "Usage: ")
        formatter.write_usage("mjsim nc", "CAMPAIGN -o FILE.zip [OPTIONS]", "       ")
        formatter.write_usage("mjsim nc read", "FILE.nc [OPTIONS]", "       ")
        formatter.write_usage("mjsim nc feed", "CAMPAIGN --test NAME [OPTIONS]", "       ")
        self.format_help_text(ctx, formatter)
        write.format_options(ctx, formatter)
        with formatter.section("Other commands (each has --help)"):
            formatter.write_dl([(f"mjsim nc {n}", self.commands[n].get_short_help_str(60)) for n in ("read", "feed")])


@click.group("nc", cls=_NC)
def command() -> None:
    """Write a test of CAMPAIGN as the five-axis NC program that a shop would run; read one as the commanded motion.

    Positions are X Y Z A C in mm and degrees; the zero point is where the A and C centrelines meet. Nothing is written
    where an axis would leave its travel. docs/nc.md tells what each dialect means.

    \b
    Example: mjsim nc examples/healthy --test cone15-x50-ccw -o cone.nc
    Example: mjsim nc read cone.nc
    Example: mjsim nc feed examples/healthy --test cone15-x50-ccw --cycle-ms 2
    """


@command.command("write", hidden=True)
@common.campaign_argument
@click.option("--test", "name", shell_complete=common.test_names, help="Test to write (default: all, as a ZIP file).")
@common.file_option("-o", "--out", required=True, help="The NC file, or the ZIP file.")
@options.written_dialect
@options.writing
@options.signs
@options.limits
@click.option("--number", type=int, default=1, show_default=True, help="Program number (fanuc).")
@options.probing
@options.force
@common.machine_option
@common.options
def write(campaign, name, out, limit, max_speed, force, machine, sphere, tip, clearance, safe, **how) -> None:
    """Write a test of CAMPAIGN as an NC program; of one that is measured at rest, the table of its positions. A sphere
    test in the dialect linuxcnc is a probing program.
    """
    from mjsim.campaign.machine_file import machine_of
    from mjsim.instruments.ball_bar.program import speed_warnings as ordinary_speed_warnings
    from mjsim.instruments.base import INSTRUMENTS
    from mjsim.instruments.sphere.measurement import SphereTest
    from mjsim.io.files import check_writable
    from mjsim.nc.dialects import FEEDS
    from mjsim.nc.write import write_nc

    if name is None:
        _write_all(campaign, out, machine, options.write_options(**how), limit, max_speed, force)
        return
    c, test = options.find_test(campaign, name, *(n for n, i in INSTRUMENTS.items() if i.at_rest))
    m = machine_of(c, machine)
    check_writable(out, force)
    if test.instrument == SphereTest.instrument and how["dialect"] == "linuxcnc":
        limits = options.allowed(limit, max_speed, test.chain)
        sizes = {"sphere": sphere, "tip": tip, "clearance": clearance, "safe": safe}
        _write_probing(test, out, sizes, limits, m.name, c.folder, force)
        return
    if INSTRUMENTS[test.instrument].at_rest:
        _write_positions(test, out, c, force)
        return
    written = write_nc(
        test, out, options.write_options(**how), options.allowed(limit, max_speed, test.chain), m.name, force
    )
    data = {
        "file": str(out),
        "test": test.recording,
        "dialect": how["dialect"],
        "feed": written.feed,
        "blocks": len(written.motion.seconds),
        "duration_s": written.motion.duration,
        "axes": axes_json(written.motion),
        "warnings": [*written.warnings, *([] if max_speed else ordinary_speed_warnings(test))],
    }
    _show(
        data,
        f"{len(written.motion.seconds)} blocks, {written.motion.duration:.3f} s, F: {FEEDS[written.feed]}",
    )
    if not common.wants_json():
        common.say(f"written to {out}")


def _write_all(campaign: Path, out: Path, machine: Path | None, how, limit, max_speed, force: bool) -> None:
    """``mjsim nc`` without a test: the programs of all tests in motion, as a ZIP file."""
    from mjsim.errors import InputError
    from mjsim.io.files import check_writable, write_whole
    from mjsim.nc.write import zipped_programs

    _check_ending(out, "all programs", ".zip")
    c, m = common.campaign_and_machine(campaign, machine, traces=False)
    c = c.in_motion
    if not c.tests:
        raise InputError(f"{c.folder / 'campaign.toml'}: no test in motion; --test names one that is measured at rest")
    check_writable(out, force)
    write_whole(out, zipped_programs(c.tests, how, options.allowed(limit, max_speed, m.chain), m.name), force)
    names = list(dict.fromkeys(map(options.recording_of, c.tests)))
    if not common.answered({"file": str(out), "tests": names, "dialect": how.dialect}):
        common.say(f"{len(names)} programs written to {out}")


def _check_ending(out: Path, what: str, ending: str) -> None:
    """Refuse the name of another kind of file for what is no NC program."""
    from mjsim.errors import InputError

    if out.suffix.lower() != ending:
        raise InputError(f"{out}: {what} are written as {ending}, not as {out.suffix or out.name!r}")


def _write_positions(test, out: Path, campaign, force: bool) -> None:
    """``mjsim nc`` of a test that is measured at rest: the table of its positions, to which what was found is added."""
    from mjsim.errors import InputError
    from mjsim.instruments.base import INSTRUMENTS
    from mjsim.io.files import write_whole

    _check_ending(out, f'the positions of "{test.name}", which is measured at rest,', ".csv")
    instrument = INSTRUMENTS[test.instrument]
    text = instrument.planned_text(test)
    if not text:
        raise InputError(
            f'{campaign.folder / "campaign.toml"}: [[test]] "{test.name}" says no positions; `mjsim plan '
            f"{campaign.folder}` with {instrument.plan_option} proposes some"
        )
    write_whole(out, text, force=force)
    rows, wanted = len(text.splitlines()) - 1, ", ".join(instrument.found_columns(test))
    if not common.answered({"file": str(out), "test": test.name, "points": rows}):
        common.say(f"{rows} positions written to {out}; add what is found: {wanted}")


def _write_probing(test, out: Path, sizes_mm: dict, limits, machine: str, campaign, force: bool) -> None:
    """``mjsim nc`` of a sphere test for LinuxCNC: the program that probes it.

    Args:
        test: With its positions.
        out: The file.
        sizes_mm: Attributes of :class:`mjsim.nc.probing.Probing` in mm.
        limits: Of the axes.
        machine: Name of the machine.
        campaign: Folder of the campaign.
        force: Replace a file that is there.
    """
    from mjsim.errors import InputError
    from mjsim.instruments.sphere.measurement import sides_of_points
    from mjsim.io.files import write_whole
    from mjsim.nc.probing import Probing, probing_program
    from mjsim.units import MM

    for name, value in sizes_mm.items():
        if value is None:  # of another diameter, the probe would hit the sphere
            raise InputError(f"--{name} is missing: a program that probes needs the diameters of sphere and tip, mm")
        if not 0.0 < value <= 1000.0:
            raise InputError(f"--{name} {value:g}; allowed: above 0, up to 1000 mm")
    text, _ = probing_program(test, Probing(**{k: v * MM for k, v in sizes_mm.items()}), limits, machine)
    write_whole(out, text, force=force)
    touches = sum(map(len, sides_of_points(test)))
    if not common.answered({"file": str(out), "test": test.name, "points": len(test.angles), "touches": touches}):
        common.say(
            f"{len(test.angles)} positions with {touches} touches written to {out}, for a sphere of "
            f"{sizes_mm['sphere']:g} mm and a tip of {sizes_mm['tip']:g} mm; LinuxCNC writes what it finds into "
            f"{test.name}.txt: mjsim import {test.name}.txt --campaign {campaign} --points --test {test.name}"
        )


@command.command("read", short_help="Read one as the motion that it commands.")
@click.argument("file", type=common.path_type())
@options.reading
@options.limits
@common.path_option("--machine", help="Machine file whose axes the program moves.")
@common.path_option("--campaign", help="Compare with a test of this campaign.")
@click.option("--test", "name", shell_complete=common.test_names, help="That test.")
@common.file_option("-o", "--out", help="CSV: time_s and the five axes at every block's end.")
@options.force
@common.options
def read(file, dialect, turned, rollover, skip, ini, limit, max_speed, machine, campaign, name, out, force) -> None:
    """Read an NC program as the motion that it commands: blocks, time, travel and speed of the axes.

    Words that change no motion are listed. What changes the motion and is not understood is refused by its name.

    With --campaign and --test also how far it is from that test's own program, at the same angle. `program = "FILE"` in
    the test's table of campaign.toml makes every command use it.

    \b
    Example: mjsim nc read cone.nc --campaign examples/healthy \\
                 --test cone15-x50-ccw
    """
    import numpy as np

    from mjsim.campaign.machine_file import read_machine
    from mjsim.instruments.ball_bar.follow import deviation
    from mjsim.instruments.ball_bar.program import Program, driven_by
    from mjsim.io.files import check_writable, write_whole
    from mjsim.nc.limits import check_travel, speed_warnings
    from mjsim.nc.read import motion_csv, read_nc

    if (campaign is None) != (name is None):
        raise click.UsageError("--campaign and --test belong together")
    test = None if campaign is None else replace(options.find_test(campaign, name)[1], commanded=None)
    chain = FIVE_AXIS if test is None else test.chain
    if machine is not None:
        chain = read_machine(machine).chain
    limits = options.allowed(limit, max_speed, chain)
    if machine is not None and test is not None and chain != test.chain:
        raise click.UsageError("--machine and --campaign name different axes")
    nc = read_nc(file, chain=chain, **options.how_read(dialect, turned, rollover, skip, ini))
    check_travel(nc.motion, limits, nc.place)
    compared = None
    if test is not None:
        compared = {"test": test.name, **deviation(driven_by(test, nc.motion, str(file)), Program(test))}
    if out:
        check_writable(out, force)
        write_whole(out, motion_csv(nc.motion), force)
    timed = nc.motion.seconds[nc.motion.cuts] if nc.motion.cuts.any() else nc.motion.seconds
    data = {
        "file": str(file),
        "dialect": nc.dialect,
        "feed": nc.feed,
        "tool_centre_point": bool(np.any(nc.motion.tip)),
        "paths": len(nc.motion.paths),
        "rests": 0 if nc.motion.stops is None else int(nc.motion.stops.sum()),
        "blocks": int(nc.motion.cuts.sum()),
        "other_moves": int((~nc.motion.cuts).sum()),
        "duration_s": nc.motion.duration,
        "block_ms": {"min": timed.min() * 1e3, "max": timed.max() * 1e3},
        "axes": axes_json(nc.motion),
        "unnamed_axes": list(nc.unnamed),
        "deviation": compared,
        "csv": str(out) if out else None,
        "ignored": {word: {"first_line": line, "count": n} for word, (line, n) in nc.ignored.items()},
        "warnings": [*nc.warnings, *speed_warnings(nc.motion, limits, nc.place)],
    }
    said = f"dialect {nc.dialect}: {data['blocks']} blocks, {nc.motion.duration:.3f} s, F: {nc.feed or 'none'}"
    said += f", {data['other_moves']} rapid moves and dwells" if data["other_moves"] else ""
    said += f", {data['paths']} cutting paths" if data["paths"] > 1 else ""
    said += ", tool centre point" if data["tool_centre_point"] else ""
    said += f", axes at rest {data['rests']} times" if data["rests"] else ""
    _show(data, said)
    if common.wants_json() or common.is_quiet():
        return
    if nc.ignored:
        words = ", ".join(f"{w} (line {line}{f', {n} times' if n > 1 else ''})" for w, (line, n) in nc.ignored.items())
        common.paragraph(f"words that change no motion: {words}")
    if nc.unnamed:
        common.paragraph(f"no word names {', '.join(nc.unnamed)}: taken as 0 throughout")
    if compared:
        click.echo()
        common.paragraph(
            f"against the program of test {compared['test']}, largest at the same angle: "
            + ", ".join(f"{a} {v:.3f} µm" for a, v in compared["position_um"].items())
            + ", "
            + ", ".join(f"{a} {v:.2f} µrad" for a, v in compared["angle_urad"].items())
            + f", time {compared['time_ms']:.3f} ms; mean feed {compared['feed_mm_min']:.3f} mm/min; reading of an "
            f"ideal machine "
            f"{compared['reading_um'][0]:.3f} to {compared['reading_um'][1]:.3f} µm"
        )
    if out:
        common.say(f"written to {out}")


def axes_json(motion) -> dict:
    """Travel and speed of each axis: from, to, min, max in mm or °; slowest, mean and fastest feed block in mm/min or
    °/min.
    """
    import numpy as np

    from mjsim.nc.limits import scale

    rows = {}
    cuts = motion.cuts if motion.cuts.any() else ~motion.cuts
    speeds, seconds = np.abs(motion.speeds())[cuts], motion.seconds[cuts]
    for i, a in enumerate(motion.chain.letters):
        q, v = motion.axes[:, i] / scale(a), speeds[:, i] / scale(a) * 60.0
        mean = float(v @ seconds / seconds.sum())
        rows[a] = {
            "from": float(q[0]),
            "to": float(q[-1]),
            "min": float(q.min()),
            "max": float(q.max()),
            "min_speed_per_min": float(v.min()),
            "mean_speed_per_min": mean,
            "max_speed_per_min": float(v.max()),
        }
    return rows


def _show(data: dict, said: str) -> None:
    if not common.answered(data):
        common.paragraph(said)
        common.table(
            ["axis", "from", "to", "lowest", "highest", "mean /min", "max /min"],
            [
                [f"{a} {'°' if is_rotary(a) else 'mm'}", *(f"{r[k]:.3f}" for k in ("from", "to", "min", "max")),
                 *(f"{r[k]:.1f}" for k in ("mean_speed_per_min", "max_speed_per_min"))]
                for a, r in data["axes"].items()
            ],
        )  # fmt: skip
    for warning in data["warnings"]:
        common.say(f"warning: {warning}")


@command.command("feed", short_help="The feed that its blocks really give.")
@common.campaign_argument
@click.option("--test", "name", required=True, shell_complete=common.test_names, help="Test that the program is for.")
@common.path_option("--program", help="NC file (default: what `mjsim nc` would write).")
@options.reading
@options.writing
@click.option(
    "--cycle-ms", type=common.NUMBER, default=0.0, show_default=True, help="Interpolation cycle; 0: continuous."
)
@click.option(
    "--block-ms",
    type=common.NUMBER,
    default=0.0,
    show_default=True,
    help="Shortest time that the control needs for a block.",
)
@click.option("--whole-cycles", is_flag=True, help="Every block lasts whole cycles, rounded up.")
@click.option(
    "--like",
    type=click.Choice(["linuxcnc"]),
    help="The block times of this control, in place of the three options above.",
)
@options.acceleration
@common.path_option("--record", help="Hold the model against this axis log of a control, with all axes.")
@common.file_option("-o", "--out", help="CSV: time_s, phi_deg, feed_mm_min, reading_um.")
@common.file_option("--plot", help="Picture of feed and reading over φ (.png or .svg).")
@options.force
@common.options
def feed(
    campaign, name, program, cycle_ms, block_ms, whole_cycles, like, acceleration, record, out, plot, force, **how
) -> None:  # fmt: skip
    """The peripheral feed that block-wise interpolation of a test's program really gives, and what its straight blocks
    do to the reading.

    The control modelled moves the axes linearly within each block, without look-ahead and smoothing. `--like linuxcnc`
    keeps the block times of LinuxCNC: whole cycles, rounded down, where a rotary axis turns.

    \b
    Example: mjsim nc feed examples/healthy --test cone15-x50-ccw \\
                 --cycle-ms 2 --whole-cycles --plot feed.png
    """
    from mjsim.campaign.driven import on_path, read_record
    from mjsim.io.files import check_writable, write_all
    from mjsim.linuxcnc.configuration import Settings, check_settings
    from mjsim.nc.control import Control, feed_report
    from mjsim.nc.read import parse_nc, read_nc
    from mjsim.nc.write import nc_program

    test = replace(options.find_test(campaign, name)[1], commanded=None)
    for file in (out, plot):
        if file:
            check_writable(file, force)
    reading = options.how_read(how["dialect"], how["turned"], how["rollover"], how.pop("skip"), how.pop("ini"))
    if program:
        nc = read_nc(program, chain=test.chain, **reading)
    else:
        how["rollover"] = bool(how["rollover"])
        how["dialect"] = reading["dialect"] = how["dialect"] or "fanuc"
        text = nc_program(test, options.write_options(**how)).text
        nc = parse_nc(text, Path(f"{test.name}.nc"), chain=test.chain, **reading)
    control = Control(cycle_ms * 1e-3, block_ms * 1e-3, whole_cycles)
    if like:
        if cycle_ms or block_ms or whole_cycles:
            raise click.UsageError("--like has the block times of a control; leave out --cycle-ms and the like")
        settings = Settings(dict(acceleration))
        check_settings(settings, test.chain)
        control = settings.model(test.chain)
    elif acceleration:
        raise click.UsageError("--acceleration needs --like linuxcnc")
    report = feed_report(test, nc.motion, control, str(nc.path))
    held = (
        feed_report(test, on_path(read_record(record, test.chain), test, record), None, str(record)) if record else None
    )
    data = {
        "test": test.name,
        "program": str(program) if program else None,
        "dialect": nc.dialect,
        "blocks": len(nc.motion.seconds),
    }
    data |= {"cycle_ms": cycle_ms, "block_ms": block_ms, "whole_cycles": whole_cycles, "like": like}
    data |= {**report.to_json(), **({"record": held.to_json()} if held else {})}
    pages: dict[Path, str | bytes] = {out: report.to_csv()} if out else {}
    if plot:
        from mjsim.plots.feed import feed_figure
        from mjsim.plots.save import encoded

        title = (
            f"{test.name}: {len(nc.motion.seconds)} blocks, {data['mean_block_ms']:.3g} ms each; mean feed "
            f"{data['mean_mm_min']:.1f} mm/min"
        )
        figure = feed_figure(report.phi_deg, report.feed_mm_min, report.reading_um, data["nominal_mm_min"], title)
        pages[plot] = encoded(figure, plot)
    write_all(pages, force)
    if common.answered(data | {"csv": str(out) if out else None, "plot": str(plot) if plot else None}):
        return
    first, second = _rows(report.to_json(), data["blocks"]), _rows(held.to_json(), None) if held else None
    if second is None:
        common.table(["", ""], first, text=(0, 1))
    else:
        rows = [[*a, b[1]] for a, b in zip(first, second, strict=True)]
        common.table(["", "model", "record"], rows, text=(0, 1, 2))
    for file in (out, plot):
        if file:
            common.say(f"written to {file}")


def _rows(r: dict, blocks: int | None) -> list[list[str]]:
    """The figures of one report; a record has no blocks."""
    bar = r["reading_um"]
    return [
        [
            "feed, mm/min",
            f"nominal {r['nominal_mm_min']:.2f}, mean {r['mean_mm_min']:.2f}, {r['min_mm_min']:.2f} to "
            f"{r['max_mm_min']:.2f}",
        ],
        ["ripple", f"{r['ripple_percent']:.3f} % of the mean, lowest to highest"],
        ["duration", f"{r['duration_s']:.3f} s, ideal {r['ideal_duration_s']:.3f} s"],
        [
            "blocks",
            "-"
            if blocks is None
            else f"{blocks}, shortest {r['shortest_block_ms']:.3f} ms, mean {r['mean_block_ms']:.3f} ms",
        ],
        [
            "reading, µm",
            f"{bar['min']:.3f} to {bar['max']:.3f}, mean {bar['mean']:.3f} (chords and rounding, ideal machine)",
        ],
        ["position, µm", ", ".join(f"{a} {v:.3f}" for a, v in r["position_um"].items()) + " off the path at most"],
        ["angle, µrad", ", ".join(f"{a} {v:.2f}" for a, v in r["angle_urad"].items()) + " off the path at most"],
        ["speed jumps", ", ".join(f"{a} {v:.2f}" for a, v in r["speed_jump_per_min"].items()) + " mm/min or °/min"],
    ]
