"""``mjsim report``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.predict import PART, part_runs


@click.command("report")
@click.argument("campaigns", type=common.path_type(), nargs=-1, required=True, metavar="CAMPAIGN...")
@common.file_option(
    "-o", "--out", show_default="report.html, or certificate.pdf", help="The page or certificate to write."
)
@common.machine_option
@common.max_effects_option
@click.option("--no-diagnose", is_flag=True, help="Compare only; look for no missing effects.")
@click.option(
    "--part", "parts", multiple=True, metavar="PROGRAM", help="Also predict the error of this part, as mjsim predict."
)
@PART
@click.option(
    "--certificate",
    is_flag=True,
    help="Write a PDF of a page or two; two campaigns are as found and as left.",
)
@click.option("--force", is_flag=True, help="Replace the page.")
@common.as_is_option
@common.threads_option
@common.options
def command(
    campaigns, out, machine, max_effects, no_diagnose, parts, tolerance, tool, zero, feed, certificate, force,
    threads, as_is, **how
) -> None:  # fmt: skip
    """Write what CAMPAIGN shows as one HTML page that works offline and prints well.

    The campaign is compared and diagnosed. Several campaigns of one machine become a trend: which figure, which
    effect has changed beyond its uncertainty. Axis logs get a page of their own. With
    ball-bar tests in the same campaign, they stand below these.

    \b
    Example: mjsim report examples/hidden-backlash -o report.html
             mjsim report examples/hidden-backlash --part s-shape --zero 40 0 120
             mjsim report before after --certificate -o certificate.pdf
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.errors import InputError
    from mjsim.io.files import check_writable, write_whole
    from mjsim.report.write import report

    runs = part_runs(parts, tolerance, tool, zero, feed, **how)
    read = [read_campaign(c, as_is=as_is) for c in campaigns]
    machines = [machine_of(c, machine) for c in read]
    if runs and (len(read) > 1 or not read[0].in_motion.measured):
        raise InputError("--part: allowed for one ball-bar campaign")
    out = out or Path("certificate.pdf" if certificate else "report.html")
    if certificate and (runs or no_diagnose or max_effects is not None):
        raise InputError("--certificate: not allowed with --part, --no-diagnose or --max-effects")
    check_writable(out, force)
    if certificate:
        from mjsim.report.certificate import make_certificate

        with common.progress_bar() as progress:
            made = make_certificate(read, machines, common.cores(threads), progress)
        write_whole(out, made.pdf(), force=force)
        if not common.answered(made.to_json()):
            common.say(f"{made.title}: {out}")
        return
    with common.progress_bar() as progress:
        result = report(read, machines, max_effects, not no_diagnose, common.cores(threads), progress, runs)
    write_whole(out, result.html, force=force)
    if not common.answered(result.data):
        common.say(f"{result.data['title']}: {out} ({len(result.html.encode()) / 1e6:.1f} MB)")
