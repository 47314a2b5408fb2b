"""What friction, play and the bodies may do with energy: take it or keep it, never make it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjsim.effects.registry import make
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import build
from mjsim.simulation import mjmodel
from mjsim.simulation.drive import BRISTLE, OMEGA, STATE_SIZE, STEP, THETA, advance, discretise, start
from mjsim.simulation.transmission import transmit

#: Index of dω per unit torque over a sub-step in a drive's parameters.
TORQUE_TO_OMEGA = 16
#: Step of the checks, s: what is asked for holds in the limit, and the error of one step is of second order.
FINE = STEP / 4


def friction(axis, commands, step=FINE):
    """Friction torque, motor angle and bristle at every step; the torque is what a twin without friction lacks."""
    p, free = discretise(axis, step), discretise(replace(axis, coulomb=0.0), step)
    s = np.zeros(STATE_SIZE)
    start(p, s, commands[0])
    rows = []
    for r in commands[1:]:
        twin = s.copy()
        before = s.copy()
        advance(p, s, r, 0.0, step, 1)
        advance(free, twin, r, 0.0, step, 1)
        rows.append(
            (
                (s[OMEGA] - twin[OMEGA]) / p[TORQUE_TO_OMEGA],
                s[THETA] - before[THETA],
                before[BRISTLE],
                s[BRISTLE],
                s[OMEGA],
            )
        )
    return np.array(rows).T


def restless(axis, size, seed):
    """A command of many frequencies that reverses often, (n,): ``size`` bristle lengths high."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(2.0 / FINE)) * FINE
    waves = [a * np.sin(2 * np.pi * f * times + p) for a, f, p in rng.uniform([0.2, 0.3, 0.0], [1.0, 6.0, 6.3], (6, 3))]
    waves = np.sum(waves, axis=0)
    return size * axis.presliding / axis.gear * (waves - waves[0])


def stored(axis, z):
    """Energy of the bent bristles, ½ σ0 z²."""
    return 0.5 * axis.coulomb / axis.presliding * z**2


@pytest.mark.parametrize("letter", ["X", "C"])
@pytest.mark.parametrize("size", [0.3, 1.5, 30.0, 600.0])
def test_lugre_dissipates_at_every_instant(machine, letter, size):
    """Without a static surplus, always: τ ω − d/dt ½σ0z² = σ1 ω² (1 − sgn(ω) u) + g |ω| u² ≥ 0 with u = σ0 z / g, |u| ≤
    1.

    And so over every cycle: what friction has taken never falls below what the bristles hold.
    """
    axis = build(machine).axes[letter]
    torque, turned, z0, z1, _ = friction(axis, restless(axis, size, 1))
    lost = torque * turned - (stored(axis, z1) - stored(axis, z0))
    scale = axis.coulomb * np.abs(turned).sum()
    assert lost.min() > -1e-12 * scale and lost.sum() > 0.0
    assert np.all(np.cumsum(torque * turned) > stored(axis, z1) - 1e-6 * scale)


@pytest.mark.parametrize("surplus", [1.3, 1.8, 3.0])
def test_lugre_with_a_static_surplus(m1, surplus):
    """Pointwise where σ1 |ω| ≤ g u²/(u − 1), u the surplus or 2; with the viscous torque C ω always where C ≥ σ1
    (surplus − 1).
    """
    axis = replace(build(m1).axes["X"], static_ratio=surplus, stribeck_velocity=1.0)
    s1 = 0.3 * np.sqrt(axis.coulomb / axis.presliding * axis.inertia)
    u = min(surplus, 2.0)
    torque, turned, z0, z1, omega = friction(axis, restless(axis, 200.0, 2))
    lost = torque * turned - (stored(axis, z1) - stored(axis, z0))
    scale = axis.coulomb * np.abs(turned).sum()
    level = axis.coulomb * (1 + (surplus - 1) * np.exp(-(omega**2)))
    slow = s1 * np.abs(omega) <= level * u**2 / (u - 1.0)
    assert slow.mean() > 0.3
    with_viscous = lost + max(axis.viscous, s1 * (surplus - 1.0)) * (turned / FINE) * turned
    assert lost[slow].min() > -1e-12 * scale
    assert with_viscous.min() > -1e-12 * scale


@pytest.mark.parametrize("kind, key, letter", [("backlash.X", "width_um", "X"), ("backlash.A", "width_deg", "A")])
def test_play_only_takes_energy(m1, bare, kind, key, letter):
    """The load moves only when it is pushed: (x − y) dy ≥ 0 at every instant, and half a width for every bit of way."""
    plant = build(bare(m1).with_effect(make(kind, **{key: 5.0 if letter == "X" else 0.003})))
    half = 2.5e-6 if letter == "X" else np.radians(0.0015)
    i = FIVE_AXIS.index(letter)
    rng = np.random.default_rng(4)
    motor = np.zeros((20000, 5))
    motor[:, i] = half * np.cumsum(rng.normal(0.0, 0.1, 20000))
    load = transmit(plant.op_table(), motor, np.arange(20000) * STEP)
    x, y, moved = motor[1:, i], load[1:, i], np.diff(load[:, i])
    work = (x - y) * moved
    assert work.min() > -1e-9 * half**2  # rounding of x + (y − x)
    assert np.all(np.abs(x - y) <= half * (1 + 1e-9))
    np.testing.assert_allclose(work.sum(), half * np.abs(moved).sum(), rtol=1e-6)
    assert 0.03 < (np.abs(moved) > 1e-6 * half).mean() < 0.9


# -- bodies ------------------------------------------------------------------------------------------------------------


def loaded(machine):
    """With the effects that change the bodies' joints and couplings."""
    for effect in (
        make("radial_error_motion.C", amplitude_um=4.0, order=2, phase_deg=30.0),
        make("axis_location.EX0C", value_um=30.0),
        make("squareness.XY", angle_urad=40.0),
    ):
        machine = machine.with_effect(effect)
    return machine


@pytest.mark.parametrize(
    "equip, integrator, limit",
    [(lambda m: m, "EULER", 1e-10), (loaded, "RK4", 1e-8)],
    ids=["as shipped", "a table that wobbles"],
)
def test_free_bodies_keep_their_energy(machine, equip, integrator, limit):
    """No drive, no friction, gravity balanced: the kinetic energy stays for 5 s.

    The bodies turn at 180°/s and run at 100 mm/s, five times what a test does. With the table's error motion free as
    well, which it never is, the bodies are coupled; the shipped integrator then loses 1e-3, half of it at half the
    step, and a better one nothing.
    """
    model = mjmodel.build_model(build(equip(machine)))
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    assert mujoco.get_mjcb_control() is None
    data.qvel[[model.joint(a).dofadr[0] for a in FIVE_AXIS.letters]] = [0.1, -0.08, 0.05, 2.0, np.pi]
    mujoco.mj_forward(model, data)
    kinetic, rows = data.energy[1], []
    for _ in range(5000):
        mujoco.mj_step(model, data)
        rows.append(data.energy[1])
    assert kinetic > 1.0
    assert np.abs(np.array(rows) - kinetic).max() < limit * kinetic


def test_gravity_is_balanced_in_every_pose(machine):
    """Cradle and table are balanced and the slides counterbalanced: at rest no joint feels gravity, wherever it
    stands.
    """
    model = mjmodel.build_model(build(machine))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    for q in rng.uniform(-1, 1, (20, 5)) * [0.2, 0.2, 0.2, 1.5, 6.0]:
        data.qpos[[model.joint(a).qposadr[0] for a in FIVE_AXIS.letters]] = q
        mujoco.mj_forward(model, data)
        assert np.abs(data.qfrc_bias - data.qfrc_passive).max() < 1e-10
