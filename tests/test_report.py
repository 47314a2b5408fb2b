"""The report page: says what it was given, escapes it, loads nothing, is the same every time."""

import dataclasses
import html.parser
import re

import numpy as np
import pytest

from mjsim.measure.iso230 import BidirectionalFigures, circular_figures
from mjsim.plots.polar import PolarTrace
from mjsim.plots.residual import ResidualTrace
from mjsim.report import numbers
from mjsim.report.content import (
    BidirectionalRow,
    Finding,
    LadderRow,
    NotTestable,
    ParameterRow,
    ReportContent,
    SetUpRow,
    TestSection,
)
from mjsim.report.page import render

PHI = np.linspace(0.0, 720.0, 1441)
HOSTILE = "<script src=\"http://evil.example/x.js\">alert('1')</script>"


def _content(name="cone15-ccw", **changes):
    measured = 2.0 * np.cos(np.radians(2 * PHI))
    polar = lambda factor: [PolarTrace("measured", PHI, measured), PolarTrace("simulated", PHI, factor * measured, "simulated")]  # noqa: E731
    figures = lambda factor: circular_figures(np.radians(PHI), factor * measured * 1e-6)  # noqa: E731
    test = TestSection(
        name=name,
        conditions="cone frustum, θ = 15°, CCW",
        before=polar(0.5),
        after=polar(1.0),
        residual=ResidualTrace(name, PHI, 0.1 * measured, {"A": [0.0, 180.0]}, 0.12),
        rms_before_um=1.08,
        rms_after_um=0.13,
        measured=figures(1.0),
        simulated_before=figures(0.5),
        simulated_after=figures(1.0),
        trigger_ms=-12.34,
        setup="x50",
    )
    content = ReportContent(
        title=f"Campaign of {name}",
        summary=[("machine", name)],
        verdict="identified",
        verdict_sentence=f"Backlash of A in {name}.",
        ladder=[LadderRow("start", 1.08, {name: 1.11}), LadderRow("+ backlash.A", 0.13, {name: 0.14})],
        findings=[
            Finding(
                "backlash.A",
                name,
                [ParameterRow("width_deg", 0.0019912, 0.001971, 0.002012, "°")],
                1.08,
                0.13,
                ["servo_delay.A"],
                name,
                [name],
            )
        ],
        tests=[test],
        noise_um=0.12,
        noise_source="half-differences of revolutions",
        setups=[SetUpRow("x50", (10.25, -3.4, 5.1), (1.1, -0.4, 0.2), [name])],
        length_offset_um=3.02,
        bidirectional=[BidirectionalRow((name, name + "-cw"), BidirectionalFigures(8.14, -0.44, (0.0, 0.0)))],
        not_testable=[NotTestable("axis_location.EC0A", name)],
        next_test=name,
        provenance=[("mjsim", "0.1.0"), ("seed", "7"), ("hash", name)],
        date="2026-11-21",
    )
    return dataclasses.replace(content, **changes)


def _plain(page):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", page, flags=re.S)))


class _Checker(html.parser.HTMLParser):
    VOID = ("meta", "img", "br", "link")

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.links, self.ids = [], set(), [], []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        attributes = dict(attrs)
        self.links += [attributes[key] for key in ("src", "href", "srcset", "action", "data") if key in attributes]
        self.ids += [attributes["id"]] if "id" in attributes else []
        if tag == "img":
            assert attributes.get("alt")
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def _checked(page):
    checker = _Checker()
    checker.feed(page)
    checker.close()
    assert checker.open == []
    return checker


def test_page_is_well_formed_and_loads_nothing():
    page = render(_content())
    checker = _checked(page)
    assert not checker.tags & {"script", "link", "iframe", "object", "base"}
    assert checker.links
    for link in checker.links:
        assert link.startswith(("data:image/", "#"))
        if link.startswith("#"):
            assert link[1:] in checker.ids
    assert len(checker.ids) == len(set(checker.ids))
    text = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert "http" not in text and "@import" not in text and "url(" not in text


def test_hostile_names_are_escaped_everywhere():
    page = render(_content(HOSTILE))
    assert "<script" not in page
    assert "script" not in _checked(page).tags
    assert page.count("&lt;script") >= 10


def test_page_is_the_same_every_time():
    assert render(_content()) == render(_content())


def test_page_says_the_numbers():
    text = _plain(render(_content()))
    for said in (
        "1.08 µm", "0.13 µm", "0.12 µm", "backlash.A", "servo_delay.A", "0.001991", "0.001971 to 0.002012", "10.25", "−3.40", "−12.3",
        "3.02 µm", "8.1", "−0.4", "2026-11-21", "0.1.0", "axis_location.EC0A", "half-differences", "Identified",
    ):  # fmt: skip
        assert said in text, said
    assert "cone15-ccw 1.11 0.14" in text
    assert "cone15-ccw 4.0 2.0 −2.0 2.0 1.0 −1.0 4.0 2.0 −2.0" in text


def test_figures_there_are_those_that_can_be_drawn():
    assert render(_content()).count("<img") == 4  # ladder, before, after, residual; one test needs no overview
    two = _content()
    assert (
        render(
            dataclasses.replace(two, tests=[*two.tests, dataclasses.replace(two.tests[0], name="other", after=(), residual=None)])
        ).count("<img")
        == 6
    )


def test_a_report_before_any_diagnosis_is_a_report():
    page = render(
        ReportContent(title="t", summary=[], verdict=None, verdict_sentence="Not diagnosed yet.", ladder=[], findings=[], tests=[])
    )
    _checked(page)
    assert "Not diagnosed yet." in page and "<img" not in page and "Evidence" not in page and "Set-up" not in page


def test_ambiguous_alternatives_are_said_and_their_absence_too():
    content = _content()
    assert "cannot tell it from servo_delay.A" in _plain(render(content)).replace(" .", ".")
    alone = dataclasses.replace(content.findings[0], alternatives=())
    assert "No other effect of the catalogue" in _plain(render(dataclasses.replace(content, findings=[alone])))


def test_an_unknown_verdict_is_refused():
    with pytest.raises(ValueError, match="nothing_found"):
        render(_content(verdict="perhaps"))


def test_missing_numbers_are_dashes():
    row = LadderRow("+ x", float("nan"), {})
    text = _plain(render(_content(ladder=[LadderRow("start", 1.0, {"cone15-ccw": 1.0}), dataclasses.replace(row, rms_um=0.5)])))
    assert "cone15-ccw 1.00 –" in text


@pytest.mark.parametrize(
    ("value", "low", "high", "shown", "span"),
    [
        (0.0019912, 0.001971, 0.002012, "0.001991", "0.001971 to 0.002012"),
        (1234.56, 1200.0, 1270.0, "1235", "1200 to 1270"),
        (-5.0123, -5.2, -4.8, "−5.01", "−5.20 to −4.80"),
        (0.0019912, None, None, "0.001991", "–"),
        (0.0, None, None, "0", "–"),
    ],
)
def test_estimates_are_rounded_by_their_interval(value, low, high, shown, span):
    parameter = ParameterRow("p", value, low, high)
    assert numbers.estimate(parameter) == shown
    assert numbers.interval(parameter) == span


def test_numbers_have_no_negative_zero_and_no_nan():
    assert numbers.um(-0.001) == "0.00"
    assert numbers.um(None) == numbers.um(float("nan")) == "–"
    assert numbers.percent_removed(2.0, 1.0) == "75.0 %"
    assert numbers.percent_removed(0.0, 1.0) == "–"
