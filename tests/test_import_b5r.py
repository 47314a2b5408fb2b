"""Renishaw .b5r: header and features as public parsers read them, beside mjsim's findings; broken XML is refused."""

import json
import shutil

import pytest
from commands import refused, run, snapshot

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.effects import registry
from mjsim.importing.b5r import UNITS, Feature, read_b5r
from mjsim.importing.features import beside, causes

FEATURES = {
    "AF_CIRCULARITY": ("UT_LENGTH_UM", 7.4), "AF_SCALE_MISMATCH": ("UT_LENGTH_UM", -3.1),
    "AF_SQUARENESS": ("UT_SQUARENESS", 12.5),
    "AF_SERVO_MISMATCH": ("UT_SERVO_MISMATCH", 0.02),
    "AF_STRAIGHTNESS_A": ("UT_LENGTH_UM", 1.1), "AF_STRAIGHTNESS_B": ("UT_LENGTH_UM", -0.4),
    "AF_BACKLASH_A_POS": ("UT_LENGTH_UM", 2.4), "AF_BACKLASH_B_NEG": ("UT_LENGTH_UM", 0.3),
    "AF_LATERAL_PLAY_B_POS": ("UT_LENGTH_UM", 0.1),
    "AF_REVERSAL_SPIKES_B_NEG": ("UT_LENGTH_UM", 1.7), "AF_CYCLIC_ERROR_A_FWD": ("UT_LENGTH_UM", 0.6),
    "AF_CYCLIC_ERROR_B_REV": ("UT_LENGTH_UM", 0.2),
    "AF_CALCULATED_FEEDRATE": ("UT_FEEDRATE", 998.0), "AF_SOMETHING_NEW": ("UT_NEW", 5.0),
}  # fmt: skip


def document(plane="XY", axes="", extra=""):
    """A file with every element that is publicly known."""
    rows = "".join(f'<FEATURE NAME="{n}" DT="{t}"> {v} </FEATURE>' for n, (t, v) in FEATURES.items())
    named = f"<A_AXIS_NAME>{axes[0]}</A_AXIS_NAME><B_AXIS_NAME>{axes[1]}</B_AXIS_NAME>" if axes else ""
    return f"""<?xml version="1.0" encoding="utf-8" standalone="yes"?>
<TEST_DOCUMENT>
<TEST_SPEC NAME="360 deg 100 mm"><INSTRUMENT>
<PLANE VIEW="+A+B" TEST_PLANE="{plane}">{named}</PLANE></INSTRUMENT></TEST_SPEC>
<OPERATOR>N. N.</OPERATOR><DATE_STARTED>20260401-080000</DATE_STARTED><MACHINE_TESTED NAME="Hall 3"/>
<SERIAL_NUMBER>H12345</SERIAL_NUMBER><LAST_CALIBRATED>20250901</LAST_CALIBRATED>
<RUN_RESULTS><BALLBAR_RUN><RUN_DIRECTION>CCW</RUN_DIRECTION>
<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_MM">0.0071</FEATURE></BALLBAR_RUN>
<BALLBAR_RUN><RUN_DIRECTION>CW</RUN_DIRECTION>
<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_MM">0.0069</FEATURE></BALLBAR_RUN></RUN_RESULTS>
<ANALYSIS NAME="DIAGNOSTICS">{rows}</ANALYSIS>{extra}</TEST_DOCUMENT>
"""


@pytest.fixture
def campaign(good, tmp_path):
    return shutil.copytree(good, tmp_path / "c")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "run 1.b5r"
    path.write_text(document())
    return path


def test_header_and_features(file):
    read = read_b5r(file)
    assert read.header == {
        "test": "360 deg 100 mm", "plane": "XY", "machine": "Hall 3", "operator": "N. N.",
        "date_started": "20260401-080000",
        "serial_number": "H12345", "last_calibrated": "20250901",
    }  # fmt: skip
    assert read.axes == ("X", "Y")
    assert {f.name: (f.type, f.value) for f in read.features if f.analysis} == FEATURES
    assert [(f.run, f.value, f.unit) for f in read.features if f.run] == [("CCW", 0.0071, "mm"), ("CW", 0.0069, "mm")]
    assert {f.unit for f in read.features} >= {"µm", "µm/m", "ms", "mm/min", ""}
    assert all(f.unit == UNITS.get(f.type, "") for f in read.features)


@pytest.mark.parametrize(
    ("plane", "axes", "want"),
    [("ZX", "", "ZX"), ("XZ", "", "XZ"), ("XZ", "XZ", "XZ"), ("", "YZ", "YZ"), ("odd", "", "")],
)
def test_letters_of_the_axes(file, plane, axes, want):
    file.write_text(document(plane, axes))
    assert "".join(read_b5r(file).axes) == want


def test_every_cause_is_an_effect_of_the_catalogue():
    """The vocabulary's ids exist, in every plane, and belong to the axis that the feature names."""
    for axes, plane in ((("X", "Y"), "XY"), (("Y", "Z"), "YZ"), (("Z", "X"), "ZX"), (("X", "Z"), "ZX")):
        for name, (kind, value) in FEATURES.items():
            for key in causes(Feature(name, kind, value, ""), axes) or ():
                registry.effect_class(key)
        assert causes(Feature("AF_SQUARENESS", "", 1.0, ""), axes) == (f"squareness.{plane}",)
        assert causes(Feature("AF_BACKLASH_B_POS", "", 1.0, ""), axes) == (f"backlash.{axes[1]}",)
        assert causes(Feature("AF_STRAIGHTNESS_A", "", 1.0, ""), axes) == (f"straightness.E{axes[1]}{axes[0]}",)
    assert causes(Feature("AF_LATERAL_PLAY_A_NEG", "", 1.0, ""), ("X", "Y")) == ()
    assert causes(Feature("AF_SOMETHING_NEW", "", 1.0, ""), ("X", "Y")) is None
    assert causes(Feature("AF_BACKLASH_A_POS", "", 1.0, ""), ()) is None, "no axes, no cause"


def test_beside_mjsims_own(file):
    found = {
        "backlash.X": {"width_um": 2.2},
        "pitch_error.X": {"components": [[1.0, 0.5, 0.0], [2.0, 0.8, 9.0]]},
        "backlash.A": {"width_deg": 1.0},
    }
    circles = [("XY", "CCW", "a", 7.0), ("XY", "", "a, b", 7.5), ("YZ", "CCW", "c", 1.0)]
    rows = beside([read_b5r(file)], found, circles)
    own = {(r["feature"], r["run"]): r["mjsim"] for r in rows}
    assert own["AF_BACKLASH_A_POS", ""] == ["backlash.X 2.2 µm"]
    assert own["AF_CYCLIC_ERROR_A_FWD", ""] == ["pitch_error.X largest of 2 orders 0.8"]
    assert own["AF_CIRCULARITY", "CCW"] == ["G 7.00 µm a"] and own["AF_CIRCULARITY", ""] == ["G 7.50 µm a, b"]
    assert own["AF_CIRCULARITY", "CW"] == own["AF_BACKLASH_B_NEG", ""] == []


def test_import_keeps_them_and_shows_them(campaign, file):
    result = run("import", file, "--campaign", campaign)
    assert result.exit_code == 0, result.output
    for words in ("squareness.XY", "12.5 µm/m", "backlash.X", "friction.Y 1.2 N·m", "serial number H12345",
        "no real file has been tried",
                  "AF_SOMETHING_NEW 5 UT_NEW"):  # fmt: skip
        assert words in " ".join(result.stdout.split()), words
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert json.loads((campaign / "imported" / "run-1.json").read_text())["source"] == "run 1.b5r"
    (kept,) = mjsim.imported_features(read_campaign(campaign))
    assert kept == read_b5r(file)
    shown = json.loads(run("import", "--show", "--campaign", campaign, "--json").stdout)
    assert len(shown["features"]) == len(FEATURES) + 2 and shown["headers"][0]["machine"] == "Hall 3"
    refused(campaign, ["import", file, "--campaign", campaign], "run-1.json", "--force")


def test_compare_shows_them(campaign, file):
    before = json.loads(run("compare", campaign, "--no-plots", "--json").stdout)
    assert "imported" not in before
    mjsim.import_features(campaign, [file])
    assert set(json.loads(run("compare", campaign, "--no-plots", "--json").stdout)) == {*before, "imported"}
    text = run("compare", campaign, "--no-plots").stdout
    assert "what the other system found" in text and "reversal spikes" in text
    assert max(map(len, text.splitlines())) <= 80


def test_traces_and_features_in_one_call_all_or_none(campaign, file):
    trace = file.with_name("turn.csv")
    shutil.move(campaign / "traces" / "turn.csv", trace)
    both = ["import", trace, file, "--campaign", campaign, "--no-check"]
    mjsim.import_features(campaign, [file])
    refused(campaign, both, "run-1.json", "--force")
    assert run(*both, "--force").exit_code == 0
    assert (campaign / "traces" / "turn.csv").is_file()


def test_preview_and_wrong_options_write_nothing(campaign, file):
    before = snapshot(campaign)
    assert run("import", file, "--campaign", campaign, "--preview").exit_code == 0
    assert snapshot(campaign) == before
    refused(campaign, ["import", file, "--campaign", campaign, "--test", "turn"], "brings no trace", "--test")


def test_a_damaged_import_is_named(campaign, file):
    mjsim.import_features(campaign, [file])
    (campaign / "imported" / "run-1.json").write_text('{"source": 1}')
    refused(campaign, ["import", "--show", "--campaign", campaign], "run-1.json", "import the file again")


BROKEN = {
    "external entity": (
        '<!DOCTYPE T [<!ENTITY x SYSTEM "file:///etc/passwd">]><T><FEATURE NAME="A">&x;</FEATURE></T>',
        "not valid XML",
    ),
    "no XML": ("time;deviation\n1;2\n", "not valid XML", "table as text"),
    "half a file": (document()[:900], "not valid XML"),
    "binary": ("\x00\x01\x02" * 50, "not valid XML"),
    "an unknown encoding": ('<?xml version="1.0" encoding="x-none"?><T/>', "not valid XML"),
    "no features": ("<TEST_DOCUMENT><OPERATOR>x</OPERATOR></TEST_DOCUMENT>", "without any FEATURE", "TEST_DOCUMENT"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_files(campaign, file, case):
    text, *words = BROKEN[case]
    file.write_text(text)
    refused(campaign, ["import", file, "--campaign", campaign, "--json"], "run 1.b5r", *words)


def test_values_that_are_no_numbers_are_kept_as_text(file):
    file.write_text(
        document(
            extra='<FEATURE NAME="AF_X" DT="UT_PERCENT">n/a</FEATURE><FEATURE NAME="AF_Y" DT="UT_ANGLE">1e999</FEATURE>'
        )
    )
    assert [(f.name, f.value, f.unit) for f in read_b5r(file).features[-2:]] == [
        ("AF_X", "n/a", "%"),
        ("AF_Y", "1e999", "°"),
    ]
