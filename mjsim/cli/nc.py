"""``mjsim nc``: write an NC program, read one, the feed that it really gives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from mjsim.cli import common, nc_feed
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
@click.option("--test", "name", required=True, shell_complete=common.test_names, help="Test to write.")
@click.option("-o", "--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="The NC file.")
@options.written_dialect
@options.writing
@options.signs
@options.limits
@click.option("--number", type=int, default=1, show_default=True, help="Program number (fanuc).")
@options.probing
@options.force
@common.machine_option
@common.options
def write(
    campaign, name, out, limit, max_speed, force, machine, as_json, quiet, sphere, tip, clearance, safe, **how
) -> None:
    """Write a test of CAMPAIGN as an NC program; of one that is measured at rest, the table of its positions. A sphere
    test in the dialect linuxcnc is a probing program.
    """
    from mjsim.campaign.machine_file import machine_of
    from mjsim.instruments.ball_bar.speed import speed_warnings as ordinary_speed_warnings
    from mjsim.instruments.base import INSTRUMENTS
    from mjsim.instruments.sphere.measurement import SphereTest
    from mjsim.io.files import check_writable
    from mjsim.nc.dialects import FEEDS
    from mjsim.nc.write import write_nc

    c, test = options.find_test(campaign, name, *(n for n, i in INSTRUMENTS.items() if i.at_rest))
    m = machine_of(c, machine)
    check_writable(out, force)
    if test.instrument == SphereTest.instrument and how["dialect"] == "linuxcnc":
        from mjsim.cli.points import write_probing

        limits = options.allowed(limit, max_speed, test.chain)
        sizes = {"sphere": sphere, "tip": tip, "clearance": clearance, "safe": safe}
        write_probing(test, out, sizes, limits, m.name, c.folder, force, as_json, quiet)
        return
    if INSTRUMENTS[test.instrument].at_rest:
        from mjsim.cli.points import write_positions

        write_positions(test, out, c, force, as_json, quiet)
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
        as_json,
        quiet,
    )
    if not as_json:
        common.say(f"written to {out}", quiet)


@command.command("read", short_help="Read one as the motion that it commands.")
@click.argument("file", type=click.Path(path_type=Path))
@options.reading
@options.limits
@click.option("--machine", type=click.Path(path_type=Path), help="Machine file whose axes the program moves.")
@click.option("--campaign", type=click.Path(path_type=Path), help="Compare with a test of this campaign.")
@click.option("--test", "name", shell_complete=common.test_names, help="That test.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="CSV: time_s and the five axes at every block's end.",
)
@options.force
@common.options
def read(
    file, dialect, turned, rollover, skip, ini, limit, max_speed, machine, campaign, name, out, force, as_json, quiet
) -> None:
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
        "dialect": dialect,
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
    said = f"{data['blocks']} blocks, {nc.motion.duration:.3f} s, F: {nc.feed or 'none'}"
    said += f", {data['other_moves']} rapid moves and dwells" if data["other_moves"] else ""
    said += f", {data['paths']} cutting paths" if data["paths"] > 1 else ""
    said += ", tool centre point" if data["tool_centre_point"] else ""
    said += f", axes at rest {data['rests']} times" if data["rests"] else ""
    _show(data, said, as_json, quiet)
    if as_json or quiet:
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
        common.say(f"written to {out}", quiet)


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


def _show(data: dict, said: str, as_json: bool, quiet: bool) -> None:
    if as_json:
        common.print_json(data)
    elif not quiet:
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
        common.say(f"warning: {warning}", quiet)


command.add_command(nc_feed.command)
