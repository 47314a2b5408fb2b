"""One axis against a laser, a scale or a level: reading, mistakes, comparison and diagnosis, on readings of the
independent generator.
"""

import json

import numpy as np
import pytest
from commands import printed as run
from commands import read

import mjsim
from mjsim.commands.any_instrument import compare_plainly
from mjsim.errors import InputError
from mjsim.inference.at_rest import RestFitter, RestProblem
from mjsim.inference.calibration import expected_effects
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.positions.instrument import position_mistakes, position_remarks, read_readings, trace_text
from mjsim.report.write import answer_of, section_of_points
from mjsim.units import DEG, UM
from tests.independent import positions

LINE = {"name": "laser-x", "axis": "X", "ends": (0.0, 300.0), "count": 9, "runs": 2}
ANGLES = {"angular_error": {"urad": 12.0}}


def intervals(result):
    rows = [(c.effect.effect.id, c.ci95) for c in result.calibration] + [(e.effect.id, e.ci95) for e in result.effects]
    return {name: next(iter(ci.values())) for name, ci in rows if ci}


def half_width(result, name, true):
    """95 % half width of a number that lies within three standard deviations of the true one; how often it lies within
    the interval, ``scripts/proofs/routes_proof.py`` tells.
    """
    low, high = intervals(result)[name]
    assert abs(0.5 * (low + high) - true) < 1.53 * 0.5 * (high - low)
    return 0.5 * (high - low)


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """A laser along X of a machine with 6 µm of play and a scale error of 60 ppm."""
    path = tmp_path_factory.mktemp("worn")
    positions.write(path, 1, {"play": {"X": 6e-6}, "scale": {"X": 60e-6}}, [LINE | {"runs": 3}])
    return path


# -- reading -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("head", "row", "message"),
    [
        ("target_mm,run,direction", "1,1,1", "line 1: allowed: one column of deviation_um"),
        ("run,deviation_um", "1,2", "line 1: the column target_mm is missing"),
        ("target_deg,deviation_um", "1,2", "line 1: column 'target_deg'; allowed for EXX: target_mm"),
        (
            "target_mm,deviation_urad",
            "1,2",
            "line 1: column 'deviation_urad'; allowed for EXX: target_mm, dev",
        ),
        ("target_mm,direction,deviation_um", "1,0,2", "line 2: direction = 0; allowed: 1 where the last move"),
        ("target_mm,deviation_um", "1,two", "line 2: deviation_um = 'two'; allowed: a number"),
        ("target_mm,deviation_um", "1,2,3", "line 2: 3 columns in '1,2,3'; allowed: 2"),
        ("target_mm,deviation_um,temperature_degC", "1,2,293", "line 2: temperature_degC = 293; allowed: -50 to 100"),
    ],
)
def test_wrong_files_are_named(worn, tmp_path, head, row, message):
    campaign, _ = read(worn)
    (tmp_path / "p.csv").write_text("\n".join([head, *[row] * 4]))
    with pytest.raises(InputError, match=message):
        read_readings(tmp_path / "p.csv", campaign.tests[0])


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ('axis = "B"', "axis = 'B'; allowed: X, Y, Z, A, C"),
        ('axis = "X"\ncomponent = "EXY"', "component = 'EXY'; allowed for X: EXX, EYX, EZX, EAX, EBX, ECX"),
        ('axis = "C"\ncomponent = "EAC"', "component = 'EAC'; allowed for C: ECC"),
        ('axis = "C"\ntargets_mm = [1.0]', "targets_mm; allowed for C: targets_deg"),
        ('axis = "X"\nat_mm = { X = 1.0 }', "at_mm names 'X'; allowed: Y, Z"),
        ('axis = "X"\nline_mm = [1.0]', "line_mm"),
    ],
)
def test_wrong_tables_are_named(worn, tmp_path, key, message):
    (tmp_path / "machine.toml").write_bytes((worn / "machine.toml").read_bytes())
    (tmp_path / "campaign.toml").write_text(
        f'name = "x"\n[instrument]\nkind = "positions"\n[[test]]\nname = "p"\nkind = "positions"\n{key}\n'
    )
    said = run("check", tmp_path, code=1)
    assert message in " ".join(said.split()) and not said.startswith("Traceback")


def test_a_trace_goes_round(worn, tmp_path):
    campaign, _ = read(worn)
    (test,) = campaign.tests
    readings = campaign.traces[test.name]
    (tmp_path / "p.csv").write_text(trace_text(test, readings))
    again = read_readings(tmp_path / "p.csv", test)
    for name in ("target", "deviation", "side", "run"):
        assert np.allclose(getattr(again, name), getattr(readings, name), atol=1e-9)


def test_sides_and_runs_follow_from_the_order(worn, tmp_path):
    """A file without direction and run: the targets stand in the order of measuring."""
    campaign, _ = read(worn)
    (test,) = campaign.tests
    readings = campaign.traces[test.name]
    rows = zip(readings.target * 1e3, readings.deviation * 1e6, strict=True)
    (tmp_path / "p.csv").write_text("\n".join(["target_mm,deviation_um", *(f"{a:.4f},{b:.4f}" for a, b in rows)]))
    again = read_readings(tmp_path / "p.csv", test)
    assert np.array_equal(again.side, readings.side) and np.array_equal(again.run, readings.run)


# -- mistakes ----------------------------------------------------------------------------------------------------------


def _one(values, i, by):
    out = values.copy()
    out[i] += by
    return out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: {"deviation": r.deviation + r.target}, "write measured less target"),
        (lambda r: {"deviation": r.deviation * 1e-3}, "write them in µm, not in a larger unit"),
        (lambda r: {"deviation": r.deviation * 1e3}, "more than any machine has"),
        (lambda r: {"side": -r.side}, "the targets fall where direction is 1 and grow where it is -1"),
        (lambda r: {"side": np.ones(len(r.side))}, "go up and down, but direction is 1 throughout"),
        (lambda r: {"target": r.target * 1e-3}, "write them in mm, not in m"),
        (lambda r: {"deviation": _one(r.deviation, 7, 40e-6)}, "off the others there, which scatter by"),
    ],
)
def test_mistakes_are_named(worn, change, message):
    from dataclasses import replace

    campaign, _ = read(worn)
    (test,) = campaign.tests
    readings = campaign.traces[test.name]
    wrong = replace(readings, **change(readings))
    (mistake,) = position_mistakes([test], {test.name: wrong})
    assert message in mistake.sentence
    assert position_mistakes([test], {test.name: readings}) == []


def test_degrees_in_radians_are_named(tmp_path):
    positions.write(tmp_path, 1, {}, [{"name": "c", "axis": "C", "ends": (0.0, 360.0), "count": 13, "runs": 2}])
    from dataclasses import replace

    campaign, _ = read(tmp_path)
    (test,) = campaign.tests
    r = campaign.traces["c"]
    told = replace(r, target=np.round(r.target / DEG, 0) * DEG)
    assert position_mistakes([test], {"c": told}) == []
    (mistake,) = position_mistakes([test], {"c": replace(told, target=told.target * DEG)})
    assert "write them in degrees" in mistake.sentence


def test_play_with_the_wrong_sign_is_remarked(worn):
    from dataclasses import replace

    campaign, _ = read(worn)
    (test,) = campaign.tests
    readings = campaign.traces[test.name]
    assert position_remarks([test], {test.name: readings}, campaign.instrument) == []
    turned = replace(readings, deviation=-readings.deviation)
    (remark,) = position_remarks([test], {test.name: turned}, campaign.instrument)
    assert "or deviation or direction has the opposite sign" in remark.sentence
    assert json.loads(run("check", worn, "--json"))["mistakes"] == []


def test_a_mistake_stops_the_diagnosis(worn, tmp_path):
    for name in ("campaign.toml", "machine.toml"):
        (tmp_path / name).write_bytes((worn / name).read_bytes())
    head, *rows = (worn / "traces" / "laser-x.csv").read_text().splitlines()
    (tmp_path / "traces").mkdir()
    wrong = [",".join([a, b, c, f"{float(d) * 1e3:.3f}"]) for a, b, c, d in (r.split(",") for r in rows)]
    (tmp_path / "traces" / "laser-x.csv").write_text("\n".join([head, *wrong]))
    assert "or say --as-is" in " ".join(run("diagnose", tmp_path, code=1).split())


# -- comparison --------------------------------------------------------------------------------------------------------

#: Errors of the generator, and the same as effects of mjsim. Waves are of 80 mm, with a lead of 10 mm.
KINDS = {
    "play": ({"play": {"X": 5e-6, "Y": 3e-6}}, [("backlash.X", "width_um", 5.0), ("backlash.Y", "width_um", 3.0)]),
    "scale": ({"scale": {"X": 40e-6, "Y": 30e-6}}, [("scale_error.X", "ppm", 40.0), ("scale_error.Y", "ppm", 30.0)]),
    "straight": ({"straight": {"EYX": (2e-6, 0.0)}}, [("straightness.EYX", "quadratic_um", 2.0)]),
    "yaw": ({"angle": {"ECX": (30e-6, 0.0)}}, [("angular_error.ECX", "linear_urad", 30.0)]),
    "pitch": ({"angle": {"EBX": (30e-6, 0.0)}}, [("angular_error.EBX", "linear_urad", 30.0)]),
    "table": ({"angle": {"EAY": (30e-6, 0.0)}}, [("angular_error.EAY", "linear_urad", 30.0)]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_model_with_the_true_errors_explains_all(tmp_path, kind):
    """mjsim and the generator, which shares no code with it, mean the same by every kind of error, on slides of the
    tool and of the table, along lines off the axes, with other axes away from 0.
    """
    errors, effects = KINDS[kind]
    tests = [
        LINE | {"line_mm": [10.0, 40.0, 120.0], "at_mm": {"Y": 60.0, "Z": 100.0}, "runs": 1},
        LINE | {"name": "straight", "component": "EYX", "line_mm": [50.0, 0.0, 20.0], "runs": 1},
        LINE | {"name": "yaw", "component": "ECX", "runs": 1},
        LINE | {"name": "laser-y", "axis": "Y", "line_mm": [30.0, 0.0, 150.0], "at_mm": {"Z": 50.0}, "runs": 1},
    ]
    positions.write(tmp_path, 3, errors, tests, noise=1e-12)
    campaign = mjsim.read_campaign(tmp_path, as_is=True)  # readings without noise look like those in a wrong unit
    machine = mjsim.read_machine(campaign.machine_file)
    before = compare_plainly(campaign, machine)
    for name, key, value in effects:
        more = {"quadratic_urad": 0.0} if key == "linear_urad" else {"cubic_um": 0.0} if key == "quadratic_um" else {}
        machine = machine.with_effect(mjsim.make_effect(name, machine.chain, **{key: value}, **more))
    after = compare_plainly(campaign, machine)
    assert before.rms > 0.1 * UM and after.rms < 0.005 * UM


def test_compare_prints_the_figures(worn):
    data = json.loads(run("compare", worn, "--json", "--no-plots"))
    figures = data["tests"][0]["figures"]
    assert figures["measured"]["B_mean_um"] == pytest.approx(-6.0, abs=0.3)
    assert figures["measured"]["E_um"] == pytest.approx(60.0 * 0.3 + 6.0, abs=1.0)
    assert figures["measured"]["A_um"] > figures["measured"]["E_um"] > figures["simulated"]["E_um"]


# -- diagnosis ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def diagnosed(worn):
    return mjsim.diagnose(*read(worn))


def test_play_and_scale_are_found(diagnosed):
    result = diagnosed
    assert result.verdict == "identified"
    assert {e.effect.id for e in result.effects} == {"backlash.X", "scale_error.X"}
    for name, true in (("backlash.X", 6.0), ("scale_error.X", 60.0)):
        assert half_width(result, name, true) < 0.05 * true
    assert result.after.rms < 1.2 * result.noise


def test_a_wave_of_the_screw_is_found(tmp_path):
    """Targets that are close enough show a pitch error once per turn of the screw."""
    dense = LINE | {"ends": (0.0, 40.0), "count": 31, "runs": 2}
    positions.write(tmp_path, 4, {"waves": {"X": [(0.010, 4e-6, 0.0)]}}, [dense])
    result = mjsim.diagnose(*read(tmp_path))
    (found,) = result.effects
    assert found.effect.id == "pitch_error.X" and result.verdict == "identified"
    ((order, amplitude, _), *_) = sorted(found.effect.values["components"], key=lambda row: -row[1])
    assert order == 1.0 and amplitude == pytest.approx(4.0, abs=0.3)


def test_nothing_is_found_on_a_sound_machine(tmp_path):
    errors = {"play": {"X": 0.3e-6}, "scale": {"X": 8e-6}}
    positions.write(tmp_path, 2, errors, [LINE], instrument={"compensated": False}, gain=10e-6)
    result = mjsim.diagnose(*read(tmp_path))
    assert result.verdict == "nothing_found" and not result.effects
    assert half_width(result, "scale_error.X", 8.0) > 10.0  # nothing is compensated: expansion and scale are one
    assert half_width(result, "backlash.X", 0.3) < 0.4


def test_an_angle_shows_on_a_line_that_is_off(tmp_path):
    """X pitches by 40 µrad in 100 mm. Along a line through the functional point nothing shows, 200 mm above it is a
    scale of 80 ppm; both lines together tell it from a scale error.
    """
    lines = [LINE | {"line_mm": [0.0, 0.0, 200.0]}]
    errors = {"angle": {"EBX": (40e-6, 0.0)}}
    positions.write(tmp_path / "one", 5, errors, lines, tolerance=ANGLES)
    alone = mjsim.diagnose(*read(tmp_path / "one"))
    (finding,) = alone.effects
    assert {finding.effect.id, *finding.alternatives} == {"angular_error.EBX", "scale_error.X"}
    positions.write(tmp_path / "two", 5, errors, [*lines, LINE | {"name": "low"}], tolerance=ANGLES)
    result = mjsim.diagnose(*read(tmp_path / "two"))
    (finding,) = result.effects
    assert finding.effect.id == "angular_error.EBX" and not finding.alternatives
    assert half_width(result, "angular_error.EBX", 40.0) < 3.0


def test_what_is_in_no_model_is_unknown(tmp_path):
    bump = LINE | {"count": 15, "extra": lambda x: 6e-6 * np.exp(-(((x - 0.15) / 0.03) ** 2))}
    positions.write(tmp_path, 6, {}, [bump])
    result = mjsim.diagnose(*read(tmp_path))
    assert result.verdict == "unknown" and result.at_rest[0].misfit > 0.9


def test_no_bounded_effect_explains_what_is_beyond_its_bound(tmp_path):
    """Where a control takes 6 µm too much of the play out, what is left is a play below zero."""
    positions.write(tmp_path, 1, {"play": {"X": -6e-6}, "scale": {"X": 60e-6}}, [LINE | {"runs": 3}])
    result = mjsim.diagnose(*read(tmp_path))
    assert result.verdict == "unknown" and result.at_rest[0].misfit > 0.9
    assert [e.effect.id for e in result.effects] == ["scale_error.X"]


def test_angles_of_a_level_and_of_a_table(tmp_path):
    """Readings in µrad: a level on the slide, and a rotary table whose worm has play."""
    tests = [
        LINE | {"name": "level", "component": "EBX"},
        {"name": "table", "axis": "C", "ends": (0.0, 360.0), "count": 13, "runs": 2},
    ]
    errors = {"angle": {"EBX": (40e-6, 0.0)}, "play": {"C": 0.004 * DEG}}
    positions.write(tmp_path, 7, errors, tests, tolerance=ANGLES, noise=0.5e-6)
    result = mjsim.diagnose(*read(tmp_path))
    assert {e.effect.id for e in result.effects} == {"angular_error.EBX", "backlash.C"}
    assert half_width(result, "angular_error.EBX", 40.0) < 2.0
    assert half_width(result, "backlash.C", 0.004) < 0.0002


def test_a_rotary_table_alone_is_a_machine(tmp_path):
    """A calibrator on the only axis that there is: nothing is asked of points in space."""
    import tomlkit

    table = {"name": "table", "axis": "C", "ends": (0.0, 360.0), "count": 13, "runs": 2}
    positions.write(tmp_path, 7, {"play": {"C": 0.004 * DEG}}, [table], noise=0.5e-6)
    machine = tomlkit.parse((tmp_path / "machine.toml").read_text()).unwrap()
    alone = {"name": "table", "configuration": "C", "drive": {"C": machine["drive"]["C"]}}
    alone["tolerance"] = {"backlash": {"deg": 0.0008}, "pitch_error": {"deg": 0.0014}}
    (tmp_path / "machine.toml").write_text(tomlkit.dumps(alone))
    result = mjsim.diagnose(*read(tmp_path))
    assert [e.effect.id for e in result.effects] == ["backlash.C"]
    assert half_width(result, "backlash.C", 0.004) < 0.0002
    assert "radial_error_motion.C" not in result.not_testable


# -- everything around it ----------------------------------------------------------------------------------------------


def test_import(worn, tmp_path):
    """Tables of other layouts give the same readings: one row a reading with measured positions, and one row a target
    with the runs side by side, with German words and decimal commas.
    """
    campaign, _ = read(worn)
    (test,) = campaign.tests
    readings = campaign.traces[test.name]
    (tmp_path / "machine.toml").write_bytes((worn / "machine.toml").read_bytes())
    text = 'name = "x"\n[[test]]\nname = "laser-x"\nkind = "positions"\naxis = "X"\n'
    (tmp_path / "campaign.toml").write_text(text + '[instrument]\nkind = "positions"\n')
    target, found = readings.target * 1e3, (readings.target + readings.deviation) * 1e3
    rows = [f"{a:.4f}\t{b:.7f}" for a, b in zip(target, found, strict=True)]
    (tmp_path / "long.txt").write_text("Target [mm]\tActual [mm]\n" + "\n".join(rows))
    order = ("--campaign", tmp_path, "--points", "--test", "laser-x")
    shown = json.loads(run("import", tmp_path / "long.txt", *order, "--preview", "--json"))["points"][0]
    assert shown["points"] == len(target) and shown["questions"] == [] and not (tmp_path / "traces").exists()
    run("import", tmp_path / "long.txt", *order)
    again = mjsim.read_campaign(tmp_path).traces["laser-x"]
    for name in ("target", "side", "run"):
        assert np.allclose(getattr(again, name), getattr(readings, name))
    assert np.allclose(again.deviation, readings.deviation, atol=1e-10)

    columns = {f"{k} {word} [µm]": (k, side) for k in (1, 2, 3) for word, side in (("vor", 1.0), ("zurück", -1.0))}
    places = np.unique(np.round(target, 4))
    cells = {}
    for name, (k, side) in columns.items():
        mine = (readings.run == k) & (readings.side == side)
        cells[name] = dict(zip(np.round(target[mine], 4), readings.deviation[mine] * 1e6, strict=True))
    lines = [";".join([f"{p:.4f}", *(f"{cells[n][p]:.4f}" for n in columns)]).replace(".", ",") for p in places]
    (tmp_path / "wide.csv").write_text("\n".join(["Soll [mm];" + ";".join(columns), *lines]))
    run("import", tmp_path / "wide.csv", *order, "--force")
    wide = mjsim.read_campaign(tmp_path).traces["laser-x"]
    assert np.allclose(wide.deviation, readings.deviation, atol=1e-10) and np.array_equal(wide.side, readings.side)
    assert "name one of the campaign with --test" in " ".join(
        run("import", tmp_path / "wide.csv", "--campaign", tmp_path, "--points", "--test", "other", code=1).split()
    )


def test_plan_and_targets(worn, tmp_path):
    data = json.loads(run("plan", worn, "--targets", "X", "--range", "X", 0, 1400, "--json"))
    targets = data["test"]["targets_mm"]
    assert len(targets) == 7 and targets[0] == 0.0 and targets[-1] <= 1400.0  # five a metre
    phases = np.sort(np.mod(np.array(targets) / 10.0, 1.0))  # of a screw of 10 mm
    assert np.diff(phases).max() < 0.4
    known = {r["id"]: (r["class_half_width95"], r["half_width95"]) for r in data["known"]}
    assert known["scale_error.X"][1] < 0.2 * known["scale_error.X"][0]  # the laser is compensated
    for name in ("machine.toml", "campaign.toml"):
        (tmp_path / name).write_bytes((worn / name).read_bytes())
    import tomlkit

    (tmp_path / "traces").mkdir()
    (tmp_path / "traces" / "laser-x.csv").write_bytes((worn / "traces" / "laser-x.csv").read_bytes())
    text = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text + "\n" + tomlkit.dumps({"test": [data["test"]]}))
    run("nc", tmp_path, "--test", "targets-x", "-o", tmp_path / "t.csv")
    head, *rows = (tmp_path / "t.csv").read_text().splitlines()
    assert head == "target_mm,run,direction" and len(rows) == 7 * 2 * 5
    assert [float(r.split(",")[0]) for r in rows[:7]] == targets
    said = " ".join(run("nc", tmp_path, "--test", "laser-x", "-o", tmp_path / "u.csv", code=1).split())
    assert "says no positions" in said and "--targets AXIS" in said
    assert len(json.loads(run("plan", worn, "--targets", "C", "--json"))["test"]["targets_deg"]) == 8
    assert "no range of X; allowed: --range X LOW HIGH" in run("plan", worn, "--targets", "X", code=1)


def test_a_campaign_from_nothing_to_a_diagonal(tmp_path):
    """No text editor: a new campaign, a line and a diagonal, and what the control is told along it."""
    folder = tmp_path / "mine"
    run("new", "campaign", folder, "--instrument", "positions")
    run("plan", folder, "--targets", "X", "--range", "X", -150, 150, "--write")
    ends = ("--range", "X", -150, 150, "--range", "Z", 200, 0)
    data = json.loads(run("plan", folder, "--targets", "XZ", *ends, "--write", "--json"))
    assert data["test"]["from_mm"] == {"X": -150.0, "Z": 200.0} and data["test"]["to_mm"] == {"X": 150.0, "Z": 0.0}
    line, diagonal = mjsim.read_campaign(folder).tests
    assert (line.name, diagonal.name, diagonal.component) == ("targets-x", "diagonal-xz", "DXZ-")
    assert diagonal.targets[0] == 0.0 and diagonal.length - 1e-6 < diagonal.targets[-1] + 2e-3
    run("nc", folder, "--test", "diagonal-xz", "-o", tmp_path / "d.csv")
    head, first, *_ = (tmp_path / "d.csv").read_text().splitlines()
    assert head == "target_mm,run,direction,X_mm,Z_mm"
    assert first.split(",")[3:] == ["-150.0000", "200.0000"]
    said = run("plan", folder, "--targets", "XZ", "--range", "X", 0, 0, "--range", "Z", 0, 100, code=1)
    assert "range of X: 0 to 0; allowed: two ends that differ" in " ".join(said.split())


def test_the_page_says_what_the_standard_says(diagnosed):
    section = section_of_points(diagnosed, diagnosed.at_rest[0])
    assert answer_of(diagnosed)["verdict"] == "identified" and section["by_itself"][0] == "from the means"
    rows = {row[0]: row[-1] for row in section["located"]}
    assert float(rows["backlash.X"]) == pytest.approx(6.0, abs=0.3)
    assert float(rows["scale_error.X"]) == pytest.approx(60.0, abs=2.0)
    figures = {name: float(measured) for name, measured, _ in section["tests"][0]["figures"]}
    assert figures["B_mean_um"] == pytest.approx(-6.0, abs=0.3) and figures["A_um"] > figures["E_um"] > 20.0


def test_what_stands_still_is_not_simulated(worn, tmp_path):
    said = " ".join(run("simulate", worn, "--out", tmp_path / "sim", code=1).split())
    assert "no test in motion, so nothing to simulate" in said and not (tmp_path / "sim").exists()


def test_commands_of_the_ball_bar_say_that_they_need_one(worn):
    for command in (("explain", worn, "scale_error.X"), ("add", worn, "scale_error.X")):
        assert "no ball-bar test was measured" in " ".join(run(*command, code=1).split())


@pytest.mark.parametrize(
    ("instrument", "test", "names"),
    [
        ("compensated = true", "", ["EXX_zero_um", "gain_ppm"]),
        ("", "", ["EXX_zero_um", "gain_ppm", "EXX_expansion_ppm"]),
        ("", "dead_path_mm = 500.0", ["EXX_zero_um", "gain_ppm", "EXX_expansion_ppm", "EXX_dead_path_um_per_h"]),
        ("", 'component = "EYX"', ["EYX_zero_um", "EYX_slope_urad"]),
        ("", 'component = "EBX"', ["EBX_zero_urad"]),
    ],
)
def test_what_the_set_up_does(worn, tmp_path, instrument, test, names):
    (tmp_path / "machine.toml").write_bytes((worn / "machine.toml").read_bytes())
    unit = "urad" if "EBX" in test else "um"
    rows = [f"{x},{x},{100 * k + x / 10}" for k in range(2) for x in (0.0, 10.0, 20.0)]
    (tmp_path / "t.csv").write_text("\n".join([f"target_mm,deviation_{unit},time_s", *rows]))
    keys = f'name = "p"\nkind = "positions"\naxis = "X"\ntrace = "t.csv"\n{test}\n'
    table = f'name = "x"\n[instrument]\nkind = "positions"\n{instrument}\n[[test]]\n{keys}'
    (tmp_path / "campaign.toml").write_text(table)
    campaign, _ = read(tmp_path)
    found = INSTRUMENTS["positions"].nuisances_of(campaign.tests[0], campaign.traces["p"], None, campaign.instrument)
    assert list(found.names) == names
    if "dead_path" in names[-1]:  # 500 mm of air drift by 0.465 µm an hour and kelvin
        assert found.spread[-1] == pytest.approx(0.465)
        assert found.columns[:, 0, -1].max() == pytest.approx(102e-6 / 3600)


def test_a_temperature_tells_the_expansion(worn, tmp_path):
    """An axis that warms by 8 K while it is measured grows: with the temperature that is no scale error."""
    (tmp_path / "machine.toml").write_bytes((worn / "machine.toml").read_bytes())
    rows = []
    rng = np.random.default_rng(1)
    for run_number, warm in enumerate(np.linspace(0.0, 8.0, 5), start=1):
        for direction, places in ((1, np.linspace(0, 300, 7)), (-1, np.linspace(300, 0, 7))):
            off = places * 1e3 * 11e-6 * warm + rng.normal(0.0, 0.2, 7)
            rows += [f"{x:.3f},{run_number},{direction},{d:.4f},{20 + warm}" for x, d in zip(places, off, strict=True)]
    (tmp_path / "t.csv").write_text("\n".join(["target_mm,run,direction,deviation_um,temperature_degC", *rows]))
    keys = '[[test]]\nname = "p"\nkind = "positions"\naxis = "X"\ntrace = "t.csv"\n'
    (tmp_path / "campaign.toml").write_text(f'name = "x"\n[instrument]\nkind = "positions"\n{keys}')
    part = compare_plainly(*read(tmp_path))
    assert part.tests[0].set_up["EXX_expansion_ppm_per_K"] == pytest.approx(11.0, abs=0.3)
    assert abs(part.tests[0].set_up["gain_ppm"]) < 2.0 and part.rms < 0.5 * UM


def test_beside_a_probed_sphere(tmp_path):
    """Probe and laser are one problem: the scale of X, of which the probe sees little, comes from the laser, and the
    location errors from the probe.
    """
    import tomlkit

    from tests.independent import sphere

    errors = sphere.draw(np.random.default_rng(3))
    sphere.write(tmp_path, 3, errors)
    probed = tomlkit.parse((tmp_path / "campaign.toml").read_text()).unwrap()
    line = {"scale": errors["scale"], "play": {}, "waves": {"X": [(0.010, *errors["waves"]["X"][0][1:])]}}
    positions.write(tmp_path / "laser", 3, line, [LINE])
    laser = tomlkit.parse((tmp_path / "laser" / "campaign.toml").read_text()).unwrap()
    (tmp_path / "laser" / "traces" / "laser-x.csv").rename(tmp_path / "traces" / "laser-x.csv")
    both = {"name": "both", "instrument": {"probe": probed["instrument"], "laser": laser["instrument"]}}
    (tmp_path / "campaign.toml").write_text(tomlkit.dumps(both | {"test": [*probed["test"], *laser["test"]]}))
    problem = RestProblem.of(read(tmp_path)[0])
    machine = read(tmp_path)[1]
    fit = RestFitter(problem, machine).fit(
        [c.free for c in expected_effects(machine) if problem.shows(machine, c.free)]
    )
    blocks = {b.name: b.labels for b in problem.nuisances.blocks}
    assert "sphere_x_um" in blocks["set-up points"] and blocks["set-up laser-x"] == ("EXX_zero_um",)
    assert blocks["laser or level"] == ("gain_ppm",) and "probe_x_um" in blocks["touch probe"]
    of = {f.effect.id: f for f in fit.effects}
    for name, true, known in (
        ("scale_error.X", errors["scale"]["X"] / 1e-6, 2.0),
        ("axis_location.EY0C", errors["location"]["EY0C"] / UM, 1.0),
    ):
        f = of[name]
        (scale,) = (spec.scale for spec in f.specs.values())
        spread = np.sqrt(fit.covariance_of(f)[0, 0]) * scale
        assert spread < known and abs(f.vector[0] * scale - true) < 3.0 * spread
