"""The page docs/diagnosis-benchmark-real.md: machines on which everything is a little wrong."""

from __future__ import annotations

from diagnosis_figures import FIGURES, beside_simple_methods, counts, coverage, paragraphs, rate, unanswered

INTRODUCTION = """\
No machine is ideal but for one fault. The machines of this page come from the generator in
`tests/independent`, which shares no code with mjsim. They have some sixty small errors inside their
tolerance, on drives of random data sheets. Half of the machine files state the tolerance. Where it
is stated, a sound machine has no findings. Where it is not, the small errors that the data prove
may be named as well. The words are those of
[the page on ideal machines](diagnosis-benchmark.md).""".splitlines()


def page_of_real_machines(rows: list[dict], simple: list[dict], remark: str = "") -> list[str]:
    """Lines of the page.

    Args:
        rows: Answers of the diagnosis.
        simple: Answers of two simple methods.
        remark: Paragraphs for its head.
    """
    ok = [r for r in rows if "error" not in r]
    stated = [r for r in ok if r["answer"]["tolerance_stated"]]
    unstated = [r for r in ok if not r["answer"]["tolerance_stated"]]
    out = [
        "# The diagnosis on real machines",
        "",
        *INTRODUCTION,
        "",
        *coverage(rows, "diagnosis-benchmark-real"),
        *paragraphs(remark),
        "| | tolerance stated | not stated | all | target |",
        "|---|---|---|---|---|",
    ]
    for name, figure, target in FIGURES:
        cells = [rate(*counts(figure, part)) for part in (stated, unstated, ok)]
        out.append(f"| {name} | {' | '.join(cells)} | {target} |")
    return [*out, *unanswered(rows), *beside_simple_methods(rows, simple)]
