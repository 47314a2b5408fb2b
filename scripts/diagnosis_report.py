"""The page docs/diagnosis-benchmark.md: machines that are ideal but for what is hidden."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np
from diagnosis_figures import (
    FIGURES,
    beside_simple_methods,
    counts,
    coverage,
    mark,
    paragraphs,
    rate,
    said,
    sizes_over_noise,
    truth,
    unanswered,
)

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
- *The error of other tests* is that of three cones which the campaign does not have. A prediction
  removes a share of its square. It counts where the error exceeds the noise of the mean.
- Intervals are 95 % (Clopper-Pearson).""".splitlines()


def page_of_ideal_machines(rows: list[dict], simple: list[dict], remark: str = "") -> list[str]:
    """Lines of the page.

    Args:
        rows: Answers of the diagnosis.
        simple: Answers of two simple methods.
        remark: Paragraphs for its head.
    """
    ok = [r for r in rows if "error" not in r]
    singles = [r for r in ok if r["category"] == "single"]
    return [
        "# How far the diagnosis can be trusted",
        "",
        *INTRODUCTION,
        "",
        *coverage(rows, "diagnosis-benchmark"),
        *paragraphs(remark),
        "| | measured | target |",
        "|---|---|---|",
        *(f"| {name} | {rate(*counts(figure, ok))} | {target} |" for name, figure, target in FIGURES + _FURTHER),
        *_detection(singles),
        *_sizes(singles),
        *_confusion(singles),
        *unanswered(rows),
        *beside_simple_methods(rows, simple),
    ]


def _exact(r: dict) -> bool:
    return mark(r) == "right"


def _of(category: str):
    return lambda r: [_exact(r)] if r["category"] == category else []


_FURTHER = (
    ("all single effects, any size: named, or the set of equivalents named", _of("single"), ""),
    ("pairs, both named", _of("pair"), "80 %"),
)


def _detection(singles: list[dict]) -> list[str]:
    out = [
        "",
        "## Detection",
        "",
        "Share of single effects that were named, by size in units of the noise of the mean:",
        "",
        "| size | named |",
        "|---|---|",
    ]
    for low, high in ((0, 1), (1, 2), (2, 3), (3, 6), (6, 12), (12, np.inf)):
        inside = [r for r in singles if low <= min(sizes_over_noise(r)) < high]
        out.append(f"| {low} to {high} | {rate(sum(map(_exact, inside)), len(inside))} |")
    return out


def _sizes(singles: list[dict]) -> list[str]:
    out = [
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
            flag: [min(r["answer"]["signature_rms_um"]) for r in members if _exact(r) is flag] for flag in (True, False)
        }
        out.append(f"| {kind} | {_number(min, sizes[True])} | {_number(max, sizes[False])} |")
    return out


def _number(pick, values: list[float]) -> str:
    return f"{pick(values):.2f}" if values else "-"


def _confusion(singles: list[dict]) -> list[str]:
    times = Counter((truth(r)[0].split(".")[0], said(r)) for r in singles if not _exact(r))
    return [
        "",
        "## Confusion",
        "",
        "Single effects by kind: what the diagnosis said instead of the truth, or beside it.",
        "",
        "| hidden | said | times |",
        "|---|---|---|",
        *(f"| {a} | {b} | {n} |" for (a, b), n in sorted(times.items())),
    ]
