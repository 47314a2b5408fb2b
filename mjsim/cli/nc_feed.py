"""``mjsim nc feed``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli import nc_options as options


@click.command("feed", short_help="The feed that its blocks really give.")
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
def command(
    campaign, name, program, cycle_ms, block_ms, whole_cycles, like, acceleration, record, out, plot, force, as_json,
    quiet, **how,
) -> None:  # fmt: skip
    """The peripheral feed that block-wise interpolation of a test's program really gives, and what its straight blocks
    do to the reading.

    The control modelled moves the axes linearly within each block, without look-ahead and smoothing. `--like linuxcnc`
    keeps the block times of LinuxCNC: whole cycles, rounded down, where a rotary axis turns.

    \b
    Example: mjsim nc feed examples/healthy --test cone15-x50-ccw \\
                 --cycle-ms 2 --whole-cycles --plot feed.png
    """
    from dataclasses import replace

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
    if common.answered(data | {"csv": str(out) if out else None, "plot": str(plot) if plot else None}, as_json, quiet):
        return
    first, second = _rows(report.to_json(), data["blocks"]), _rows(held.to_json(), None) if held else None
    if second is None:
        common.table(["", ""], first, text=(0, 1))
    else:
        rows = [[*a, b[1]] for a, b in zip(first, second, strict=True)]
        common.table(["", "model", "record"], rows, text=(0, 1, 2))
    for file in (out, plot):
        if file:
            common.say(f"written to {file}", quiet)


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
