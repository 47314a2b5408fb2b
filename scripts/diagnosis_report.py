"""Marks and rates of the diagnosis benchmark; the page docs/diagnosis-benchmark.md."""

from __future__ import annotations

import textwrap
from collections import Counter, defaultdict
from collections.abc import Callable

import numpy as np
from scipy.stats import beta

INTRODUCTION = """\
This page has the figures of `scripts/benchmark_diagnosis` on the published half of its bank. The
bank has campaigns of the generator in `tests/independent`. The generator shares no code with mjsim:
it has its own kinematics, drives, instrument and noise. The other half of the bank was used for
tuning and does not count here.

- The *size* of a signature is its RMS over the campaign, after set-up and trigger errors are taken
  out.
- The *noise of the mean* is that of the mean of two revolutions (noise of a sample over √2).
- *Separable* means that no other effect's signature has a cosine above 0.97 with that of the hidden
  one.
- Intervals are 95 % (Clopper-Pearson).""".splitlines()


def truth(row: dict) -> list[str]:
    """Ids that hide in a campaign."""
    return [e["id"] for e in row["answer"].get("effect", [])]


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
    if answer["verdict"] == "none":
        return "wrong" if said or result["unexplained"] else "right"
    wanted = {e["id"]: {e["id"], *e.get("equivalent", [])} for e in answer.get("effect", [])}
    if answer["verdict"] == "unknown":
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


def snr(row: dict) -> float:
    """Size of the (smallest) hidden signature over the noise of the mean of two revolutions."""
    sizes = row["answer"].get("signature_rms_um") or [0.0]
    return min(sizes) / (row["noise_um"] / np.sqrt(2.0))


def separable(row: dict) -> bool:
    """Whether no other effect of the catalogue has the hidden one's signature (cosine 0.97) in these tests."""
    return not any(e.get("equivalent") for e in row["answer"].get("effect", []))


def rate(hits: int, count: int) -> str:
    """``hits/count = p % [95 % interval]`` (Clopper-Pearson)."""
    if not count:
        return "none"
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return f"{hits}/{count} = {100 * hits / count:.1f} % [{100 * low:.0f}, {100 * high:.0f}]"


def _line(name: str, rows: list[dict], good, target: str) -> str:
    return f"| {name} | {rate(sum(map(good, rows)), len(rows))} | {target} |"


def _covered(row: dict) -> list[bool]:
    """Whether each true number lies in its 95 % interval."""
    out = []
    for e in row["answer"].get("effect", []):
        found = next((f for f in row["result"]["effects"] if f["id"] == e["id"]), None)
        if found is None:
            continue
        for name, pair in found["ci95"].items():
            if name == "components":
                for order, amplitude, _ in e.get(name, []):
                    for low, high in zip(*pair, strict=True):
                        if round(low[0]) == round(order):
                            out.append(low[1] <= amplitude <= high[1])
            elif isinstance(e.get(name), (int, float)) and not name.startswith("phase"):
                low, high = pair
                out.append((low is None or low <= e[name]) and (high is None or e[name] <= high))
    return out


def wrapped(text: str) -> list[str]:
    """Prose in lines of at most 100 columns."""
    return textwrap.wrap(text, 100, break_long_words=False, break_on_hyphens=False)


def page(rows: list[dict], remark: str = "") -> list[str]:
    """Lines of the page on machines that are ideal but for what is hidden."""
    by = defaultdict(list)
    for r in rows:
        by[r["category"]].append(r)
    ok = [r for r in rows if "error" not in r]
    singles = [r for r in ok if r["category"] == "single"]
    clear = [r for r in singles if snr(r) >= 3.0]
    apart = [r for r in clear if separable(r)]
    pairs = [r for r in ok if r["category"] == "pair"]
    nulls, unlisted = [r for r in ok if r["category"] == "null"], [r for r in ok if r["answer"]["verdict"] == "unknown"]
    known = [u for u in unlisted if u["result"]["unexplained"]]
    faulty = [r for r in ok if r["category"] != "null"]
    covered = [c for r in ok for c in _covered(r)]

    def exact(r: dict) -> bool:
        return mark(r) == "right"

    def axis(r: dict) -> bool:
        return bool(set(r["result"]["unexplained"]["axes"]) & set(r["answer"]["axes"]))

    def variable(r: dict) -> bool:
        return r["result"]["unexplained"]["variable"] in r["answer"]["variable"]

    def confident(r: dict) -> bool:
        return mark(r) == "wrong" and r["category"] != "null"

    seconds = [r["seconds"] for r in ok]
    out = [
        "# How far the diagnosis can be trusted",
        "",
        *INTRODUCTION,
        "",
        *wrapped(
            f"The page covers {len(rows)} campaigns: "
            + ", ".join(f"{len(v)} {k}" for k, v in sorted(by.items()))
            + ". "
            f"{len(rows) - len(ok)} crashed. A diagnosis took {np.median(seconds):.0f} s (median) and at most "
            f"{max(seconds):.0f} s "
            "on one core."
        ),
        "",
        *([line for part in remark.split("\n\n") for line in (*wrapped(part), "")] if remark else []),
        "| | measured | target |",
        "|---|---|---|",
        _line(
            "false alarms on healthy machines",
            nulls,
            lambda r: r["result"]["verdict"] != "nothing_found",
            "at most 1 %",
        ),
        _line("separable single effects of 3 times the noise or more, named", apart, exact, "95 %"),
        _line(
            "all single effects of 3 times the noise or more: named, or the set of equivalents named",
            clear,
            exact,
            "95 %",
        ),
        _line("all single effects, any size", singles, exact, ""),
        _line("pairs, both named", pairs, exact, "80 %"),
        _line("wrong confident names among faulty campaigns", faulty, confident, "at most 2 %"),
        _line("unlisted causes recognised as unknown", unlisted, lambda r: bool(r["result"]["unexplained"]), "90 %"),
        _line("... with no catalogue effect named beside", unlisted, exact, ""),
        _line("... on the right axis (of those recognised)", known, axis, "80 %"),
        _line("... with the right variable (of those recognised)", known, variable, ""),
        f"| 95 % intervals that hold the truth | {rate(sum(covered), len(covered))} | 88 to 99 % |",
        "",
        "## Detection",
        "",
        "Share of single effects that were named, by size in units of the noise of the mean:",
        "",
        "| size | named |",
        "|---|---|",
    ]
    for low, high in ((0, 1), (1, 2), (2, 3), (3, 6), (6, 12), (12, np.inf)):
        inside = [r for r in singles if low <= snr(r) < high]
        out.append(f"| {low} to {high} | {rate(sum(map(exact, inside)), len(inside))} |")
    out += [
        "",
        "Smallest signature that was named and largest that was not, in µm RMS, for each effect:",
        "",
        "| effect | named from, µm RMS | missed up to, µm RMS |",
        "|---|---|---|",
    ]
    kinds = defaultdict(list)
    for r in singles:
        kinds[truth(r)[0].split(".")[0]].append(r)
    for kind, members in sorted(kinds.items()):
        sizes = {
            flag: [min(r["answer"]["signature_rms_um"]) for r in members if exact(r) is flag] for flag in (True, False)
        }
        out.append(f"| {kind} | {_number(min, sizes[True])} | {_number(max, sizes[False])} |")
    out += [
        "",
        "## Confusion",
        "",
        "Single effects by kind: what the diagnosis said instead of the truth, or beside it.",
        "",
        "| hidden | said | times |",
        "|---|---|---|",
    ]
    confusion = Counter()
    for r in singles:
        if not exact(r):
            confusion[truth(r)[0].split(".")[0], said(r)] += 1
    out += [f"| {a} | {b} | {n} |" for (a, b), n in sorted(confusion.items())]
    return [*out, *unanswered(rows, lambda r: f"{snr(r):.1f}")]


def unanswered(rows: list[dict], size: Callable[[dict], str]) -> list[str]:
    """Lines with every campaign that was not answered in full; ``size`` writes how large a campaign's causes are."""
    out = [
        "",
        "## Every campaign that was not answered in full",
        "",
        "| campaign | hidden | size / noise of mean | said |",
        "|---|---|---|---|",
    ]
    for r in rows:
        if mark(r) != "right":
            answer = r.get("answer", {})
            hidden = truth(r) if answer else []
            hidden += [answer["hidden"]] if answer.get("hidden") else []
            sizes = size(r) if answer.get("signature_rms_um") else ""
            out.append(f"| {r['name']} | {', '.join(hidden) or 'nothing'} | {sizes} | {mark(r)}: {said(r)} |")
    return out


def _number(pick, values: list[float]) -> str:
    return f"{pick(values):.2f}" if values else "-"


def said(row: dict) -> str:
    if "error" in row:
        return row["error"].strip().splitlines()[-1].replace("|", "/")
    r = row["result"]
    names = [e["id"] + (f" or {' or '.join(e['alternatives'])}" if e["alternatives"] else "") for e in r["effects"]]
    if r["unexplained"]:
        names.append(f"unknown on {', '.join(r['unexplained']['axes'])} ({r['unexplained']['variable']})")
    return "; ".join(names) or "nothing found"
