"""The page docs/diagnosis-benchmark-real.md: machines on which everything is a little wrong, and simple methods beside
the diagnosis.
"""

from __future__ import annotations

import numpy as np
from diagnosis_report import mark, rate, unanswered, wrapped

#: A cause is clear from so many times the noise of the mean.
_CLEAR = 3.0
_REMOVED = 0.95


def page_of_real_machines(rows: list[dict], others: dict[str, list[dict]], remark: str = "") -> list[str]:
    """Lines of the page.

    Args:
        rows: Answers of the diagnosis.
        others: Answers of other methods, by the method's name.
        remark: Paragraphs for its head.
    """
    ok = [r for r in rows if "error" not in r]
    stated = [r for r in ok if r["answer"]["tolerance_stated"]]
    unstated = [r for r in ok if not r["answer"]["tolerance_stated"]]
    seconds = [r["seconds"] for r in ok]
    count = {k: sum(r["category"] == f"real-{k}" for r in rows) for k in ("sound", "faulty", "unlisted")}
    out = [
        "# The diagnosis on real machines",
        "",
        *wrapped(
            "No machine is ideal but for one fault. The machines of this page come from the generator in "
            "`tests/independent`, which shares no code with mjsim. They have some sixty small errors inside their "
            "tolerance, on drives of random data sheets. "
            "Half of the machine files state the tolerance. Where it is stated, a sound machine has no findings. "
            "Where it is not, the small errors that the data prove may be named as well."
        ),
        "",
        *wrapped(
            f"The page covers {len(rows)} campaigns of the published half: {count['sound']} of sound machines, "
            f"{count['faulty']} of faulty ones with one to "
            f"three causes, {count['unlisted']} with a cause that is in no catalogue. {len(rows) - len(ok)} crashed. A "
            f"diagnosis took {np.median(seconds):.0f} s (median) and at most {max(seconds):.0f} s of one core."
        ),
        "",
        *([line for part in remark.split("\n\n") for line in (*wrapped(part), "")] if remark else []),
        "| | tolerance stated | not stated | all | target |",
        "|---|---|---|---|---|",
    ]
    for name, figure, target in _FIGURES:
        cells = [rate(*counts(figure, part)) for part in (stated, unstated, ok)]
        out.append(f"| {name} | {' | '.join(cells)} | {target} |")
    return [*out, *unanswered(rows, _sizes), *_methods(rows, others)]


def counts(figure, rows: list[dict]) -> tuple[int, int]:
    """Hits and number of what a figure counts, over all rows."""
    each = [x for r in rows for x in figure(r)]
    return sum(each), len(each)


def _false_alarm(r: dict) -> list[bool]:
    return [mark(r) == "wrong"] if r["category"] == "real-sound" else []


def _clear_causes(r: dict) -> list[bool]:
    """For every clear, separable cause of a faulty machine: whether it was named."""
    if r["category"] != "real-faulty":
        return []
    names = [{e["id"], *e["alternatives"]} for e in r["result"]["effects"]]
    noise = r["noise_um"] / np.sqrt(2.0)
    return [
        any(e["id"] in n for n in names)
        for e, size in zip(r["answer"]["effect"], r["answer"]["signature_rms_um"], strict=True)
        if size >= _CLEAR * noise and not e.get("equivalent")
    ]


def _wrong_name(r: dict) -> list[bool]:
    return [mark(r) == "wrong"] if r["category"] != "real-sound" else []


def recognised(r: dict) -> list[bool]:
    return [bool(r["result"]["unexplained"])] if r["answer"]["verdict"] == "unknown" else []


def right_axis(r: dict) -> list[bool]:
    seen = r["result"]["unexplained"]
    return [bool(set(seen["axes"]) & set(r["answer"]["axes"]))] if recognised(r) == [True] else []


def intervals(r: dict) -> list[bool]:
    """For every planted number that has an interval: whether it lies inside."""
    answers = {e["id"]: e for e in [*r["answer"].get("within", []), *r["answer"].get("effect", [])]}
    out = []
    for entry in [*r["result"].get("calibration", []), *r["result"]["effects"]]:
        true = answers.get(entry["id"], {})
        for name, pair in (entry.get("ci95") or {}).items():
            if name == "components":
                out += _waves(true.get(name, []), pair)
            elif isinstance(true.get(name), (int, float)) and not name.startswith("phase"):
                low, high = pair
                out.append((low is None or low <= true[name]) and (high is None or true[name] <= high))
    return out


def _waves(waves: list, pair) -> list[bool]:
    """Whether the amplitude of every planted wave that has an interval lies inside."""
    found = {round(low[0]): (low[1], high[1]) for low, high in zip(*pair, strict=True)}
    return [
        found[round(order)][0] <= amplitude <= found[round(order)][1]
        for order, amplitude, _ in waves
        if round(order) in found
    ]


def predicted(r: dict) -> list[bool]:
    return [r["heldout_removed"] >= _REMOVED] if "heldout_removed" in r else []


_FIGURES = (
    ("false alarms on sound machines", _false_alarm, "at most 1 %"),
    ("separable causes of 3 times the noise of the mean, named", _clear_causes, "97 %"),
    ("campaigns with a wrong confident name, of the others", _wrong_name, "at most 1 %"),
    ("causes outside the catalogue recognised", recognised, "95 %"),
    ("... on the right axis", right_axis, ""),
    ("95 % intervals that hold the truth", intervals, "93 to 97 %"),
    ("0.95 or more of the error of other tests predicted", predicted, "95 %"),
)


def _methods(rows: list[dict], others: dict[str, list[dict]]) -> list[str]:
    """The same campaigns answered by simple methods, side by side."""
    common = {r["name"] for r in rows if "error" not in r}
    for theirs in others.values():
        common &= {r["name"] for r in theirs if "error" not in r}
    if not others or not common:
        return []
    answers = {"diagnosis": rows, **others}
    shared = {name: [r for r in theirs if r["name"] in common] for name, theirs in answers.items()}
    out = [
        "",
        "## Beside simple methods",
        "",
        *wrapped(
            f"The same {len(common)} campaigns of such machines, answered by three methods that see the same data and "
            "the same limits. The diagnosis selects by evidence (automatic relevance determination) and fits again. "
            "Matching pursuit adds the signature that explains most until none takes 30 variances of the noise off. "
            "The list of features is what ball-bar software measures on circles, with fixed limits "
            "(`scripts/diagnosis_baselines.py`)."
        ),
        "",
        "| | " + " | ".join(shared) + " |",
        "|---" * (len(shared) + 1) + "|",
    ]
    for name, figure, _ in _FIGURES[:4]:
        out.append(f"| {name} | " + " | ".join(rate(*counts(figure, theirs)) for theirs in shared.values()) + " |")
    right = [rate(sum(mark(r) == "right" for r in theirs), len(theirs)) for theirs in shared.values()]
    seconds = [f"{np.median([r['seconds'] for r in theirs]):.0f}" for theirs in shared.values()]
    out.append(f"| answered in full | {' | '.join(right)} |")
    out.append(f"| seconds of one core, median | {' | '.join(seconds)} |")
    return out


def _sizes(r: dict) -> str:
    """Size of every hidden signature in units of the noise of the mean."""
    return ", ".join(f"{s / (r['noise_um'] / np.sqrt(2.0)):.1f}" for s in r["answer"]["signature_rms_um"])
