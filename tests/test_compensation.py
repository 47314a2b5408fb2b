"""Corrections for controls: what is written is what was found, back to the last digit, and does what is forecast."""

import json
from dataclasses import replace

import numpy as np
import pytest
import tomlkit
from commands import as_json, ok, run
from independent import controls as reader
from independent import drives as generator_drives
from independent import layouts
from independent import machines as generator_machines
from independent import programs as generator_programs
from independent import simulate as generator_simulate

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.saved import Known, SavedDiagnosis
from mjsim.compensation.arithmetic import Arithmetic, corrected, directions, ramped, sticks
from mjsim.compensation.compensate import compensate, write_compensation
from mjsim.compensation.controls import CONTROLS, Settings, control
from mjsim.compensation.forecast import forecast
from mjsim.compensation.tables import Corrections, Grid, Pulse, sampled, tuned, wanted_of, worth_typing
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.posterior import Posterior
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.units import DEG, MM, UM

RANGES = {"X": (-0.11, 0.13), "Y": (-0.12, 0.1), "Z": (0.05, 0.26), "A": (-5 * DEG, 40 * DEG), "C": (-0.2, 2.1 * np.pi)}


def effect(name, **values):
    return registry.make(name, FIVE_AXIS, **values)


#: Something of every form that a control may take.
EFFECTS = (
    effect("backlash.A", width_deg=0.0021234),
    effect("backlash.X", width_um=1.7321),
    effect("pitch_error.A", components=[[60.0, 0.0011, 33.0]]),
    effect("pitch_error.C", components=[[3.0, 0.0014, -70.0]]),
    effect("pitch_error.C", components=[[2.0, 0.0007, 10.0]], direction="CW"),
    effect("pitch_error.Y", components=[[1.0, 0.9, 120.0]]),
    effect("worm_wear.A", depth_deg=0.002, centre_deg=20.0, width_deg=4.0),
    effect("scale_error.X", ppm=31.0),
    effect("squareness.XY", angle_urad=22.0),
    effect("straightness.EZX", quadratic_um=3.0, cubic_um=-1.2),
    effect("axis_location.EX0C", value_um=7.3),
    effect("axis_location.EY0C", value_um=-4.1),
    effect("axis_location.EY0A", value_um=3.3),
    effect("axis_location.EZ0A", value_um=-6.2),
    effect("axis_location.EA0C", value_urad=21.0),
    effect("axis_location.EB0A", value_urad=-14.0),
    effect("servo_gain.X", ratio=0.97),
)


@pytest.fixture(scope="module")
def machine():
    m = read_machine(examples() / "hidden-backlash" / "machine.toml")
    for e in EFFECTS:
        m = m.with_effect(e)
    return m


@pytest.fixture(scope="module")
def tests():
    c = read_campaign(examples() / "hidden-backlash", traces=False)
    return {t.name: t for t in c.tests}


def saved(machine, known):
    return SavedDiagnosis("identified", machine, tuple(known), Posterior((), np.zeros((0, 0))), "", 0.1 * UM)


@pytest.fixture(scope="module", params=list(CONTROLS))
def told(request, machine, tmp_path_factory):
    """Control, corrections, and what the independent reader makes of its files."""
    who = control(request.param)
    wanted, left = wanted_of(machine, list(EFFECTS))
    assert not left
    corrections = who.corrections(wanted, RANGES)
    folder = tmp_path_factory.mktemp(request.param)
    for name, text in who.files(corrections).items():
        (folder / name).write_text(text)
    return who, corrections, reader.READERS[request.param](folder), folder


def test_files_give_every_number_back(told):
    _, c, got, _ = told
    assert set(got.backlash) == set(c.backlash)
    for a, width in c.backlash.items():
        assert got.backlash[a] * reader.UNIT[a] == pytest.approx(width, rel=1e-12)
    assert {(t.out, t.source) for t in got.tables} == {(t.out, t.source) for t in c.tables}
    for t in got.tables:
        mine = c.table(t.out, t.source)
        assert mine is not None and mine.modulo == t.modulo
        assert t.x * reader.UNIT[t.source] == pytest.approx(mine.positions, abs=1e-9)
        for a, b in ((t.forward, mine.forward), (t.reverse, mine.reverse)):
            assert a * reader.UNIT[t.out] == pytest.approx(b, abs=1e-13)
    assert {k for k, v in got.location.items() if abs(v) > 1e-6} == set(c.kinematics)
    for name, value in c.kinematics.items():
        size = MM if name[1] in "XYZ" else UM
        assert got.location[name] * size == pytest.approx(value, abs=1.1e-8 if size == UM else 1e-12)
    for a, gain in c.gains.items():
        assert got.gain[a] == pytest.approx(gain, abs=0.006)


def test_what_is_told_and_what_is_left_is_everything(told):
    who, c, _, _ = told
    done = {k for t in c.tables for k in t.keys} | {f"axis_location.{n}" for n in c.kinematics}
    done |= {f"backlash.{a}" for a in c.backlash} | {f"servo_gain.{a}" for a in c.gains}
    if who.name == "linuxcnc":  # its tables hold the play of their axes
        done |= {f"backlash.{t.out}" for t in c.tables}
    missing = {e.key for e in EFFECTS} - done - {x.key for x in c.left}
    assert not missing


def test_both_arithmetics_agree(told, tests):
    """The control's arithmetic of mjsim against the independent one, on a cone."""
    from mjsim.instruments.ball_bar.program import Program

    who, c, got, _ = told
    program = Program(tests["cone15-x50-ccw"])
    given = program.commands(np.arange(0.0, 30.0, 1e-3))
    how = replace(who.arithmetic(FIVE_AXIS), ramp=None)
    mine, other = corrected(given, c, how, 1e-3), reader.commands(got, given)
    assert np.abs(mine - other).max() < 5e-9
    assert np.abs(mine - given).max() > 1e-6


def test_the_forecast_of_a_control_without_limits_is_a_perfect_repair(machine, tests):
    who = control("sinumerik")
    wanted, _ = wanted_of(machine, list(EFFECTS))
    c = who.corrections(wanted, RANGES)
    sound = machine
    for e in EFFECTS:
        sound = sound.without(e.key)
    some = [tests["cone15-x50-ccw"], tests["circle-xy-ccw"]]
    f = forecast(machine, sound, some, c, who.arithmetic(FIVE_AXIS), threads=1)
    before, after, perfect = f.rms()
    assert f.gone is not None and f.gone > 0.97, (before, after, perfect)


@pytest.mark.parametrize("told", ["linuxcnc"], indirect=True)
def test_limits_of_linuxcnc(told, machine):
    who, c, _, folder = told
    for t in c.tables:
        assert len(t.positions) <= 256 and (np.diff(t.positions) > 0).all()
        text = (folder / f"comp-{t.out.lower()}.txt").read_text()
        assert all(len(line.split()) == 3 for line in text.removesuffix("\n").split("\n"))
    reasons = {x.key: x.reason for x in c.left}
    assert "no table of one axis by another" in reasons["squareness.XY"]
    assert "direction of an axis" in reasons["axis_location.EA0C"]
    fast, _ = wanted_of(machine, [effect("pitch_error.C", components=[[180.0, 0.001, 0.0]])])
    c = who.corrections(fast, RANGES)
    assert not c.tables and "too short for the table" in c.left[0].reason


def test_table_of_a_wave_is_the_wave_with_the_other_sign():
    wanted, _ = wanted_of(
        read_machine(examples() / "hidden-backlash" / "machine.toml"),
        [effect("pitch_error.C", components=[[3.0, 0.0014, -70.0]])],
    )
    table, left = sampled(FIVE_AXIS, wanted.terms, (0.0, 1.0), Grid(1000))
    assert table is not None and not left and table.modulo
    assert table.positions[-1] == pytest.approx(2 * np.pi)
    expected = -0.0014 * DEG * np.sin(3.0 * table.positions - 70.0 * DEG)
    assert table.forward == pytest.approx(expected, abs=0.6e-6 * DEG)


def test_ramp_reaches_what_is_wanted_and_sticks_where_linuxcnc_does():
    a, cycle = 5.0, 1e-3
    for size in np.array([0.1, 0.24, 0.3, 0.49, 0.51, 3.0, 40.0]) * a * cycle**2:
        wanted = np.concatenate([np.zeros(5), np.full(500, size)])
        done = ramped(wanted, a, 0.3, cycle)
        assert (abs(done[-1] - size) < 1e-12) == (not sticks(size, a)), size / (a * cycle**2)
        assert np.abs(np.diff(done)).max() <= max(0.15 * cycle, size) + 1e-15


def test_direction_is_that_of_the_last_motion():
    assert directions(np.array([0.0, 0.0, 1.0, 1.0, 0.5, 0.5, 2.0])).tolist() == [0, 0, 1, 1, -1, -1, 1]


# -- what is worth typing ----------------------------------------------------------------------------------------------


def test_sizes_below_their_uncertainty_and_ambiguous_effects_are_left(machine):
    known = [
        Known(effect("backlash.A", width_deg=0.002), {"width_deg": [0.0019, 0.0021]}, "found"),
        Known(effect("backlash.X", width_um=0.3), {"width_um": [-0.2, 0.8]}, "calibrated"),
        Known(effect("squareness.XY", angle_urad=20.0), {"angle_urad": [15.0, 25.0]}, "found", ("scale_error.X",)),
        Known(effect("scale_error.Y", ppm=9.0), {"ppm": [5.0, 13.0]}, "calibrated", (), False),
        Known(
            effect("pitch_error.C", components=[[72.0, 0.001, 0.0], [144.0, 0.0001, 0.0]]),
            {"components": [[[72.0, 0.0009, 0.0], [144.0, 0.0, 0.0]], [[72.0, 0.0011, 0.0], [144.0, 0.0003, 0.0]]]},
            "found",
        ),
        Known(effect("scale_error.X", ppm=12.0), {}, "stated"),
        Known(effect("friction.X", coulomb_Nm=2.0), {"coulomb_Nm": [1.9, 2.1]}, "found"),
    ]
    worth, left = worth_typing(saved(machine, known))
    assert [w.effect.key for w in worth] == ["backlash.A", "pitch_error.C", "scale_error.X"]
    assert worth[1].effect.values["components"] == [[72.0, 0.001, 0.0]]
    reasons = {x.key: x.reason for x in left}
    assert set(reasons) == {"backlash.X", "squareness.XY", "scale_error.Y", "pitch_error.C", "friction.X"}
    assert reasons["backlash.X"] == "not worth typing: width_um is 0.30 ± 0.50 µm, smaller than its own uncertainty"
    assert "ambiguous: the data cannot tell it from scale_error.X" in reasons["squareness.XY"]
    assert "not observable" in reasons["scale_error.Y"]


def test_component_errors_go_to_controls_that_know_the_arm(machine):
    """A table that wobbles and a slide that turns: KinematicsComp of HEIDENHAIN takes them, others do not."""
    hidden = [
        effect("radial_error_motion.C", amplitude_um=2.0, order=2.0),
        effect("angular_error.EBX", linear_urad=20.0, quadratic_urad=5.0),
    ]
    wanted, left = wanted_of(machine, hidden)
    assert not left and {t.out for t in wanted.terms} == {"EXC", "EYC", "EBX"}
    ranges = {a: (-0.2, 0.2) for a in FIVE_AXIS.linear} | {"A": (-1.0, 1.0), "C": (0.0, 6.0)}
    made = control("heidenhain").corrections(wanted, ranges)
    assert not made.left and {t.out for t in made.tables} == {"EXC", "EYC", "EBX"}
    text = control("heidenhain").files(made)["kinematicscomp.txt"]
    head, *rows, end = next(p for p in text.split("BEGIN ") if p.startswith("X.COM")).splitlines()[1:]
    assert head.split() == ["NR", "AXISPOS", "C5_EBX"] and end == "[END]"
    x, error = np.array([r.split()[1:] for r in rows], float).T
    want = np.degrees(20e-6 * x / 100.0 + 5e-6 * (x / 100.0) ** 2)
    np.testing.assert_allclose(error, want, atol=1.5e-6)
    for name in ("linuxcnc", "sinumerik", "fanuc"):
        others = control(name).corrections(wanted, ranges)
        assert not others.tables and {x.key for x in others.left} == {e.key for e in hidden}


def test_nothing_to_correct_is_said(machine, tests):
    f = forecast(machine, machine, [tests["circle-xy-ccw"]], Corrections(FIVE_AXIS), Arithmetic(), threads=1)
    assert f.gone is None and f.rms()[0] == f.rms()[1] == f.rms()[2]


# -- the command -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    from test_cli import cut

    return cut(tmp_path_factory.mktemp("compensate") / "short")


def test_the_command_uses_the_kept_diagnosis(campaign, tmp_path):
    said = as_json("diagnose", campaign, "--json")
    kept = json.loads((campaign / ".mjsim" / "diagnosis.json").read_text())
    assert kept["verdict"] == said["verdict"] == "identified"
    data = as_json("compensate", campaign, "--control", "linuxcnc", "-o", tmp_path / "out", "--json")
    assert [row["id"] for row in data["corrects"]] == ["backlash.A"]
    width = reader.read_linuxcnc(tmp_path / "out").backlash
    assert width["A"] == pytest.approx(0.002, rel=0.02) and set(width) == {"A"}
    f = data["forecast"]
    assert f["rms_after_um"] < 1.1 * f["rms_perfect_um"] < f["rms_before_um"]
    text = (tmp_path / "out" / "corrections.txt").read_text()
    assert "backlash.A" in text and "±" in text and "Left:" in text
    assert (tmp_path / "out" / "forecast.png").read_bytes()[:4] == b"\x89PNG"
    again = run("compensate", campaign, "--control", "linuxcnc", "-o", tmp_path / "out")
    assert again.exit_code == 1 and "exists already" in again.stderr
    shown = ok("compensate", campaign, "--control", "csv", "-o", tmp_path / "csv").stdout
    assert "backlash.A" in shown and "perfect µm" in shown


def test_from_python_and_wrong_arguments(campaign, tmp_path):
    c = read_campaign(campaign)
    m = read_machine(c.machine_file)
    found = m.with_effect(effect("backlash.A", width_deg=0.002))
    known = [Known(effect("backlash.A", width_deg=0.002), {"width_deg": [0.0019, 0.0021]}, "found")]
    result = compensate(c, m, "fanuc", Settings(detection_unit=1e-3), saved=saved(found, known), threads=1)
    assert result.corrections.backlash == {"A": pytest.approx(0.002 * DEG)}
    assert "N01851A4P2" in result.files["parameters.txt"]
    assert {p.name for p in write_compensation(result, tmp_path)} == {"corrections.txt", "parameters.txt"}
    coarse = compensate(c, m, "fanuc", Settings(detection_unit=0.01), saved=saved(found, known), threads=1)
    assert coarse.corrections.empty and "last digit" in coarse.corrections.left[0].reason
    with pytest.raises(InputError, match="unknown control"):
        compensate(c, m, "mazak")
    with pytest.raises(InputError, match="57 to 0 °; allowed: the lower end first"):
        compensate(c, m, "csv", ranges={"A": (57.0 * DEG, 0.0)}, saved=saved(found, known))
    bad = run("compensate", campaign, "--control", "csv", "-o", tmp_path / "x", "--range", "Q", "0", "1")
    assert bad.exit_code == 1 and "allowed: X, Y, Z, A, C" in bad.stderr


# -- friction ----------------------------------------------------------------------------------------------------------


def test_the_friction_pulse_calms_the_independent_drive(tmp_path):
    """Numbers tuned on the model, read from the file, given to the generator's drive: what friction does goes."""
    model = generator_machines.nominal("M1")
    (tmp_path / "machine.toml").write_text(tomlkit.dumps(model))
    (table,) = layouts.arrange([{**layouts.circle("XY", feed=3000.0), "revolutions": 1}])
    head = {"name": "x", "machine": "machine.toml", "test": [table]}
    (tmp_path / "campaign.toml").write_text(tomlkit.dumps(head))
    machine, (test,) = read_machine(tmp_path / "machine.toml"), read_campaign(tmp_path, traces=False).tests
    who = control("sinumerik")
    digit = who.pulse_digit(FIVE_AXIS, "X")
    pulse = tuned(machine, "X", [test], digit)
    assert pulse is not None and pulse.removes > 0.5 and tuned(machine, "A", [test]) is None
    (folder := tmp_path / "files").mkdir()
    for name, text in who.files(Corrections(FIVE_AXIS, pulses={"X": pulse})).items():
        (folder / name).write_text(text)
    told = reader.READERS["sinumerik"](folder)
    assert told.friction["X"][0] * MM / 60.0 == pytest.approx(pulse.speed, rel=1e-9)
    program = generator_programs.Program(table)
    time = generator_simulate.grid(program)
    plain = program.commands(time)
    step = time[1] - time[0]
    gain = model["drive"]["X"]["position_gain_per_s"]
    pulsed = plain.copy()
    pulsed[:, 0] += reader.friction_pulses(told, "X", plain[:, 0], gain, step)
    assert np.abs(pulsed - plain)[:, 0].max() == pytest.approx(pulse.speed / gain, rel=0.3)
    effects = generator_machines.by_id(model["effect"])
    free = {k: v for k, v in effects.items() if k != "friction.X"}
    inside = (time > program.window[0]) & (time < program.window[1])

    def motor(commands, present):
        given = type("Given", (), {"commands": staticmethod(lambda t: commands)})
        return generator_drives.run(model["drive"], present, given, time)[0][inside, 0]

    wanted = motor(plain, free)
    before, after = (np.mean((motor(c, effects) - wanted) ** 2) for c in (plain, pulsed))
    assert 1.0 - after / before == pytest.approx(pulse.removes, abs=0.1)


def test_friction_of_controls_without_such_numbers_is_listed(machine):
    for name in ("fanuc", "heidenhain", "linuxcnc"):
        who = control(name)
        assert not who.pulses and "0.4 N·m" in who.friction_advice("X", 0.4)
    neutral = control("csv").files(Corrections(FIVE_AXIS, pulses={"A": Pulse(0.001, 0.02, 45.0)}))
    assert "friction pulse,A,3.437747,deg/min" in neutral["values.csv"]


def test_a_pulse_through_a_feedforward_is_the_same_speed():
    """The position loop turns the offset into the pulse: gain · offset + feedforward · its rate."""
    time = np.arange(0.0, 1.0, 1e-4)
    command = 0.01 * np.sin(2.0 * np.pi * 2.0 * time)
    for ratio in (0.0, 0.4):
        pulse = Pulse(2e-4, 0.02, 45.0, ratio)
        d = pulse.offset(command, 1e-4)
        speed = 45.0 * d + ratio * np.gradient(d, 1e-4)
        start = np.flatnonzero(d)[0]
        at = start + np.array([20, 100, 300])
        assert speed[at] == pytest.approx(-2e-4 * np.exp(-(at - start) * 1e-4 / 0.02), rel=0.03)
