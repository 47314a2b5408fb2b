"""``identify pitch-error`` on campaigns of the independent generator: what was planted comes back, nothing else
does, limits are stated.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from independent import kato2013
from independent.campaign import Case, write_files
from independent.layouts import arrange, cone, rotary

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.errors import InputError
from mjsim.inference.pitch.alternating import alternate
from mjsim.inference.pitch.curve import Curve
from mjsim.inference.pitch.identify import identified_machine, identify_pitch_error, identify_pitch_errors
from mjsim.inference.pitch.spectrum import amplitude
from mjsim.plots.pitch import PitchCurves, PitchSpectrum, curves_figure, draw_curves, spectrum_figure

A_CW = [[60, 0.0012, 40.0], [120, 0.0006, -70.0], [180, 0.00035, 150.0], [328, 0.0004, -120.0]]
A_CCW = [[60, 0.00105, 55.0], [120, 0.0005, -50.0], [180, 0.0003, 170.0], [328, 0.00035, -100.0]]
C_CW = [[72, 0.0025, -30.0], [90, 0.0004, 160.0], [180, 0.0005, 100.0]]
C_CCW = [[72, 0.0010, -10.0], [90, 0.0006, 130.0], [180, 0.0003, 45.0]]
PLANTED = {("A", "CW"): A_CW, ("A", "CCW"): A_CCW, ("C", "CW"): C_CW, ("C", "CCW"): C_CCW}
TURNS_A = [rotary("A", 0, 90), rotary("A", 90, 0)]
TURNS_C = [rotary("C", 0, 360, (70, 0)), rotary("C", 360, 0, (70, 0))]
#: Cones that turn A both ways, and C once each way: their reversals tie the start of every recording.
CONES = [cone(45, (0, 0), feed=2000.0), cone(15, (70, 0), feed=2000.0), cone(15, (70, 0), "CW", 2000.0)]
FOUR = [*TURNS_A, *TURNS_C]


@pytest.fixture
def measured(tmp_path):
    """``measured(tests, planted, seed, **case)``: campaign and machine; ``planted`` by (axis, way), the way empty
    for both.
    """

    def make(tests, planted, seed, extra=(), **case):
        hidden = [
            {"id": f"pitch_error.{axis}", "components": rows, **({"direction": way} if way else {})}
            for (axis, way), rows in planted.items()
        ]
        write_files(Case("pitch", "K", tuple(arrange(tests)), hidden=(*hidden, *extra), seed=seed, **case), tmp_path)
        c = read_campaign(tmp_path)
        return c, read_machine(c.machine_file)

    return make


def errors(direction, planted):
    """Relative amplitude error and phase error (deg) with their half widths, per planted component; the orders must
    be the planted ones.
    """
    assert [c.order for c in direction.components] == [n for n, _, _ in planted]
    out = []
    for c, (_, size, phase) in zip(direction.components, planted, strict=True):
        low, high = c.ci95["amplitude_deg"]
        turn = (c.phase_deg - phase + 180.0) % 360.0 - 180.0
        out.append((c.amplitude_deg / size - 1.0, 0.5 * (high - low) / size, turn, c.phase_half_width_deg))
    return np.array(out)


def test_what_was_planted_comes_back_and_nothing_else(measured):
    found = identify_pitch_errors(*measured([*FOUR, *CONES], PLANTED, 31), threads=1)
    for (axis, way), rows in PLANTED.items():
        d = found[axis].directions[way]
        e = errors(d, rows)
        assert np.abs(e[:, 0]).max() < 0.03 and np.abs(e[:, 2]).max() < 3.0
        assert (np.abs(e[:, 0]) < 2 * e[:, 1]).all() and (
            np.abs(e[:, 2]) < 2 * e[:, 3]
        ).all()  # within four standard deviations
        assert e[:, 3].max() < 3.0 and not d.phase_limited_by_trigger
        assert all(c.order_known and c.separable for c in d.components) and not d.faults
        assert [c.multiple_of_teeth for c in d.components] == [n % d.tooth_order == 0 for n, _, _ in rows]
        rms = d.rms_deg()
        assert rms["residual_away_from_reversals"] < 0.12 * rms["modified"]
        for by_turns, joint in d.differences:
            assert abs(by_turns) < 0.08 and abs(joint) < 8.0  # both methods speak of the same thing
    assert [e.key for e in found["C"].effects] == ["pitch_error.C[CW]", "pitch_error.C[CCW]"]


@pytest.mark.parametrize("friction", [True, False])
def test_nothing_is_found_where_nothing_is(measured, friction):
    """Also where the machine file has no friction: four glitches per turn make lines at all multiples of four, 72
    and 180 among them. Then the file does not explain the tests, and the result says so.
    """
    c, m = measured(FOUR, {}, 33)
    for axis in "XYZAC" if not friction else "":
        m = m.without(f"friction.{axis}")
    found = identify_pitch_errors(c, m, threads=1)
    for axis in "AC":
        assert found[axis].effects == () and not found[axis].common
        for d in found[axis].directions.values():
            assert d.components == () and d.faults == ()
        assert any("does not explain" in note for note in found[axis].notes) != friction


def test_one_direction_stays_one_direction(measured):
    found = identify_pitch_error(*measured(TURNS_C, {("C", "CW"): C_CW}, 34), "C", threads=1)
    e = errors(found.directions["CW"], C_CW)
    assert np.abs(e[:, 0]).max() < 0.06  # nothing but two turns: the noise allows 2 % for the smallest (95 %)
    assert (np.abs(e[:, 0]) < 2 * e[:, 1]).all() and (np.abs(e[:, 2]) < 2 * e[:, 3]).all()
    assert found.directions["CCW"].components == ()
    assert [x.key for x in found.effects] == ["pitch_error.C[CW]"]
    # no test repeats its revolution: the noise comes from the spectrum's floor
    assert found.noise_um == pytest.approx(0.12, rel=0.15)


def test_where_both_directions_agree_one_effect_is_enough(measured):
    c, m = measured([*TURNS_A, cone(45, (0, 0))], {("A", ""): A_CW}, 35)
    found = identify_pitch_error(c, m, "A", threads=1)
    assert found.common and [e.key for e in found.effects] == ["pitch_error.A"]
    e = errors(found.directions["CCW"], A_CW)
    assert np.abs(e[:, 0]).max() < 0.03 and np.abs(e[:, 2]).max() < 3.0
    apart = identify_pitch_errors(c, m, ("A",), per_direction=True, threads=1)["A"]
    assert not apart.common and len(apart.effects) == 2
    known = m.with_effect(found.effects[0].replaced(components=[[60.0, 0.5, 0.0]]))
    assert [e.key for e in identified_machine(known, {"A": apart}).effects if e.kind == "pitch_error"] == [
        e.key for e in apart.effects
    ]


def test_the_trigger_limits_phases_and_a_cone_lifts_the_limit(measured):
    alone = identify_pitch_error(
        *measured(TURNS_A, {k: v for k, v in PLANTED.items() if k[0] == "A"}, 36), "A", threads=1
    )
    for way, rows in (("CW", A_CW), ("CCW", A_CCW)):
        d = alone.directions[way]
        e = errors(d, rows)
        assert np.abs(e[:, 0]).max() < 0.03
        assert (np.abs(e[:, 2]) < 2 * e[:, 3]).all()
        assert e[3, 3] > 9.0 and d.components[3].phase_fixed_trigger_deg < 2.0
        assert d.phase_limited_by_trigger and "cone-frustum" in d.advice
        # the same shift in time: phases go wrong in proportion to the order
        assert e[:, 3] / e[0, 3] == pytest.approx(np.array([60, 120, 180, 328]) / 60, rel=0.1)
        assert d.safe_feed_mm_min == pytest.approx(3.0 / (1.96 * 0.02 * 328) * np.pi / 180 * 155.0 * 60, rel=0.02)
    together = identify_pitch_error(
        *measured([*TURNS_A, cone(45, (0, 0))], {k: v for k, v in PLANTED.items() if k[0] == "A"}, 36), "A", threads=1
    )
    for way, rows in (("CW", A_CW), ("CCW", A_CCW)):
        assert np.abs(errors(together.directions[way], rows)[:, 2]).max() < 3.0


@pytest.mark.parametrize("apart", [2, 6])
def test_the_resolution_of_a_partial_arc(measured, apart):
    """An arc of 86° resolves 4.2 per revolution: 2 apart is one component that is not separable, 6 apart are two."""
    pair = [[60, 0.0012, 40.0], [328, 0.0004, -120.0], [328 + apart, 0.0003, 30.0]]
    d = identify_pitch_error(*measured(TURNS_A, {("A", "CW"): pair}, 37), "A", threads=1).directions["CW"]
    assert d.resolution == pytest.approx(360.0 / d.arc_deg) and d.arc_deg == pytest.approx(86.0, abs=0.3)
    if apart > d.resolution:
        assert np.abs(errors(d, pair)[:, 0]).max() < 0.03
    else:
        assert len(d.components) == 2 and d.components[0].separable
        mixed = d.components[1]
        assert not mixed.separable and len(mixed.merged) == 1 and abs(mixed.order - 329) < d.resolution
        assert mixed.to_json()["not_separable_from"]


def test_a_worn_flank_does_not_disturb(measured):
    found = identify_pitch_error(
        *measured(TURNS_A, {("A", "CW"): A_CW, ("A", "CCW"): A_CCW}, 38, extra=(kato2013.WEAR,)), "A", threads=1
    )
    d = found.directions["CW"]
    assert np.abs(errors(d, A_CW)[:, 0]).max() < 0.03
    (fault,) = d.faults
    assert (fault.centre_deg, fault.width_deg) == pytest.approx((7.5, 1.5), abs=0.3)
    assert fault.height_deg == pytest.approx(0.0035, rel=0.05)
    assert np.abs(errors(found.directions["CCW"], A_CCW)[:, 0]).max() < 0.03


def test_a_test_that_the_machine_does_not_explain_is_left_out_and_named(measured):
    c, m = measured([*TURNS_A, cone(45, (0, 0))], {("A", "CW"): A_CW}, 39)
    found = identify_pitch_error(c, m.without("backlash.A"), "A", threads=1)
    assert any("cone45" in note for note in found.notes)
    e = errors(found.directions["CW"], A_CW)
    assert (np.abs(e[:, 2]) < 2 * e[:, 3]).all() and e[3, 3] > 9.0  # less certain than with it, and it says so


def test_only_one_direction_measured(measured):
    c, m = measured(TURNS_A[1:], {("A", "CW"): A_CW}, 40)
    found = identify_pitch_error(c, m, "A", threads=1)
    assert list(found.directions) == ["CW"] and "only CW" in found.notes[0]
    frame = found.to_dataframe()
    assert frame["order"].tolist() == [row[0] for row in A_CW] and set(frame["direction"]) == {"CW"}
    assert (frame["amplitude_deg_low"] < frame["amplitude_deg"]).all() and (
        frame["phase_deg"] < frame["phase_deg_high"]
    ).all()
    with pytest.raises(InputError, match=r'tangential test of axis C; needed: .*axis = "C"'):
        identify_pitch_error(c, m, "C")


def test_an_arc_that_is_too_short_is_refused_with_the_arc_needed(measured):
    c, m = measured([rotary("A", 0, 25)], {}, 41)
    with pytest.raises(InputError, match=r"measures 21\.0° of A; .* 28\.0° apart"):
        identify_pitch_error(c, m, "A")


def test_the_command(measured, tmp_path):
    _, m = measured(TURNS_A, {("A", "CW"): A_CW}, 42, extra=(kato2013.WEAR,))
    run = CliRunner().invoke
    args = ["identify", "pitch-error", str(tmp_path), "--threads", "1"]
    result = run(main, [*args, "--axis", "A", "--json", "--write", str(tmp_path / "found.toml")])
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    way = data["axes"]["A"]["directions"]["CW"]
    assert {
        "tests",
        "arc_deg",
        "resolution_per_rev",
        "tooth_order",
        "noise_floor_deg",
        "alternating",
        "largest_difference",
    } <= set(way)
    assert [x["order"] for x in way["components"]] == [60, 120, 180, 328]
    assert all(
        x["ci95"]["amplitude_deg"][0] < x["amplitude_deg"] < x["ci95"]["amplitude_deg"][1] for x in way["components"]
    )
    assert data["effects"][0]["id"] == "pitch_error.A" and data["effects"][0]["direction"] == "CW"
    assert [p.rsplit("/", 1)[1] for p in data["plots"]] == ["spectrum-a.png", "curves-a.png"]
    written = read_machine(tmp_path / "found.toml")
    assert written.effect("pitch_error.A[CW]").values["components"][0][1] == pytest.approx(0.0012, rel=0.03)
    assert [e.key for e in written.effects[:-1]] == [e.key for e in m.effects]
    again = run(main, [*args, "--axis", "A", "--no-plots", "--write", str(tmp_path / "found.toml")])
    assert again.exit_code == 1 and "found.toml" in again.stderr
    text = run(main, [*args, "--no-plots"])
    assert text.exit_code == 0 and max(map(len, text.stdout.splitlines())) <= 80
    assert "local fault taken out: +3." in text.stdout and len(way["local_faults"]) == 1
    assert "A CW: rotary-a-tangential-centre-cw" in text.stdout and "no component stands out" in text.stdout
    missing = run(main, [*args, "--axis", "C", "--no-plots"])
    assert missing.exit_code == 1 and "no measured tangential test of axis C" in missing.stderr


def test_the_alternating_scheme_finds_sines_of_a_full_turn():
    x = np.linspace(0.0, 2 * np.pi, 7200, endpoint=False)
    value = 3e-5 * np.sin(72 * x + 0.7) + 1e-5 * np.sin(90 * x - 2.0)
    still = np.zeros(len(x), bool)
    line = Curve(x, value, value, value, still)
    assert amplitude(x, value, np.array([72.0, 80.0, 90.0])) == pytest.approx([3e-5, 0.0, 1e-5], abs=1e-9)
    for got, (n, size, phase) in zip(alternate(line, [72.0, 90.0]), ((72, 3e-5, 0.7), (90, 1e-5, -2.0)), strict=True):
        assert got.order == n
        assert got.amplitude_deg == pytest.approx(np.degrees(size), rel=1e-6)
        assert got.phase_deg == pytest.approx(np.degrees(phase), abs=1e-3)
    glitch = np.where(np.abs(x - 1.0) < 0.05, 1e-3, 0.0)
    spoilt = replace(line, modified=value + glitch, at_reversal=np.abs(x - 1.0) < 0.06)
    assert alternate(spoilt, [72.0])[0].amplitude_deg == pytest.approx(np.degrees(3e-5), rel=0.03)


def test_figures_say_what_they_show():
    n = np.arange(1.0, 801.0)
    line = PitchSpectrum("C CW", n, 1e-5 + 0 * n, 1e-6 + 0 * n, 4e-6 + 0 * n, [(72.0, 2.5e-3), (90.0, 4e-4)], 72)
    figure = spectrum_figure([line, replace(line, title="C CCW", named=[])], "pitch errors of C")
    texts = [t.get_text() for t in figure.axes[0].texts]
    assert {"N=72", "N=90", "C CW"} <= set(texts) and "N=72" not in [t.get_text() for t in figure.axes[1].texts]
    assert figure.axes[0].get_ylim() == figure.axes[1].get_ylim()
    x = np.linspace(2.0, 88.0, 400)
    wave = 2e-3 * np.sin(np.radians(60 * x))
    curves = PitchCurves("A CW", x, wave + 0.01, wave, wave)
    polar = curves_figure([curves], "curves").axes[0]
    assert (polar.get_thetamin(), polar.get_thetamax()) == (0.0, 90.0)
    assert draw_curves(polar, curves) == pytest.approx(2e-3)
    with pytest.raises(ValueError, match="above 0"):
        draw_curves(polar, curves, 0.0)
    with pytest.raises(ValueError, match="at least one"):
        spectrum_figure([], "none")
