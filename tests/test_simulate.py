"""The multibody simulation: equal to the independent axes, the same on every run, with inertias that add up."""

import os
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.effects import registry
from mjsim.effects.registry import make
from mjsim.errors import SimulationError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.model import build
from mjsim.machine.plant import STAGES
from mjsim.simulation import callback, mjmodel
from mjsim.simulation.axes import AxesMotion, time_grid
from mjsim.simulation.drive import STEP, SUBSTEPS
from mjsim.simulation.multibody import prepare, simulate

FEED = 6000.0


def loaded(machine):
    """A machine with effects of every sort in it: drive, transmission with and without memory, geometry, table's
    error motion.
    """
    for effect in (
        make("servo_gain.C", ratio=1.03),
        make("servo_delay.Y", delay_ms=0.7),
        make("velocity_feedforward.X", ratio=0.2),
        make("torque_ripple.A", amplitude_Nm=0.05, order=4),
        make("backlash.A", width_deg=0.002),
        make("backlash.X", width_um=3.0),
        make("pitch_error.A", components=[[60, 1.5e-3, 20.0]], direction="CW"),
        make("pitch_error.C", components=[[72, 2.5e-3, 20.0], [360, 5e-4, 0.0]]),
        make("worm_wear.C", depth_deg=2e-3, centre_deg=140.0, width_deg=9.0),
        make("gravity_windup.A", amplitude_deg=1e-3, phase_deg=10.0),
        make("scale_error.Y", ppm=40.0),
        make("straightness.EYX", quadratic_um=3.0, cubic_um=-2.0),
        make("squareness.XY", angle_urad=40.0),
        make("axis_location.EX0C", value_um=30.0),
        make("axis_location.EB0A", value_urad=-50.0),
        make("thermal_drift.Y", amplitude_um=8.0, time_constant_s=60.0),
    ):
        machine = machine.with_effect(effect)
    return machine


def wobbling(machine):
    """With the rotary table's error motion as well, which has joints of its own."""
    machine = machine.with_effect(make("radial_error_motion.C", amplitude_um=4.0, order=2, phase_deg=30.0))
    return machine.with_effect(make("tilt_error_motion.C", amplitude_urad=40.0, order=-3, phase_deg=70.0))


@pytest.fixture(scope="module")
def tests(cone, circle, turn):
    return [
        cone(15, 10, (50, 20, 155), FEED, name="cone", started=10.0),
        cone(45, 30, (0, -80, 155), FEED, name="cone45", sensitive="parallel", direction="CW", started=30.0),
        circle("ZX", (0, 30, 155), FEED, name="circle", started=50.0),
        turn("C", 0, 200, (80, 60, 155), "tangential", FEED, name="rotary-c", started=70.0),
        turn("A", 10, -60, (20, 60, 120), "radial", FEED, name="rotary-a", started=80.0),
    ]


@pytest.mark.parametrize("delay", [0.37e-3, -0.4e-3, 12.8e-3])
def test_a_command_that_comes_late_is_the_path_at_an_earlier_time(tests, delay):
    """To less than 0.01 nm and 0.01 nrad: in cones that turn a table many times, at both ends, and at the corners of
    the blocks of an NC program too.
    """
    corners = tests[2].chain.count * [0.0], [0.01, 0.0, 0.02, 0.1, 0.0], [0.0, 0.01, 0.02, 0.0, 0.2]
    in_blocks = replace(tests[2], commanded=Commanded(np.array([0.5, 0.25]), np.array(corners)))
    for test in (*tests, in_blocks):
        program, time = Program(test), time_grid(Program(test))
        now, then = program.commands(time), program.commands(time - delay)
        for axis in range(now.shape[1]):
            late = program.late(axis, now, STEP, delay)
            assert np.abs(late - then[:, axis]).max() < 1e-11


def test_multibody_equals_independent_axes(machine, bare, tests):
    """The balanced machine's mass matrix is diagonal: below 0.1 nm in the reading, 0.01 nm where no effect couples the
    axes.

    A wobbling table loads the C motor a little, with the square of the speed: 1 nm is allowed at six times the usual
    feed.
    """
    for build_up, limit in ((lambda m: m, 1e-11), (loaded, 1e-10), (lambda m: wobbling(loaded(m)), 1e-9)):
        equipped = build_up(machine)
        plant = build(equipped)
        for s in simulate(equipped, tests):
            alone = AxesMotion(s.test)
            np.testing.assert_array_equal(alone.time, s.time)
            np.testing.assert_allclose(alone.commands, s.command, rtol=0, atol=1e-15)
            assert np.abs(alone.reading(plant) - s.deviation).max() < limit, s.test.name
            # angles at a lever of 0.1 m
            assert np.abs((alone.load(plant)[:, :5] - s.position) * [1, 1, 1, 0.1, 0.1]).max() < limit, s.test.name
            assert np.ptp(s.deviation) > 5e-6


def test_loops_closed_on_the_load(m1, bare, cone, circle):
    """Play of axes with an encoder at the load, in both engines: it costs the accuracy of reversals."""
    tests = [cone(15, 10, (50, 20, 155), 1000.0, name="cone"), circle("XY", (0, 0, 155), 1000.0, name="circle")]
    motor = m1.with_effects([make("backlash.X", width_um=20.0), make("backlash.C", width_deg=0.002)])
    drives = {a: replace(d, encoder="load") if a in ("X", "C") else d for a, d in motor.drives.items()}
    load = replace(motor, drives=drives)
    sound = replace(load, effects=m1.effects)
    for outside, inside, without in zip(*(simulate(m, tests) for m in (motor, load, sound)), strict=True):
        alone = AxesMotion(inside.test).reading(build(load))
        assert np.abs(alone - inside.deviation).max() < 1e-10
        lost = [float(np.sqrt(np.mean((s.deviation - without.deviation) ** 2))) for s in (outside, inside)]
        assert 1e-7 < lost[1] < 0.5 * lost[0]


def test_the_campaigns_of_the_examples(m1):
    """The same on a measured campaign's own tests (two of them, whole)."""
    campaign = read_campaign(examples() / "hidden-backlash", traces=False)
    chosen = [t for t in campaign.tests if t.name in ("cone15-x50-ccw", "rotary-a-tangential-cw")]
    assert len(chosen) == 2
    plant = build(loaded(m1))
    for s in simulate(loaded(m1), chosen):
        assert np.abs(AxesMotion(s.test).reading(plant) - s.deviation).max() < 1e-10


def test_what_is_left_out_of_the_model_changes_nothing(machine, tests, monkeypatch):
    """Without meshes, shapes to touch, tendon and balanced gravity the reading is the same to rounding, and the
    model is a small one.
    """
    equipped = wobbling(loaded(machine))
    small = mjmodel.build_model(build(equipped))
    lean = simulate(equipped, tests[:2])
    monkeypatch.setattr(mjmodel, "compiled", mjmodel.compiled.__wrapped__)  # nothing that is kept
    monkeypatch.setattr(mjmodel, "_strip", lambda spec: None)
    whole = mjmodel.build_model(build(equipped))
    assert whole.nmesh > 20 and whole.ngeom > 20 and whole.ntendon and not (small.nmesh or small.ngeom or small.ntendon)
    np.testing.assert_array_equal(small.opt.gravity, 0.0)
    np.testing.assert_array_equal(small.body_inertia, whole.body_inertia)
    monkeypatch.setattr(mjmodel, "_balanced", lambda model: False)
    assert mjmodel.build_model(build(equipped)).opt.gravity[2] < -9.0
    for s, t in zip(lean, simulate(equipped, tests[:2]), strict=True):
        assert np.abs(s.deviation - t.deviation).max() < 1e-15


def test_a_light_motion_is_the_same_motion(machine, tests):
    plant = build(loaded(machine))
    for test in tests[::2]:
        light = AxesMotion(test, keep=1, light=True)
        for _ in range(2):
            assert np.array_equal(light.reading(plant, 5), AxesMotion(test).reading(plant, 5))
            assert not {"time", "commands"} & set(vars(light))


def identical(a, b):
    return all(
        np.array_equal(getattr(a, k), getattr(b, k)) for k in ("time", "phi", "command", "position", "deviation")
    )


def test_bit_identical_whatever_the_threads_and_the_order(m1, tests):
    equipped = wobbling(loaded(m1))
    first = simulate(equipped, tests, threads=1)
    assert all(map(identical, first, simulate(equipped, tests, threads=1)))
    assert all(map(identical, first, simulate(equipped, tests, threads=2)))
    assert all(map(identical, first, reversed(simulate(equipped, tests[::-1], threads=2))))
    assert identical(first[2], simulate(equipped, tests[2:3])[0])
    other = simulate(equipped.without("backlash.A"), tests[:1])[0]
    assert not np.array_equal(other.deviation, first[0].deviation)
    assert identical(first[0], simulate(equipped, tests[:1])[0])  # nothing is left behind by another machine


def test_progress_is_told(m1, tests):
    seen = []
    simulate(m1, tests[:3], done=seen.append)
    assert sorted(t.name for t in seen) == sorted(t.name for t in tests[:3])


def test_nothing_is_left_installed(m1, tests):
    simulate(m1, tests[:1])
    assert mujoco.get_mjcb_control() is None
    assert mujoco.get_mjcb_time() is None


def test_a_users_clock_is_left_as_it_was(m1, tests):
    heard = []

    def clock():
        heard.append(0.0)
        return 0.0

    mujoco.set_mjcb_time(clock)
    try:
        simulate(m1, tests[:1])
        assert mujoco.get_mjcb_time() is clock
        assert not heard
    finally:
        mujoco.set_mjcb_time(None)


def test_no_warnings_from_mujoco(machine, tests):
    heard = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        simulate(wobbling(loaded(machine)), tests)
    finally:
        mujoco.set_mju_user_warning(before)
    assert not heard


def test_an_unstable_drive_is_refused(m1, tests):
    """A position loop far beyond what the velocity loop carries ends in an error, not in numbers."""
    with pytest.raises(SimulationError, match="drive X: the control loop swings itself up"):
        simulate(m1.with_drive("X", position_gain=1000.0, velocity_gain=1e-3), tests[:1])


# --- inertias and forces ---


@pytest.mark.parametrize(
    "equip", [lambda m: m, loaded, lambda m: wobbling(loaded(m))], ids=["as shipped", "loaded", "wobbling"]
)
def test_mass_matrix_is_the_data_sheet(machine, equip):
    plant = build(equip(machine))
    model = mjmodel.build_model(plant)
    dofs = [model.joint(a).dofadr[0] for a in FIVE_AXIS.letters]
    assert np.all(model.dof_armature[dofs] > 0)
    want = np.array([plant.axes[a].inertia * plant.axes[a].gear ** 2 for a in FIVE_AXIS.letters])
    data = mujoco.MjData(model)
    full = np.zeros((model.nv, model.nv))
    rng = np.random.default_rng(3)
    for q in [np.zeros(5), *rng.uniform(-1, 1, (5, 5)) * [0.2, 0.2, 0.2, 1.2, 6.0]]:
        data.qpos[[model.joint(a).qposadr[0] for a in FIVE_AXIS.letters]] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        mass = full[np.ix_(dofs, dofs)]
        np.testing.assert_allclose(np.diag(mass), want, rtol=1e-3)
        scale = np.sqrt(np.outer(want, want))
        assert np.abs((mass - np.diag(np.diag(mass))) / scale).max() < 1e-3  # balanced: nothing couples
    data.qpos[:] = 0.0
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    np.testing.assert_allclose(np.diag(full)[dofs], want, rtol=1e-12)


def test_forces_are_what_the_motors_give(machine, bare, cone):
    """Without transmission errors the joints' generalized force is gear · J dω/dt of the motors, from the motion of
    the drives.
    """
    still = bare(machine)
    for effect in machine.effects:
        still = still.with_effect(effect)  # friction acts on the motor, not on the joint
    plant = build(still)
    model = mjmodel.build_model(plant)
    _, time, _, sent, model, data = prepare(model, plant, cone(15, 10, (50, 20, 155), FEED), STEP)
    force, motor = np.empty((len(time), 5)), np.empty((len(time), 5))
    dofs = [model.joint(a).dofadr[0] for a in FIVE_AXIS.letters]
    callback.install()
    try:
        for k in range(len(time)):
            motor[k] = data.qpos[dofs]
            data.ctrl[:] = sent[min(k + 1, len(sent) - 1)]
            mujoco.mj_step(model, data)
            force[k] = data.qfrc_applied[dofs]
    finally:
        callback.uninstall()
    for i, a in enumerate(FIVE_AXIS.letters):
        axis = plant.axes[a]
        acceleration = (motor[2:, i] - 2 * motor[1:-1, i] + motor[:-2, i]) / STEP**2
        want = axis.gear * (axis.inertia * axis.gear * acceleration)
        got = force[1:-1, i]
        assert np.abs(want).max() > 0.1, a
        assert np.abs(got - want).max() < 1e-3 * np.abs(want).max(), a


def test_joints_stand_where_the_motors_are(m1, bare, cone):
    """With no effect at all the multibody model follows the drives to rounding."""
    s = simulate(bare(m1), [cone(15, 10, (50, 20, 155), FEED)])[0]
    load = AxesMotion(s.test).load(build(bare(m1)))
    assert np.abs(load - s.position).max() < 1e-12


# --- effects in plain Python ---


class WaveOfX(Effect):
    """5 µm wave of the X position, as a user would write it."""

    kind = "wave_of_x"
    subjects = ("X",)
    parameters = (
        Parameter("amplitude_um", "height", 0.0, 100.0, neutral=0.0, scale=1.0),
        Parameter("lead_mm", "length", 1.0, 1000.0),
    )
    title = "Wave of the X position"
    definition = "x + amplitude·sin(2π x/lead)"
    source = "test"
    signature = "as pitch_error.X"

    def position_error(self, motion):
        out = np.zeros_like(motion.position)
        out[:, 0] = self.si("amplitude_um") * np.sin(2 * np.pi * motion.position[:, 0] / self.si("lead_mm"))
        return out


class ByClock(WaveOfX):
    kind = "by_clock"
    parameters = (Parameter("amplitude_um", "height", 0.0, 100.0, neutral=0.0, scale=1.0),)

    def position_error(self, motion):
        out = np.zeros_like(motion.position)
        out[:, 1] = self.si("amplitude_um") * (1 - np.exp(-motion.clock / 60.0))
        return out


class Broken(ByClock):
    kind = "broken"

    def position_error(self, motion):
        return np.full_like(motion.position, np.nan)


class ByRates(ByClock):
    """Uses everything else that a motion tells: velocity, acceleration, time since a reversal."""

    kind = "by_rates"

    def position_error(self, motion):
        size = self.si("amplitude_um")
        out = np.zeros_like(motion.position)
        out[:, 0] = size * motion.velocity[:, 3]
        out[:, 1] = 0.1 * size * motion.acceleration[:, 4]
        out[:, 2] = size * np.exp(-motion.since_reversal[:, 0] / 0.05)
        return out


@pytest.fixture
def own_effects(monkeypatch):
    """The effects above, known for one test only."""
    registry.kinds()
    monkeypatch.setattr(registry, "_REGISTRY", dict(registry._REGISTRY))
    for cls in (WaveOfX, ByClock, ByRates, Broken):
        registry.register(cls)


def test_python_effect_equals_the_compiled_one(m1, own_effects, cone):
    test = cone(15, 10, (50, 20, 155), 12000, name="short", started=20.0)
    native = simulate(m1.with_effect(make("pitch_error.X", components=[[1, 5.0, 0.0]])), [test])[0]
    own = m1.with_effect(make("wave_of_x.X", amplitude_um=5.0, lead_mm=10.0))
    python = simulate(own, [test])[0]
    assert np.ptp(native.deviation - simulate(m1, [test])[0].deviation) > 3e-6
    assert np.abs(native.deviation - python.deviation).max() < 1e-10
    assert np.abs(AxesMotion(test).reading(build(own)) - python.deviation).max() < 1e-10
    again = simulate(own, [test])[0]
    assert identical(python, again)


def test_python_effect_sees_the_campaign_clock(m1, own_effects, cone):
    test = cone(15, 10, (50, 20, 155), 12000, name="short", started=20.0)
    native = simulate(m1.with_effect(make("thermal_drift.Y", amplitude_um=5.0, time_constant_s=60.0)), [test])[0]
    python = simulate(m1.with_effect(make("by_clock.X", amplitude_um=5.0)), [test])[0]
    assert np.abs(native.deviation - python.deviation).max() < 1e-10


def test_python_effect_sees_the_same_rates_either_way(m1, own_effects, cone):
    """Called once per step in MuJoCo, or once with the whole motion: the same numbers."""
    test = cone(15, 10, (50, 20, 155), 12000, name="short", sensitive="parallel")
    own = m1.with_effect(make("by_rates.X", amplitude_um=5.0))
    python = simulate(own, [test])[0]
    alone = AxesMotion(test)
    assert np.abs(alone.load(build(own)) - alone.load(build(m1))).max(axis=0)[:3].min() > 0.5e-6
    assert np.abs(alone.reading(build(own)) - python.deviation).max() < 1e-9


def test_neutral_python_effect_is_absent(m1, own_effects, cone):
    test = cone(15, 10, (50, 20, 155), 12000)
    assert identical(simulate(m1, [test])[0], simulate(m1.with_effect(make("by_clock.X", amplitude_um=0.0)), [test])[0])


def test_broken_python_effect_is_named(m1, own_effects, cone):
    with pytest.raises(SimulationError, match=r"broken\.X"):
        simulate(m1.with_effect(make("broken.X", amplitude_um=1.0)), [cone(15, 10, (50, 20, 155), 12000)])
    assert mujoco.get_mjcb_control() is None


def test_vibration_has_its_phase_in_every_test(m1, bare, cone):
    """amplitude·sin(ωt + φ), t from the program's start, φ the test's own, added to the axis last of all."""
    assert STAGES[-1] == "vibration"
    test = cone(15, 10, (50, 20, 155), 12000, started=33.0)
    wave = make("vibration.Y", amplitude_um=3.0, frequency_Hz=7.0)
    motion = AxesMotion(test)
    rigid = motion.load(build(bare(m1)))[:, 1]
    for phases, phase in (({}, 0.0), ({test.name: 0.4}, 0.4)):
        plant = build(bare(m1).with_effect(wave.with_phases(phases)))
        added = motion.load(plant)[:, 1] - rigid
        np.testing.assert_allclose(added, 3e-6 * np.sin(2 * np.pi * 7.0 * motion.time + phase), rtol=0, atol=1e-14)
        whole = simulate(bare(m1).with_effect(wave.with_phases(phases)), [test])[0]
        np.testing.assert_allclose(whole.position[:, 1] - rigid, added, rtol=0, atol=1e-10)


def test_shipped_discretisation():
    assert (STEP, SUBSTEPS) == (1e-3, 2)


def test_compiled_code_older_than_a_source_is_dropped(tmp_path):
    """A change of one module must reach the callback, which has that module's code compiled in."""
    from mjsim.simulation.cache import forget_stale_code

    cache = tmp_path / "__pycache__"
    cache.mkdir()
    for name, when in (("a.py", 100), ("b.py", 200), ("__pycache__/a.old.nbi", 150), ("__pycache__/a.new.nbi", 250)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (when, when))
    forget_stale_code(tmp_path, tmp_path)
    assert [p.name for p in cache.iterdir()] == ["a.new.nbi"]
