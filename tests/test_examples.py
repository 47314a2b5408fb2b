"""The example campaigns, end to end: what hides in each is found, nothing is found where nothing hides."""

import json
import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from commands import TESTS, cut

from mjsim.cli.diagnose import show
from mjsim.cli.main import main
from mjsim.io.resources import examples

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("shared_results", "fast_plans")]
KEYS = {
    "verdict", "probabilities", "noise_um", "discrepancy_um", "slide_turns_urad", "drift_um", "friction_varies_percent",
    "bar_gain_percent", "hum", "louder", "rms_before_um", "rms_after_um", "effects", "unexplained", "further_curves",
    "not_testable", "left_out", "next_test", "samples", "calibration", "combinations", "shares", "budget",
}  # fmt: skip
EFFECT_KEYS = {
    "id", "parameters", "ci95", "rms_before_um", "rms_after_um", "probability", "alternatives", "alternative_ids",
    "tests", "undetermined",
}  # fmt: skip
#: Tests of an example that show what is said of it here.
PARTS = {
    "healthy": (
        "cone15-centre-ccw", "cone45-x50-ccw", "circle-xy-ccw", "rotary-a-tangential-ccw", "rotary-c-tangential-ccw",
    ),
    "hidden-backlash": TESTS,
    "pitch-error": ("cone15-x50-ccw", "cone15-y50-ccw"),
    "two-candidates": ("cone15-centre-ccw", "cone15-x50-ccw", "cone45-x50-ccw"),
    # C turns both ways: else its position and the time since it turned round are one
    "unlisted": ("cone15-x50-ccw", "cone15-y50-ccw", "rotary-c-tangential-cw"),
}  # fmt: skip

SIZED = ("cone15-centre-ccw", "cone45-x50-ccw", "cone15-y50-ccw", "rotary-c-tangential-ccw", "circle-xy-ccw")


def run(*args):
    result = CliRunner().invoke(main, [*map(str, args), "--json", "--quiet"])
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory, shared_results):
    """``diagnosed(name)``: JSON of `mjsim diagnose` and the fitted machine's file; each example is diagnosed once."""
    folder, done = tmp_path_factory.mktemp("fitted"), {}

    def diagnose(name):
        if name not in done:
            fitted = folder / f"{name}.toml"
            campaign = cut(folder / name, PARTS[name], example=name)
            done[name] = run("diagnose", campaign, "--write", fitted), fitted
        return done[name]

    return diagnose


@pytest.mark.parametrize("name", ["healthy", "hidden-backlash", "pitch-error", "two-candidates"])
def test_json_is_as_documented(diagnosed, name):
    data, fitted = diagnosed(name)
    assert set(data) == KEYS
    for effect in data["effects"]:
        assert set(effect) == EFFECT_KEYS
        assert set(effect["tests"]) <= {
            p.name.removesuffix(".csv.gz") for p in (examples() / name / "traces").iterdir()
        }
        for key, interval in effect["ci95"].items():
            if key != "components":
                assert interval[0] <= effect["parameters"][key] <= interval[1]
    assert fitted.is_file()


def test_healthy_has_nothing(diagnosed):
    data, _ = diagnosed("healthy")
    assert (data["verdict"], data["effects"], data["unexplained"]) == ("nothing_found", [], None)
    assert data["rms_after_um"] <= 1.15 * data["noise_um"]


def test_healthy_compares_down_to_the_noise(tmp_path):
    data = run("compare", cut(tmp_path / "healthy", PARTS["healthy"], example="healthy"), "--no-plots")
    assert data["rms_um"] <= 1.15 * data["noise_um"]


def test_hidden_backlash_is_identified(diagnosed):
    data, _ = diagnosed("hidden-backlash")
    assert (data["verdict"], [e["id"] for e in data["effects"]]) == ("identified", ["backlash.A"])
    assert data["effects"][0]["parameters"]["width_deg"] == pytest.approx(0.002, rel=0.03)
    assert data["effects"][0]["alternatives"] == []
    assert data["rms_after_um"] <= 1.15 * data["noise_um"]


@pytest.mark.parametrize(("name", "printed"), [("hidden-backlash", 1), ("pitch-error", 2)])
def test_numbers_are_printed_with_two_digits_of_their_uncertainty(diagnosed, name, printed, capsys):
    """Half the width of every printed interval has two digits, and the number as many decimals as its ends."""
    data, _ = diagnosed(name)
    show(data)
    found = re.findall(r"(-?[0-9.]+)[^0-9.\[-]*\[(-?[0-9.]+),\s+(-?[0-9.]+)\]", capsys.readouterr().out)
    assert len(found) == printed
    for row in found:
        decimals = {len(x.partition(".")[2]) for x in row}
        assert len(decimals) == 1
        half = (float(row[2]) - float(row[1])) / 2 * 10 ** decimals.pop()
        assert 9 <= half <= 100.5  # ends are rounded: half a last digit each


def test_adding_the_hidden_backlash_removes_the_error(tmp_path):
    data = run("add", cut(tmp_path / "campaign"), "backlash.A")
    assert data["rms_after_um"] <= 0.14
    assert data["effect"]["parameters"]["width_deg"] == pytest.approx(0.002, rel=0.03)


def without_eccentricity(phi, d):
    m = np.column_stack([np.cos(phi), np.sin(phi), np.ones_like(phi)])
    return d - m @ np.linalg.lstsq(m, d, rcond=None)[0]


def test_the_fitted_machine_predicts_tests_outside_the_campaign(diagnosed, tmp_path):
    _, fitted = diagnosed("hidden-backlash")
    heldout = examples() / "hidden-backlash" / "heldout"
    run("simulate", heldout, "--machine", fitted, "--out", tmp_path, "--no-plots")
    before = after = 0.0
    truths = sorted(heldout.glob("*.truth.csv.gz"))
    assert len(truths) == 3
    for truth in truths:
        phi, deviation, nominal = np.loadtxt(truth, delimiter=",", skiprows=1).T
        simulated = np.genfromtxt(tmp_path / truth.name.replace(".truth.csv.gz", ".csv"), delimiter=",", names=True)
        order = np.argsort(simulated["phi_deg"], kind="stable")
        s = np.interp(phi, simulated["phi_deg"][order], simulated["deviation_um"][order])
        keep = (np.abs(phi) > 30) & (np.abs(phi) < 690)
        p = np.radians(phi[keep])
        true = without_eccentricity(p, deviation[keep])
        after += np.mean((true - without_eccentricity(p, s[keep])) ** 2)
        before += np.mean((true - without_eccentricity(p, nominal[keep])) ** 2)
    assert 1 - after / before >= 0.95


def test_pitch_error_has_its_order_and_amplitude(diagnosed):
    data, _ = diagnosed("pitch-error")
    (effect,) = data["effects"]
    assert effect["id"] == "pitch_error.C"
    amplitude = {round(order): a for order, a, _ in effect["parameters"]["components"]}
    assert amplitude[72] == pytest.approx(0.0025, rel=0.03)
    assert data["rms_after_um"] <= 1.15 * data["noise_um"]


def test_two_candidates_are_both_named(diagnosed):
    data, _ = diagnosed("two-candidates")
    assert data["verdict"] == "ambiguous"
    (effect,) = data["effects"]
    assert effect["id"] in ("servo_gain.C", "servo_delay.C")
    assert {effect["id"], *effect["alternative_ids"]} >= {"servo_gain.C", "servo_delay.C"}


def test_an_unknown_cause_is_described_and_an_own_effect_explains_it(tmp_path):
    """docs/unknown-cause.md: unknown, described, own effect, noise floor."""
    folder = cut(tmp_path / "campaign", PARTS["unlisted"], example="unlisted")
    data = run("diagnose", folder)
    unknown = data["unexplained"]
    assert (data["verdict"], data["effects"]) == ("unknown", [])
    assert (unknown["axes"], unknown["variable"]) == (["C"], "position")
    assert unknown["left_um"] < 1.5 * data["noise_um"] < unknown["rms_um"]
    height, place = re.search(r"flat but for a step of \+([\d.]+)° at (-[\d.]+)°", unknown["summary"]).groups()
    assert float(height) == pytest.approx(0.0045, rel=0.1) and float(place) == pytest.approx(-300.0, abs=3.0)
    for written in (unknown["effect_file"], unknown["plot"]):
        assert (folder / ".mjsim").joinpath(written.rpartition("/")[2]).stat().st_size > 1000
    sized = cut(tmp_path / "sized", SIZED, example="unlisted")  # the step's size needs more tests than its place
    shutil.copy(examples() / "unlisted" / "encoder_step.py", sized)
    added = run("add", sized, sized / "encoder_step.py")
    assert added["effect"]["parameters"]["step_deg"] == pytest.approx(0.0045, rel=0.01)
    assert added["effect"]["parameters"]["at_deg"] == pytest.approx(-300.0, abs=0.1)
    assert added["rms_after_um"] < 0.14
