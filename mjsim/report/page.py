"""One self-contained HTML page from a report's content: numbers, images, styles and scripts inside, nothing loaded from
anywhere.

What is printed, and what shows without script, are matplotlib's figures; on a screen interactive plots take their
place. Every number comes from the JSON that the page carries, and says by a JSON pointer (``data-json``) which one it
is.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from mjsim.digits import decimals_of
from mjsim.inference.budget import NAMES as BUDGET_ROWS
from mjsim.io.files import finite
from mjsim.plots import curve, ladder, polar, residual, trend
from mjsim.plots.waterfall import Fall, waterfall_figure
from mjsim.report.content import (
    NONE,
    ParameterRow,
    ReportContent,
    TestSection,
    estimate,
    fixed,
    interval,
    percent_removed,
    um,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mjsim.report.trend import Series, TrendContent

VERDICTS = {
    "identified": "Identified",
    "ambiguous": "Ambiguous",
    "unknown": "Unknown cause",
    "nothing_found": "Nothing missing",
}
_GROUPS = (
    (
        "figure",
        "Circular errors after ISO 230-4",
        "Measured on the full circles that all campaigns have under the same conditions. The 95 % interval follows "
        "from the noise.",
    ),
    (
        "parameter",
        "Effects over time",
        "Parameters of the effects found, with 95 % intervals. An effect that was not found counts as zero.",
    ),
)
#: Colours of a printed figure: a few hues and their mixtures with white.
_COLOURS = 32
#: Dots per inch of a printed figure: sharp on paper at its usual three inches, and the page stays under 2 MB.
_DPI = 120
KINDS = {"adjust": "adjust", "compensate": "compensate", "maintain": "maintain", "share": "share only"}


def render(
    content: ReportContent,
    beside: Mapping[str, tuple[dict, list]] = MappingProxyType({}),
    warming: tuple[str | None, Sequence[str]] = (None, ()),
) -> str:
    """The page as HTML text.

    All texts are escaped; the same content gives the same page.

    Args:
        content: What the page says.
        beside: What other instruments of the campaign add, by JSON key: plain data, and pictures, (name, data URI) by
            test.
        warming: Picture of the temperatures, as data URI, and what is to be said of them.

    Raises:
        ValueError: an unknown verdict, or traces that cannot be drawn (see :mod:`mjsim.plots`).
    """
    if content.verdict is not None and content.verdict not in VERDICTS:
        raise ValueError(f"verdict must be one of {', '.join(VERDICTS)}, not '{content.verdict}'")
    return page(
        "report.html",
        data_of(content, beside) | ({"temperature": list(warming[1])} if warming[0] else {}),
        content.traces,
        ("common.js", "plot.js", "report.js"),
        beside=list(beside.values()),
        temperature_image=warming[0],
        last=len(content.models) - 1,
        verdict=VERDICTS.get(content.verdict or ""),
        removed=_removed(content),
        best_repair=_best_repair(content),
        full_rows=[i for i, r in enumerate(content.what_if.rows) if r.tests_um] if content.what_if else [],
        open_causes=bool(content.what_if and any(r.instead for r in content.what_if.rows)),
        kinds=KINDS,
        ladder_image=_ladder_image(content),
        curve_image=data_uri(curve.curve_figure(*content.curve)) if content.curve else None,
        overview_image=_overview_image(content),
        waterfall_image=_waterfall_image(content),
        unseen=sum(not row.observable for row in content.calibration),
        sections=[_section(test) for test in content.tests],
        part_images=[data_uri(p.figure, None) if p.figure else None for p in content.parts],
        iso_rows=any(test.measured is not None for test in content.tests),
        triggers=any(test.trigger_ms is not None for test in content.tests),
    )


def data_of(content: ReportContent, beside: Mapping[str, tuple[dict, list]] = MappingProxyType({})) -> dict:
    """Everything that :func:`render` says, as plain data; arguments as there."""
    return content.to_json() | {key: section for key, (section, _) in beside.items()}


def render_trend(content: TrendContent) -> str:
    """The trend page as HTML text; as :func:`render`."""
    labels = [row.date or str(i + 1) for i, row in enumerate(content.campaigns)]
    images = {}
    for group, _, _ in _GROUPS:
        rows = [
            trend.TrendSeries(s.name, s.unit, s.values, s.lows, s.highs, s.verdict in ("grew", "shrank"))
            for s in content.series
            if s.group == group
        ]
        images[group] = data_uri(trend.trend_figure(rows, labels)) if rows else None
    return page(
        "trend.html",
        content.to_json(),
        [],
        ("common.js", "plot.js", "trend.js"),
        groups=_GROUPS,
        images=images,
        verdicts=VERDICTS,
        dates=all(row.date for row in content.campaigns),
        decimals=[_decimals(s) for s in content.series],
    )


def _decimals(s: Series) -> int:
    """Decimals that show the change's uncertainty, or the largest value where it has none."""
    size = s.uncertainty or 0.01 * max((abs(v) for v in s.values if v is not None), default=0.0)
    return decimals_of(None, (-size, size)) if size else 0


def page(template: str, data: dict, traces: Any, scripts: tuple[str, ...], **more: Any) -> str:
    """A page of the report family.

    Args:
        template: file in ``assets``.
        data: the page's JSON; in the template ``c`` is the same.
        traces: data of the interactive plots; None leaves plots and scripts out.
        scripts: files in ``assets``, in the order in which they run.
        more: further names for the template.
    """
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=jinja2.FunctionLoader(asset),
    )
    environment.filters.update(
        um=um,
        interval=lambda p: interval(ParameterRow(**p)),
        estimate=lambda p: estimate(ParameterRow(**p)),
    )

    def number(pointer: str, decimals: int = 2) -> str:
        value = at(data, pointer)
        return Markup('<span data-json="{}">{}</span>').format(pointer, fixed(value, decimals))

    def known(pointer: str, ends: str) -> str:
        digits = decimals_of(at(data, pointer), at(data, ends))
        return number(pointer, digits)

    def by_u(pointer: str, standard: float) -> str:
        return number(pointer, decimals_of(at(data, pointer), (-2.0 * standard, 2.0 * standard)))

    def span(pointer: str) -> str:
        digits = decimals_of(None, at(data, pointer))
        return number(pointer + "/0", digits) + " to " + number(pointer + "/1", digits)

    def estimated(pointer: str) -> str:
        row = ParameterRow(**at(data, pointer))
        return Markup('<span data-json="{}">{}</span>').format(pointer + "/value", estimate(row))

    return environment.get_template(template).render(
        c=data,
        n=number,
        estimated=estimated,
        known=known,
        span=span,
        by_u=by_u,
        budget_names=BUDGET_ROWS,
        used_parts=used_parts,
        css=Markup(asset("style.css")),
        data=Markup(script_json(data)),
        traces=None if traces is None else Markup(script_json(traces)),
        scripts=() if traces is None else tuple(Markup(asset(name)) for name in scripts),
        **more,
    )


def used_parts(budget: Sequence[dict]) -> list[str]:
    """Names of the parts that are not zero in every row of a budget, in their order."""
    return [name for name in BUDGET_ROWS if any(row["parts"].get(name) for row in budget)]


def asset(name: str) -> str:
    """Text of a file that belongs to the pages."""
    return resources.files("mjsim.report").joinpath("assets", name).read_text(encoding="utf-8")


def at(data: Any, pointer: str) -> Any:
    """What a JSON pointer (``/models/0/rms_um``) points to; None where nothing is."""
    for key in pointer.split("/")[1:]:
        if isinstance(data, list):
            data = data[int(key)] if int(key) < len(data) else None
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data


def script_json(data: Any) -> str:
    """JSON that is safe inside a ``script`` element: no text can end the element or begin a comment. Not-a-numbers
    become null.
    """
    text = json.dumps(finite(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def data_uri(figure: Figure, colours: int | None = _COLOURS) -> str:
    """The figure as the value of an ``img`` element's ``src``: a PNG.

    Args:
        figure: What is drawn.
        colours: Of its palette, which is enough for a line drawing; ``None`` keeps all.
    """
    import numpy as np
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    figure.set_dpi(_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    if colours:  # the median cut, Pillow's default, would lose the few dots of an axis letter's colour
        image = image.quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    image.save(buffer, "PNG")  # an optimised one is a tenth smaller, and takes ten times as long
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def _ladder_image(content: ReportContent) -> str | None:
    if not content.models:
        return None
    steps = [ladder.LadderStep(row.label, row.rms_um) for row in content.models]
    return data_uri(ladder.ladder_figure(steps, content.noise_um))


def _waterfall_image(content: ReportContent) -> str | None:
    if not content.waterfall or not content.models:
        return None
    falls = [Fall(row.cause, row.percent, row.after_um, row.finding) for row in content.waterfall]
    ends = content.models[content.start].rms_um, content.models[-1].rms_um
    return data_uri(waterfall_figure(ends[0], falls, ends[1], content.noise_um))


def _overview_image(content: ReportContent) -> str | None:
    tests = [(test.name, test.after or test.before) for test in content.tests if test.before or test.after]
    return data_uri(polar.overview_figure(tests)) if len(tests) > 1 else None


def _section(test: TestSection) -> dict[str, Any]:
    """Images of one test; both polar plots have one scale, so that they can be compared by eye."""
    together = [*test.before, *test.after]
    step = polar.division_um(together) if together else None
    return {
        "test": test,
        "before": data_uri(polar.polar_figure(test.before, "as given", None, step, 4.2)) if test.before else None,
        "after": data_uri(polar.polar_figure(test.after, "final model", None, step, 4.2)) if test.after else None,
        "residual": data_uri(residual.residual_figure([test.residual])) if test.residual else None,
    }


def _best_repair(content: ReportContent) -> int | None:
    """Place of the single repair that gains most, if one gains anything."""
    rows = content.what_if.rows if content.what_if else ()
    return next((i for i, r in enumerate(rows) if r.kind != "share" and r.remedy and r.gain_um > 0.0), None)


def _removed(content: ReportContent) -> str | None:
    """Share of the error beyond the noise that the last model removed from that of the machine as given."""
    if len(content.models) < content.start + 2:
        return None
    noise = content.noise_um or 0.0
    before, after = (max(content.models[i].rms_um ** 2 - noise**2, 0.0) ** 0.5 for i in (content.start, -1))
    share = percent_removed(before, after)
    return None if share == NONE else "> 99.9 %" if share == "100.0 %" else share
