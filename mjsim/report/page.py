"""One self-contained HTML page from a report's content: images inside, styles inside, no script, nothing loaded from anywhere."""

from __future__ import annotations

import base64
from importlib import resources
from typing import TYPE_CHECKING, Any

from mjsim.plots import ladder, overview, polar, residual
from mjsim.plots.save import encode
from mjsim.report import numbers
from mjsim.report.content import ReportContent, TestSection

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VERDICTS = {
    "identified": "Identified",
    "ambiguous": "Ambiguous",
    "unknown": "Unknown cause",
    "nothing_found": "Nothing missing",
}


def render(content: ReportContent) -> str:
    """The page as HTML text.

    All texts are escaped; the same content gives the same page.

    Raises:
        ValueError: an unknown verdict, or traces that cannot be drawn (see :mod:`mjsim.plots`).
    """
    import jinja2

    if content.verdict is not None and content.verdict not in VERDICTS:
        raise ValueError(f"verdict must be one of {', '.join(VERDICTS)}, not '{content.verdict}'")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(
        um=numbers.um, fixed=numbers.fixed, estimate=numbers.estimate, interval=numbers.interval, letters=_letters
    )  # fmt: skip
    template = environment.from_string(resources.files("mjsim.report").joinpath("template.html").read_text(encoding="utf-8"))
    return template.render(
        c=content,
        verdict=VERDICTS.get(content.verdict or ""),
        removed=_removed(content),
        ladder_image=_ladder_image(content),
        overview_image=_overview_image(content),
        sections=[_section(test) for test in content.tests],
        ladder_tests=_ladder_tests(content),
        iso_rows=[test for test in content.tests if test.measured is not None],
        triggers=[test for test in content.tests if test.trigger_ms is not None],
    )


def data_uri(figure: Figure, kind: str = "svg") -> str:
    """The figure as the value of an ``img`` element's ``src``."""
    media = "image/svg+xml" if kind == "svg" else "image/png"
    return f"data:{media};base64,{base64.b64encode(encode(figure, kind)).decode('ascii')}"


def _ladder_image(content: ReportContent) -> str | None:
    if not content.ladder:
        return None
    steps = [ladder.LadderStep(row.label, row.rms_um) for row in content.ladder]
    return data_uri(ladder.ladder_figure(steps, content.noise_um))


def _overview_image(content: ReportContent) -> str | None:
    tests = [(test.name, test.after or test.before) for test in content.tests if test.before or test.after]
    return data_uri(overview.overview_figure(tests), "png") if len(tests) > 1 else None


def _section(test: TestSection) -> dict[str, Any]:
    """Images of one test; both polar plots have one scale, so that they can be compared by eye."""
    together = [*test.before, *test.after]
    step = polar.division_um(together) if together else None
    return {
        "test": test,
        "before": data_uri(polar.polar_figure(test.before, "before", None, step, 4.2)) if test.before else None,
        "after": data_uri(polar.polar_figure(test.after, "after", None, step, 4.2)) if test.after else None,
        "residual": data_uri(residual.residual_figure([test.residual])) if test.residual else None,
    }


def _ladder_tests(content: ReportContent) -> list[str]:
    """Tests of the ladder's table: in the order of the report, then those that only the ladder knows."""
    known = [test.name for test in content.tests]
    extra = [name for row in content.ladder for name in row.rms_by_test_um if name not in known]
    return [name for name in dict.fromkeys([*known, *extra]) if any(name in row.rms_by_test_um for row in content.ladder)]


def _removed(content: ReportContent) -> str | None:
    """Share of the error beyond the noise that the last model removed."""
    if len(content.ladder) < 2:
        return None
    noise = content.noise_um or 0.0
    before, after = (max(row.rms_um**2 - noise**2, 0.0) ** 0.5 for row in (content.ladder[0], content.ladder[-1]))
    share = numbers.percent_removed(before, after)
    return None if share == numbers.NONE else share


def _letters(index: int) -> str:
    """1 → S1: short heading of a table column whose full text stands in a note."""
    return f"S{index}"
