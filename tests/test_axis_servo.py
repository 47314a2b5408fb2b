"""The digital servo loop against closed forms: the difference equation of its control, and the motion of its plant."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from mjsim.inference.axis_logs.gains import _output
from mjsim.machine.control import Control, Law
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.servo import ServoStart, follow
from mjsim.simulation.servo_filters import filters
from tests.independent import logs

GEAR = 2.0 * np.pi / 0.02
STEP = 2e-4


def drive(position_gain=100.0, velocity_gain=0.26, integral_time=np.inf, viscous=0.006, control=None, **more):
    control = control or Control(sample_time=STEP)
    return AxisPlant(GEAR, position_gain, velocity_gain, integral_time, 7e-4, viscous, 0.0, control=control, **more)


def ramp(n=2000, speed=0.02):
    time = STEP * np.arange(n)
    return time, speed * np.clip(time - 0.02, 0.0, 0.1)


def by_hand(axis, command, gain, law):
    """θ of ``J ω' = u − C ω`` with ``u`` held between samples, from the control's difference equation, rad."""
    F = np.array([[0.0, 1.0], [0.0, -axis.viscous / axis.inertia]])
    E = expm(np.block([[F, np.array([[0.0], [1.0 / axis.inertia]])], [np.zeros((1, 3))]]) * STEP)
    x, out = np.zeros(2), np.empty(len(command))
    R, S, T = law
    u, y, r = (np.zeros(8) for _ in range(3))
    for k, value in enumerate(command * GEAR):
        out[k] = x[0]
        y, r, u = (np.concatenate([[new], old[:-1]]) for new, old in ((x[0], y), (value, r), (0.0, u)))
        u[0] = T @ r[: len(T)] - S @ y[: len(S)] - R[1:] @ u[1 : len(R)]
        x = E[:2, :2] @ x + E[:2, 2] * gain * u[0]
    return out


def test_lead_lag_is_the_cascade():
    """A published lead-lag controller, 0.7533 u1 + 161.7 e − 158.49834 e1 (V per mm), stated as a cascade."""
    axis = drive(99.99, 0.2639, feedforward=1.0, control=Control(sample_time=STEP, torque_lag=0.711e-3))
    R, S, T = filters(axis, STEP)
    to_volt = 0.2639 * GEAR * 1e-3 / 0.63864
    assert R[1] == pytest.approx(-0.7533, abs=1e-4)
    assert S == pytest.approx(T)  # with a feedforward of 1 the control sees the error alone
    assert S * to_volt == pytest.approx([161.7, -158.498], rel=1e-3)


@pytest.mark.parametrize("lag", [0.0, 1.5e-3])
def test_without_friction_the_motion_is_that_of_the_difference_equation(lag):
    axis = drive(control=Control(sample_time=STEP, torque_lag=lag), feedforward=0.3)
    time, command = ramp()
    found = follow(axis, time, command, ServoStart(0.0))
    assert found.position * GEAR == pytest.approx(by_hand(axis, command, 0.26, filters(axis, STEP)), abs=1e-9)


def test_a_law_of_its_own():
    S = 1.2527 / (GEAR * 1e-3)
    axis = drive(1.0, 0.63864, control=Control(sample_time=STEP, law=Law((1.0,), (S,), (S,))))
    time, command = ramp()
    expected = by_hand(axis, command, 0.63864, filters(axis, STEP))
    assert follow(axis, time, command, ServoStart(0.0)).position * GEAR == pytest.approx(expected, abs=1e-9)


def test_a_constant_load_leaves_the_error_that_statics_give():
    """P-P: τ = Kvp·Kpp·error; with an integrator the error goes away."""
    time, command = ramp(6000)
    load = 0.4
    for integral_time, error in ((np.inf, load / (0.26 * 100.0)), (0.01, 0.0)):
        axis = drive(integral_time=integral_time)
        axis.gravity = load
        found = follow(axis, time, command, ServoStart(0.0))
        assert (command[-1] - found.position[-1]) * GEAR == pytest.approx(error, abs=1e-7)


def test_the_clip_limits_and_the_integrator_winds_up():
    time = STEP * np.arange(4000)
    command = np.where(time > 0.01, 2e-3, 0.0)
    overshoot = {}
    for anti_windup in (False, True):
        control = Control(sample_time=STEP, clip=0.05, anti_windup=anti_windup)
        found = follow(drive(integral_time=0.02, control=control), time, command, ServoStart(0.0))
        assert np.abs(found.torque).max() <= 0.05
        overshoot[anti_windup] = found.position.max() - 2e-3
    assert overshoot[False] > 2.0 * overshoot[True]


@pytest.mark.parametrize("feedforward", [0.0, 1.0])
def test_a_limited_set_point_is_a_limited_speed(feedforward):
    time = STEP * np.arange(4000)
    command = 0.4 * np.clip(time - 0.02, 0.0, 0.2)
    control = Control(sample_time=STEP, fastest=0.25 * GEAR)
    found = follow(drive(viscous=0.0, feedforward=feedforward, control=control), time, command, ServoStart(0.0))
    falls_behind = (time > 0.1) & (time < 0.2)
    assert found.velocity[falls_behind] == pytest.approx(0.25, rel=1e-6)
    assert np.abs(found.velocity).max() < 0.251 and found.position[-1] == pytest.approx(command[-1], abs=1e-9)


def test_a_limited_voltage_leaves_a_speed_torque_line():
    """At full voltage, J dω/dt = τs (1 − ω/ω0) has its closed form; against the motion there is more torque."""
    time, stall, no_load = STEP * np.arange(4000), 0.5, 60.0
    command = np.where(time > 0.01, 1.0, 0.0)
    control = Control(sample_time=STEP, voltage=(stall, 1.0 / no_load))
    axis = drive(viscous=0.0, control=control)
    found = follow(axis, time, command, ServoStart(0.0))
    k = int(np.argmax(command > 0.0))
    kept = 1.0 - stall * STEP / (axis.inertia * no_load)  # of what is missing to ω0, in a sample of constant torque
    expected = no_load * (1.0 - kept ** np.arange(300))
    assert found.velocity[k : k + 300] * GEAR == pytest.approx(expected, rel=1e-6, abs=1e-9)
    back = follow(axis, time, np.where(time > 0.3, -1.0, command), ServoStart(0.0))
    assert back.torque.min() == pytest.approx(-2.0 * stall, rel=0.02)


def as_stated(axis, control, **changes):
    """The drive that the independent integration has, with further numbers of its digital control."""
    return AxisPlant(
        2.0 * np.pi / axis.lead,
        control.position_gain,
        control.velocity_gain,
        control.integral_time,
        axis.inertia,
        axis.viscous,
        0.0,
        feedforward=control.feedforward,
        coulomb=axis.coulomb,
        presliding=axis.presliding,
        control=Control(sample_time=control.sample, **changes),
    )


@pytest.mark.parametrize(
    "changes", [{"fastest": 90.0}, {"stall": 2.0, "no_load": 130.0}, {"clip": 1.2}], ids=["speed", "voltage", "torque"]
)
@pytest.mark.parametrize("integral_time", [np.inf, 0.04])
def test_limits_are_those_of_an_independent_integration(changes, integral_time):
    axis = logs.Axis(coulomb=0.15)
    control = logs.Control(integral_time=integral_time, feedforward=0.5, **changes)
    command = logs.to_and_fro()
    truth, _ = logs.record(axis, control, command, noise=0.0, step=1e-13)
    limits = {"fastest": control.fastest, "clip": control.clip, "voltage": (control.stall, 1.0 / control.no_load)}
    plant = as_stated(axis, control, **limits)
    motion = follow(plant, 1e-3 * np.arange(len(command)), command, ServoStart(0.0))
    free = follow(replace(plant, control=Control(sample_time=1e-3)), motion.time, command, ServoStart(0.0))
    assert np.sqrt(np.mean((motion.position - truth) ** 2)) < 10e-9
    assert np.abs(free.position - truth).max() > 100e-6


@pytest.mark.parametrize(("sample", "every"), [(1e-3, 4), (2.5e-4, 8)])
@pytest.mark.parametrize("integral_time", [np.inf, 0.04])
def test_a_slower_position_loop_holds_its_set_point(sample, every, integral_time):
    """As an independent integration has it; as a single loop of either time, the same drive moves otherwise."""
    axis = logs.Axis(coulomb=0.15)
    control = logs.Control(integral_time=integral_time, feedforward=0.5, sample=sample, every=every)
    command = logs.to_and_fro(sample)
    truth, torque = logs.record(axis, control, command, noise=0.0, step=1e-13)
    plant = as_stated(axis, control, position_sample_time=every * sample)
    time = sample * np.arange(len(command))
    motion = follow(plant, time, command, ServoStart(0.0))
    assert np.sqrt(np.mean((motion.position - truth) ** 2)) < 10e-9
    assert np.abs(motion.torque - torque).max() < 0.02 * np.abs(torque).max()
    single = follow(replace(plant, control=Control(sample_time=sample)), time, command, ServoStart(0.0))
    assert np.abs(single.position - truth).max() > 1e-6
    # and the law says the torque of what was recorded
    assert np.std(_output(plant, sample, command, truth) - torque) < 0.01 * np.std(torque)


@pytest.mark.parametrize(("order", "integral_time"), [(1.0, np.inf), (2.0, 0.04), (4.0, 0.04)])
def test_an_encoder_that_reads_wrong_misleads_its_control(order, integral_time):
    """As an independent integration has it; the recording follows the command, and the motor does not."""
    axis = logs.Axis(coulomb=0.15, misread=np.radians(0.3), misread_order=order, misread_phase=0.7)
    control = logs.Control(integral_time=integral_time, feedforward=0.5)
    command = logs.to_and_fro()
    truth, torque = logs.record(axis, control, command, noise=0.0, step=1e-13)
    plant = replace(as_stated(axis, control), encoder_error=(np.radians(0.3), order, 0.7))
    time = 1e-3 * np.arange(len(command))
    motion = follow(plant, time, command, ServoStart(truth[0]))
    assert np.sqrt(np.mean((motion.position - truth) ** 2)) < 10e-9
    assert np.abs(motion.torque - torque).max() < 0.02 * np.abs(torque).max()
    right = follow(replace(plant, encoder_error=(0.0, 1.0, 0.0)), time, command, ServoStart(truth[0]))
    assert np.abs(right.position - truth).max() > 0.2e-6
    # between the samples the speed is that of what the encoder gives
    assert np.std(np.gradient(motion.position, 1e-3) - motion.velocity) < 3e-4


def test_at_a_low_speed_an_encoder_shows_nothing_of_its_error():
    """The control makes the motor follow what it reads: at rest and slowly, the error is in the motion alone."""
    time = STEP * np.arange(20000)
    command = 5e-3 * time / time[-1]  # one wave
    wrong = drive(integral_time=0.02, encoder_error=(0.005, 2.0, 0.3))
    read = follow(wrong, time, command, ServoStart(0.0)).position
    right = follow(replace(wrong, encoder_error=(0.0, 1.0, 0.0)), time, command, ServoStart(0.0)).position
    late = slice(2000, None)  # once it has settled
    assert np.abs(read - right)[late].max() < 0.02 * 0.005 / wrong.gear


def test_a_delay_of_whole_samples_moves_the_torque():
    time, command = ramp()
    torque = {}
    for samples in (0, 3):
        control = Control(sample_time=STEP, loop_delay=samples * STEP)
        axis = drive(position_gain=1e-9, velocity_gain=1e-6, feedforward=1.0, control=control)  # in effect an open loop
        torque[samples] = follow(axis, time, command, ServoStart(0.0)).torque
    assert torque[3][3:] == pytest.approx(torque[0][:-3], abs=1e-11)
    assert np.abs(torque[0]).max() > 0.0


def test_friction_holds_below_its_level_and_slides_at_it():
    time, command = ramp(3000, speed=0.05)
    axis = drive(coulomb=0.3, presliding=0.003)
    at_rest = follow(axis, time, np.zeros(len(time)), ServoStart(1e-6))
    assert np.ptp(at_rest.position) < 1e-8  # 1 µm of error asks for less torque than the friction holds
    moving = follow(axis, time, command, ServoStart(0.0))
    k = np.searchsorted(time, 0.11)
    speed = moving.velocity[k] * GEAR
    assert moving.torque[k] == pytest.approx(0.3 + axis.viscous * speed, rel=1e-3)


@pytest.mark.parametrize(
    ("more", "extra"),
    [
        ({"asymmetry": 0.2}, 0.06),
        ({"rising": (0.1, 3.0)}, 0.0995),
        ({"resting": (0.5, 0.05, 0.01)}, 0.15 / (1.0 + 0.05 * GEAR * 0.01 / 0.05)),
    ],
)
def test_friction_by_direction_and_speed(more, extra):
    time, command = ramp(3000, speed=0.05)
    axis = drive(coulomb=0.3, presliding=0.003, **more)
    k = np.searchsorted(time, 0.11)
    forth = follow(axis, time, command, ServoStart(0.0)).torque[k]
    back = follow(axis, time, -command, ServoStart(0.0)).torque[k]
    plain = 0.3 + axis.viscous * 0.05 * GEAR
    assert forth == pytest.approx(plain + extra, rel=2e-3)
    assert back == pytest.approx(-(plain - extra) if "asymmetry" in more else -(plain + extra), rel=2e-3)


def test_an_axis_at_rest_is_not_computed_on():
    """An integrator that does next to nothing is always computed; without one the rest is passed over."""
    time = STEP * np.arange(12000)
    command = 0.005 * (np.clip((time - 0.2) / 0.1, 0.0, 1.0) - np.clip((time - 1.7) / 0.1, 0.0, 1.0))
    ripple = {"ripple": (0.02, 3.0, 0.4), "friction_ripple": (0.1, 2.0, 0.0)}
    found = [
        follow(drive(integral_time=t, coulomb=0.3, presliding=0.003, resting=(1.0, 0.02, 0.5), **ripple), time, command,
               ServoStart(0.0)).position
        for t in (np.inf, 1e15)
    ]  # fmt: skip
    assert np.ptp(found[0]) > 4e-3 and np.abs(found[0] - found[1]).max() < 1e-11


def test_elastic_bristles_do_not_creep():
    """A load that swings below the break-away level moves LuGre's motor away; with ``hold`` it comes back."""
    time = STEP * np.arange(20000)
    command = 20e-6 * (1.0 + np.sin(2 * np.pi * 5.0 * time))
    drift = {}
    for hold in (0.0, 0.8):
        axis = drive(10.0, 1.0, coulomb=0.3, presliding=0.003, hold=hold)
        q = follow(axis, time, command, ServoStart(0.0)).position
        period = int(0.2 / STEP)
        drift[hold] = abs(q[-period:].mean() - q[period : 2 * period].mean())
    assert drift[0.8] < 0.1 * drift[0.0]


def test_interpolated_positions_are_those_of_a_finer_control():
    time, command = ramp()
    slow = follow(drive(), time, command, ServoStart(0.0))
    parabola = slow.time[:-1] + 0.3 * STEP
    exact = slow.position[:-1] + 0.3 * STEP * slow.velocity[:-1]
    assert slow.at(slow.time) == pytest.approx(slow.position, abs=1e-15)
    assert np.abs(slow.at(parabola) - exact).max() < 0.5 * np.abs(np.gradient(slow.velocity, STEP)).max() * STEP**2


@pytest.mark.parametrize(
    "changes",
    [
        {"viscous_share": 0.3},
        {"ripple": 0.03, "ripple_order": 6.0},
        {"presliding": 0.002},
        {"excess": 2.0, "way": 0.03, "rest": 0.4},
    ],
    ids=["viscous by direction", "ripple", "stiff bristles", "after a rest"],
)
@pytest.mark.parametrize("delay", [0, 3])
def test_the_loop_is_true_to_nanometres(changes, delay):
    """Against an independent integration 500 times finer, with reversals: no interval is better than that."""
    axis = logs.Axis(coulomb=0.15, **changes)
    control = logs.Control(delay_samples=delay)
    command = logs.to_and_fro()
    truth, _ = logs.record(axis, control, command, noise=0.0, step=1e-13)
    plant = replace(
        as_stated(axis, control, loop_delay=1e-3 * delay),
        viscous_share=axis.viscous_share,
        ripple=(axis.ripple, axis.ripple_order, axis.ripple_phase),
        resting=(axis.excess, axis.way, axis.rest),
    )
    motion = follow(plant, 1e-3 * np.arange(len(command)), command, ServoStart(0.0))
    assert np.sqrt(np.mean((motion.position - truth) ** 2)) < 6e-9
