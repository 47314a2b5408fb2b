"""Figures of ISO 230-2 against a published report: data and results of a real slit axis, measured at 5 positions in 5
cycles. Source: paulscherrerinstitute/ecmccfg, examples/mcu1025_fat_sat/report.md (ecmc motion system test report of 10
November 2021). Its unidirectional figures, B, R_i and M are those of the standard. For E over both directions it prints
that of the forward one; here that number is from its own table of means.
"""

import numpy as np
import pytest

from mjsim.instruments.positions.instrument import positioning_figures

TARGETS = [15.0, 25.2, 35.4, 45.6, 55.8]
#: Deviations x(i, j) in mm, one row a position.
FORWARD = """
0.0033 0.00452 0.00085 0.0033 0.00595
-0.00067 -0.00087 -0.00067 0.00015 0.00117
-0.01523 -0.01238 -0.01605 -0.0136 -0.0134
-0.00818 -0.01022 -0.00737 -0.00737 -0.0092
0.03882 0.04025 0.03964 0.04086 0.04005
"""
BACKWARD = """
0.10035 -0.0279 -0.0279 -0.03034 -0.02749
0.07803 0.0132 0.01259 0.01748 0.01422
-0.00361 -0.01197 -0.01074 -0.00748 -0.0085
-0.02613 -0.02959 -0.0351 -0.03061 -0.02939
-0.00685 -0.00501 -0.00868 -0.00807 -0.0042
"""
PRINTED = {
    "R_forward": 0.00751,
    "R_backward": 0.23036,
    "R": 0.23036,
    "E_forward": 0.05405,
    "E_backward": 0.05727,
    "M": 0.036,
    "B": 0.04649,
    "B_mean": 0.00829,
    "A_forward": 0.05853,
    "A_backward": 0.23036,
    "A": 0.23036,
}


def rows(text):
    return np.array([[float(v) for v in line.split()] for line in text.strip().splitlines()])


def columns(*sides):
    """Targets, sides and deviations in a row of readings, shuffled: their order does not matter."""
    target = np.concatenate([np.repeat(TARGETS, rows(t).shape[1]) for _, t in sides])
    side = np.concatenate([np.full(rows(t).size, s) for s, t in sides])
    deviation = np.concatenate([rows(t).ravel() for _, t in sides])
    order = np.random.default_rng(1).permutation(len(target))
    return target[order], side[order], deviation[order]


def test_against_a_published_report():
    found = positioning_figures(*columns((1.0, FORWARD), (-1.0, BACKWARD)))
    for name, value in PRINTED.items():
        assert found[name] == pytest.approx(value, abs=2.1e-5), name  # their s has five digits
    assert found["E"] == pytest.approx(0.03993 + 0.03016, abs=1.1e-5)  # largest and smallest of its table of means


def test_both_sides_with_a_step_between_them():
    """R takes the reversal error in where both sides repeat well: R_5 of the report, and A over both sides."""
    up, down = rows(FORWARD)[4], rows(BACKWARD)[4]
    target = np.full(10, TARGETS[4])
    found = positioning_figures(target, np.repeat([1.0, -1.0], 5), np.concatenate([up, down]))
    assert found["R"] == pytest.approx(0.05185, abs=1.1e-5)
    both = 2 * up.std(ddof=1) + 2 * down.std(ddof=1) + up.mean() - down.mean()
    assert found["A"] == pytest.approx(both) and found["R"] == pytest.approx(both)


def test_what_readings_do_not_give_is_left_out():
    found = positioning_figures(*columns((1.0, FORWARD)))
    assert set(found) == {"A_forward", "R_forward", "E_forward"}
    target, side, deviation = columns((1.0, FORWARD), (-1.0, BACKWARD))
    _, first = np.unique(np.column_stack([target, side]), axis=0, return_index=True)
    once = positioning_figures(target[first], side[first], deviation[first])
    assert set(once) == {"E", "E_forward", "E_backward", "M", "B", "B_mean"}
