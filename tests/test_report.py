"""The report page: says what it was given, escapes it, loads nothing, is the same every time."""

import dataclasses
import html
import html.parser
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.commands.finding import percent
from mjsim.digits import estimate
from mjsim.effects import registry
from mjsim.effects.registry import make
from mjsim.errors import InputError
from mjsim.inference.budget import Budget
from mjsim.instruments.ball_bar.iso230 import BidirectionalFigures, circular_figures
from mjsim.io.resources import examples
from mjsim.machine.axis import is_rotary
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.effect import UNKNOWN
from mjsim.plots.polar import PolarTrace
from mjsim.plots.residual import ResidualTrace
from mjsim.plots.trend import TrendSeries, trend_figure
from mjsim.prediction.part_run import PartRun
from mjsim.report import build, content, trend, whatif
from mjsim.report.build import kept, part_sections, steps
from mjsim.report.content import (
    BidirectionalRow,
    Finding,
    ModelRow,
    NotTestable,
    ParameterRow,
    Rejected,
    RepairRow,
    ReportContent,
    SetUpRow,
    TestSection,
    WhatIf,
    interval,
    percent_removed,
    um,
)
from mjsim.report.page import asset, at, render, render_trend, script_json
from mjsim.report.write import check_same_machine

PHI = np.linspace(0.0, 720.0, 1441)
HOSTILE = "<script src=\"http://evil.example/x.js\">alert('1')</script>"


def _content(name="cone15-ccw", **changes):
    measured = 2.0 * np.cos(np.radians(2 * PHI))

    def polar(factor):
        return [PolarTrace("measured", PHI, measured), PolarTrace("simulated", PHI, factor * measured, "simulated")]

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
        worst=name,
    )
    repair = RepairRow(
        "backlash.A", name, name, "adjust", name, "full simulation", 1.4, 0.7, 33.3, [4.04], name, 2.02, 33.3
    )
    content = ReportContent(
        title=f"Campaign of {name}",
        summary=[("machine", name)],
        verdict="identified",
        verdict_sentence=f"Backlash of A in {name}.",
        models=[
            ModelRow("rigid kinematics", 3.21, [3.22], name, "kinematics"),
            ModelRow("machine as given", 1.08, [1.11]),
            ModelRow(name, 0.13, [0.14]),
        ],
        start=1,
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
                98.7,
                99.2,
                name,
                Rejected("straightness.EXY", 43.2),
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
        what_if=WhatIf(2.1, [6.06], [repair]),
        diagnosis={"verdict": name},
        provenance=[("mjsim", "0.1.0"), ("seed", "7"), ("hash", name)],
        date="2026-11-21",
    )
    return dataclasses.replace(content, **changes)


def _drawn(name="cone15-ccw"):
    """Content whose page has interactive plots."""
    row = [0, 100, 200]
    places = {"phi": row, **{a: row for a in "XYZAC"}}
    one = {
        "name": name,
        "phi": row,
        "measured": [1, None, 3],
        "models": [row] * 3,
        "centre": [0, 0, 0],
        "axes": places,
    }
    return _content(name, traces=[one | {"shift": 180.0, "full": False, "events": [["A", 180.5]], "noise": 0.12}])


def _plain(page):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<(style|script).*?</\1>", "", page, flags=re.S)))


class _Checker(html.parser.HTMLParser):
    VOID = ("meta", "img", "br", "link", "input")

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
    assert not checker.tags & {"iframe", "object", "base", "embed", "form"}
    assert len(checker.links) > 3
    for link in checker.links:
        assert link.startswith(("data:", "#"))
        if link.startswith("#"):
            assert link[1:] in checker.ids
    assert len(checker.ids) == len(set(checker.ids))
    text = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    text = text.replace('http-equiv="Content-Security-Policy"', "")
    assert "http" not in text and "@import" not in text and "url(" not in text
    assert "default-src 'none'" in page  # the browser itself then refuses every request


def test_a_page_with_plots_brings_its_scripts_with_it():
    page, still = render(_drawn()), render(_content())
    assert {"button", "select", "input", "noscript"} <= _checked(page).tags - _checked(still).tags
    for script in map(asset, ("common.js", "plot.js", "report.js")):
        assert page.count(script) == 1 and script not in still
    assert not re.search(r"<script[^>]*\bsrc=", page)
    assert "fetch(" not in page and "XMLHttpRequest" not in page and "import(" not in page
    assert len(page) < 300_000


def test_hostile_names_are_escaped_everywhere():
    page = render(_content(HOSTILE))
    checker = _checked(page)
    assert "<script src" not in page and page.count("<script") == 1  # the numbers
    assert not any("evil" in link for link in checker.links)
    assert page.count("&lt;script") >= 10


def test_numbers_inside_the_page_cannot_end_their_element():
    page = render(_drawn(HOSTILE))
    own = re.findall(r'<script type="application/json" id="[a-z-]+">(.*?)</script>', page, re.S)
    assert len(own) == 2
    for text in own:
        assert not set("<>&") & set(text)
    assert json.loads(own[0])["findings"][0]["title"] == HOSTILE
    assert json.loads(own[1])[0]["name"] == HOSTILE
    assert script_json({"a": "\u2028<!--", "b": float("nan")}) == '{"a":"\\u2028\\u003c!--","b":null}'


def test_every_number_says_where_in_the_json_it_is():
    content = _content()
    page = render(content)
    data = json.loads(re.search(r'id="mjsim-numbers">(.*?)</script>', page, re.S)[1])
    assert data == content.to_json()
    marked = re.findall(r'<span data-json="([^"]+)">([^<]*)</span>', page)
    assert len(marked) > 30
    for pointer, shown in marked:
        value = at(data, pointer)
        if value is None:
            assert shown == "–"
        else:
            decimals = len(shown.partition(".")[2])
            assert float(shown.replace("−", "-")) == pytest.approx(value, abs=0.5001 * 10.0**-decimals), pointer
    assert {p.split("/")[1] for p, _ in marked} >= {
        "models",
        "findings",
        "what_if",
        "tests",
        "setups",
        "bidirectional",
        "noise_um",
    }


def test_page_is_the_same_every_time():
    assert render(_content()) == render(_content())


def test_page_says_the_numbers():
    text = _plain(render(_content()))
    for said in (
        "1.08 µm", "0.13 µm", "0.12 µm", "backlash.A", "servo_delay.A", "0.001991", "0.001971 to 0.002012", "10.25",
        "−3.40", "−12.3",
        "3.02 µm", "8.1", "−0.4", "2026-11-21", "0.1.0", "axis_location.EC0A", "half-differences", "Identified",
        "0.70 µm gained by the best single repair, backlash.A", "98.7", "99.2", "2.02 µm, 33 %",
        "straightness.EXY , reaches 43 %", "rigid kinematics", "2.10 µm",
    ):  # fmt: skip
        assert said in text, said
    assert "cone15-ccw 3.22 1.11 0.14" in text
    assert "cone15-ccw 6.1 4.0" in text
    assert "cone15-ccw 4.0 2.0 −2.0 2.0 1.0 −1.0 4.0 2.0 −2.0" in text


def test_figures_there_are_those_that_can_be_drawn():
    assert render(_content()).count("<img") == 4  # ladder, before, after, residual; one test needs no overview
    two = _content()
    assert (
        render(
            dataclasses.replace(
                two, tests=[*two.tests, dataclasses.replace(two.tests[0], name="other", after=(), residual=None)]
            )
        ).count("<img")
        == 6
    )


def test_a_report_before_any_diagnosis_is_a_report():
    page = render(
        ReportContent(
            title="t", summary=[], verdict=None, verdict_sentence="Not diagnosed yet.", models=[], findings=[], tests=[]
        )
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
    content = _content(models=[ModelRow("start", 1.0, [1.0]), ModelRow("+ x", 0.5, [float("nan")])], start=0)
    assert "cone15-ccw 1.00 –" in _plain(render(content))


@pytest.mark.parametrize(
    ("value", "low", "high", "shown", "span"),
    [
        (0.0019912, 0.001971, 0.002012, "0.001991", "0.001971 to 0.002012"),
        (1234.56, 1200.0, 1270.0, "1235", "1200 to 1270"),
        (12345.6, 11000.0, 13600.0, "12300", "11000 to 13600"),
        (1.2345, 1.135, 1.3342, "1.23", "1.14 to 1.33"),
        (-5.0123, -5.2, -4.8, "−5.01", "−5.20 to −4.80"),
        (0.0019912, None, None, "0.001991", "–"),
        (0.0, None, None, "0", "–"),
    ],
)
def test_estimates_are_rounded_by_their_interval(value, low, high, shown, span):
    parameter = ParameterRow("p", value, low, high)
    assert content.estimate(parameter) == shown
    assert interval(parameter) == span


def test_the_page_has_the_budget_of_every_number():
    rows = {"noise": 0.004, "set_up": 0.003, "instrument": 0.0361, "data_sheet": 0.0}
    known = Budget("backlash.Y", "width_um", "µm", 0.8294, 0.0367, rows, 0.0, 0.8, 0.7885)
    page = render(_content(diagnosis={"budget": [known.to_json()]}, instrument_source="certificate 4711"))
    text = _plain(page)
    assert "backlash.Y width_um, µm 0.829 0.073 0.004 0.003 0.036" in text
    assert "known from: certificate 4711" in text and "most of it from instrument (0.036 of 0.037 µm)" in text
    assert (known.decision, known.to_json()["probability_beyond"]) == ("open", 0.7885)
    assert 'id="budget"' not in render(_content())


def test_every_interval_on_the_page_has_two_digits(tmp_path):
    """Of findings, and of the largest deviation, paths and blocks of a part."""
    machine = read_machine(examples() / "hidden-backlash" / "machine.toml")
    file = tmp_path / "two.nc"
    file.write_text("G21 G90 G94 M3\nG0 X0. Y0. Z0.\nG1 X20. F600.\nG0 Z5.\nX0.\nG1 Y20.\nM30\n")
    sections = part_sections([PartRun(str(file), (0.04, 0.01, 0.12), tolerance=1e-3)], machine)
    page = _plain(render(_content("cone15-ccw", parts=sections)))
    rows = re.findall(r"([−0-9.]+) (?:µm, 95 % interval )?([−0-9.]+) to ([−0-9.]+)", page)
    assert len(rows) >= 5
    for row in rows:
        decimals = {len(x.partition(".")[2]) for x in row}
        assert len(decimals) == 1, row
        low, high = (float(x.replace("−", "-")) for x in row[1:])
        if high > low:  # a block that nothing uncertain moves has no width
            assert 9 <= (high - low) / 2 * 10 ** decimals.pop() <= 100.5, row


def test_numbers_have_no_negative_zero_and_no_nan():
    assert um(-0.001) == "0.00"
    assert um(None) == um(float("nan")) == "–"
    assert percent_removed(2.0, 1.0) == "75.0 %"
    assert percent_removed(0.0, 1.0) == "–"


@pytest.mark.parametrize(
    ("p", "said"), [(1.0, "over 99.9 %"), (0.9973, "99.7 %"), (0.62, "62 %"), (0.012, "1 %"), (0.001, "below 1 %")]
)
def test_probabilities_are_told_as_they_are_read(p, said):
    assert percent(p) == said


def test_thinned_traces_keep_every_glitch():
    phi = np.linspace(0.0, 4.0 * np.pi, 30000)
    signal = np.zeros(30000)
    signal[[777, 12345, 29000]] = 5.0, -7.0, 9.0
    index = kept(phi, signal, per_turn=500)
    assert len(index) < 1100 and index[0] == 0 and index[-1] == 29999
    assert {777, 12345, 29000} <= set(index.tolist())
    assert kept(phi[:100], signal[:100]).tolist() == list(range(100))


def test_steps_of_a_list_add_up_to_it():
    values = [1200, 1201, None, 1199, None, None, 1200]
    packed = steps(values)
    assert packed == [1200, 1, None, -2, None, None, 1]
    assert [
        None if d is None else sum(x for x in packed[: i + 1] if x is not None) for i, d in enumerate(packed)
    ] == values
    assert steps([]) == []


# -- the answer --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (make("servo_gain.C", ratio=1.0308), "position gain about 3.1 % too high"),
        (make("servo_gain.X", ratio=0.97), "position gain about 3.0 % too low"),
        (make("backlash.A", width_deg=0.00199), "backlash of about 0.0020°"),
        (make("backlash.X", width_um=12.34), "backlash of about 12 µm"),
        (make("servo_delay.Y", delay_ms=-0.5), "command delay of about −0.50 ms"),
        (make("velocity_feedforward.X", ratio=0.05), "velocity feedforward of about 5.0 %"),
        (
            make("pitch_error.C", components=[[72, 0.001, 0.0], [1, -0.0012, 0.0]]),
            "pitch error of about 0.0012° at order 1 and 1 more",
        ),
        (make("drive_compliance.A", stiffness_Nm_per_urad=2.0), "elastic drive with a stiffness of about 2.0 N·m/µrad"),
        (make("friction_direction.X", share_ratio=0.2), "friction by direction of about 20 %"),
        (make("straightness.EXZ", quadratic_um=0.015, cubic_um=-0.244), "straightness error of about −0.24 µm"),
        (make("worm_wear.A", depth_deg=0.002, centre_deg=30.0, width_deg=3.0), "worm wear of about 0.0020°"),
    ],
)
def test_the_answer_names_cause_and_size(effect, said):
    assert build.sized(effect) == said


def test_the_answer_compares_with_the_machine_file(m1):
    former = m1.effect("friction.Y")
    torque = former.values["coulomb_Nm"]
    assert build.sized(former.replaced(coulomb_Nm=1.5 * torque), former).endswith(
        "(about 50 % above the machine file's)"
    )
    assert build.sized(former.replaced(coulomb_Nm=0.8 * torque), former).endswith(
        "(about 20 % below the machine file's)"
    )


def test_every_effect_of_the_catalogue_has_a_name_and_a_remedy():
    for cls in (c for c in registry.kinds().values() if c.__module__.startswith("mjsim.effects")):
        assert build.noun(cls) and cls.remedy is not UNKNOWN
        assert cls.remedy.kind in ("adjust", "compensate", "maintain", "share") and cls.remedy.text.endswith(".")


def test_a_remedy_fits_the_axis():
    """A linear axis has a screw and a nut, a rotary axis a worm: neither is told to mend what it does not have."""
    for cls in registry.kinds().values():
        for subject in cls.subjects_of(FIVE_AXIS):
            if len(subject) == 1:
                foreign = {"screw", "nut", "guideway"} if is_rotary(subject) else {"worm", "wheel"}
                text = cls.remedy.on(subject).text
                assert not foreign & set(re.findall(r"[a-z]+", text.lower())), f"{cls.kind}.{subject}: {text}"


@pytest.mark.parametrize(
    ("effect_id", "said"),
    [
        ("servo_gain.C", "a wrong position gain of C"),
        ("loop_delay.X", "a loop delay of X"),
        ("axis_location.EXC", "a location error of EXC"),
        ("integral_time.Z", "an integral time of Z"),
        ("worm_wear.A[CW]", "worm wear of A"),
        ("inertia.Y", "inertia of Y"),
        ("my_wave.Y", "a my wave of Y"),
    ],
)
def test_an_alternative_is_named_without_its_size(effect_id, said):
    assert build._named(effect_id) == said


def _found(effect, alternatives=(), shares=(None,)):
    others = dict(zip(alternatives, shares[1:], strict=False))
    return SimpleNamespace(effect=effect, alternatives=alternatives, probability=shares[0], others=others, ci95={})


NEXT = {
    "test": {"kind": "cone_frustum", "table_ball_mm": [0.0, 100.0, 155.0], "feed_mm_min": 4000.0},
    "minutes": 4.3,
    "decides": True,
}


@pytest.mark.parametrize(
    ("verdict", "effects", "following", "lines", "sentence"),
    [
        (
            "ambiguous", [_found(make("servo_gain.C", ratio=1.0308), ("servo_delay.C",), (0.93, 0.07))], NEXT,
            ["C axis: position gain about 3.1 % too high (93 %), or a command delay of C (7 %)."],
            "These 7 tests cannot decide. Next: one 4-minute test (cone, Y 100 mm, 4000 mm/min).",
        ),
        (
            "ambiguous", [_found(make("servo_delay.C", delay_ms=0.5), ("servo_gain.C", "backlash.C"))],
            NEXT | {"decides": False},
            ["C axis: command delay of about 0.50 ms, or a wrong position gain of C, or backlash of C."],
            "These 7 tests cannot decide. No test within reach decides. The best is one of 4 minutes (cone, Y 100 "
            "mm, 4000 mm/min).",
        ),
        (
            "identified", [_found(make("backlash.A", width_deg=0.002)), _found(make("squareness.XY",
            angle_urad=21.4))], None,
            ["A axis: backlash of about 0.0020°.", "XY: squareness error of about 21 µrad."],
            "No other effect of the catalogue explains the measurement as well.",
        ),
        (
            "nothing_found", [], None, ["No effect is missing from the machine's model."],
            "The measurement shows no error larger than the data sheet and the machine's class allow.",
        ),
    ],
)  # fmt: skip
def test_the_first_box_names_the_answer(m1, verdict, effects, following, lines, sentence):
    before = SimpleNamespace(machine=m1, tests=range(7))
    result = SimpleNamespace(effects=effects, before=before, unexplained=None, verdict=verdict, next_test=following)
    assert build.headlines(result) == lines
    assert build.explained(result) == sentence
    page = html.unescape(_plain(render(_content(answer=lines, verdict_sentence=sentence))))
    assert " ".join(lines) in page and sentence in page


def test_many_causes_leave_the_first_box_short(m1):
    found = [_found(make("scale_error.X", ppm=float(i + 1))) for i in range(9)]
    result = SimpleNamespace(effects=found, before=SimpleNamespace(machine=m1), unexplained=None)
    lines = build.headlines(result)
    assert len(lines) == 5 and lines[-1] == "And 5 smaller causes, each with its share in the table."
    rows = [dataclasses.replace(_content().findings[0], rms_before_um=None, rms_after_um=None) for _ in range(9)]
    page = render(_content(findings=rows))
    assert "The other 3 effects in detail" in page and page.count("<details>") == page.count("</details>") == 1
    assert "share the last step of the ladder" in page


def test_a_gain_does_not_treat_an_open_cause_as_decided():
    content = _content()
    row = dataclasses.replace(content.what_if.rows[0], instead=("servo_delay.A",))
    page = _plain(render(dataclasses.replace(content, what_if=dataclasses.replace(content.what_if, rows=[row]))))
    assert "gained by the best single repair, backlash.A, if that is the cause" in page
    assert "the cause could also be servo_delay.A" in page and "Some causes are open" in page
    assert "if that is the cause" not in _plain(render(content)) and "Some causes are open" not in _plain(
        render(content)
    )


# -- repairs -----------------------------------------------------------------------------------------------------------


def test_lags_that_differ_are_a_cause_and_can_be_matched(quiet):
    assert [c.name for c in whatif.causes(quiet, quiet)] == []
    off = quiet.with_effect(make("servo_gain.C", ratio=0.98)).with_effect(make("servo_delay.X", delay_ms=0.2))
    found = {c.name: c for c in whatif.causes(off, quiet)}
    assert set(found) == {"servo_gain.C", "servo_delay.X", "servo lag"}
    assert found["servo_gain.C"].machine.effect("servo_gain.C") is None
    axes = whatif.build(found["servo lag"].machine).axes
    assert np.ptp([whatif.lag(axes[a]) for a in "XYZAC"]) < 1e-6
    assert np.ptp([whatif.lag(whatif.build(off).axes[a]) for a in "XYZAC"]) > 4e-4


def test_friction_that_has_grown_can_go_back(m1):
    former = m1.effect("friction.Y")
    grown = m1.with_effect(former.replaced(coulomb_Nm=2.0 * former.values["coulomb_Nm"]))
    rows = {c.name: c for c in whatif.causes(grown, m1, {"friction.Y"})}
    assert rows["friction.Y"].remedy.kind == "share"
    assert rows["friction.Y as in the file"].remedy.repairable
    assert rows["friction.Y as in the file"].machine.effect("friction.Y").values == former.values
    repaired = whatif._all_repaired(grown.with_effect(make("backlash.A", width_deg=0.001)), m1, list(rows.values()))
    assert repaired.effect("friction.Y").values == former.values and len(repaired.effects) == len(m1.effects) + 1
    assert not any(name.endswith("in the file") for name in {c.name for c in whatif.causes(grown, m1)})


# -- trend -------------------------------------------------------------------------------------------------------------


def test_series_judge_by_their_intervals():
    series = lambda values, half: trend.series_of("x", "µm", "figure", values, half)  # noqa: E731
    grew = series([1.0, 1.2, 2.0], [0.3, 0.3, 0.4])
    assert (grew.verdict, grew.since, grew.change) == ("grew", 2, 1.0)
    assert grew.uncertainty == pytest.approx(0.5)
    assert series([1.0, 1.4], [0.3, 0.4]).verdict == "within uncertainty"
    assert series([-2.0, -1.0], [0.1, 0.1]).verdict == "shrank"
    assert series([-1.0, -2.0], [0.1, 0.1]).verdict == "grew"
    assert series([1.0, 9.0], [None, 0.1]).verdict == "cannot be said"
    assert series([1.0, None], [0.1, None]).verdict == "cannot be said"


def test_trend_page_says_its_numbers_and_escapes_names():
    row = trend.CampaignRow(HOSTILE, "2026-03-01", 3, 0.12, 1.33, 0.11, "identified", ["backlash.A"])
    s = trend.series_of("backlash.A width_deg", "°", "parameter", [0.001, 0.00212], [0.00001, 0.00002], ["", HOSTILE])
    g = trend.series_of("G circle", "µm", "figure", [3.0, 3.1], [0.3, 0.3])
    content = trend.TrendContent("t", [("m", HOSTILE)], [row, row], [g, s], HOSTILE, [("seed", "none")])
    page = render_trend(content)
    text = _plain(page)
    for said in (
        "0.001000",
        "0.002120",
        "0.001120",
        "0.000022",
        "grew",
        "within uncertainty",
        "1.33",
        "2026-03-01",
        "Identified",
    ):
        assert said in text, said
    assert "<script src" not in page and not any("evil" in link for link in _checked(page).links)
    assert render_trend(content) == page


def test_trend_figure_refuses_what_it_cannot_draw():
    with pytest.raises(ValueError, match="at least one"):
        trend_figure([], ["a"])
    with pytest.raises(ValueError, match="2 values"):
        trend_figure([TrendSeries("x", "µm", [1.0], [None], [None])], ["a", "b"])


def test_campaigns_of_other_machines_are_refused(m1, m2, cone, tmp_path):
    test = cone(15, 10, (0, 0, 155))
    a, b = (
        Campaign(name, tmp_path / name, tmp_path / "m.toml", (test,), {test.name: None}, {"ball_bar": None})
        for name in ("a", "b")
    )
    check_same_machine([(a, m1), (b, m1)])
    with pytest.raises(InputError, match=r"b: not of the same machine as .*a: machine 'M1'.*'M2'"):
        check_same_machine([(a, m1), (b, m2)])
    other = dataclasses.replace(m1, drives={**m1.drives, "C": m2.drives["C"]})
    with pytest.raises(InputError, match="worm teeth of C"):
        check_same_machine([(a, m1), (b, other)])
    with pytest.raises(InputError, match="no test has a trace"):
        check_same_machine([(dataclasses.replace(a, traces={}), m1), (b, m1)])


def test_a_predicted_part_has_its_section(tmp_path):
    machine = read_machine(examples() / "hidden-backlash" / "machine.toml")
    sections = part_sections([PartRun("pocket", (0.04, 0.01, 0.12), tolerance=1e-3)], machine)
    content = _content("cone15-ccw", parts=sections)
    page, said = render(content), content.to_json()["parts"][0]["predicted"]
    text = _plain(page)
    assert (
        "square pocket with sharp corners" in text and "Cannot say with these measurements (allowed 1000.0 µm)" in text
    )
    assert (
        f"Largest deviation {estimate(said['largest_um'], said['largest_ci95_um'])} µm" in text
        and "Cutting forces are not included" in text
    )
    assert {b["cause"] for b in said["blocks"]} <= {c["id"] for c in said["causes"]}
    assert 'alt="square pocket with sharp corners: deviation as colour on the path' in page
    assert "Cutting paths" not in text
    assert 'id="parts"' not in render(_content("cone15-ccw"))
    file = tmp_path / "two.nc"
    file.write_text("G21 G90 G94 M3\nG0 X0. Y0. Z0.\nG1 X20. F600.\nG0 Z5.\nX0.\nG1 Y20.\nM30\n")
    sections = part_sections([PartRun(str(file), (0.04, 0.01, 0.12), tolerance=1e-3)], machine)
    text = _plain(render(_content("cone15-ccw", parts=sections)))
    assert "Cutting paths, each for itself" in text and "Words that change no motion: M3 (1, first in line 1)" in text
    assert [p["first_line"] for p in sections[0].predicted["paths"]] == [3, 6]
