"""The contract that every effect keeps, and the quasi-static effects against their definitions written out."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from motions import load

from mjsim.campaign.machine_file import read_machine, write_machine
from mjsim.effects import registry
from mjsim.effects.registry import make
from mjsim.errors import InputError
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS, chain_of
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.model import build
from mjsim.machine.temperatures import Temperatures
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.multibody import simulate

DEG, UM = math.pi / 180.0, 1e-6
IDS = registry.all_ids()
SENSOR = "spindle nose"
#: Functional points that no ball is in line with: an angular error needs an arm to be seen.
AWAY = tuple((a, (0.1, -0.2, 0.15)) for a in FIVE_AXIS.linear)


def typical(effect_id, off=False, direction=None):
    """Values that switch the effect on (or off), everything else at its default or at a plausible number."""
    cls, subject = registry.effect_class(effect_id)
    values = {}
    for p in cls.parameters_of(subject):
        if p.kind == "choice":
            if direction:
                values[p.name] = direction
        elif p.kind == "sensor":
            values[p.name] = SENSOR
        elif p.kind == "components":
            values[p.name] = [] if off else [[7.0, p.scale, 30.0], [20.5, -0.5 * p.scale, -170.0]]
        elif p.neutral is not None:
            on = p.decode(p.encode(p.neutral) + 1.0)
            values[p.name] = p.neutral if off else float(f"{on:.12g}")  # as files have it
        elif p.default is None:
            values[p.name] = min(p.upper, max(p.lower, 3.0 * p.scale))
    return values


@pytest.fixture(scope="module")
def short(cone):
    """A fast cone test that moves all five axes, reverses four of them and sees Z."""
    test = cone(15, 10, (60, 30, 155), feed=20000, sensitive="parallel", name="short", started=40.0)
    return replace(test, chain=chain_of(FIVE_AXIS.configuration, functional_points=AWAY))


@pytest.fixture(scope="module")
def empty(m1, bare):
    warming = Temperatures(np.array([0.0, 300.0]), (SENSOR,), np.array([[20.0], [21.0]]))
    return replace(bare(m1), functional_points=AWAY, temperatures=warming)


@pytest.fixture(scope="module")
def absent(empty, short):
    return simulate(empty, [short])[0]


@pytest.fixture(scope="module")
def simulated(empty, short):
    """``simulated(effect_id)``: the short test with that effect on at its typical size."""
    return cache(lambda effect_id: simulate(empty.with_effect(make(effect_id, **typical(effect_id))), [short])[0])


def same(a, b):
    return np.array_equal(a.deviation, b.deviation) and np.array_equal(a.position, b.position)


# --- the contract ---


@pytest.mark.parametrize("effect_id", IDS)
def test_neutral_is_absent(effect_id, empty, short, absent):
    effect = make(effect_id, **typical(effect_id, off=True))
    assert effect.is_neutral
    assert same(simulate(empty.with_effect(effect), [short])[0], absent)


@pytest.mark.parametrize("effect_id", IDS)
def test_on_does_something_and_the_same_every_time(effect_id, empty, short, absent, simulated):
    effect = make(effect_id, **typical(effect_id))
    assert not effect.is_neutral
    first = simulated(effect_id)
    assert same(first, simulate(empty.with_effect(effect), [short])[0])
    assert np.abs(first.deviation - absent.deviation).max() > 1e-9
    assert np.abs(first.deviation - absent.deviation).max() < 1e-3  # a typical size is no disaster


@pytest.mark.parametrize("effect_id", [f"pitch_error.{a}" for a in FIVE_AXIS.rotary])
@pytest.mark.parametrize("direction", ["CW", "CCW"])
def test_zero_amplitudes_are_absent(effect_id, direction, empty, short, absent):
    effect = make(effect_id, components=[[60, 0.0, 10.0], [3, 0.0, 0.0]], direction=direction)
    assert effect.is_neutral and effect.key == f"{effect_id}[{direction}]"
    assert same(simulate(empty.with_effect(effect), [short])[0], absent)


@pytest.mark.parametrize("kind", registry.kinds())
def test_metadata(kind):
    cls = registry.kinds()[kind]
    assert cls.kind == kind and kind.isidentifier()
    subjects = cls.subjects_of(FIVE_AXIS)
    for text in (cls.title, cls.definition, cls.source, cls.signature):
        assert isinstance(text, str) and len(text.strip()) > 5
    assert len(set(subjects)) == len(subjects) > 0
    for subject in subjects:
        parameters = cls.parameters_of(subject)
        assert any(p.leading for p in parameters)
        names = [p.name for p in parameters]
        assert len(set(names)) == len(names)
        assert set(cls.search.free_of(parameters)) <= set(names) and cls.search.free_of(parameters)
        for p in parameters:
            assert p.meaning and p.scale > 0 and p.lower < p.upper
            for value in (p.neutral, p.default):
                if value is not None and p.kind == "number":
                    assert p.lower <= value <= p.upper
            if p.kind == "choice":
                assert p.choices
            if not p.leading and p.kind == "number" and p.default is None:
                assert p.lower < p.upper  # required: the file must give it
        for seed in cls.search.seeds_of(parameters, subject, FIVE_AXIS):
            known = {n: v for n, v in typical(f"{kind}.{subject}").items() if n not in seed}
            assert isinstance(cls(subject, **known, **seed), cls)  # every seed is an allowed value


@pytest.mark.parametrize("effect_id", IDS)
def test_file_round_trip(effect_id, m1, bare, tmp_path):
    """Added to a commented machine file: values come back, comments and order stay; taken out again: the text is as
    before.
    """
    source = tmp_path / "machine.toml"
    text = (examples() / "hidden-backlash" / "machine.toml").read_text()
    text = text.replace("[drive.X]", "[drive.X]  # new motor").replace(
        'id = "friction.Y"', 'id = "friction.Y" # measured'
    )
    text = "# bought in 2009\n" + text
    source.write_text(text)
    machine = read_machine(source)
    effect = make(effect_id, **typical(effect_id))
    target = tmp_path / "with.toml"
    write_machine(machine.with_effect(effect), source, target)
    written, back = target.read_text(), read_machine(target)
    for comment in ("# bought in 2009", "# new motor", "# measured"):
        assert comment in written
    assert back.effect(effect.key).values == effect.values
    assert len(back.effects) == len(machine.effects) + (machine.effect(effect.key) is None)
    for other in machine.effects:
        if other.key != effect.key:
            assert back.effect(other.key).values == other.values
    assert back.drives == machine.drives
    if machine.effect(effect.key) is None:
        assert written.startswith(text.rstrip())
        write_machine(back.without(effect.key), target, tmp_path / "without.toml")
        assert (tmp_path / "without.toml").read_text().rstrip() == text.rstrip()


def test_file_round_trip_of_directions(tmp_path, m1):
    source = examples() / "hidden-backlash" / "machine.toml"
    both = m1.with_effect(make("pitch_error.A", components=[[60, 0.001, 5.0]], direction="CW"))
    both = both.with_effect(make("pitch_error.A", components=[[60, 0.002, 7.0]], direction="CCW"))
    write_machine(both, source, tmp_path / "both.toml")
    back = read_machine(tmp_path / "both.toml")
    assert back.effect("pitch_error.A[CW]").values["components"] == [[60.0, 0.001, 5.0]]
    assert back.effect("pitch_error.A[CCW]").values["components"] == [[60.0, 0.002, 7.0]]


def bad_values(p):
    if p.kind != "sensor":
        yield "text"
    yield True
    yield float("nan")
    if p.kind == "number":
        yield [1.0]
        yield p.lower - max(1.0, abs(p.lower))
        if p.upper < math.inf:  # a stiffness may be infinite
            yield p.upper + max(1.0, abs(p.upper))
            yield float("inf")
    elif p.kind == "choice":
        yield 1.0
    elif p.kind == "sensor":
        yield 3.0
        yield ""
        yield "nose]"
    else:
        yield 3.0
        yield [[1.0, 2.0]]
        yield [[1, p.upper * 1.01, 0.0]]
        yield [[0.0, 0.0, 0.0]]
        yield [[2001.0, 0.0, 0.0]]
        yield [[1.0, float("nan"), 0.0]]
        yield [[1.0, 0.0, float("inf")]]
        yield [[1.0, "x", 0.0]]
        yield [[True, 0.0, 0.0]]


@pytest.mark.parametrize("effect_id", IDS)
def test_bad_values_are_named(effect_id):
    cls, subject = registry.effect_class(effect_id)
    good = typical(effect_id)
    for p in cls.parameters_of(subject):
        for value in bad_values(p):
            with pytest.raises(InputError) as error:
                make(effect_id, **{**good, p.name: value})
            assert effect_id in str(error.value), (p.name, value)
            if p.kind != "components":
                assert p.name in str(error.value), (p.name, value)
    with pytest.raises(InputError, match="colour") as error:
        make(effect_id, **good, colour=1.0)
    assert effect_id in str(error.value)
    for p in cls.parameters_of(subject):
        if p.default is None and p.kind != "choice":
            with pytest.raises(InputError) as error:
                make(effect_id, **{k: v for k, v in good.items() if k != p.name})
            assert effect_id in str(error.value) and p.name in str(error.value)


@pytest.mark.parametrize("effect_id", IDS)
def test_bounds_are_inside(effect_id):
    cls, subject = registry.effect_class(effect_id)
    good = typical(effect_id)
    for p in cls.parameters_of(subject):
        if p.kind == "number":
            for value in (p.lower, p.upper):
                assert make(effect_id, **{**good, p.name: value}).values[p.name] == value


def test_errors_in_a_file_name_the_file_and_the_entry(tmp_path):
    text = (examples() / "hidden-backlash" / "machine.toml").read_text()
    file = tmp_path / "machine.toml"
    for entry, said in (
        ('id = "backlash.A"\nwidth_deg = 7.0', "out of bounds"),
        ('id = "backlash.A"\nwidth_um = 7.0', "unknown parameter"),
        ('id = "backlash.A"', "missing"),
        ('id = "backlash.B"\nwidth_deg = 0.1', "exists for: X, Y, Z, A, C"),
        ('id = "slop.A"\nwidth_deg = 0.1', "known kinds"),
        ('id = "backlsh.A"\nwidth_deg = 0.1', r"did you mean 'backlash'\?"),
        ("width_deg = 0.1", "'id' is missing"),
        ('id = "friction.X"\ncoulomb_Nm = 1.0', "appears twice"),
    ):
        file.write_text(f"{text}\n[[effect]]\n{entry}\n")
        with pytest.raises(InputError, match=said) as error:
            read_machine(file)
        assert str(file) in str(error.value)


def test_unknown_subject_of_a_class():
    with pytest.raises(InputError, match="allowed: A"):
        registry.kinds()["gravity_windup"]("X", amplitude_deg=0.0)


def test_clashing_kinds_are_refused(monkeypatch):
    monkeypatch.setattr(registry, "_REGISTRY", dict(registry._REGISTRY))
    original = registry.kinds()["backlash"]
    with pytest.raises(InputError, match="already taken"):
        registry.register(type("Other", (original,), {"__module__": "elsewhere"}))
    with pytest.raises(InputError, match="definition"):
        registry.register(
            type("Nameless", (Effect,), {"kind": "nameless", "subjects": ("X",), "parameters": (), "title": "t"})
        )


def test_the_catalogue_holds_what_is_required():
    """Kinds and subjects of the effect catalogue."""
    have = {k: set(c.subjects_of(FIVE_AXIS)) for k, c in registry.kinds().items()}
    every, linear, rotary = set(FIVE_AXIS.letters), set(FIVE_AXIS.linear), set(FIVE_AXIS.rotary)
    required = {
        "friction": every, "viscous_friction": every, "servo_gain": every, "velocity_gain": every, "servo_delay": every,
        "torque_ripple": every, "velocity_feedforward": every, "backlash": every, "pitch_error": every,
        "worm_wear": rotary,
        "gravity_windup": {"A"}, "scale_error": linear, "thermal_drift": linear, "squareness": {"XY", "YZ", "ZX"},
        "straightness": {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}, "radial_error_motion": {"C"},
        "tilt_error_motion": {"C"}, "axial_error_motion": rotary,
        "angular_error": {f"E{about}{a}" for about in "ABC" for a in linear},
        "vibration": linear, "drive_compliance": every,
        "axis_location": {"EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A"},
    }  # fmt: skip
    for kind, subjects in required.items():
        assert subjects <= have.get(kind, set()), kind


def test_units_come_from_the_names():
    effect = make("worm_wear.A", depth_deg=0.001, centre_deg=20.0, width_deg=5.0)
    assert effect.si("depth_deg") == pytest.approx(0.001 * DEG)
    assert make("scale_error.X", ppm=30.0).si("ppm") == pytest.approx(30e-6)
    assert make("servo_delay.X", delay_ms=2.0).si("delay_ms") == pytest.approx(2e-3)
    assert Parameter("speed_rad_per_s", "").unit == "rad/s" and Parameter("ratio", "").unit == ""


# --- definitions ---


@pytest.fixture(scope="module")
def motion(cone):
    """A whole cone test, two turns (C passes 360°), late on the campaign clock."""
    return AxesMotion(cone(45, 30, (60, 30, 155), feed=8000, sensitive="parallel", revolutions=2, started=400.0))


@pytest.fixture(scope="module")
def motor(motion, m1):
    """The motors' own positions, with friction: what the transmission starts from."""
    return motion.load(build(m1))


def only(got, motor, axis, limit=1e-15):
    """The axis' change; the other axes must not have moved."""
    k = FIVE_AXIS.columns.index(axis)
    rest = [i for i in range(5) if i != k]
    np.testing.assert_array_equal(got[:, rest], motor[:, rest])
    return got[:, k]


def play(x, width):
    y = np.empty_like(x)
    y[0] = x[0]
    for i in range(1, len(x)):
        y[i] = y[i - 1]
        if y[i] < x[i] - width / 2:
            y[i] = x[i] - width / 2
        if y[i] > x[i] + width / 2:
            y[i] = x[i] + width / 2
    return y


@pytest.mark.parametrize("axis", FIVE_AXIS.letters)
def test_backlash(motion, motor, m1, axis):
    values = {"width_deg": 0.004} if FIVE_AXIS.is_rotary(axis) else {"width_um": 6.0}
    width = 0.004 * DEG if FIVE_AXIS.is_rotary(axis) else 6.0 * UM
    x = motor[:, FIVE_AXIS.columns.index(axis)]
    y = only(load(motion, m1, make(f"backlash.{axis}", **values)), motor, axis)
    np.testing.assert_allclose(y, play(x, width), rtol=0, atol=1e-15)
    assert np.abs(y - x).max() == pytest.approx(width / 2)
    assert y[0] == x[0]  # starts centred


@pytest.mark.parametrize("axis", FIVE_AXIS.letters)
def test_pitch_error(motion, motor, m1, axis):
    components = (
        [[60.0, 0.0021, 20.0], [328.0, -0.0007, 200.0]]
        if FIVE_AXIS.is_rotary(axis)
        else [[1.0, 3.0, 20.0], [2.5, 1.0, -40.0]]
    )
    x = motor[:, FIVE_AXIS.columns.index(axis)]
    y = only(load(motion, m1, make(f"pitch_error.{axis}", components=components)), motor, axis)
    unit, turn = (DEG, 1.0) if FIVE_AXIS.is_rotary(axis) else (UM, 2 * np.pi / 0.010)
    want = x + sum(w * unit * np.sin(n * turn * x + p * DEG) for n, w, p in components)
    np.testing.assert_allclose(y, want, rtol=0, atol=1e-14)


def share(x, sign, blend=0.05 * DEG):
    """How much of a one-way error acts: it follows the travel like a play of the blending's width, from none at the
    start.
    """
    low = np.empty_like(x)
    low[0] = x[0] if sign > 0 else x[0] - blend  # the window [low, low + blend] that x pushes along
    for i in range(1, len(x)):
        low[i] = min(max(low[i - 1], x[i] - blend), x[i])
    part = (x - low) / blend
    return part if sign > 0 else 1 - part


@pytest.mark.parametrize("direction", ["CW", "CCW"])
def test_pitch_error_of_one_direction(motion, motor, m1, direction):
    sign = 1 if direction == "CCW" else -1
    x = motor[:, FIVE_AXIS.columns.index("A")]
    y = only(
        load(motion, m1, make("pitch_error.A", components=[[60, 0.002, 20.0], [10, 0.001, 0.0]], direction=direction)),
        motor,
        "A",
    )
    want = x + share(x, sign) * (0.002 * np.sin(60 * x + 20 * DEG) + 0.001 * np.sin(10 * x)) * DEG
    np.testing.assert_allclose(y, want, rtol=0, atol=1e-14)
    # one degree past every reversal it is all there, or gone
    v = np.gradient(x)
    settled = np.array(
        [np.all(np.sign(v[max(0, i - 400) : i + 1]) == np.sign(v[i])) and i > 400 for i in range(len(x))]
    )
    settled &= np.abs(x - np.roll(x, 400)) > 0.06 * DEG
    on = settled & (np.sign(v) == sign)
    off = settled & (np.sign(v) == -sign)
    assert on.sum() > 500 and off.sum() > 500
    np.testing.assert_array_equal(y[off], x[off])
    full = only(load(motion, m1, make("pitch_error.A", components=[[60, 0.002, 20.0], [10, 0.001, 0.0]])), motor, "A")
    np.testing.assert_allclose(y[on], full[on], rtol=0, atol=1e-15)


def test_both_directions_add_up(motion, motor, m1):
    """CW and CCW sets of the same components give the undirected error wherever one of them is fully on."""
    rows = [[60, 0.002, 20.0]]
    one = [make("pitch_error.A", components=rows, direction=d) for d in ("CW", "CCW")]
    both, plain = load(motion, m1, *one), load(motion, m1, make("pitch_error.A", components=rows))
    started = np.abs(motor[:, 3] - motor[0, 3]) > 0.05 * DEG
    first = int(np.argmax(started))
    np.testing.assert_allclose(both[first:], plain[first:], rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("axis", "centre", "width"), [("A", 30.0, 4.0), ("C", 140.0, 9.0), ("C", -350.0, 20.0), ("C", 0.0, 90.0)]
)
def test_worm_wear(motion, motor, m1, axis, centre, width):
    x = motor[:, FIVE_AXIS.columns.index(axis)]
    y = only(
        load(motion, m1, make(f"worm_wear.{axis}", depth_deg=0.003, centre_deg=centre, width_deg=width)), motor, axis
    )
    d = np.angle(np.exp(1j * (x - centre * DEG)))
    np.testing.assert_allclose(y, x - 0.003 * DEG * np.exp(-0.5 * (d / (width * DEG)) ** 2), rtol=0, atol=1e-13)
    if axis == "C":
        assert np.ptp(x) > 4 * np.pi  # it came by more than once


@pytest.mark.parametrize("axis", FIVE_AXIS.linear)
def test_scale_error(motion, motor, m1, axis):
    y = only(load(motion, m1, make(f"scale_error.{axis}", ppm=120.0)), motor, axis)
    np.testing.assert_allclose(y, motor[:, FIVE_AXIS.columns.index(axis)] * (1 + 120e-6), rtol=0, atol=1e-16)


def test_gravity_windup(motion, motor, m1):
    y = only(load(motion, m1, make("gravity_windup.A", amplitude_deg=0.004, phase_deg=25.0)), motor, "A")
    np.testing.assert_allclose(y, motor[:, 3] + 0.004 * DEG * np.sin(motor[:, 3] + 25 * DEG), rtol=0, atol=1e-15)


@pytest.mark.parametrize("subject", ["EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"])
def test_straightness(motion, motor, m1, subject):
    y = only(load(motion, m1, make(f"straightness.{subject}", quadratic_um=3.0, cubic_um=-5.0)), motor, subject[1])
    u = motor[:, FIVE_AXIS.columns.index(subject[2])] / 0.1
    np.testing.assert_allclose(
        y, motor[:, FIVE_AXIS.columns.index(subject[1])] + (3.0 * u**2 - 5.0 * u**3) * UM, rtol=0, atol=1e-16
    )


@pytest.mark.parametrize("axis", FIVE_AXIS.linear)
def test_thermal_drift(motion, motor, m1, axis):
    y = only(load(motion, m1, make(f"thermal_drift.{axis}", amplitude_um=-9.0, time_constant_s=300.0)), motor, axis)
    clock = 400.0 + motion.time
    np.testing.assert_allclose(
        y, motor[:, FIVE_AXIS.columns.index(axis)] - 9.0 * UM * (1 - np.exp(-clock / 300.0)), rtol=0, atol=1e-16
    )


@pytest.mark.parametrize(
    ("kind", "value", "columns"), [("radial", {"amplitude_um": 4.0}, (5, 6)), ("tilt", {"amplitude_urad": 4.0}, (7, 8))]
)
def test_error_motion_of_the_table(motion, motor, m1, kind, value, columns):
    got = load(motion, m1, make(f"{kind}_error_motion.C", order=-3.0, phase_deg=50.0, **value))
    np.testing.assert_array_equal(got[:, :5], motor)
    angle = -3.0 * motor[:, 4] + 50 * DEG
    np.testing.assert_allclose(got[:, columns[0]], 4e-6 * np.cos(angle), rtol=0, atol=1e-18)
    np.testing.assert_allclose(got[:, columns[1]], 4e-6 * np.sin(angle), rtol=0, atol=1e-18)
    assert not np.delete(got[:, 5:], [c - 5 for c in columns], axis=1).any()


def test_order_of_the_position_effects(motion, motor, m1):
    """Pitch error, wear, backlash, scale, wind-up, straightness, drift: each acts on what the one before it left."""
    effects = [
        make("thermal_drift.X", amplitude_um=9.0, time_constant_s=300.0),
        make("straightness.EYX", quadratic_um=3.0),
        make("gravity_windup.A", amplitude_deg=0.1, phase_deg=25.0),
        make("scale_error.X", ppm=2000.0),
        make("backlash.X", width_um=500.0),
        make("backlash.A", width_deg=0.3),
        make("worm_wear.A", depth_deg=0.1, centre_deg=30.0, width_deg=4.0),
        make("pitch_error.A", components=[[60, 0.2, 0.0]]),
        make("pitch_error.X", components=[[1, 300.0, 0.0]]),
    ]
    got = load(motion, m1, *effects)
    np.testing.assert_array_equal(got, load(motion, m1, *effects[::-1]))  # the file's order does not matter
    x, a = motor[:, 0], motor[:, 3]
    x = x + 300 * UM * np.sin(2 * np.pi * x / 0.010)
    x = play(x, 500 * UM)
    x = x * (1 + 2000e-6)
    a = a + 0.2 * DEG * np.sin(60 * a)
    a = a - 0.1 * DEG * np.exp(-0.5 * ((a - 30 * DEG) / (4 * DEG)) ** 2)
    a = play(a, 0.3 * DEG)
    a = a + 0.1 * DEG * np.sin(a + 25 * DEG)
    np.testing.assert_allclose(got[:, 1], motor[:, 1] + 3 * UM * (x / 0.1) ** 2, rtol=0, atol=1e-15)
    np.testing.assert_allclose(got[:, 3], a, rtol=0, atol=1e-12)
    np.testing.assert_allclose(got[:, 0], x + 9 * UM * (1 - np.exp(-(400.0 + motion.time) / 300.0)), rtol=0, atol=1e-13)


# --- effects on the drive ---


@pytest.mark.parametrize("axis", FIVE_AXIS.letters)
@pytest.mark.parametrize(
    ("kind", "attribute"),
    [("servo_gain", "position_gain"), ("velocity_gain", "velocity_gain"), ("viscous_friction", "viscous")],
)
def test_ratios_change_the_drive(motion, m1, axis, kind, attribute):
    """The effect is bit-identical to a machine file that has the changed number."""
    changed = m1.with_drive(axis, **{attribute: getattr(m1.drives[axis], attribute) * 1.25})
    np.testing.assert_array_equal(load(motion, m1, make(f"{kind}.{axis}", ratio=1.25)), load(motion, changed))


@pytest.mark.parametrize("axis", FIVE_AXIS.letters)
@pytest.mark.parametrize("delay", [-3.0, 2.0])
def test_servo_delay(motion, motor, m1, axis, delay):
    """By whole steps the axis' whole motion is shifted by so many samples; the other axes do not care."""
    y = only(load(motion, m1, make(f"servo_delay.{axis}", delay_ms=delay)), motor, axis)
    x, n = motor[:, FIVE_AXIS.columns.index(axis)], int(delay)
    limit = 1e-9 * (
        0.1 if axis in FIVE_AXIS.linear else 1.0
    )  # the start from rest lies between two samples of a parabola
    if n > 0:
        np.testing.assert_allclose(y[n:], x[:-n], rtol=0, atol=limit)
    else:
        away = slice(2000, -2000)  # earlier than the program's start it is on its way already
        np.testing.assert_allclose(y[:n][away], x[-n:][away], rtol=0, atol=1e-8)


@pytest.mark.parametrize("axis", FIVE_AXIS.letters)
def test_friction_reaches_the_drive(empty, axis):
    effect = make(
        f"friction.{axis}", coulomb_Nm=0.7, presliding_rad=0.004, static_ratio=1.3, stribeck_velocity_rad_per_s=2.0
    )
    plant = build(empty.with_effect(effect))
    a = plant.axes[axis]
    assert (a.coulomb, a.presliding, a.static_ratio, a.stribeck_velocity) == (0.7, 0.004, 1.3, 2.0)
    assert all(plant.axes[b] == build(empty).axes[b] for b in FIVE_AXIS.letters if b != axis)


@pytest.mark.parametrize("axis", FIVE_AXIS.letters)
def test_ripple_and_feedforward_reach_the_drive(empty, axis):
    plant = build(empty.with_effect(make(f"torque_ripple.{axis}", amplitude_Nm=0.2, order=6.0, phase_deg=30.0)))
    assert plant.axes[axis] == replace(build(empty).axes[axis], ripple=(0.2, 6.0, 30.0 * DEG))
    plant = build(empty.with_effect(make(f"velocity_feedforward.{axis}", ratio=0.4)))
    assert plant.axes[axis] == replace(build(empty).axes[axis], feedforward=0.4)


def test_stribeck_is_off_at_a_static_ratio_of_one(motion, m1):
    plain = load(motion, m1)
    same_level = make(
        "friction.X", coulomb_Nm=1.0, presliding_rad=0.003, static_ratio=1.0, stribeck_velocity_rad_per_s=5.0
    )
    np.testing.assert_array_equal(plain, load(motion, m1, same_level))
