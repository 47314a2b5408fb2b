"""The drive kernel against the written-out equations, closed forms and what friction may not do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mjsim.machine.model import build
from mjsim.simulation.drive import (
    BRISTLE,
    INTEGRAL,
    OMEGA,
    STATE_SIZE,
    STEP,
    SUBSTEPS,
    THETA,
    advance,
    discretise,
    run,
    start,
)  # fmt: skip

UM = 1e-6
#: Distance from the A centreline that turns its angle into a reading, m (the far corner of the tests' work space).
LEVER = 0.25
#: Index of dω per unit torque over a sub-step in the parameters.
TORQUE_TO_OMEGA = 16


def kernel(axis, commands, step=STEP, substeps=SUBSTEPS):
    """Axis positions for commands one step apart."""
    out = np.empty(len(commands))
    run(discretise(axis, step / substeps), np.ascontiguousarray(commands), step / substeps, substeps, out)
    return out


def history(axis, commands, step=STEP, substeps=SUBSTEPS, load=None):
    """The whole state after every step, (n, STATE_SIZE)."""
    p, s = discretise(axis, step / substeps), np.zeros(STATE_SIZE)
    start(p, s, commands[0])
    out = [s.copy()]
    for k in range(1, len(commands)):
        advance(p, s, commands[k], 0.0 if load is None else load[k], step / substeps, substeps)
        out.append(s.copy())
    return np.array(out)


def integrate(axis, command, rate, times):
    """Motor angle of the written-out drive equations by an eighth-order method, rad."""
    p = axis
    s0 = p.coulomb / p.presliding
    s1 = 0.3 * np.sqrt(s0 * p.inertia)
    a, order, phase = p.ripple

    def equations(t, y):
        th, om, it, z, lth, lom = y
        error = p.position_gain * (p.gear * command(t) - th) + p.feedforward * p.gear * rate(t) - om
        torque = p.velocity_gain * (error + it / p.integral_time)
        friction = dz = 0.0
        if p.coulomb:
            level = p.coulomb
            if p.static_ratio > 1:
                level *= 1 + (p.static_ratio - 1) * np.exp(-((om / p.stribeck_velocity) ** 2))
            dz = om - abs(om) * s0 * z / level
            friction = s0 * z + s1 * dz
        net = torque - p.viscous * om - friction - p.gravity - a * np.sin(order * th + phase)
        spring = p.stiffness * (th - lth) + p.damping * (om - lom)
        if not p.load_inertia:
            return [om, net / p.inertia, error, dz, om, 0.0]
        return [om, (net - spring) / (p.inertia - p.load_inertia), error, dz, lom, spring / p.load_inertia]

    first = p.gear * command(0.0)
    rest = [first, 0.0, p.gravity * p.integral_time / p.velocity_gain, 0.0, first, 0.0]
    got = solve_ivp(
        equations, (0.0, times[-1]), rest, method="DOP853", t_eval=times, rtol=1e-10, atol=1e-13, max_step=2e-3
    )
    assert got.success
    return got.y


def quiet(axis, **changes):
    """A drive without friction and ripple."""
    return replace(axis, coulomb=0.0, static_ratio=1.0, ripple=(0.0, 1.0, 0.0), **changes)


# --- against the differential equations ---

VARIANTS = {
    "data sheet": {},
    "gravity, feedforward": {"gravity": 3.0, "feedforward": 0.4},
    "Stribeck": {"static_ratio": 1.5, "stribeck_velocity": 2.0},
    "ripple": {"ripple": (0.2, 4.0, 0.7)},
    "no friction": {"coulomb": 0.0, "viscous": 0.05},
    "soft": {"load_inertia": 0.0012, "stiffness": 25.0, "damping": 0.02},
    "soft and rippling": {
        "load_inertia": 0.0012,
        "stiffness": 60.0,
        "damping": 0.05,
        "ripple": (0.2, 4.0, 0.7),
        "coulomb": 0.0,
    },
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("name", "letter"), [("m1", "X"), ("m2", "A")])
def test_kernel_against_the_equations(request, name, letter, variant):
    """A start from rest, three reversals: 31 mm/s on X at its fastest and 6°/s on A, as in a cone test at 1000
    mm/min.
    """
    axis = replace(build(request.getfixturevalue(name)).axes[letter], **VARIANTS[variant])
    size, w = (0.01 if letter == "X" else np.radians(2.0)), np.pi
    times = np.arange(3001) * STEP
    state = integrate(axis, lambda t: size * (1 - np.cos(w * t)), lambda t: size * w * np.sin(w * t), times)
    error = np.abs(kernel(axis, size * (1 - np.cos(w * times))) - state[4] / axis.gear)
    error *= 1.0 if letter == "X" else LEVER
    reversals = times[1:][state[1][1:] * state[1][:-1] < 0]
    assert len(reversals) >= 2
    near = np.abs(times[:, None] - reversals).min(axis=1) <= 0.05
    assert error[~near].max() < 0.05 * UM
    assert error[near].max() < 0.5 * UM


def test_presliding_against_the_equations(m1):
    """Motion that never breaks away (the bristles only bend), where friction is an elastic spring with damping."""
    axis = build(m1).axes["X"]
    size, w = 0.4 * axis.presliding / axis.gear, 2 * np.pi
    times = np.arange(2001) * STEP
    state = integrate(axis, lambda t: size * np.sin(w * t), lambda t: size * w * np.cos(w * t), times)
    assert np.abs(state[3]).max() < 0.9 * axis.presliding
    assert np.abs(kernel(axis, size * np.sin(w * times)) - state[0] / axis.gear).max() < 0.005 * UM


def test_bristles_hold_a_load_below_break_away(m1):
    """A load of 80 % of Coulomb is shared by bristles and integrator without sliding away; reloading starts from
    there.
    """
    axis = build(m1).axes["X"]
    still = np.zeros(3001)
    held = history(axis, still, load=np.full(3001, 0.8 * axis.coulomb))
    assert np.abs(held[:, THETA]).max() < axis.presliding
    assert abs(held[-1, THETA]) < 1e-3 * axis.presliding  # the integrator brings it back
    assert np.abs(held[:, BRISTLE]).max() <= axis.presliding


# --- the linear cascade ---


@pytest.mark.parametrize("letter", ["X", "Z", "A", "C"])
@pytest.mark.parametrize("hertz", [0.2, 1.0, 5.0, 20.0, 60.0])
@pytest.mark.parametrize("substeps", [SUBSTEPS, 50])
def test_frequency_response(machine, letter, hertz, substeps):
    """Amplitude and phase of θ/r without friction: Kvp (s + 1/Ti)(Kpp + ratio·s) / [J s³ + C s² + Kvp (s +
    1/Ti)(Kpp + s)].
    """
    axis = quiet(build(machine).axes[letter], feedforward=0.3)
    w = 2 * np.pi * hertz
    s = 1j * w
    loop = axis.velocity_gain * (s + 1 / axis.integral_time)
    closed = (
        loop
        * (axis.position_gain + 0.3 * s)
        / (axis.inertia * s**3 + axis.viscous * s**2 + loop * (axis.position_gain + s))
    )
    times = np.arange(int((2.0 + 3 / hertz) / STEP)) * STEP
    substep = STEP / substeps
    got = kernel(axis, 0.001 * np.sin(w * times), substeps=substeps)
    end = times > 2.0  # the slowest mode, about Kpp, has died out
    parts = np.column_stack([np.sin(w * times[end]), np.cos(w * times[end])])
    (a, b), *_ = np.linalg.lstsq(parts, got[end] / 0.001, rcond=None)
    # a sine taken as straight pieces of one sub-step loses (ωh)²/12 of its height; as parabolas of one step at most
    # (ωh)³/15
    allowed = 1e-9 + (w * substep) ** 2 / 12 + (w * STEP) ** 3 / 15
    assert abs((a + 1j * b) - closed) < allowed * 1.01


@pytest.mark.parametrize("letter", ["X", "Y", "Z", "A", "C"])
def test_following_error_at_constant_speed(machine, letter):
    """v (1 − feedforward) / Kpp behind the command, whatever gravity and friction; the integrator takes those."""
    axis = build(machine).axes[letter]
    v = 0.02
    times = np.arange(3001) * STEP
    for ratio in (0.0, 0.5, 1.0):
        lag = v * times[-1] - kernel(replace(axis, feedforward=ratio, gravity=2.0), v * times)[-1]
        assert lag == pytest.approx(v * (1 - ratio) / axis.position_gain, abs=1e-10)


@pytest.mark.parametrize("letter", ["X", "Y", "Z", "A", "C"])
def test_gravity_is_held_at_rest(machine, letter):
    axis = replace(build(machine).axes[letter], gravity=4.5)
    at = 0.123
    states = history(axis, np.full(2001, at))
    assert np.abs(states[:, THETA] / axis.gear - at).max() < 1e-13
    assert np.abs(states[:, OMEGA]).max() < 1e-9
    np.testing.assert_allclose(axis.velocity_gain / axis.integral_time * states[:, INTEGRAL], 4.5, rtol=1e-6)


def test_integrator_takes_a_load_that_stays(m1):
    """A constant load torque leaves no position error behind, only the integrator knows of it."""
    axis = quiet(build(m1).axes["X"])
    states = history(axis, np.zeros(4001), load=np.full(4001, 2.0))
    assert np.abs(states[:300, THETA]).max() > 1e-4
    assert abs(states[-1, THETA]) < 1e-12
    assert axis.velocity_gain / axis.integral_time * states[-1, INTEGRAL] == pytest.approx(2.0)


def test_ripple_at_constant_speed(m1):
    """A small ripple at constant speed moves the motor by its amplitude times the loop's compliance at that
    frequency.
    """
    axis = quiet(build(m1).axes["X"])
    v, order, amplitude = 0.02, 5.0, 0.01
    w = order * axis.gear * v
    s = 1j * w
    loop = axis.velocity_gain * (s + 1 / axis.integral_time)
    compliance = s / (axis.inertia * s**3 + axis.viscous * s**2 + loop * (axis.position_gain + s))
    times = np.arange(4001) * STEP
    ripple = kernel(replace(axis, ripple=(amplitude, order, 0.0)), v * times) - kernel(axis, v * times)
    wave = ripple[times > 2.0] * axis.gear
    phase = w * times[times > 2.0]
    a, b = 2 * np.mean(wave * np.sin(phase)), 2 * np.mean(wave * np.cos(phase))
    assert np.hypot(a, b) == pytest.approx(amplitude * abs(compliance), rel=0.01)


# --- friction ---


def friction_torques(axis, commands):
    """Friction torque on the motor and its angle at every sub-step: the torque is what a twin without friction
    lacks.
    """
    p, free = discretise(axis, STEP), discretise(replace(axis, coulomb=0.0), STEP)
    s = np.zeros(STATE_SIZE)
    start(p, s, commands[0])
    torque, angle, bristle = [], [s[THETA]], [0.0]
    for r in commands[1:]:
        twin = s.copy()
        advance(p, s, r, 0.0, STEP, 1)
        advance(free, twin, r, 0.0, STEP, 1)
        torque.append((s[OMEGA] - twin[OMEGA]) / p[TORQUE_TO_OMEGA])
        angle.append(s[THETA])
        bristle.append(s[BRISTLE])
    return np.array(torque), np.array(angle), np.array(bristle)


@pytest.mark.parametrize("letter", ["X", "A"])
@pytest.mark.parametrize("static_ratio", [1.0, 1.6])
@pytest.mark.parametrize("turns", [0.3, 1.0, 5.0, 300.0])
def test_friction_only_dissipates(machine, letter, static_ratio, turns):
    """Work taken over closed cycles, from motions inside the presliding range (0.3 of it) to long sliding ones."""
    axis = replace(build(machine).axes[letter], static_ratio=static_ratio, stribeck_velocity=2.0)
    size = turns * axis.presliding / axis.gear
    times = np.arange(4001) * STEP
    torque, angle, bristle = friction_torques(axis, size * np.sin(2 * np.pi * times))
    work = np.concatenate([[0.0], np.cumsum(torque * np.diff(angle))])
    scale = axis.coulomb * np.abs(np.diff(angle)).sum()
    assert work.min() > -1e-6 * scale  # never gives more than it took
    for k in (1000, 2000, 2999):  # a whole cycle from here
        assert work[k + 1000] > work[k]
    assert np.abs(bristle).max() <= static_ratio * axis.presliding * (1 + 1e-12)
    assert np.abs(torque).max() < 1.5 * static_ratio * axis.coulomb
    if turns == 300.0 and static_ratio == 1.0:  # sliding all the time: Coulomb torque times the way
        assert work[-1] == pytest.approx(scale, rel=0.05)


def test_sliding_friction_is_coulomb(m1):
    axis = build(m1).axes["X"]
    torque, *_ = friction_torques(axis, 0.01 * np.arange(1001) * STEP)
    np.testing.assert_allclose(torque[500:], axis.coulomb, rtol=1e-6)


def test_stribeck_level(m1):
    """Sliding at ω, friction is Tc [1 + (ratio − 1) exp(−(ω/ω_s)²)]."""
    axis = replace(build(m1).axes["X"], static_ratio=1.4, stribeck_velocity=3.0)
    for v in (1e-3, 4e-3, 2e-2):
        torque, *_ = friction_torques(axis, v * np.arange(2001) * STEP)
        want = axis.coulomb * (1 + 0.4 * np.exp(-((v * axis.gear / 3.0) ** 2)))
        assert torque[-1] == pytest.approx(want, rel=1e-5)


@pytest.mark.parametrize("letter", ["X", "Y", "A", "C"])
def test_mirrored_command_gives_mirrored_motion(machine, letter):
    axis = replace(build(machine).axes[letter], static_ratio=1.2, stribeck_velocity=1.0, ripple=(0.1, 3.0, 0.0))
    times = np.arange(4001) * STEP
    commands = 0.02 * np.sin(3 * times) + 0.005 * np.sin(11 * times)
    np.testing.assert_array_equal(kernel(axis, -commands), -kernel(axis, commands))


def test_without_friction_no_bristles(m1):
    axis = quiet(build(m1).axes["X"])
    times = np.arange(1001) * STEP
    assert not history(axis, 0.02 * np.sin(3 * times))[:, BRISTLE].any()
    assert history(build(m1).axes["X"], 0.02 * np.sin(3 * times))[:, BRISTLE].any()


def test_vanishing_friction_is_no_friction(m1):
    """The friction branch at a vanishing level agrees with the branch that has none."""
    axis = quiet(build(m1).axes["X"])
    commands = 0.02 * np.sin(3 * np.arange(2001) * STEP)
    assert np.abs(kernel(replace(axis, coulomb=1e-12), commands) - kernel(axis, commands)).max() < 1e-12  # a picometre


def test_nothing_moves_before_the_command(machine):
    for axis in build(machine).axes.values():
        commands = np.concatenate([np.full(100, 0.1), 0.1 + 0.01 * np.arange(50) * STEP])
        np.testing.assert_allclose(kernel(axis, commands)[:100], 0.1, rtol=0, atol=1e-12)
