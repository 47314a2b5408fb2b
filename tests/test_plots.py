"""Figures: the data are where they belong, nothing global is touched, the same input gives the same file."""

import itertools
import re
import subprocess
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from mjsim.errors import InputError
from mjsim.plots import series, style
from mjsim.plots.curve import curve_figure
from mjsim.plots.ladder import LadderStep, ladder_figure
from mjsim.plots.output import polar_traces
from mjsim.plots.polar import PolarTrace, division_um, overview_figure, polar_figure, scale_text
from mjsim.plots.residual import ResidualTrace, residual_figure, reversal_angles, spread
from mjsim.plots.save import encode, save

PHI = np.linspace(0.0, 720.0, 2001)


def _line(figure, label):
    (line,) = [line for axes in figure.axes for line in axes.lines if line.get_label() == label]
    return line


def _texts(figure):
    return [text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text"))]


def _two_tests():
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 0.1, PHI.size)
    return [
        ResidualTrace(
            "cone", PHI, noise, {"X": [29.0, 311.0, 389.0, 671.0], "A": [0.0, 180.0, 360.0, 540.0, 720.0]}, 0.1
        ),
        ResidualTrace("rotary", np.linspace(2.0, 88.0, 500), noise[:500], {"Y": [45.0]}, 0.1, goes_round=False),
    ]


def test_what_lies_between_both_polar_traces_is_the_residual(turn, circle):
    """A mean that each trace lost by itself hid an offset of a rotary test."""
    for test in (turn("A", 0.0, 90.0, (50, 20, 155)), circle("XY", (0, 0, 155))):
        phi, valid = np.radians(PHI), PHI != 90.0
        t = SimpleNamespace(test=test, phi=phi, valid=valid, measured=1e-6 * (3.0 + np.cos(phi)), simulated=0.0 * phi)
        measured, simulated = polar_traces(t)
        gap = measured.deviation_um - simulated.deviation_um
        assert gap[valid] == pytest.approx(1e6 * t.measured[valid]) and np.isnan(gap[~valid]).all()


def test_polar_data_are_drawn_at_phi():
    deviation = 3.0 * np.cos(np.radians(2.0 * PHI))
    line = _line(polar_figure([PolarTrace("m", PHI, deviation)], "t"), "m")
    np.testing.assert_allclose(line.get_xdata(), np.radians(PHI))
    np.testing.assert_array_equal(line.get_ydata(), deviation)


def test_the_papers_figures_are_turned():
    line = _line(polar_figure([PolarTrace("m", PHI, np.sin(PHI), shift_deg=180.0)], "t"), "m")
    np.testing.assert_allclose(line.get_xdata(), np.radians(PHI + 180.0))


def test_outward_is_outward_zero_is_right_and_angles_go_counter_clockwise():
    axes = polar_figure([PolarTrace("m", PHI, np.cos(np.radians(PHI)))], "t").axes[0]
    centre = axes.transData.transform((0.0, axes.get_rorigin()))
    right, up = axes.transData.transform([(0.0, 0.0), (np.pi / 2.0, 0.0)]) - centre
    assert right[0] > 0.0 and right[1] == pytest.approx(0.0, abs=1e-6)
    assert up[1] > 0.0 and up[0] == pytest.approx(0.0, abs=1e-6)
    further = axes.transData.transform((0.0, 1.0)) - centre
    assert further[0] > right[0] > 0.0


@pytest.mark.parametrize(
    ("largest", "step"),
    [
        (0.01, 0.1),
        (0.3, 0.1),
        (1.0, 0.5),
        (3.2, 1.0),
        (3.3, 2.0),
        (10.0, 5.0),
        (16.1, 10.0),
        (29.0, 10.0),
        (120.0, 50.0),
    ],
)
def test_the_division_is_the_smallest_nice_step_that_fits(largest, step):
    deviation = -largest * np.abs(np.sin(np.radians(PHI / 8.0)))
    deviation[1000] = -largest
    traces = [PolarTrace("m", PHI, deviation)]
    assert division_um(traces) == pytest.approx(step)
    figure = polar_figure(traces, "t")
    assert scale_text(step) in _texts(figure)
    axes = figure.axes[0]
    assert axes.get_rorigin() < -largest < axes.get_rmax()


def test_scale_text_is_the_papers():
    assert scale_text(5.0) == "1 div.: 5 µm"
    assert scale_text(0.5) == "1 div.: 0.5 µm"


def test_a_given_division_is_kept_and_data_beyond_it_stay_inside():
    figure = polar_figure([PolarTrace("m", PHI, 40.0 * np.cos(np.radians(PHI)))], "t", um_per_div=2.0)
    axes = figure.axes[0]
    assert scale_text(2.0) in _texts(figure)
    assert axes.get_rorigin() < -40.0 and axes.get_rmax() >= 40.0
    with pytest.raises(ValueError, match="above 0"):
        polar_figure([], "t", um_per_div=0.0)


def test_a_trace_is_refused_by_style_and_by_length():
    with pytest.raises(ValueError, match="measured, simulated, nominal"):
        polar_figure([PolarTrace("m", PHI, PHI, "dotted")], "t")
    with pytest.raises(ValueError, match="one length"):
        polar_figure([PolarTrace("m", PHI, PHI[:-1])], "t")


def test_no_line_is_drawn_across_a_missing_stretch():
    kept = (PHI < 100.0) | (PHI > 140.0)
    line = _line(polar_figure([PolarTrace("m", PHI[kept], np.zeros(kept.sum()))], "t"), "m")
    assert np.isnan(line.get_xdata()).sum() == 1


def test_thinning_keeps_every_peak_and_the_order():
    angle = np.linspace(0.0, 720.0, 60001)
    value = np.zeros(angle.size)
    value[[1234, 40000]] = 7.0, -9.0
    thin_angle, thin_value = series.thinned(angle, value)
    assert thin_angle.size < 2.2 * series.PER_TURN
    assert np.all(np.diff(thin_angle) > 0.0)
    assert thin_value.max() == 7.0 and thin_value.min() == -9.0
    assert thin_angle[np.argmax(thin_value)] == angle[1234]
    assert (thin_angle[0], thin_angle[-1]) == (0.0, 720.0)


def test_thinning_keeps_breaks():
    angle, value = series.broken(np.r_[np.linspace(0, 100, 9000), np.linspace(140, 360, 18000)], np.zeros(27000))
    assert np.isnan(series.thinned(angle, value)[0]).sum() == 1


def test_measured_and_simulated_differ_on_a_black_and_white_print():
    grey = [
        int(c[1:3], 16) * 0.299 + int(c[3:5], 16) * 0.587 + int(c[5:7], 16) * 0.114
        for c in (style.MEASURED, style.SIMULATED)
    ]
    assert abs(grey[0] - grey[1]) > 60.0


def test_one_mark_per_reversal_place_and_axis():
    figure = residual_figure(_two_tests())
    gids = [line.get_gid() for line in figure.axes[0].lines if (line.get_gid() or "").startswith("reversal-")]
    assert sorted(gids) == ["reversal-A", "reversal-A", "reversal-X", "reversal-X"]
    assert reversal_angles(_two_tests()[0]) == [
        ("A", 0.0),
        ("X", pytest.approx(29.0)),
        ("A", 180.0),
        ("X", pytest.approx(311.0)),
    ]
    assert reversal_angles(_two_tests()[1]) == [("Y", 45.0)]
    letters = [text.get_text() for text in figure.axes[0].texts if len(text.get_text()) == 1]
    assert sorted(letters) == ["A", "A", "X", "X"]


def test_a_clockwise_trace_marks_the_same_places():
    trace = ResidualTrace("cw", -PHI, np.zeros(PHI.size), {"A": [0.0, -180.0, -360.0, -540.0, -720.0]})
    assert reversal_angles(trace) == [("A", 0.0), ("A", 180.0)]


def test_marks_a_hair_either_side_of_zero_are_one():
    trace = ResidualTrace("t", PHI, np.zeros(PHI.size), {"A": [179.9, 540.1]})
    assert len(reversal_angles(trace)) == 1


def test_letters_of_crowded_marks_stand_apart_in_their_order():
    got = spread(np.array([0.0, 100.0, 101.0, 103.0, 200.0]), 8.0)
    np.testing.assert_allclose(got, [0.0, 304.0 / 3.0 - 8.0, 304.0 / 3.0, 304.0 / 3.0 + 8.0, 200.0])
    assert spread(np.zeros(0), 8.0).size == 0
    trace = ResidualTrace(
        "t", PHI, np.zeros(PHI.size), {"X": [10.0], "Y": [12.0], "Z": [13.0], "A": [0.0, 180.0], "C": [14.0]}
    )
    figure = residual_figure([trace])
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.axes[0].texts]
    assert not any(box.overlaps(other) for index, box in enumerate(boxes) for other in boxes[index + 1 :])


def test_long_labels_of_a_long_ladder_do_not_overlap():
    figure = ladder_figure([LadderStep(f"+ axis_location.EC0A{k}", 1.0 + k) for k in range(9)])
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.axes[0].get_xticklabels()]
    assert len(boxes) == 9
    assert all(left.x1 <= right.x0 for left, right in itertools.pairwise(boxes))


def test_outliers_count_neither_for_rms_nor_for_scale():
    residual = np.full(PHI.size, 0.5)
    outlier = np.zeros(PHI.size, dtype=bool)
    residual[100:110], outlier[100:110] = 300.0, True
    trace = ResidualTrace("t", PHI, residual, {}, 0.1, outlier)
    assert trace.rms_um() == pytest.approx(0.5)
    axes = residual_figure([trace]).axes[0]
    assert axes.get_ylim()[1] < 1.0
    grey = [line for line in axes.lines if str(line.get_label()).startswith("left out")]
    assert len(grey) == 1 and grey[0].get_ydata().size == 10


def test_noise_band_is_two_sigma():
    axes = residual_figure(_two_tests()).axes[0]
    (band,) = [patch for patch in axes.patches if "2σ" in str(patch.get_label())]
    corners = (
        band.get_path().vertices
        if not hasattr(band, "get_y")
        else np.array([[0, band.get_y()], [1, band.get_y() + band.get_height()]])
    )
    assert (corners[:, 1].min(), corners[:, 1].max()) == pytest.approx((-0.2, 0.2))


def test_panels_share_one_scale_and_name_their_units():
    figure = residual_figure(_two_tests())
    assert len({axes.get_ylim() for axes in figure.axes}) == 1
    assert all("µm" in axes.get_ylabel() for axes in figure.axes)
    assert "deg" in figure.axes[-1].get_xlabel()


def test_all_of_a_step_is_drawn_but_no_knot_that_tests_hardly_visit():
    """Knots before a step are known to be zero, those beyond have the spread of its size."""
    y, spread = np.repeat([0.0, 5.0], 10), np.repeat([1e-9, 0.02], [11, 9])
    spread[-1] = 3.0
    (line,) = (x for x in curve_figure(np.arange(20.0), y, spread, ("x", "y")).axes[0].lines if len(x.get_xdata()) > 2)
    assert np.array_equal(np.isfinite(line.get_ydata()), np.arange(20) < 19)


def test_ladder_draws_values_floor_and_scale():
    steps = [LadderStep("start", 3.41), LadderStep("+ backlash.A", 0.64), LadderStep("+ pitch_error.A", 0.13)]
    axes = ladder_figure(steps, 0.12).axes[0]
    (points,) = [line for line in axes.lines if line.get_marker() == "o"]
    np.testing.assert_array_equal(points.get_ydata(), [3.41, 0.64, 0.13])
    assert axes.get_yscale() == "log"
    assert {"3.41 µm", "0.64 µm", "0.13 µm"} <= {text.get_text() for text in axes.texts}
    assert ladder_figure(steps[1:], 0.12).axes[0].get_yscale() == "linear"
    assert ladder_figure([LadderStep("perfect", 0.0), LadderStep("still", 0.0)]).axes[0].get_yscale() == "linear"


@pytest.mark.parametrize("make", [lambda: ladder_figure([]), lambda: overview_figure([]), lambda: residual_figure([])])
def test_empty_figures_are_refused(make):
    with pytest.raises(ValueError, match="at least one"):
        make()


def test_overview_has_one_plot_per_test_with_its_own_scale():
    tests = [(f"t{i}", [PolarTrace("measured", PHI, 10.0**i * np.cos(np.radians(PHI)))]) for i in range(3)]
    figure = overview_figure(tests, columns=2)
    assert len(figure.axes) == 3
    assert {"t0", "t1", "t2", scale_text(0.5), scale_text(5.0), scale_text(50.0)} <= set(_texts(figure))


@pytest.mark.parametrize(
    "make",
    [
        lambda: polar_figure(
            [PolarTrace("measured", PHI, PHI * 0.0), PolarTrace("simulated", PHI, PHI * 0.0, "simulated")],
            "t",
            "s",
            size_in=4.2,
        ),
        lambda: polar_figure(
            [PolarTrace("measured", PHI, PHI * 0.0), PolarTrace("simulated", PHI, PHI * 0.0, "simulated")],
            "t" * 120,
            "s" * 200,
        ),
    ],
)
def test_texts_outside_the_plot_do_not_overlap_nor_leave_the_figure(make):
    figure = make()
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.texts] + [
        legend.get_window_extent(renderer) for legend in figure.legends
    ]
    boxes.append(figure.axes[0].patch.get_window_extent(renderer).padded(-1.0))
    for index, box in enumerate(boxes):
        assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0.0 and box.y1 <= figure.bbox.y1
        corner = index == len(figure.texts) - 1  # the scale stands in the corner of the square round the circle
        for other in boxes[index + 1 : len(boxes) - (1 if corner else 0)]:
            assert not box.overlaps(other)


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_files_are_the_same_every_time(kind, tmp_path):
    make = lambda: polar_figure([PolarTrace("m", PHI, np.sin(np.radians(3 * PHI)))], "t")  # noqa: E731
    save(make(), tmp_path / f"a.{kind}")
    save(make(), tmp_path / f"b.{kind}")
    data = (tmp_path / f"a.{kind}").read_bytes()
    assert data == (tmp_path / f"b.{kind}").read_bytes()
    assert data.startswith(b"\x89PNG" if kind == "png" else b"<?xml")


def test_svg_coordinates_are_short_and_matplotlibs_settings_untouched():
    import matplotlib

    before = dict(matplotlib.rcParams)
    svg = encode(polar_figure([PolarTrace("m", PHI, np.sin(np.radians(3 * PHI)))], "t"), "svg")
    assert dict(matplotlib.rcParams) == before
    assert not re.search(rb' d="[^"]*\.\d{3}', svg)


def test_save_refuses_other_kinds_and_files_in_the_way(tmp_path):
    figure = ladder_figure([LadderStep("start", 1.0)])
    with pytest.raises(InputError, match=r"\.png or \.svg"):
        save(figure, tmp_path / "a.pdf")
    save(figure, tmp_path / "a.png")
    with pytest.raises(InputError, match="exists already"):
        save(figure, tmp_path / "a.png", force=False)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_threads_give_the_same_bytes():
    figures = [polar_figure([PolarTrace("m", PHI, np.sin(np.radians(3 * PHI)))], "t") for _ in range(4)]
    got: list[bytes] = []
    threads = [threading.Thread(target=lambda f=figure: got.append(encode(f, "svg"))) for figure in figures]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(got) == 4 and len(set(got)) == 1


def test_importing_the_plots_does_not_import_matplotlib_nor_pyplot():
    code = (
        "import sys; import mjsim.plots.polar, mjsim.plots.residual, mjsim.plots.ladder, mjsim.plots.polar, "
        "mjsim.plots.save\n"
        "assert 'matplotlib' not in sys.modules\n"
        "mjsim.plots.ladder.ladder_figure([mjsim.plots.ladder.LadderStep('a', 1.0)])\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
