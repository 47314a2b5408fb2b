"""Machines with other axes than the shipped one: parsing, names, kinematics, drives and estimation ask the chain,
not the letters.
"""

from dataclasses import replace

import numpy as np
import pytest
from commands import with_b_axis

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.findings import explain
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import Projector
from mjsim.inference.testability import not_testable
from mjsim.inference.vibration import separate
from mjsim.instruments.ball_bar.kinds import KINDS, able_kinds
from mjsim.instruments.ball_bar.measurement import BallBarTest, Trace
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS, Chain, chain_of
from mjsim.machine.inverse import aim
from mjsim.machine.kinematics import Geometry, bar_vector, machine_to_work, reading, sensitivity, work_to_machine
from mjsim.machine.model import Machine, build
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.bar import reading as compiled
from mjsim.simulation.multibody import simulate
from mjsim.units import DEG

CHAINS = [chain_of(c) for c in ("w-C'B'X'bYZ-t", "w-C'B'Y'bXZ-t", "w-C'B'Z'bYX-t", "w-C'A'Y'bXZ-t")]
B = CHAINS[0]
BALL, LENGTH = np.array([0.083, -0.047, 0.155]), 0.1


def turn(axis, angle):
    """A homogeneous rotation about a coordinate axis, by Rodrigues' formula."""
    k = np.cross(np.eye(3), np.eye(3)["xyz".index(axis)])
    out = np.eye(4)
    out[:3, :3] = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
    return out


def shift(x, y, z):
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def b_machine() -> Machine:
    """The shipped example with its tilting axis renamed: the same drives on a machine that tilts about Y."""
    machine = read_machine(read_campaign(examples() / "healthy", traces=False).machine_file)
    drives = {a: replace(machine.drives["A" if a == "B" else a], axis=a) for a in B.letters}
    effects = tuple(type(e)("B" if e.subject == "A" else e.subject, **e.values) for e in machine.effects)
    return replace(machine, drives=drives, effects=effects, configuration=B.configuration)


def b_tests() -> list[BallBarTest]:
    cone = BallBarTest(
        "cone",
        "cone_frustum",
        (0.05, 0.02, 0.155),
        0.1,
        0.05,
        half_apex=15 * DEG,
        inclination=10 * DEG,
        setup="1",
        chain=B,
    )
    turned = BallBarTest(
        "tilt",
        "rotary",
        (0.02, 0.01, 0.155),
        0.1,
        0.02,
        sensitive="tangential",
        axis="B",
        start=-0.3,
        stop=1.2,
        chain=B,
    )
    return [cone, replace(cone, name="back", direction="CW"), turned]


def test_names_of_a_chain():
    assert B.letters == ("X", "Y", "Z", "B", "C") and B.linear == ("X", "Y", "Z") and B.rotary == ("B", "C")
    assert (B.round_axes, B.count, B.index("B")) == (("C",), 5, 3)
    assert B.columns[5:9] == ("EXC", "EYC", "EAC", "EBC")
    assert [e.name for e in B.location_errors] == ["EX0C", "EY0C", "EA0C", "EB0C", "EX0B", "EZ0B", "EA0B", "EC0B"]
    assert B.planes == ("XY", "YZ", "ZX") and B.straightness == FIVE_AXIS.straightness
    assert chain_of(B.configuration) is B and hash(B) != hash(FIVE_AXIS)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "w-C'A'Y'bXZ",
        "w-B'XYZ-t",
        "w-C'A'Y'bXX-t",
        "w-C'A'Y'bXZC-t",
        "w-C'A'Y'bXZB-t",
        "w-C'A'b-t",
        "YXY",
        "XAX",
        "w-C'A'bXYZU-t",
        "x" * 500,
    ],
)
def test_other_configurations_are_refused(text):
    with pytest.raises(InputError, match=r"configuration .* is unknown: .*; allowed: .*w-C'A'Y'bXZ-t") as error:
        chain_of(text)
    assert len(str(error.value)) < 320


@pytest.mark.parametrize(
    ("text", "letters", "planes", "kinds"),
    [
        ("X", ("X",), (), []),
        ("YX", ("X", "Y"), ("XY",), []),
        ("ZX", ("X", "Z"), ("ZX",), []),
        ("XYZ", ("X", "Y", "Z"), ("XY", "YZ", "ZX"), ["circular"]),
        ("w-X'Y'bZ-t", ("X", "Y", "Z"), ("XY", "YZ", "ZX"), ["circular"]),
        ("w-C'bXYZ-t", ("X", "Y", "Z", "C"), ("XY", "YZ", "ZX"), ["circular", "rotary"]),
        ("w-bXYZB-t", ("X", "Y", "Z", "B"), ("XY", "YZ", "ZX"), ["circular", "rotary"]),
        ("w-C'bXYZB-t", ("X", "Y", "Z", "B", "C"), ("XY", "YZ", "ZX"), ["circular", "cone_frustum", "rotary"]),
    ],
)
def test_chains_with_fewer_axes(text, letters, planes, kinds):
    chain = chain_of(text)
    assert chain.letters == letters and chain.planes == planes and chain.count == len(letters)
    assert {f"E{a}{b}" for a in chain.linear for b in chain.linear if a != b} == set(chain.straightness)
    assert sorted(set(able_kinds(chain)) & {"circular", "cone_frustum", "rotary"}) == kinds
    ids = registry.all_ids(chain)
    assert len(ids) == len(set(ids)) and f"friction.{letters[0]}" in ids
    assert not {i for i in ids for a in "ABCXYZ" if i.endswith(f".{a}") and a not in letters}


def test_a_machine_without_all_three_slides_runs_no_ball_bar_test(tmp_path):
    source = examples() / "healthy"
    drive = (source / "machine.toml").read_text().partition("[drive.X]")[2].partition("[")[0]
    (tmp_path / "machine.toml").write_text(f'name = "x"\nconfiguration = "X"\n[drive.X]{drive}')
    machine = read_machine(tmp_path / "machine.toml")
    assert machine.chain.letters == ("X",) and set(build(machine).axes) == {"X"}
    (tmp_path / "campaign.toml").write_text(
        'name = "x"\n[[test]]\nname = "t"\nkind = "circular"\ntable_ball_mm = [0, 0, 155]\nbar_length_mm = '
        '100\nfeed_mm_min = 1000\nplane = "XY"\ndirection = "CW"\n'
    )
    with pytest.raises(InputError, match=r"\[\[test\]\] \"t\": .*circular.*'X': it needs X, Y, Z.*no Y and no Z"):
        read_campaign(tmp_path)


@pytest.mark.parametrize("chain", CHAINS, ids=lambda c: c.configuration)
def test_the_reading_is_a_product_of_matrices(chain):
    """Every location error, squareness and error motion of the table at once, sizes at which the order of rotations
    counts.
    """
    rng = np.random.default_rng(3)
    location = {e.name: rng.normal(0, 4e-3) for e in chain.location_errors}
    square = {n: rng.normal(0, 4e-3) for n in ("XY", "YZ", "ZX")}
    q = rng.uniform(-1, 1, (50, 9)) * [0.3, 0.3, 0.3, 2.0, 2.0, 1e-3, 1e-3, 1e-3, 1e-3]
    e = location
    cradle = {
        "A": shift(0, e.get("EY0A", 0), e.get("EZ0A", 0)) @ turn("z", e.get("EC0A", 0)) @ turn("y", e.get("EB0A", 0)),
        "B": shift(e.get("EX0B", 0), 0, e.get("EZ0B", 0)) @ turn("z", e.get("EC0B", 0)) @ turn("x", e.get("EA0B", 0)),
    }[chain.turning[1].letter]
    table = shift(e["EX0C"], e["EY0C"], 0) @ turn("y", e["EB0C"]) @ turn("x", e["EA0C"])
    about = {"A": "x", "B": "y"}[chain.turning[1].letter]
    want = []
    for x, y, z, tilt, c, dx, dy, a, b in q:
        moved = turn("x", a) @ turn("y", b) @ shift(dx, dy, 0)
        ball = cradle @ turn(about, tilt) @ table @ moved @ turn("z", c) @ [*BALL, 1.0]
        spindle = np.array([x - square["XY"] * y + square["ZX"] * z, y - square["YZ"] * z, z])
        want.append(np.linalg.norm(spindle - ball[:3]) - LENGTH)
    geometry = Geometry(location, square)
    np.testing.assert_allclose(reading(chain, q, BALL, LENGTH, geometry), want, rtol=0, atol=1e-14)
    np.testing.assert_allclose(compiled(chain, q, BALL, LENGTH, geometry), want, rtol=0, atol=1e-14)


@pytest.mark.parametrize("chain", CHAINS, ids=lambda c: c.configuration)
def test_aim_and_back(chain):
    rng = np.random.default_rng(4)
    d = rng.normal(size=(500, 3)) + np.array([0, 0, 1])
    d /= np.linalg.norm(d, axis=1)[:, None]
    q = aim(chain, d)
    np.testing.assert_allclose(work_to_machine(chain, q, d), np.tile([0.0, 0.0, 1.0], (500, 1)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(machine_to_work(chain, q, work_to_machine(chain, q, d)), d, rtol=0, atol=1e-14)


@pytest.mark.parametrize("chain", CHAINS, ids=lambda c: c.configuration)
def test_sensitivity_is_the_derivative(chain):
    q = np.random.default_rng(5).uniform(-0.4, 0.4, (30, 5)) + np.array([0.2, 0.1, 0.3, 0, 0])
    s, h = sensitivity(chain, q, BALL), 1e-6
    for i in range(5):
        d = h * np.eye(5)[i]
        slope = (reading(chain, q + d, BALL, LENGTH) - reading(chain, q - d, BALL, LENGTH)) / (2 * h)
        np.testing.assert_allclose(s.axes[:, i], slope, rtol=0, atol=1e-8)
    for i in range(3):
        d = h * np.eye(3)[i]
        slope = (reading(chain, q, BALL + d, LENGTH) - reading(chain, q, BALL - d, LENGTH)) / (2 * h)
        np.testing.assert_allclose(s.table[:, i], slope, rtol=0, atol=1e-8)


@pytest.mark.parametrize("test", b_tests(), ids=lambda t: t.name)
def test_ideal_axes_keep_the_bars_length(test):
    kind = KINDS[test.kind]
    phi = np.linspace(-0.3, 1.2, 200) if test.kind == "rotary" else np.linspace(0.0, 4 * np.pi, 2000)
    q = kind.path(test, phi)
    assert np.abs(np.linalg.norm(bar_vector(B, q, np.array(test.table_ball)), axis=1) - test.length).max() < 1e-12
    assert np.ptp(q[:, B.index("B")]) > 0.3
    back = kind.angle(test, q) - phi
    assert np.abs(back - 2 * np.pi * np.round(back / (2 * np.pi))).max() < 1e-9


def test_the_catalogue_follows_the_chain():
    ids = set(registry.all_ids(B))
    assert {"backlash.B", "gravity_windup.B", "axis_location.EZ0B", "radial_error_motion.C", "worm_wear.B"} <= ids
    assert not {i for i in ids if i.endswith(".A") or i.endswith("0A")}
    with pytest.raises(InputError, match=r"backlash exists for: X, Y, Z, A, C"):
        registry.make("backlash.B", width_deg=0.002)
    with pytest.raises(InputError, match=r"effect backlash\.A: the machine has no A; allowed: X, Y, Z, B, C"):
        build(b_machine().with_effect(registry.make("backlash.A", width_deg=0.002)))


def test_a_planted_backlash_steps_where_its_axis_reverses():
    """The drives alone: the reading changes by the play times the bar's sensitivity to the axis, once the axis has
    reversed.
    """
    cone, machine = b_tests()[0], b_machine()
    width = 0.004 * DEG
    motion = AxesMotion(cone)
    plain, worn = build(machine), build(machine.with_effect(registry.make("backlash.B", B, width_deg=0.004)))
    difference = motion.load(worn) - motion.load(plain)
    others = [B.index(a) for a in B.letters if a != "B"]
    assert not difference[:, others].any()
    play = difference[:, B.index("B")]
    assert play.max() == pytest.approx(width / 2, rel=1e-6) and play.min() == pytest.approx(-width / 2, rel=1e-6)
    slope = motion.sensitivity(plain).axes[:, B.index("B")]
    np.testing.assert_allclose(motion.reading(worn) - motion.reading(plain), slope * play, rtol=0, atol=1e-9)


def measured(chain: Chain, machine: Machine, truth: Machine) -> Problem:
    """Two cones of one set-up on the axes' motion alone: ball 15 µm off its place, the recorder 11 ms late, 0.1 µm
    of white noise.
    """
    rng, traces, plant = np.random.default_rng(8), {}, build(truth)
    tests = tuple(replace(t, revolutions=2, chain=chain) for t in b_tests()[:2])
    for test in tests:
        motion = AxesMotion(test)
        ball = np.array(test.table_ball) + np.array([12e-6, -7e-6, 4e-6])
        exact = reading(chain, motion.load(plant), ball, test.length, plant.geometry) + 2e-6
        first, last = motion.program.measured_span
        time = np.arange(np.ceil(first / 0.005), np.floor(last / 0.005)) * 0.005
        noise = rng.normal(0.0, 0.1e-6, len(time))
        traces[test.name] = Trace(time, np.interp(time - 0.011, motion.time, exact) + noise, np.ones(len(time), bool))
    campaign = read_campaign(examples() / "healthy", traces=False)
    return checked_problem(replace(campaign, tests=tests, traces=traces), machine, threads=1)


def test_a_diagnosis_finds_the_backlash_of_another_axis():
    configuration = "w-C'B'X'bYZ-t"
    chain = chain_of(configuration)
    machine = replace(b_machine(), configuration=configuration)
    problem = measured(chain, machine, machine.with_effect(registry.make("backlash.B", chain, width_deg=0.0015)))
    separated = separate(problem, machine)
    assert not separated.lines
    selection = explain(separated, most=2).selection
    assert [f.key for f in selection.found] == ["backlash.B"] and not selection.found[0].alternatives
    (found,) = selection.fit.effects
    low, high = found.interval(found.vector, selection.fit.covariance_of(found))["width_deg"]
    assert low < 0.0015 < high and high - low < 1e-4
    hidden = not_testable(separated.problem, Projector(selection.start), selection.bank)
    assert "backlash.B" not in hidden and set(hidden) <= set(registry.all_ids(chain))


def test_tests_of_another_machine_are_refused():
    shipped = read_machine(read_campaign(examples() / "healthy", traces=False).machine_file)
    with pytest.raises(InputError, match=r"test cone: is of a machine with the configuration"):
        simulate(shipped, b_tests()[:1])


def test_the_drives_alone_give_what_the_bodies_give():
    """On a machine whose model is made of its chain."""
    machine = b_machine().with_effect(registry.make("backlash.B", B, width_deg=0.004))
    for one in simulate(machine, b_tests()[::2]):
        alone = AxesMotion(one.test).reading(build(machine))
        assert np.abs(alone - one.deviation).max() < 1e-8


def test_a_campaign_takes_the_axes_of_its_machine(tmp_path):
    """machine.toml says which axes there are; campaign.toml is read with them."""
    source = examples() / "healthy"
    (tmp_path / "machine.toml").write_text(with_b_axis((source / "machine.toml").read_text(), B.configuration))
    (tmp_path / "campaign.toml").write_text(
        'name = "b"\n[[test]]\nname = "t"\nkind = "rotary"\ntable_ball_mm = [20, 10, 155]\nbar_length_mm = '
        "100\nfeed_mm_min = 1000\n"
        'axis = "B"\nfrom_deg = -10\nto_deg = 60\nsensitive_direction = "radial"\n'
    )
    (test,) = read_campaign(tmp_path).tests
    assert (
        test.chain == B and test.axis == "B" and set(read_machine(tmp_path / "machine.toml").drives) == set(B.letters)
    )
    (tmp_path / "machine.toml").write_text((source / "machine.toml").read_text())
    with pytest.raises(InputError, match=r"axis = 'B'; allowed: 'A' or 'C'"):
        read_campaign(tmp_path)
