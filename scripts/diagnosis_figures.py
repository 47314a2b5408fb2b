"""Marks and figures of the diagnosis benchmark: what an answer was worth, and how often all are right."""

from __future__ import annotations

import textwrap
from collections import Counter

import numpy as np
from scipy.stats import beta

#: A cause is clear from so many times the noise of the mean.
_CLEAR = 3.0
#: Share of the squared error of other tests that a fitted machine should predict.
_REMOVED = 0.95


def truth(row: dict) -> list[str]:
    """Ids that hide in a campaign."""
    return [e["id"] for e in row["answer"].get("effect", [])]


def is_sound(row: dict) -> bool:
    """Whether nothing hides in a campaign."""
    return row["answer"]["verdict"] == "none"


def is_unlisted(row: dict) -> bool:
    """Whether what hides in a campaign is in no catalogue."""
    return row["answer"]["verdict"] == "unknown"


def mark(row: dict) -> str:
    """What a diagnosis was worth: ``right``, ``partly``, ``missed``, ``wrong`` (a name that is not there, said without
    alternatives that hold the truth), ``crash``.

    Small errors of a real machine may be named where the machine file states no tolerance, and need not be.
    """
    if "error" in row:
        return "crash"
    result, answer = row["result"], row["answer"]
    said = [({e["id"], *e["alternatives"]}) for e in result["effects"]]
    small = set() if answer.get("tolerance_stated", True) else {e["id"] for e in answer.get("within", [])}
    said = [s for s in said if not s & small or s & set(truth(row))]
    if is_sound(row):
        return "wrong" if said or result["unexplained"] else "right"
    wanted = {e["id"]: {e["id"], *e.get("equivalent", [])} for e in answer.get("effect", [])}
    if is_unlisted(row):
        if not result["unexplained"]:
            return "wrong" if any(not s & set(wanted) for s in said) else "missed"
        return "partly" if any(not s & set(wanted) for s in said) else "right"
    strange = [s for s in said if not s & set(wanted)]
    if strange:
        return "wrong"
    hit = {w for w in wanted for s in said if w in s and s <= wanted[w]}
    near = {w for w in wanted for s in said if w in s}
    if hit == set(wanted):
        return "right"
    return "partly" if near else "missed"


def sizes_over_noise(row: dict) -> list[float]:
    """Size of every hidden signature in units of the noise of the mean of two revolutions."""
    return [size / (row["noise_um"] / np.sqrt(2.0)) for size in row["answer"].get("signature_rms_um") or []]


def rate(hits: int, count: int) -> str:
    """``hits/count = p % [95 % interval]`` (Clopper-Pearson)."""
    if not count:
        return "none"
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return f"{hits}/{count} = {100 * hits / count:.1f} % [{100 * low:.0f}, {100 * high:.0f}]"


def counts(figure, rows: list[dict]) -> tuple[int, int]:
    """Hits and number of what a figure counts, over all rows."""
    each = [x for r in rows for x in figure(r)]
    return sum(each), len(each)


def _false_alarm(r: dict) -> list[bool]:
    return [mark(r) == "wrong"] if is_sound(r) else []


def _clear_causes(r: dict) -> list[bool]:
    """For every clear, separable cause of a faulty machine: whether it was named."""
    if is_sound(r) or is_unlisted(r):
        return []
    names = [{e["id"], *e["alternatives"]} for e in r["result"]["effects"]]
    return [
        any(e["id"] in n for n in names)
        for e, size in zip(r["answer"]["effect"], sizes_over_noise(r), strict=True)
        if size >= _CLEAR and not e.get("equivalent")
    ]


def _wrong_name(r: dict) -> list[bool]:
    return [mark(r) == "wrong"] if not is_sound(r) else []


def recognised(r: dict) -> list[bool]:
    return [bool(r["result"]["unexplained"])] if is_unlisted(r) else []


def right_axis(r: dict) -> list[bool]:
    seen = r["result"]["unexplained"]
    return [bool(set(seen["axes"]) & set(r["answer"]["axes"]))] if recognised(r) == [True] else []


def _right_variable(r: dict) -> list[bool]:
    seen = r["result"]["unexplained"]
    return [seen["variable"] in r["answer"]["variable"]] if recognised(r) == [True] else []


def _no_name_beside(r: dict) -> list[bool]:
    return [mark(r) == "right"] if is_unlisted(r) else []


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
    """Whether the fitted machine predicts the error of other tests, where that exceeds the noise of the mean."""
    return [] if is_unlisted(r) else _predicted(r)


def _predicted_unlisted(r: dict) -> list[bool]:
    return _predicted(r) if is_unlisted(r) else []


def _predicted(r: dict) -> list[bool]:
    if r.get("heldout_um", 0.0) < r["noise_um"] / np.sqrt(2.0):
        return []
    return [r["heldout_removed"] >= _REMOVED]


FIGURES = (
    ("false alarms on sound machines", _false_alarm, "at most 1 %"),
    ("separable causes of 3 times the noise of the mean, named", _clear_causes, "97 %"),
    ("campaigns with a wrong confident name, of the others", _wrong_name, "at most 1 %"),
    ("causes outside the catalogue recognised", recognised, "95 %"),
    ("... on the right axis (of those recognised)", right_axis, ""),
    ("... with the right variable (of those recognised)", _right_variable, ""),
    ("... with no effect of the catalogue named that is not there", _no_name_beside, ""),
    ("95 % intervals that hold the truth", intervals, "93 to 97 %"),
    ("0.95 or more of the error of other tests predicted", predicted, "95 %"),
    ("... on machines with a cause outside the catalogue", _predicted_unlisted, ""),
)


def unanswered(rows: list[dict]) -> list[str]:
    """Lines with every campaign that was not answered in full."""
    out = [
        "",
        "## Every campaign that was not answered in full",
        "",
        "| campaign | hidden | size / noise of mean | said |",
        "|---|---|---|---|",
    ]
    for r in sorted(rows, key=lambda r: r["name"]):
        if mark(r) != "right":
            answer = r.get("answer", {})
            hidden = truth(r) if answer else []
            hidden += [answer["hidden"]] if answer.get("hidden") else []
            sizes = ", ".join(f"{s:.1f}" for s in sizes_over_noise(r)) if answer else ""
            out.append(f"| {r['name']} | {', '.join(hidden) or 'nothing'} | {sizes} | {mark(r)}: {said(r)} |")
    return out


def said(row: dict) -> str:
    if "error" in row:
        return row["error"].strip().splitlines()[-1].replace("|", "/")
    r = row["result"]
    names = [e["id"] + (f" or {' or '.join(e['alternatives'])}" if e["alternatives"] else "") for e in r["effects"]]
    if r["unexplained"]:
        names.append(f"unknown on {', '.join(r['unexplained']['axes'])} ({r['unexplained']['variable']})")
    return "; ".join(names) or "nothing found"


def beside_simple_methods(rows: list[dict], simple: list[dict]) -> list[str]:
    """The same campaigns answered by simple methods (``results`` of the rows ``simple``), side by side."""
    theirs = {r["name"]: r for r in simple if "error" not in r}
    common = [r for r in rows if "error" not in r and r["name"] in theirs]
    if not common:
        return []
    shared = {"diagnosis": common}
    for method in theirs[common[0]["name"]]["results"]:
        shared[method] = [r | {"result": theirs[r["name"]]["results"][method]} for r in common]
    out = [
        "",
        "## Beside simple methods",
        "",
        *wrapped(
            f"The same {len(common)} campaigns, answered by three methods that see the same data and "
            "the same limits. The diagnosis selects by evidence (automatic relevance determination) and fits again. "
            "Matching pursuit adds the signature that explains most until none takes 30 variances of the noise off. "
            "The list of features is what ball-bar software measures on circles, with fixed limits "
            "(`scripts/diagnosis_baselines.py`). Their answers are in "
            "[simple-methods.jsonl.gz](data/simple-methods.jsonl.gz)."
        ),
        "",
        "| | " + " | ".join(shared) + " |",
        "|---" * (len(shared) + 1) + "|",
    ]
    for name, figure, _ in FIGURES[:4]:
        out.append(f"| {name} | " + " | ".join(rate(*counts(figure, theirs)) for theirs in shared.values()) + " |")
    right = [rate(sum(mark(r) == "right" for r in theirs), len(theirs)) for theirs in shared.values()]
    out.append(f"| answered in full | {' | '.join(right)} |")
    return out


def wrapped(text: str) -> list[str]:
    """Prose in lines of at most 100 columns."""
    return textwrap.wrap(text, 100, break_long_words=False, break_on_hyphens=False)


def paragraphs(text: str) -> list[str]:
    """Lines of paragraphs that a blank line parts, with one after each."""
    return [line for part in text.split("\n\n") for line in (*wrapped(part), "")] if text else []


def coverage(rows: list[dict], name: str) -> list[str]:
    """Paragraphs on which campaigns a page covers, how long they took, which version of the program answered, and where
    the answers are (``name`` of the page).
    """
    ok = [r for r in rows if "error" not in r]
    seconds = [r["seconds"] for r in ok]
    kinds = Counter(r["category"].removeprefix("real-") for r in rows)
    versions = Counter(r.get("commit", "an older one") for r in rows)
    return paragraphs(
        f"The page covers {len(rows)} campaigns of the published half: "
        + ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
        + f". {len(rows) - len(ok)} crashed. A diagnosis took {np.median(seconds):.0f} s (median) and at most "
        f"{max(seconds):.0f} s of one core. Version of the program (campaigns): "
        + ", ".join(f"{commit} ({n})" for commit, n in sorted(versions.items()))
        + f".\n\nEvery answer is a line of JSON in [{name}.jsonl.gz](data/{name}.jsonl.gz)."
    )
