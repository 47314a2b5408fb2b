"""``mjsim fleet``."""

from __future__ import annotations

import click

from mjsim.cli import common

#: Most failures that are listed on the terminal.
_MOST = 10


@click.command("fleet")
@click.argument("folders", type=common.path_type(), nargs=-1, required=True, metavar="FOLDER...")
@common.folder_option("--out", required=True, help="Folder of the results.")
@click.option("--scheduler", metavar="ADDRESS", help="Diagnose on the workers of this Dask scheduler.")
@click.option(
    "--max-effects",
    type=click.IntRange(1, 100),
    default=None,
    help="Look for at most so many effects (default: all).",
)
@click.option(
    "--time-limit",
    type=click.IntRange(1, 1_000_000),
    default=3600,
    show_default=True,
    help="Give a campaign up after so many seconds (without --scheduler).",
)
@click.option(
    "--threads",
    type=click.IntRange(1, 256),
    default=None,
    help="Campaigns diagnosed side by side (default: all cores).",
)
@common.as_is_option
@common.options
def command(folders, out, scheduler, max_effects, time_limit, threads, as_is) -> None:
    """Diagnose many campaigns side by side.

    FOLDER is a campaign, or a folder with campaigns below it. The results are
    three Parquet tables (campaigns, findings, calibration) and a page with the
    trend of each machine. A campaign that cannot be diagnosed is a row with the
    reason. The same command goes on where it was stopped.

    \b
    Example: mjsim fleet examples --out fleet
    """
    from mjsim.batch.fleet import fleet

    with common.resumable_progress(out) as progress:
        result = fleet(folders, out, common.cores(threads), scheduler, max_effects, as_is, float(time_limit), progress)
    if not common.answered(result.to_json()):
        _show(result)
    if result.failed == len(result.campaigns):
        common.fail(f"no campaign could be diagnosed; the column 'error' of {out / 'campaigns.parquet'} says why")


def _show(result) -> None:
    """What was found how often, and what failed."""
    from collections import Counter

    there = len(result.campaigns) - result.diagnosed
    before = f" ({there} were there already)" if there else ""
    common.paragraph(f"{result.diagnosed} campaigns worked on in {result.seconds:.0f} s{before}")
    done = [c for c in result.campaigns if c.get("error") is None]
    words = {"nothing_found": "nothing found"}
    counts = Counter(words.get(c["verdict"], c["verdict"]) for c in done)
    if counts:
        common.paragraph("Verdicts: " + ", ".join(f"{name} {n}" for name, n in counts.most_common()) + ".")
    named = Counter(effect for c in done for effect in dict.fromkeys(f["effect"] for f in c["findings"]))
    if named:
        click.echo()
        common.table(["found", "campaigns"], [[e, str(n)] for e, n in named.most_common(_MOST)])
    failures = [c for c in result.campaigns if c.get("error") is not None]
    for c in failures[:_MOST]:
        common.paragraph(f"not diagnosed: {c['folder']}: {c['error']}")
    if len(failures) > _MOST:
        common.paragraph(f"and {len(failures) - _MOST} more, see campaigns.parquet")
    click.echo()
    common.paragraph(f"Page with the trend of each machine: {result.files[-1]}")
    common.paragraph(f"Tables: {', '.join(str(f) for f in result.files[:-1])} (pandas.read_parquet reads them)")
