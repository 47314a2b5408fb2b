"""The recorded runs inside a .b5r: readings become the traces of the tests that fit; what is not known is said or
asked for.
"""

import json

import numpy as np
import pytest
from commands import refused, run, snapshot
from test_import import CAMPAIGN, UM, recorded
from test_import import folder as folder  # a fixture

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.errors import InputError
from mjsim.importing.b5r import read_recorded
from mjsim.importing.reading import Options

COUNT = 720


def readings(folder, name):
    """Readings (µm) evenly spaced over a test's turns, in the order of its motion."""
    program, _, _, _ = recorded(folder, name)
    lo, hi = program.measured_span
    phi = program.phi(lo + (hi - lo) * np.arange(COUNT) / COUNT)
    return 12.0 + 6.0 * np.cos(phi) - 3.0 * np.sin(phi) + 2.0 * np.cos(2 * phi + 0.4) + 0.7 * np.sin(5 * phi)


def one(direction, values, circularity="", attribute="", digits=6):
    text = " ".join(f"{v:.{digits}f}" for v in values) if not isinstance(values, str) else values
    feature = f'<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_MM">{circularity}</FEATURE>' if circularity else ""
    head = f"<RUN_DIRECTION>{direction}</RUN_DIRECTION>{feature}"
    return f"<BALLBAR_RUN>{head}<READINGS{attribute}>{text}</READINGS></BALLBAR_RUN>"


def document(*runs, plane="XY", length="100", feed="3000", extra=""):
    return f"""<?xml version="1.0" encoding="utf-8"?><TEST_DOCUMENT><TEST_SPEC NAME="t"><INSTRUMENT><DYNAMIC_BALLBAR>
<NOMINAL_LENGTH>{length}</NOMINAL_LENGTH><PROGRAMMED_FEEDRATE>{feed}</PROGRAMMED_FEEDRATE>
<SAMPLES_A_SECOND>250</SAMPLES_A_SECOND>
<PLANE TEST_PLANE="{plane}"/></DYNAMIC_BALLBAR></INSTRUMENT></TEST_SPEC>
<RUN_RESULTS>{"".join(runs)}</RUN_RESULTS>{extra}</TEST_DOCUMENT>"""


@pytest.fixture
def both(folder):
    """A file with both runs of the campaign's circles, readings in 0.1 µm."""
    path = folder.parent / "xy.b5r"
    path.write_text(document(*(one(n.upper(), 10 * readings(folder, n), "0.0051") for n in ("ccw", "cw"))))
    return path


def errors(folder, name):
    """Largest difference (µm) of a trace from what the readings were made of, at the trace's own angles."""
    campaign = read_campaign(folder)
    trace = campaign.traces[name]
    program, _, _, _ = recorded(folder, name)
    phi = program.phi(trace.time)
    want = 12.0 + 6.0 * np.cos(phi) - 3.0 * np.sin(phi) + 2.0 * np.cos(2 * phi + 0.4) + 0.7 * np.sin(5 * phi)
    return float(np.abs(trace.deviation / UM - want).max())


def test_both_directions_become_the_traces_of_their_tests(folder, both):
    result = run("import", both, "--campaign", folder, "--no-check")
    assert result.exit_code == 0, result.output
    for words in ("2 recorded runs", "readings taken for 0.1 µm", "the file's circularity is 5.1 µm",
        "the file does not say where",
                  "SAMPLES_A_SECOND 250", "no real file has been tried"):  # fmt: skip
        assert words in " ".join(result.stdout.split()), words
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert errors(folder, "ccw") < 0.01 and errors(folder, "cw") < 0.01
    assert (folder / "imported" / "xy.json").is_file()


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "µm"), (10.0, "0.1 µm"), (1e-3, "mm")])
def test_the_unit_agrees_with_the_circularity(folder, both, factor, unit):
    both.write_text(document(one("CCW", factor * readings(folder, "ccw"), "0.0051", digits=9)))
    assert run("import", both, "--campaign", folder, "--no-check").exit_code == 0
    assert errors(folder, "ccw") < 0.01
    file = read_recorded(both)
    assert unit in file.unit(file.runs[0], Options())[1]


def test_unit_from_the_file_or_the_user(folder, both):
    values = readings(folder, "ccw")
    both.write_text(document(one("CCW", values / 1e3, attribute=' DT="UT_LENGTH_MM"', digits=9)))
    assert "the file says so" in run("import", both, "--campaign", folder, "--preview", "--no-check").output
    both.write_text(document(one("CCW", values)))
    refused(
        folder,
        ["import", both, "--campaign", folder],
        "xy.b5r",
        "neither a unit nor a circularity",
        "--deviation-unit",
        "--scale",
    )
    assert run("import", both, "--campaign", folder, "--deviation-unit", "um", "--no-check").exit_code == 0
    assert errors(folder, "ccw") < 0.01
    both.write_text(document(one("CCW", values / 0.05)))
    assert run("import", both, "--campaign", folder, "--scale", 0.05, "--force", "--no-check").exit_code == 0
    assert errors(folder, "ccw") < 0.01


WRONG = {
    "a bad number": (lambda v: one("CCW", "1.0 2.0 x"), "run CCW", "reading 3 is 'x'"),
    "decimal commas": (lambda v: one("CCW", "1,0 2,0"), "reading 1 is '1,0'", "decimal point"),
    "no finite number": (lambda v: one("CCW", "1 nan"), "reading 2 is 'nan'"),
    "no number": (lambda v: one("CW", ""), "run CW", "no number"),
    "no direction": (lambda v: "<BALLBAR_RUN><READINGS>1 2</READINGS></BALLBAR_RUN>", "no RUN_DIRECTION"),
    "another direction": (lambda v: one("LEFT", v), "'LEFT'", "CW or CCW"),
    "one direction twice": (lambda v: one("CW", v) * 2, "more than one run CW"),
    "no unit fits": (lambda v: one("CCW", v, "0.3"), "300 µm", "--deviation-unit"),
    "the file contradicts itself": (
        lambda v: one("CCW", v, "0.0051", ' DT="UT_LENGTH_MM"'),
        "the file says mm",
        "5.1 µm",
    ),
    "runs of different units": (
        lambda v: one("CCW", v, "0.0051") + one("CW", 10 * v, "0.0051"),
        "different units",
        "--scale",
    ),
    "too few readings": (lambda v: one("CCW", v[::20], "0.0051"), "at least 50"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_readings(folder, both, case):
    make, *words = WRONG[case]
    both.write_text(document(make(readings(folder, "ccw"))))
    refused(folder, ["import", both, "--campaign", folder, "--json"], "xy.b5r", *words)


def test_tests_named_by_the_user(folder, both):
    assert run("import", f"{both}=cw", "--campaign", folder, "--no-check").exit_code == 0
    assert set(read_campaign(folder).traces) == {"cw"}
    assert run("import", f"{both}=cw", f"{both}=ccw", "--campaign", folder, "--no-check", "--force").exit_code == 0
    assert errors(folder, "ccw") < 0.01
    refused(folder, ["import", f"{both}=turn", "--campaign", folder, "--force"], "'turn' is rotary")
    refused(folder, ["import", f"{both}=new", "--campaign", folder, "--force"], "run CCW and run CW", "--direction")
    new = [
        "import",
        f"{both}=new",
        "--campaign",
        folder,
        "--force",
        "--direction",
        "CW",
        "--no-check",
        "--table-ball",
        0,
        0,
        155,
    ]
    assert run(*new).exit_code == 0
    (test,) = (t for t in read_campaign(folder).tests if t.name == "new")
    assert (test.plane, test.direction, test.length) == ("XY", "CW", 0.1)
    (folder / "campaign.toml").write_text(
        CAMPAIGN + CAMPAIGN[CAMPAIGN.index("[[test]]") :].split("\n\n")[0].replace('"ccw"', '"again"')
    )
    refused(folder, ["import", both, "--campaign", folder, "--force"], "fits the tests ccw, again", "FILE=TEST")


def test_new_tests_of_both_runs(folder, both):
    both.write_text(both.read_text().replace('"XY"', '"YZ"'))
    result = run("import", both, "--campaign", folder, "--no-check", "--table-ball", 0, 0, 155)
    assert result.exit_code == 0, result.output
    assert {t.name: t.direction for t in read_campaign(folder).tests[-2:]} == {"xy-ccw": "CCW", "xy-cw": "CW"}


def test_runs_without_a_test_are_said(folder, both):
    both.write_text(both.read_text().replace("3000", "1000"))
    result = run("import", both, "--campaign", folder)
    assert result.exit_code == 0 and "no trace made of CCW and CW" in " ".join(result.stdout.split())
    assert not read_campaign(folder).traces
    named = run("import", f"{both}=ccw", "--campaign", folder, "--force", "--no-check")
    assert "the file says feed 1000 mm/min" in " ".join(named.output.split())


def test_from_python(folder, both):
    assert mjsim.import_trace(folder, both, "cw", check=False).test.direction == "CW"
    both.write_text(both.read_text().replace("3000", "1000"))
    with pytest.raises(InputError, match="no run fits a test"):
        mjsim.import_trace(folder, both, check=False)
    both.write_text(document(extra='<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_UM">5</FEATURE>'))
    with pytest.raises(InputError, match="brings no trace"):
        mjsim.import_trace(folder, both, "cw", check=False)


def test_a_plane_called_xz_is_not_taken_over(folder, both):
    text = both.read_text().replace('"XY"', '"XZ"')
    both.write_text(text)
    campaign = folder / "campaign.toml"
    campaign.write_text(campaign.read_text().replace('plane = "XY"', 'plane = "ZX"'))
    assert "no trace made" in " ".join(
        run("import", both, "--campaign", folder, "--no-check", "--preview").stdout.split()
    )
    named = " ".join(run("import", f"{both}=cw", "--campaign", folder, "--no-check").stdout.split())
    assert "G02 of the plane ZX, which is not certain" in named and "no trace made" not in named


def test_preview_and_json(folder, both):
    before = snapshot(folder)
    shown = json.loads(run("import", both, "--campaign", folder, "--preview", "--no-check", "--json").stdout)
    assert snapshot(folder) == before
    assert [(r["direction"], r["readings"], r["um_per_reading"]) for r in shown["runs"]] == [
        ("CCW", COUNT, 0.1),
        ("CW", COUNT, 0.1),
    ]
    assert [t["test"] for t in shown["traces"]] == ["ccw", "cw"]
    assert shown["headers"][0]["programmed_feedrate"] == "3000"


def test_an_arc_is_asked_about(folder, both):
    both.write_text(document(one("CCW", readings(folder, "ccw")[:440], "0.0051")))
    result = run("import", both, "--campaign", folder, "--deviation-unit", "um", "--no-check")
    assert "do the readings cover whole turns" in " ".join(result.output.split())


def test_rate_and_first_angle_by_option(folder, both):
    program, _, _, _ = recorded(folder, "ccw")
    lo, hi = program.measured_span
    both.write_text(document(one("CCW", np.roll(readings(folder, "ccw"), -COUNT // 4), "0.0051")))
    assert run("import", both, "--campaign", folder, "--no-check", "--start-angle", 90).exit_code == 0
    assert errors(folder, "ccw") < 0.05
    refused(folder, ["import", both, "--campaign", folder, "--rate", 10, "--force"], "check feed")
    assert (
        run("import", both, "--campaign", folder, "--no-check", "--rate", COUNT / (hi - lo), "--force").exit_code == 0
    )
