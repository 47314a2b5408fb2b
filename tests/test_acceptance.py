"""Figures against limits: the decision rule, the uncertainty, the table of the campaign."""

import numpy as np
import pytest
import tomlkit
from commands import as_json, ok, run
from test_cli import cut

from mjsim.instruments.ball_bar.acceptance import Acceptance, Limit, Measured, decide, judge
from mjsim.units import UM


def ellipse(size, noise=0.0, turns=2, seed=0, sign=1.0):
    phi = sign * np.linspace(0.0, 2.0 * np.pi * turns, 4000 * turns, endpoint=False)
    wobble = noise * np.random.default_rng(seed).standard_normal(turns)[np.floor(np.abs(phi) / (2 * np.pi)).astype(int)]
    return phi, (0.5 * size + wobble) * np.cos(2.0 * phi) + 3e-6 * np.cos(phi)


@pytest.mark.parametrize(
    ("value", "said"),
    [(8.0, "pass"), (9.0, "pass"), (9.01, "inside"), (-9.5, "inside"), (11.0, "inside"), (11.01, "fail")],
)
def test_what_lies_within_the_guard_band_proves_nothing(value, said):
    assert decide(value, 10.0, 1.0).split()[0] == said


def test_circular_error_and_its_uncertainty_in_closed_form():
    phi, deviation = ellipse(10e-6, 1e-6)
    limits = (Limit(("a",), "circular_error", 12e-6, "agreed"), Limit(("a", "b"), "circular_error", 12e-6, "agreed"))
    rows = judge(Acceptance(limits, 1.2e-6), [Measured("a", phi, deviation)], 0.1 * UM)
    assert len(rows) == 2  # b was not measured
    own = [10.0 + 2.0 * x for x in np.random.default_rng(0).standard_normal(2)]
    u = np.hypot(0.5 * abs(own[0] - own[1]), 0.6)
    assert rows[0].value_um == pytest.approx(max(own), abs=0.02)
    assert rows[0].uncertainty_um == pytest.approx(u, rel=1e-3)
    assert rows[0].guard_um == pytest.approx(1.6449 * u, rel=1e-3)
    quiet = judge(Acceptance(limits[:1], 0.0), [Measured("a", *ellipse(10e-6))], 0.1 * UM)[0]
    assert quiet.uncertainty_um == pytest.approx(0.1) and quiet.decision == "pass"


def test_bidirectional_error_takes_both_directions():
    ccw, cw = Measured("ccw", *ellipse(4e-6)), Measured("cw", *ellipse(8e-6, sign=-1.0))
    limit = Limit(("ccw", "cw"), "bidirectional_error", 5e-6, "agreed")
    row = judge(Acceptance((limit,), 0.0), [ccw, cw], 0.01 * UM)[0]
    assert row.tests == ("ccw", "cw") and row.value_um == pytest.approx(8.0, abs=0.01) and row.decision == "fail"


@pytest.fixture
def campaign(tmp_path):
    folder = cut(tmp_path / "c")
    document = tomlkit.parse((folder / "campaign.toml").read_text())
    document["acceptance"] = {
        "instrument_um": 0.5,
        "limit": [
            {"tests": ["cone45-centre-ccw"], "figure": "circular_error", "um": 50.0, "source": "agreed, table 1"},
            {"tests": ["rotary-a-tangential-ccw"], "figure": "range", "um": 0.1, "source": "agreed, table 2"},
        ],
    }
    (folder / "campaign.toml").write_text(tomlkit.dumps(document))
    return folder


def test_compare_and_the_report_decide(campaign, tmp_path):
    data = as_json("compare", campaign, "--no-plots", "--json")
    assert [a["decision"] for a in data["acceptance"]] == ["pass", "fail"]
    shown = ok("compare", campaign, "--no-plots").stdout
    assert "ISO 14253-1" in shown and "agreed, table 2" in shown
    ok("report", campaign, "-o", tmp_path / "r.html", "--no-diagnose")
    page = (tmp_path / "r.html").read_text()
    assert 'id="acceptance"' in page and "agreed, table 1" in page


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tests": ["none"]}, "there is no test 'none'"),
        ({"figure": "range"}, "allowed for it: figures of ISO 230-4"),
        ({"figure": "bidirectional_error"}, "one CCW and one CW"),
        ({"figure": "roundness"}, "circular_error"),
        ({"um": -1.0}, "um"),
    ],
)
def test_wrong_limits_are_refused(campaign, changes, words):
    document = tomlkit.parse((campaign / "campaign.toml").read_text())
    document["acceptance"]["limit"][0].update(changes)
    (campaign / "campaign.toml").write_text(tomlkit.dumps(document))
    refused = run("compare", campaign, "--no-plots")
    assert refused.exit_code == 1 and words in refused.stderr


def test_the_report_shows_what_a_control_can_correct():
    from test_report import _content

    from mjsim.report.page import render

    rows = [{"name": "cone", "before_um": 2.41, "after_um": 0.52, "perfect_um": 0.48}]
    forecast = {"tests": rows, "rms_before_um": 2.41, "rms_after_um": 0.52, "rms_perfect_um": 0.48}
    page = render(_content(compensation={"corrects": [{"id": "backlash.A"}], "forecast": forecast}))
    assert 'id="compensation"' in page and "backlash.A" in page
    assert 'data-json="/compensation/forecast/tests/0/after_um">0.52<' in page
