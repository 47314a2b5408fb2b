"""The loop closed with a real control: LinuxCNC runs mjsim's program with what ``compensate`` wrote, its set-points
drive the independent machine, and what is left is held against the forecast.
"""

from dataclasses import replace

import numpy as np
import pytest
from independent import drives, transmission
from independent.kinematics import bar_reading

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.saved import Known, SavedDiagnosis
from mjsim.compensation.arithmetic import corrected
from mjsim.compensation.compensate import compensate, write_compensation
from mjsim.compensation.controls import Settings
from mjsim.effects import registry
from mjsim.inference.posterior import Posterior
from mjsim.instruments.ball_bar.follow import unwrapped
from mjsim.io.resources import examples
from mjsim.linuxcnc.configuration import JOINT_ACCELERATION
from mjsim.linuxcnc.configuration import Settings as LinuxCNC
from mjsim.linuxcnc.run import missing, run_test
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import sensitivity
from mjsim.machine.model import build
from mjsim.nc.write import Options
from mjsim.simulation.axes import load_of
from mjsim.simulation.bar import reading
from mjsim.units import DEG, MM, UM

SCALE = np.array([MM, MM, MM, DEG, DEG])
PLANTED = {
    "backlash.A": {"width_deg": 0.002},
    "pitch_error.A": {"components": [[60.0, 0.001, 30.0]]},
    "backlash.X": {"width_um": 2.0},
}
INTERVALS = {
    "backlash.A": {"width_deg": [0.0019, 0.0021]},
    "pitch_error.A": {"components": [[[60.0, 0.0009, 25.0]], [[60.0, 0.0011, 35.0]]]},
    "backlash.X": {"width_um": [1.9, 2.1]},
}


@pytest.mark.slow
def test_linuxcnc_does_what_is_forecast(tmp_path):
    if what := missing():
        pytest.skip(f"LinuxCNC cannot run here: {what} is missing")
    c = read_campaign(examples() / "hidden-backlash")
    base = next(t for t in c.tests if t.name == "cone15-x50-ccw")
    test = replace(base, revolutions=1, feed=3000.0 * MM / 60.0)
    given = read_machine(c.machine_file)
    machine = given
    for name, values in PLANTED.items():
        machine = machine.with_effect(registry.make(name, FIVE_AXIS, **values))
    known = tuple(Known(machine.effect(n), INTERVALS[n], "found") for n in PLANTED)
    saved = SavedDiagnosis("identified", machine, known, Posterior((), np.zeros((0, 0))), "", 0.1 * UM)
    settings = Settings(
        acceleration={a: JOINT_ACCELERATION * s for a, s in zip("XYZAC", SCALE, strict=True)}, transforms=False
    )
    one = replace(c, tests=(test,), traces={test.name: c.traces[test.name]})
    result = compensate(one, given, "linuxcnc", settings, saved=saved, threads=1)
    write_compensation(result, tmp_path)
    record = run_test(test, LinuxCNC(corrections=tmp_path), Options(dialect="linuxcnc", step_deg=0.3))
    motor, command = record.told, record.path
    path = slice(record.feed.start - 20, record.feed.stop + 150)
    effects = {e.id: dict(e.values) for e in given.effects}
    before = _error(command[path], command[path], given, test, effects | PLANTED)
    after = _error(motor[path], command[path], given, test, effects | PLANTED)
    sound = _error(command[path], command[path], given, test, effects)
    # LinuxCNC runs a program at a pace of its own: the forecast is made for the set-points that it gave
    sent = corrected(command[path], result.corrections, result.control.arithmetic(FIVE_AXIS), 1e-3)
    said = _about_set_up(_forecast(machine, sent, test), command[path], test)
    assert before > 1.5 * sound, (before, after, sound, said)
    assert after < 1.05 * sound, (before, after, sound, said)
    assert after == pytest.approx(said, rel=0.1), (before, after, sound, said)
    # every cycle's correction is the one that the table says
    table = result.corrections.table("A", "A")
    assert table is not None
    added = (motor - command)[path, 3]
    sign = np.sign(np.gradient(command[path, 3]))
    for s, values in ((1.0, table.forward), (-1.0, table.reverse)):
        steady = np.flatnonzero((sign == s) & (np.roll(sign, 50) == s) & (np.roll(sign, -50) == s))
        wanted = np.interp(command[path, 3], table.positions, values)
        assert np.abs(added - wanted)[steady].max() < 2e-6 * DEG


def _error(sent, nominal, machine, test, effects):
    """RMS about the set-up of the independent machine that gets ``sent``, µm."""
    data = {}
    for a in "XYZAC":
        d = machine.drives[a]
        data[a] = {
            "position_gain_per_s": d.position_gain,
            "velocity_gain_Nms_per_rad": d.velocity_gain,
            "integral_time_s": d.integral_time,
            "inertia_kgm2": d.inertia,
            "viscous_Nms_per_rad": d.viscous,
            "gravity_Nm": d.gravity,
        } | ({"lead_mm": 2 * np.pi / d.gear / MM} if a in "XYZ" else {"worm_teeth": d.gear})
    time = np.arange(len(sent)) * 1e-3
    program = type(
        "Sent", (), {"commands": staticmethod(lambda t: np.column_stack([np.interp(t, time, x) for x in sent.T]))}
    )
    motor, _ = drives.run(data, effects, program, time)
    load = transmission.load_side(motor, time, data, effects)
    bar = bar_reading(np.ascontiguousarray(load), np.array(test.table_ball), test.length, effects)
    return _about_set_up(bar, nominal, test)


def _forecast(machine, sent, test):
    """Reading that mjsim's drives give for set-points, m."""
    plant = build(machine)
    load = np.ascontiguousarray(load_of(plant, np.arange(len(sent)) * 1e-3, sent))
    return reading(FIVE_AXIS, load, np.array(test.table_ball), test.length, plant.geometry)


def _about_set_up(bar, nominal, test):
    """RMS of a reading over the measured turn without what ball offsets and the bar's length make, µm."""
    phi = unwrapped(test, nominal)
    part = np.flatnonzero((phi >= 0.0) & (phi <= 2.0 * np.pi))[::5]
    s = sensitivity(FIVE_AXIS, nominal[part], np.array(test.table_ball))
    columns = np.column_stack([np.ones(len(part)), s.table, s.spindle])
    rest = bar[part] - columns @ np.linalg.lstsq(columns, bar[part], rcond=1e-8)[0]
    return float(np.sqrt(np.mean(rest**2)) / UM)
