"""A sphere in motion: closed forms of its three readings, recordings of the independent generator from reading to
diagnosis, mistakes, programs, plans.
"""

import json

import numpy as np
import pytest
import tomlkit
from commands import printed as run
from commands import read

import mjsim
from mjsim.commands.compare import compare
from mjsim.errors import InputError
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import trusted_problem
from mjsim.inference.nuisance import NEST_ANGLE, NEST_GAIN, SPHERE, set_up_columns
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import Geometry, rotation, sensitivity
from mjsim.machine.kinematics import reading as reference
from mjsim.machine.model import build
from mjsim.nc.read import read_nc
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.bar import reading_in
from mjsim.simulation.multibody import simulate
from mjsim.units import UM
from tests.independent import r_test

#: Sphere in the work frame, mm.
BALL = [110.0, 20.0, 90.0]


def moves():
    """C and A there and back, and A slowly: what is late at any speed is not what is late by a time."""
    place = {"kind": "r_test", "sphere_mm": BALL, "setup": "sphere"}
    rows = (
        ("c-ccw", "C", 0.0, 200.0, 4000.0),
        ("c-cw", "C", 200.0, 0.0, 4000.0),
        ("a-up", "A", -50.0, 30.0, 4000.0),
        ("a-down", "A", 30.0, -50.0, 4000.0),
        ("a-slow", "A", -50.0, 30.0, 1500.0),
    )
    return [
        {"name": n, "trace": f"traces/{n}.csv", **place, "axis": a, "from_deg": i, "to_deg": j, "feed_mm_min": f}
        | {"started_s": 60.0 * k}
        for k, (n, a, i, j, f) in enumerate(rows)
    ]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A machine without a fault."""
    path = tmp_path_factory.mktemp("sound")
    r_test.write(path, 5, tests=moves())
    return path


@pytest.fixture
def readings(sound):
    """The planned readings of the same tests, by name."""
    return {t.name: t for t in mjsim.read_campaign(sound, traces=False).tests}


def shown(readings, name, geometry, count=200):
    """Angle of the axis (n,) rad, and the three coordinates (n, 3) µm of an R-test on axes without any error."""
    one = readings[f"{name}.dx"]
    phi = np.linspace(*Program(one).ends, count)
    q = Program(one).path(phi)
    return phi, np.column_stack([reading_in(readings[f"{name}.d{c}"], q, geometry) for c in "xyz"]) / UM


def test_the_tool_centre_follows_the_sphere(readings):
    for name in ("c-ccw", "a-up"):
        assert np.abs(shown(readings, name, Geometry())[1]).max() < 1e-6


def test_a_location_error_is_a_harmonic(readings):
    """C's centre line off by 40 µm in Y: constant while C turns, once per turn of A while A turns; C tilted about X:
    once per turn of C in Z, of the sphere's radius.
    """
    _, d = shown(readings, "c-ccw", Geometry({"EY0C": 40e-6}, {}))
    np.testing.assert_allclose(d, np.tile([0.0, 40.0, 0.0], (len(d), 1)), atol=1e-6)
    a, d = shown(readings, "a-up", Geometry({"EY0C": 40e-6}, {}))
    np.testing.assert_allclose(d, np.column_stack([0 * a, 40 * np.cos(a), 40 * np.sin(a)]), atol=1e-6)
    c, d = shown(readings, "c-ccw", Geometry({"EA0C": 20e-6}, {}))
    y = 0.110 * np.sin(c) + 0.020 * np.cos(c)
    np.testing.assert_allclose(d, np.column_stack([0 * c, -20 * 0.090 + 0 * c, 20 * y]), atol=1e-3)


def test_compiled_and_written_out_readings_agree(readings):
    rng = np.random.default_rng(3)
    geometry = Geometry({"EY0C": 30e-6, "EB0A": 50e-6}, {"XY": 40e-6})
    for t in list(readings.values())[:3]:
        q = Program(t).path(np.linspace(*Program(t).ends, 50)) + 1e-5 * rng.standard_normal((50, 5))
        want = reference(t.chain, q, np.array(t.table_ball), 0.0, geometry, t.component)
        np.testing.assert_allclose(reading_in(t, q, geometry), want, atol=1e-15)
        slope = sensitivity(t.chain, q, np.array(t.table_ball), t.component).axes
        for i in range(5):
            h = 1e-6 * np.eye(5)[i]
            number = (reading_in(t, q + h, Geometry()) - reading_in(t, q - h, Geometry())) / 2e-6
            np.testing.assert_allclose(slope[:, i], number, atol=1e-6)


def test_set_up_is_linear(readings):
    """Sphere off its place, and a nest that is turned and has gains: the columns say what rotation and scale do."""
    one = readings["c-ccw.dy"]
    phi = np.linspace(*Program(one).ends, 50)
    q = Program(one).path(phi)
    away = 50e-6 * np.column_stack([np.cos(phi), np.sin(2 * phi), np.cos(3 * phi)])
    columns = set_up_columns(one, sensitivity(one.chain, q, np.array(one.table_ball), "Y"), away)
    moved = np.array(one.table_ball) + np.array([1e-4, -2e-4, 3e-4])
    want = reference(FIVE_AXIS, q, moved, 0.0, Geometry(), "Y")
    np.testing.assert_allclose(columns[:, :3] @ np.array([1e-4, -2e-4, 3e-4]) / SPHERE, want, atol=1e-12)
    turned = away @ rotation(0, 1e-4).T - away
    np.testing.assert_allclose(columns[:, 6] * 1e-4 / NEST_ANGLE, turned[:, 1], atol=1e-12)
    np.testing.assert_allclose(columns[:, 10] * 1e-2 / NEST_GAIN, 1e-2 * away[:, 1], atol=1e-12)
    assert not columns[:, [9, 11]].any()


def test_multibody_shows_the_same(sound, readings):
    machine = mjsim.read_machine(sound / "machine.toml").with_effect(
        mjsim.make_effect("axis_location.EY0C", value_um=30.0)
    )
    tests = [t for t in readings.values() if t.recording == "a-up"]
    for s in simulate(machine, tests):
        alone = AxesMotion(s.test).reading(build(machine))
        assert np.abs(alone - s.deviation).max() < 1e-10


def test_the_independent_generator_sees_the_same(sound):
    """A machine without a fault against its own model: little is left beside the noise; its drives have tolerances."""
    campaign, machine = read(sound)
    part = compare(campaign, machine, 1).parts[0]
    assert {t.test.name: t.rms / UM < 0.8 for t in part.tests} == {t.name: True for t in campaign.tests}
    said = part.to_json()
    assert said["noise_um"] == pytest.approx(0.2, abs=0.05)
    assert set(said["nest"]) == {f"angle_{c}_mrad" for c in "xyz"} | {f"gain_{c}_percent" for c in "xyz"}
    for t in said["tests"]:
        ranges = t["iso10791_6"]
        assert ranges["measured"]["range_um"] == pytest.approx(ranges["simulated"]["range_um"], abs=2.5)


def test_a_sound_machine_is_sound(sound):
    found = mjsim.diagnose(*read(sound), threads=1)
    assert found.verdict == "nothing_found" and not found.effects


def test_planted_faults_are_found(tmp_path):
    """A rotary axis off its place and play of another one: geometry and dynamics from one motion."""
    r_test.write(
        tmp_path,
        6,
        [{"id": "axis_location.EY0C", "value_um": 40.0}, {"id": "backlash.A", "width_deg": 0.006}],
        tests=moves(),
    )
    found = {e.effect.id: e for e in mjsim.diagnose(*read(tmp_path), threads=1).effects}
    assert set(found) == {"axis_location.EY0C", "backlash.A"}
    for name, key, truth in (("axis_location.EY0C", "value_um", 40.0), ("backlash.A", "width_deg", 0.006)):
        low, high = found[name].ci95[key]
        assert low < truth < high and abs(found[name].effect.values[key] / truth - 1.0) < 0.15, name


@pytest.fixture
def spoiled(sound, tmp_path):
    """Writes the campaign with changed traces and gives its folder."""

    def write(change):
        (tmp_path / "traces").mkdir()
        for name in ("campaign.toml", "machine.toml"):
            (tmp_path / name).write_bytes((sound / name).read_bytes())
        for file in (sound / "traces").iterdir():
            head, *rows = file.read_text().splitlines()
            table = change(np.array([[float(v) for v in r.split(",")] for r in rows]))
            lines = [head, *(",".join(f"{v:.4f}" for v in row) for row in table), ""]
            (tmp_path / "traces" / file.name).write_text("\n".join(lines))
        return tmp_path

    return write


@pytest.mark.parametrize(
    "change, said",
    [
        (lambda t: t[:, [0, 2, 1, 3]] * [1, 1, -1, 1], "correct the columns"),
        (lambda t: t * [1, 1, 1, -1], "correct the columns"),
        (lambda t: t * [1e3, 1, 1, 1], "time_s is in ms"),
        (lambda t: t * [1, 1e-3, 1e-3, 1e-3], "write them in µm"),
    ],
)
def test_mistakes_are_named(spoiled, change, said):
    folder = spoiled(change)
    found = json.loads(run("check", str(folder), "--json"))["mistakes"]
    assert found and all(said in m["sentence"] for m in found), found


def test_wrong_tables_are_named(sound, tmp_path):
    raw = tomlkit.parse((sound / "campaign.toml").read_text()).unwrap()
    (tmp_path / "machine.toml").write_bytes((sound / "machine.toml").read_bytes())
    for change, said in (
        ({"axis": "B"}, "allowed: 'A' or 'C'"),
        ({"sphere_mm": [0.0, 0.0, 90.0]}, "sphere_mm = .* lies on the C axis"),
        ({"second_from_deg": 0.0}, "second_to_deg is missing"),
    ):
        first = {k: v for k, v in raw["test"][0].items() if k != "trace"}
        (tmp_path / "campaign.toml").write_text(tomlkit.dumps(raw | {"test": [first | change]}))
        with pytest.raises(InputError, match=said):
            mjsim.read_campaign(tmp_path)


def test_a_program_is_written_and_a_table_is_imported(sound, tmp_path):
    program = tmp_path / "c.nc"
    run("nc", str(sound), "--test", "c-ccw", "-o", str(program), "--dialect", "siemens")
    q = read_nc(program, "siemens").motion.axes
    want = Program(mjsim.read_campaign(sound, traces=False).tests[0]).path(q[:, 4])
    np.testing.assert_allclose(q, want, atol=1e-6)
    assert "R-test c-ccw" in program.read_text()

    raw = tomlkit.parse((sound / "campaign.toml").read_text()).unwrap()
    (tmp_path / "machine.toml").write_bytes((sound / "machine.toml").read_bytes())
    first = {k: v for k, v in raw["test"][0].items() if k != "trace"}
    (tmp_path / "campaign.toml").write_text(tomlkit.dumps(raw | {"test": [first]}))
    text = (
        (sound / "traces" / "c-ccw.csv")
        .read_text()
        .replace("time_s,dx_um,dy_um,dz_um", "t [s];ΔX [µm];ΔY [µm];ΔZ [µm]")
    )
    (tmp_path / "other.csv").write_text(text.replace(",", ";"))
    run("import", str(tmp_path / "other.csv"), "--campaign", str(tmp_path), "--points", "--test", "c-ccw")
    a, b = (mjsim.read_campaign(f).traces["c-ccw.dy"] for f in (sound, tmp_path))
    np.testing.assert_allclose(a.deviation, b.deviation, atol=1e-12)

    # recorded from the start of the program to its end, before and after the measured part too
    head, *rows = text.replace(",", ";").splitlines()
    end = Program(mjsim.read_campaign(sound, traces=False).tests[0]).duration
    whole = [f"0.0000;{rows[0].partition(';')[2]}", *rows, f"{end:.4f};{rows[-1].partition(';')[2]}"]
    (tmp_path / "whole.csv").write_text("\n".join([head, *whole, ""]))
    said = run(
        "import", str(tmp_path / "whole.csv"), "--campaign", str(tmp_path), "--points", "--test", "c-ccw", "--force"
    )
    assert "2 samples are left out: they lie before or after the measured part" in " ".join(said.split())
    b = mjsim.read_campaign(tmp_path).traces["c-ccw.dy"]
    np.testing.assert_allclose(a.deviation, b.deviation, atol=1e-12)


def test_a_plan_of_motions(sound):
    said = json.loads(
        run(
            "plan",
            "--new",
            "--machine",
            str(sound / "machine.toml"),
            "--instrument",
            "r_test",
            "--minutes",
            "15",
            "--json",
        )
    )
    assert {t["kind"] for t in said["tests"]} == {"r_test"}
    assert {t["axis"] for t in said["tests"]} == {"A", "C"}
    assert "axis_location.EB0C" in said["told"] and said["minutes"] <= 15
    turned = {t["name"] for t in said["tests"] if t.get("spindle_deg") == 180.0}
    assert turned and turned == {t["name"] for t in said["tests"] if t["name"].endswith("-spindle180")}
    assert "axis_location.EY0A" not in said["hidden"]  # it stands still as the place of the nest does


def test_sweeps_and_simulations_run_it(sound, tmp_path):
    """One coordinate of one recording, or all three; the reading of a sweep is that of the command ``simulate``."""
    said = json.loads(
        run("simulate", str(sound), "--test", "a-up", "--out", str(tmp_path / "s"), "--no-plots", "--json")
    )
    rows = {r["name"]: r for r in said["tests"]}
    assert set(rows) == {"a-up.dx", "a-up.dy", "a-up.dz"}
    sweep = {"name": "both", "campaign": "c", "tests": ["a-up.dy", "c-cw"], "design": "grid"}
    vary = {"parameter": "feed_mm_min", "values": [4000.0, 2000.0]}
    (tmp_path / "c").symlink_to(sound)
    (tmp_path / "sweep.toml").write_text(tomlkit.dumps(sweep | {"vary": [vary]}))
    table = mjsim.run_batch(tmp_path / "sweep.toml", tmp_path / "out").to_dataframe()
    assert set(table["test"]) == {"a-up.dy", "c-cw.dx", "c-cw.dy", "c-cw.dz"} and table["error"].isna().all()
    assert table["circular_error_um"].isna().all()  # a coordinate is no circle
    (own,) = table[(table["test"] == "a-up.dy") & (table["feed_mm_min"] == 4000.0)]["max_um"]
    assert own == pytest.approx(rows["a-up.dy"]["max_um"], abs=1e-3)
    vary["parameter"] = "table_ball_mm.x"
    (tmp_path / "sweep.toml").write_text(tomlkit.dumps(sweep | {"vary": [vary]}))
    with pytest.raises(InputError, match="has no table_ball_mm"):
        mjsim.run_batch(tmp_path / "sweep.toml", tmp_path / "out2")


def test_one_turn_twice_tells_the_noise(tmp_path):
    place = {"kind": "r_test", "sphere_mm": BALL, "setup": "s", "feed_mm_min": 6000.0, "started_s": 0.0}
    twice = {"name": "c", "trace": "traces/c.csv", **place, "axis": "C", "from_deg": 0.0, "to_deg": 720.0}
    r_test.write(tmp_path, 3, tests=[twice], noise_um=0.4)
    part = compare(*read(tmp_path), 1).parts[0]
    assert "two revolutions" in part.noise_source and part.noise / UM == pytest.approx(0.4, rel=0.2)


def test_beside_a_ball_bar(tmp_path):
    """One problem with readings of both, each with its own noise; what both see is of one machine."""
    circle = {"name": "circle", "kind": "circular", "plane": "XY", "direction": "CCW", "revolutions": 2}
    circle |= {"table_ball_mm": [0.0, 0.0, 155.0], "bar_length_mm": 100.0, "feed_mm_min": 4000.0}
    circle |= {"trace": "traces/circle.csv", "setup": "centre", "started_s": 400.0}
    r_test.write_with_bar(tmp_path, 6, [circle], [{"id": "squareness.XY", "angle_urad": 60.0}], moves()[:2])
    campaign, machine = read(tmp_path)
    assert [p.instrument for p in compare(campaign, machine, 1).parts] == ["ball_bar", "r_test"]
    problem = trusted_problem(campaign.in_motion, machine, 1)
    noise = {name: n.rms / UM for name, n in problem.noises.items()}
    assert noise["ball_bar"] == pytest.approx(0.12, rel=0.3) and noise["r_test"] == pytest.approx(0.2)
    off = EffectVector(mjsim.make_effect("squareness.XY", angle_urad=1.0), ("angle_urad",))
    fit = Fitter(problem, machine).fit([off], exact=False)
    assert fit.effects[0].effect.values["angle_urad"] == pytest.approx(60.0, abs=2.0)
