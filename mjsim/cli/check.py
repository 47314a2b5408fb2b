"""``mjsim check``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common


@click.command("check")
@common.campaign_argument
@common.machine_option
@common.folder_option("--fix", help="Write a corrected copy of the campaign into this new folder.")
@common.threads_option
@common.options
def command(campaign, machine, fix, threads) -> None:
    """Look for what people get wrong in CAMPAIGN: unit, sign, direction, feed, clock, exchanged traces.

    Friction leaves a spike where an axis reverses, and tests of one set-up share the balls' offsets. Both tell whether
    a trace is what campaign.toml says, whatever is wrong with the machine. A test is "ok" only where its reversals show
    its unit and sign. They do not always show its direction. Commands that compare traces with a model look as well.
    They refuse what is certainly wrong, unless they are told --as-is.

    \b
    Example: mjsim check my-machine
             mjsim check my-machine --fix my-machine-corrected
    """
    from mjsim.campaign.machine_file import read_machine
    from mjsim.commands.check import check, write_corrected

    result = check(campaign, read_machine(machine) if machine else None, common.cores(threads))
    files = write_corrected(result, fix) if fix and result.bars is not None and result.bars.mistakes else []
    data = result.to_json()
    if common.answered({**data, "files": [str(f) for f in files]}):
        return
    for part, mine in common.each_part(result.parts, data):
        if part is result.bars:
            _show_bars(mine, part, fix, files)
        else:
            _show(mine)
    for sentence in data.get("temperature", ()):
        common.paragraph(sentence)


#: What a check says of tests without a trace.
_NOT_CHECKED = "Not checked, because campaign.toml names no trace for them: {}."
#: What it shows of a test, where an instrument has it, and the heading.
_COLUMNS = {"axes": "axes", "samples": "samples", "rate_Hz": "rate Hz", "duration_s": "duration s"}


def _show(data: dict) -> None:
    """The check of an instrument without a table of its own."""
    tests = data["tests"]
    keys = [k for k in _COLUMNS if all(k in t for t in tests)]
    rows = [[t["name"], *(_cell(t[k]) for k in keys), ", ".join(t["finding"])] for t in tests]
    words = [1 + i for i, k in enumerate(keys) if k == "axes"]
    common.table(["test", *(_COLUMNS[k] for k in keys), "finding"], rows, text=(0, *words, 1 + len(keys)))
    click.echo()
    for finding in [*data["mistakes"], *data.get("signals", ())]:
        common.paragraph(finding["sentence"])
    if not data["mistakes"]:
        logs = ": command and actual position, axes, units and time fit each other" if "axes" in keys else ""
        common.paragraph(f"No mistake found{logs}.")
    if data["not_measured"]:
        common.paragraph(_NOT_CHECKED.format(", ".join(data["not_measured"])))


def _cell(value) -> str:
    if isinstance(value, list):
        return " ".join(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _show_bars(data: dict, part, fix: Path | None, files: list[Path]) -> None:
    """The check of ball-bar tests."""
    rows = []
    for t in data["tests"]:
        seen = t["agreement"] is not None
        wrong = [m["kind"].replace("_", " ") for m in data["mistakes"] if t["name"] in m["tests"]]
        asked = any(q.startswith(f"{t['name']}: ") for q in data["questions"])
        finding = ", ".join(wrong) or ("duration" if asked else "no evidence" if t["evidence"] else "ok")
        rows.append([t["name"], *([f"{t['size']:.3g}", f"{t['agreement']:.2f}"] if seen else ["–", "–"]), finding])
    common.table(["test", "size", "agreement", "finding"], rows, text=(0, 3))
    click.echo()
    common.paragraph(
        "Size: what the trace shows at the axes' reversals, over what the model gives there. Agreement: their "
        "correlation. –: the model "
        "shows nothing there."
    )
    for t in data["tests"]:
        if t["evidence"] and not any(t["name"] in m["tests"] for m in data["mistakes"]):
            common.paragraph(f"{t['name']} cannot be checked: {t['evidence']}.")
    for question in data["questions"]:
        common.paragraph(question)
    if data["not_measured"]:
        common.paragraph(_NOT_CHECKED.format(", ".join(data["not_measured"])))
    for m in data["mistakes"]:
        common.paragraph(m["sentence"])
    if files:
        common.say(f"corrected copy in {fix}")
    elif part.mistakes and all(m.certain for m in part.mistakes):
        common.say("--fix FOLDER writes a corrected copy")
    elif not part.mistakes:
        shown = sum(row[3] == "ok" for row in rows)
        common.paragraph(f"No mistake found. The reversals of {shown} of {len(rows)} tests show unit and sign.")
        if fix:
            common.say(f"nothing was written to {fix}")
