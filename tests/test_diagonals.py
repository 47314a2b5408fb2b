"""Diagonals of ISO 230-6: several linear axes go along a line, and a laser reads how far they have gone."""

import numpy as np
import pytest
from independent import positions

import mjsim
from mjsim.campaign.machine_file import machine_of
from mjsim.commands.any_instrument import compare_plainly
from mjsim.errors import InputError
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.positions.instrument import position_mistakes

LOW, HIGH = {"X": -100.0, "Y": -80.0, "Z": -60.0}, {"X": 100.0, "Y": 80.0, "Z": 60.0}
LENGTH = float(np.linalg.norm([HIGH[a] - LOW[a] for a in "XYZ"]))


def diagonal(name: str, *turned: str, axes: str = "XYZ", **more) -> dict:
    """A diagonal of the box, with some of its axes the other way round."""
    low = {a: (HIGH if a in turned else LOW)[a] for a in axes}
    high = {a: (LOW if a in turned else HIGH)[a] for a in axes}
    length = float(np.linalg.norm([high[a] - low[a] for a in axes]))
    return {
        "name": name,
        "axis": axes,
        "from_mm": low,
        "to_mm": high,
        "ends": (0.0, np.floor(length)),
        "count": 7,
        "runs": 2,
        "line_mm": [30.0, 20.0, 150.0],
        **more,
    }


#: Errors of the generator, and the same as an effect of mjsim.
KINDS = {
    "square": ({"square": {"XY": 40e-6}}, "squareness.XY", {"angle_urad": 40.0}),
    "scale": ({"scale": {"Y": 50e-6}}, "scale_error.Y", {"ppm": 50.0}),
    "play": ({"play": {"X": 8e-6}}, "backlash.X", {"width_um": 8.0}),
    "yaw": ({"angle": {"ECX": (30e-6, 0.0)}}, "angular_error.ECX", {"linear_urad": 30.0, "quadratic_urad": 0.0}),
    "straight": ({"straight": {"EZY": (3e-6, 0.0)}}, "straightness.EZY", {"quadratic_um": 3.0, "cubic_um": 0.0}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_model_with_the_true_error_explains_the_diagonals(tmp_path, kind):
    """mjsim and the generator, which shares no code with it, mean the same, on faces and across the body."""
    errors, effect, values = KINDS[kind]
    faces = [diagonal("face", axes="XY", at_mm={"Z": 40.0}), diagonal("other", "Z", axes="YZ")]
    positions.write(tmp_path, 3, errors, [diagonal("body"), diagonal("turned", "X"), *faces], noise=1e-12)
    campaign = mjsim.read_campaign(tmp_path, as_is=True)
    machine = machine_of(campaign)
    true = machine.with_effect(mjsim.make_effect(effect, machine.chain, **values))
    before, after = (compare_plainly(campaign, m).rms for m in (machine, true))
    assert before > 0.3e-6 and after < 1e-8, (before, after)


def test_squareness_is_the_difference_of_two_diagonals(tmp_path):
    """Along the diagonals of a rectangle a × b, an angle γ between the axes makes ± γ a b / (a² + b²) of the way. So it
    comes out of two diagonals. Whose scale is wrong a line along one axis says.
    """
    line = {"name": "laser-x", "axis": "X", "ends": (-100.0, 100.0), "count": 7, "runs": 2}
    tests = [diagonal("face-1", axes="XY"), diagonal("face-2", "Y", axes="XY"), line]
    errors = {"square": {"XY": 60e-6}, "scale": {"X": 70e-6}}
    positions.write(tmp_path, 5, errors, tests)
    campaign = mjsim.read_campaign(tmp_path)
    a, b = 200.0, 160.0
    slopes = []
    for name in ("face-1", "face-2"):
        r = campaign.traces[name]
        slopes.append(np.polyfit(r.target, r.deviation, 1)[0])
    gamma = 0.5 * abs(slopes[0] - slopes[1]) * (a * a + b * b) / (a * b)
    assert gamma == pytest.approx(60e-6, rel=0.05)
    result = mjsim.diagnose(campaign, machine_of(campaign))
    found = {e.effect.key: e for e in result.effects}
    for key, name, size in (("squareness.XY", "angle_urad", 60.0), ("scale_error.X", "ppm", 70.0)):
        low, high = found[key].ci95[name]
        assert low <= size <= high and found[key].probability > 0.95
    assert set(found) == {"squareness.XY", "scale_error.X"}


def test_the_figures_are_those_of_the_standard(tmp_path):
    positions.write(tmp_path, 7, {"scale": {"X": 50e-6}}, [diagonal("body")])
    campaign = mjsim.read_campaign(tmp_path)
    (test,) = campaign.tests
    r = campaign.traces["body"]
    figures = INSTRUMENTS["positions"].figures_of(test, r, r.time, r.deviation[:, None])
    means = [r.deviation[r.place == p].mean() for p in np.unique(r.place)]  # a place has a side
    assert figures["E_um"] == pytest.approx(1e6 * np.ptp(means), abs=1e-5)
    assert set(figures) == {"E_um", "E_forward_um", "E_backward_um", "B_um", "B_mean_um"}
    assert test.length * 1e3 == pytest.approx(LENGTH)


def test_a_diagonal_that_is_none_is_refused(tmp_path):
    positions.write(tmp_path, 9, {}, [diagonal("body")])
    file = tmp_path / "campaign.toml"
    text = file.read_text()
    for old, new, said in (
        ('axis = "XYZ"', 'axis = "XA"', "axis = 'XA' with from_mm and to_mm; allowed: two or more of X, Y, Z"),
        ('axis = "XYZ"', 'axis = "XY"', "from_mm names X, Y, Z; allowed of a diagonal: each of X, Y"),
        ("X = 100.0", "X = -100.0", "X is at -100 mm at both ends"),
    ):
        assert old in text
        file.write_text(text.replace(old, new))
        with pytest.raises(InputError) as error:
            mjsim.read_campaign(tmp_path)
        assert said in str(error.value)


def test_targets_beyond_the_end_are_named(tmp_path):
    """As coordinates of an axis would be in the place of the way along the line."""
    from dataclasses import replace

    positions.write(tmp_path, 9, {}, [diagonal("body")])
    campaign = mjsim.read_campaign(tmp_path)
    (test,) = campaign.tests
    r = campaign.traces["body"]
    assert position_mistakes([test], {"body": r}) == []
    (mistake,) = position_mistakes([test], {"body": replace(r, target=r.target - 0.1)})
    assert "target_mm counts along the line, from where from_mm says" in mistake.sentence
