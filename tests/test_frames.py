"""Results as data frames: what the dataclasses hold, in the units of the columns' names."""

from dataclasses import replace

import numpy as np
import pytest

import mjsim
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.effects.registry import make
from mjsim.io.resources import examples
from mjsim.paper.figures import PaperFigures
from mjsim.paper.numbers import Number


def test_simulation(m1, cone):
    (s,) = mjsim.simulate(m1, [cone(45, 30, (50, 0, 155), feed=8000)])
    frame = s.to_dataframe()
    assert list(frame.columns[:4]) == ["time_s", "phi_deg", "deviation_um", "X_command_mm"]
    assert len(frame) == len(s.time) and len(frame.columns) == 13
    np.testing.assert_allclose(frame["deviation_um"], s.deviation * 1e6)
    np.testing.assert_allclose(frame["A_actual_deg"], np.degrees(s.position[:, 3]))
    np.testing.assert_allclose(frame["Z_command_mm"], s.command[:, 2] * 1e3)


@pytest.fixture(scope="module")
def comparison():
    campaign = mjsim.read_campaign(examples() / "hidden-backlash")
    few = replace(
        campaign, tests=tuple(t for t in campaign.tests if t.name in ("circle-xy-ccw", "rotary-a-tangential-ccw"))
    )
    return mjsim.compare(few, mjsim.read_machine(campaign.machine_file))


def test_comparison(comparison):
    frame = comparison.to_dataframe().set_index("test")
    for t in comparison.tests:
        row = frame.loc[t.test.name]
        assert row["rms_um"] == pytest.approx(t.rms * 1e6, abs=1e-4)
        assert row["kind"] == t.test.kind
    circle = comparison.tests[[t.test.name for t in comparison.tests].index("circle-xy-ccw")]
    assert frame.loc["circle-xy-ccw", "measured_circular_error_um"] == circle.iso["measured"]["circular_error_um"]
    assert np.isnan(frame.loc["rotary-a-tangential-ccw", "measured_circular_error_um"])


def test_diagnosis(comparison):
    play = DiagnosedEffect(
        make("backlash.A", width_deg=0.002),
        ("width_deg",),
        {"width_deg": [0.0019, 0.0021]},
        1e-6,
        1e-7,
        ("servo_delay.A",),
        (),
    )
    waves = make("pitch_error.C", components=[[72, 0.0025, 10.0]])
    bounds = [[[72, 0.0024, 9.0]], [[72, 0.0026, 11.0]]]
    pitch = DiagnosedEffect(waves, ("components",), {"components": bounds}, 1e-6, 1e-7, (), ())
    result = Diagnosis(
        comparison.campaign, "ambiguous", 1e-7, (play, pitch), None, (), comparison.machine, comparison, comparison
    )
    rows = result.to_dataframe().to_dict("records")
    assert rows[0] == {
        "effect": "backlash.A", "parameter": "width_deg", "value": 0.002, "low": 0.0019, "high": 0.0021,
        "alternatives": "servo_delay.A",
    }  # fmt: skip
    assert [(r["parameter"], r["value"], r["low"], r["high"]) for r in rows[1:]] == [
        ("order 72 amplitude", 0.0025, 0.0024, 0.0026),
        ("order 72 phase", 10.0, 9.0, 11.0),
    ]


def test_no_effect_gives_an_empty_frame(comparison):
    empty = Diagnosis(
        comparison.campaign, "nothing_found", 1e-7, (), None, (), comparison.machine, comparison, comparison
    )
    frame = empty.to_dataframe()
    assert frame.empty and "parameter" in frame.columns


def test_paper_figures():
    frame = PaperFigures((), (Number("worm", "A_teeth", 60, 60), Number("worm", "C_teeth", 72, 71))).to_dataframe()
    assert frame["agrees"].tolist() == [True, False]
