"""What the error consists of: the calibration against its limits, and the error by cause down to the noise."""

import dataclasses
import html
import re
from types import SimpleNamespace

import numpy as np
import pytest
from test_report import _content, _plain

from mjsim.cli.compare import calibration_sentence, share_text
from mjsim.commands.calibrate import calibrate
from mjsim.effects.registry import make
from mjsim.inference.budget import Budget
from mjsim.inference.calibration import calibrated_effects
from mjsim.inference.findings import ClassSizes
from mjsim.inference.shares import Calibration
from mjsim.plots.waterfall import Fall, waterfall_figure
from mjsim.report import causes, whatif
from mjsim.report.page import render

TOLERANCE = {"backlash": {"um": 0.8, "deg": 0.0008}, "squareness": {"urad": 24.0}, "pitch_error": {"deg": 0.0014}}


def _calibration(machine, key, width, rms, **values):
    """An entry of the calibration with an interval of the given half width."""
    expected = next(c for c in calibrated_effects(machine) if c.key == key)
    free = expected.free.with_effect(expected.free.effect.replaced(**values))
    name = free.names[0]
    v = values[name]
    if name == "components":
        ends = [[[o, max(a - width, 0.0), p] for o, a, p in v], [[o, a + width, p] for o, a, p in v]]
    else:
        ends = [v - width, v + width]
    return Calibration(free, {name: ends}, next(iter(expected.limits.values())), True, rms)


@pytest.mark.parametrize(("width_deg", "beyond"), [(0.0004, 0.0), (0.0008, 0.0), (0.0016, 0.5), (0.0032, 0.75)])
def test_what_is_beyond_a_limit_is_what_goes_when_the_limit_is_kept(m1, width_deg, beyond):
    machine = dataclasses.replace(m1, tolerance=TOLERANCE)
    known = {c.key: c for c in calibrated_effects(machine)}
    free = known["backlash.A"].free
    free = free.with_effect(free.effect.replaced(width_deg=width_deg))
    assert ClassSizes(known, machine).excess(free) == pytest.approx(beyond)
    assert ClassSizes({}, machine).excess(free) == 1.0  # of a machine without a class nothing is allowed


@pytest.fixture
def result(m1):
    """A diagnosis with one finding beyond its limit, and three calibrated effects."""
    machine = dataclasses.replace(m1, tolerance=TOLERANCE)
    found = SimpleNamespace(
        effect=make("backlash.A", width_deg=0.0024), free=("width_deg",), ci95={"width_deg": [0.0023, 0.0025]}
    )
    waves = [[60.0, 0.0003, 10.0], [120.0, 0.0001, -20.0]]
    calibration = (
        _calibration(machine, "squareness.XY", 1.0, 0.4e-6, angle_urad=18.0),
        _calibration(machine, "squareness.ZX", 23.0, 0.01e-6, angle_urad=0.5),
        _calibration(machine, "pitch_error.A", 0.0001, 0.2e-6, components=waves),
    )
    known = Budget("squareness.XY", "angle_urad", "µrad", 18.0, 2.0, {"noise": 2.0}, 0.0, 20.0, 0.16)
    return SimpleNamespace(
        effects=(found,),
        budget=(known,),
        calibration=calibration,
        shares={},
        explained_shares={"backlash.A": 0.6, "squareness.*": 0.3, "pitch_error.*": 0.095, "friction.*": 0.005},
        before=SimpleNamespace(machine=machine, rms=1.0e-6),
        after=SimpleNamespace(rms=0.12e-6),
    )


def test_every_number_stands_against_its_limit(result):
    rows = causes.calibration_rows(result)
    assert {r.effect_id: r.beyond_percent for r in rows}["squareness.XY"] == 16.0
    assert [(r.effect_id, r.finding, r.observable) for r in rows] == [
        ("backlash.A", True, True),
        ("squareness.XY", False, True),
        ("pitch_error.A", False, True),
        ("pitch_error.A", False, True),
        ("squareness.ZX", False, False),
    ]
    assert rows[0].used_percent == pytest.approx(300.0) and rows[1].used_percent == pytest.approx(75.0)
    assert (rows[2].name, rows[2].unit, rows[2].limit) == ("order 60", "°", 0.0014)
    assert [r.beyond for r in rows] == [True, False, False, False, False]
    assert rows[1].rms_um == pytest.approx(0.4) and rows[0].rms_um is None


def test_a_number_departs_from_what_the_file_states(m1):
    machine = dataclasses.replace(m1, tolerance={"friction": {"ratio": 0.4}})
    stated = machine.effect("friction.X").values["coulomb_Nm"]
    entry = _calibration(machine, "friction.X", 0.05 * stated, 0.1e-6, coulomb_Nm=1.1 * stated)
    result = SimpleNamespace(effects=(), calibration=(entry,), before=SimpleNamespace(machine=machine), budget=())
    (row,) = causes.calibration_rows(result)
    assert row.expected == stated and row.used_percent == pytest.approx(25.0, abs=0.1) and row.unit == "N·m"


def test_the_waterfall_ends_at_the_final_model(result):
    falls = causes.waterfall(result)
    assert [f.cause for f in falls] == ["backlash.A", "squareness.*", "pitch_error.*", "1 smaller"]
    assert [f.finding for f in falls] == [True, False, False, False]
    assert falls[-1].after_um == pytest.approx(0.12, abs=1e-4)
    assert sum(f.percent for f in falls) == pytest.approx(100.0)
    explained = 1.0 - 0.12**2
    assert falls[0].rms_um == pytest.approx(np.sqrt(0.6 * explained), abs=1e-4)
    levels = [1.0, *(f.after_um for f in falls)]
    for f, high, low in zip(falls, levels, levels[1:], strict=False):
        assert high**2 - low**2 == pytest.approx(f.percent / 100.0 * explained, abs=2e-4)


def test_without_anything_explained_there_is_no_waterfall(result):
    result.after.rms = result.before.rms
    assert causes.waterfall(result) == []


def test_the_picture_of_the_waterfall_has_a_bar_for_each_cause():
    falls = [Fall("backlash.A", 80.0, 0.45, True), Fall("squareness.*", 20.0, 0.12)]
    figure = waterfall_figure(1.0, falls, 0.12, 0.115)
    (axes,) = figure.axes
    bars = {round(p.get_y() + 0.31): (p.get_x(), p.get_width()) for p in axes.patches}
    assert bars[1] == pytest.approx((0.45, 0.55)) and bars[2] == pytest.approx((0.12, 0.33))
    assert [t.get_text() for t in axes.get_yticklabels()][1:3] == ["backlash.A", "squareness.*"]
    with pytest.raises(ValueError, match="at least one"):
        waterfall_figure(1.0, [], 0.1)


def test_the_page_shows_calibration_and_causes(result):
    content = _content(calibration=causes.calibration_rows(result), waterfall=causes.waterfall(result))
    page = render(content)
    text = html.unescape(_plain(page))
    assert "These 5 numbers have a tolerance" in text and "The tests do not observe 1 of them" in text
    assert "Error by cause" in text and "1 smaller" in text
    assert len(re.findall(r'<svg class="limit-bar', page)) == 5
    table = page[page.index('id="calibration-table"') :]
    assert table.index("backlash.A") < table.index("squareness.XY") < table.index("pitch_error.A")


def test_a_page_without_tolerance_has_no_calibration():
    assert "Calibration against the tolerance" not in render(_content())


def test_effects_within_tolerance_are_one_row_of_the_repairs(result):
    machine = result.before.machine
    changed = machine.with_effect(make("backlash.A", width_deg=0.002)).with_effect(
        make("squareness.XY", angle_urad=9.0)
    )
    rows = whatif.causes(changed, machine, {"backlash.A"}, {"squareness.XY"})
    names = [c.name for c in rows]
    assert whatif.WITHIN in names and "backlash.A" in names and "squareness.XY" not in names
    within = next(c for c in rows if c.name == whatif.WITHIN)
    assert within.machine.effect("squareness.XY") is None and within.machine.effect("backlash.A") is not None


def test_the_line_on_the_calibration():
    data = {
        "calibration": [
            {"id": "squareness.XY", "observable": True, "rms_um": 0.4},
            {"id": "squareness.ZX", "observable": False, "rms_um": 0.01},
        ],
        "shares": [{"id": "backlash.A", "share": 0.7}, {"id": "squareness.*", "share": 0.3}],
    }
    sentence = calibration_sentence(data)
    assert "2 effects, 30 % of the error, 1 of them observable" in sentence and "squareness.XY (0.40 µm)" in sentence
    assert [share_text(x) for x in (0.62, 0.034, 0.0002)] == ["62 %", "3.4 %", "< 0.1 %"]


def test_calibrating_needs_a_tolerance(m1, tmp_path):
    with pytest.raises(ValueError, match=r"has no \[tolerance\] table"):
        calibrate(SimpleNamespace(measured_parts={"ball_bar": None}, in_motion=SimpleNamespace(measured=(1,))), m1)


def test_effects_beyond_the_ladder_share_its_last_step():
    from mjsim.commands.diagnosis import Diagnosis

    def own(effects, rungs):
        bars = SimpleNamespace(effects=effects)
        return Diagnosis.own_rungs.fget(SimpleNamespace(of_bars=lambda: bars, rungs=rungs))

    a, b, c, d, e, last = (object() for _ in range(6))
    assert own((), (a, last)) == 0
    assert own((1, 2), (a, b, last)) == 2
    assert own(tuple(range(7)), (a, b, c, d, e, last, last, last)) == 4


def test_many_findings_are_a_table(capsys):
    from mjsim.cli.diagnose import show
    from mjsim.inference.unexplained import FurtherCurve

    def finding(i):
        waves = {"components": [[60.0, 0.001, 5.0], [120.0, 0.003, 7.0]]}
        ends = {
            "components": [[[60.0, 0.0009, 4.0], [120.0, 0.0029, 6.0]], [[60.0, 0.0011, 6.0], [120.0, 0.0031, 8.0]]]
        }
        parameters, ci95 = (waves, ends) if i == 5 else ({"ppm": 3.0 + i}, {"ppm": [2.0 + i, 4.0 + i]})
        kind = "pitch_error.A" if i == 5 else f"scale_error.{'XYZ'[i % 3]}"
        rms = {"rms_before_um": 1.0, "rms_after_um": 0.5}
        told = {"probability": 0.98, "alternatives": [], "alternative_ids": [], "tests": []}
        return {"id": kind, "parameters": parameters, "ci95": ci95, **rms, **told}

    data = {
        "verdict": "identified", "rms_before_um": 2.0, "rms_after_um": 0.12, "noise_um": 0.11, "left_out": [],
        "effects": [finding(i) for i in range(7)], "shares": [{"id": "pitch_error.A", "share": 0.02}],
        "calibration": [], "unexplained": None, "next_test": None, "not_testable": [],
        "further_curves": [FurtherCurve("C", "Z", "position", 5e-7, 6e-7, 1e-7, 0.01).to_json()],
    }  # fmt: skip
    show(data, "c")
    text = capsys.readouterr().out
    curve = "acts on the Z axis and depends on the C axis' position: up to 0.5 µm, 0.10 µm RMS in the readings"
    assert curve in " ".join(text.split()) and "may have 0.6 µm" in " ".join(text.split())
    assert text.count("→") == 4  # in full
    assert "order 120: 0.00300 and 1" in text and "0.00290 to 0.00310" in text and "2.0 %" in text
    assert all(len(line) <= 80 for line in text.splitlines())


def test_the_remedy_fits_the_axis():
    from mjsim.cli.diagnose import remedy_text

    assert "worm" in remedy_text("backlash.C") and "nut" not in remedy_text("backlash.C")
    assert "nut" in remedy_text("backlash.X") and "worm" not in remedy_text("backlash.X")
    assert "no remedy" in remedy_text("my_own_effect.C")
