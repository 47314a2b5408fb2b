"""Machines of any chain against an independent closed form: products of exponentials in 4 x 4 matrices, from the
configuration text alone (``independent/chains.py``).
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from independent.chains import Kinematics

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.errors import InputError
from mjsim.machine.chain import Placement, chain_of
from mjsim.machine.inverse import linear_positions, pose, solutions
from mjsim.machine.kinematics import Geometry, reading, sensitivity, spindle_in_work, tool_direction
from mjsim.machine.model import Drive, Machine, build
from mjsim.machine.plant import Op
from mjsim.machine.redundant import visible_orders
from mjsim.simulation import mjmodel
from mjsim.simulation.bar import reading as compiled

NUTATING = (("B", Placement((0.0, 1.0, 1.0))),)
OFFSET = (("A", Placement(None, (0.0, 0.03, -0.05))), ("C", Placement(None, (0.004, -0.02, 0.0))))
PIVOT = (("B", Placement(None, (0.01, 0, 0.02))),)
#: Configuration, placements, tool length: table-table, head-table, head-head, nutating, fewer axes, slides on tables.
MACHINES = [
    ("w-C'A'Y'bXZ-t", (), None), ("w-C'B'X'bYZ-t", (), None), ("w-C'A'X'Y'bZ-t", (), None), ("w-C'B'bXYZ-t", (), None),
    ("w-C'A'Z'bXY-t", OFFSET, None), ("w-A'C'Y'bXZ-t", (), None), ("w-B'A'Y'bXZ-t", (), None),
    ("w-C'X'bYZB-t", (), 0.2), ("w-C'bXYZA-t", (), 0.25), ("w-C'Y'bXZB-t", PIVOT, None),
    ("w-A'bXYZB-t", (), 0.3),
    ("w-bXYZCA-t", (), 0.25), ("w-X'bYZCB-t", OFFSET[1:], 0.4), ("w-X'Y'bZAB-t", (), 0.25),
    ("w-C'B'Y'bXZ-t", NUTATING, None), ("w-C'bXYZB-t", NUTATING, 0.25), ("w-bXYZCB-t", NUTATING, 0.25),
    ("w-X'Y'bZ-t", (), None), ("w-C'bXYZ-t", (), None), ("w-bXYZB-t", (), 0.25),
    ("w-X'C'bYZA-t", (), 0.25), ("w-C'bXYBZ-t", (), 0.25),
]  # fmt: skip
CHAINS = [chain_of(*m) for m in MACHINES]
FIVE = [c for c in CHAINS if len(c.rotary) == 2 and not c.idle]
BALL, LENGTH = np.array([0.083, -0.047, 0.155]), 0.1


def named(chain):
    return chain.configuration + ("*" if any(a.tilted or any(a.point) for a in chain.axes) else "")


def oracle(machine, location=None, square=None):
    """The machine's closed form, from its configuration text."""
    text, placements, length = machine
    directions = {a: p.direction for a, p in placements if p.direction is not None}
    offsets = {a: p.offset for a, p in placements}
    return Kinematics(text, directions, offsets, 0.25 if length is None else length, location, square)


def amounts(chain, n, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, (n, len(chain.columns))) * 2e-3
    q[:, chain.linear_columns] = rng.uniform(-0.3, 0.3, (n, 3))
    q[:, chain.rotary_columns] = rng.uniform(-2.5, 2.5, (n, len(chain.rotary)))
    return q


def errors(chain, seed, size=4e-3):
    rng = np.random.default_rng(seed)
    return {e.name: rng.normal(0, size) for e in chain.location_errors}, {s: rng.normal(0, size) for s in chain.planes}


def wanted(machine, chain, q, location=None, square=None, ball=BALL):
    values = dict(zip(chain.columns, q.T, strict=False))
    motion = {name: values[name] for name in chain.columns[chain.count : q.shape[1]]}
    return np.linalg.norm(oracle(machine, location, square).bar(values, motion, ball), axis=1) - LENGTH


def drives(chain):
    linear = Drive("", 628.3, 45.0, 4.0, 0.012, 0.012, 0.01)
    rotary = Drive("", 72.0, 45.0, 1.5, 0.012, 0.004, 0.004)
    return {a: replace(rotary if chain.is_rotary(a) else linear, axis=a) for a in chain.letters}


def machine_of(machine, chain):
    return Machine("m", drives(chain), configuration=machine[0], placements=machine[1], tool_length=machine[2])


PAIRS = list(zip(MACHINES, CHAINS, strict=True))
EACH = pytest.mark.parametrize(("machine", "chain"), PAIRS, ids=[named(c) for c in CHAINS])
EACH_FIVE = pytest.mark.parametrize("chain", FIVE, ids=named)


@EACH
def test_the_reading_is_a_product_of_exponentials(machine, chain):
    """All location errors, squareness and error motions at once, sizes at which the order of rotations counts."""
    q = amounts(chain, 1000, 3)
    location, square = errors(chain, 4)
    want, geometry = wanted(machine, chain, q, location, square), Geometry(location, square)
    np.testing.assert_allclose(reading(chain, q, BALL, LENGTH, geometry), want, rtol=0, atol=1e-13)
    np.testing.assert_allclose(compiled(chain, q, BALL, LENGTH, geometry), want, rtol=0, atol=1e-13)


@EACH
def test_mujoco_agrees_with_the_product_of_exponentials(machine, chain):
    """1000 poses, all geometric errors at once, every body and joint of the model."""
    q = amounts(chain, 1000, 5)
    location, square = errors(chain, 6)
    plant = build(machine_of(machine, chain))
    plant.geometry.location.update(location)
    plant.geometry.squareness.update(square)
    plant.ops = [Op(0, 0, len(chain.columns) - 1, 0, ())]  # so that every error motion has its joint
    assert plant.width == len(chain.columns)
    model = mjmodel.build_model(plant)
    model.body("table_fixture").pos[:] = BALL
    data, got = mujoco.MjData(model), []
    at = [model.joint(n).qposadr[0] for n in chain.columns]
    ends = model.site("spindle_ball").id, model.site("table_ball").id
    for row in q:
        data.qpos[at] = row
        mujoco.mj_kinematics(model, data)
        got.append(np.linalg.norm(data.site_xpos[ends[0]] - data.site_xpos[ends[1]]) - LENGTH)
    np.testing.assert_allclose(got, wanted(machine, chain, q, location, square), rtol=0, atol=1e-12)


@EACH
def test_sensitivity_is_the_derivative_on_any_machine(machine, chain):
    q, h = amounts(chain, 40, 7)[:, : chain.count], 1e-6
    s = sensitivity(chain, q, BALL)
    for i in range(chain.count):
        d = h * np.eye(chain.count)[i]
        slope = (wanted(machine, chain, q + d) - wanted(machine, chain, q - d)) / (2 * h)
        np.testing.assert_allclose(s.axes[:, i], slope, rtol=0, atol=1e-8)
    for i in range(3):
        d = h * np.eye(3)[i]
        slope = (wanted(machine, chain, q, ball=BALL + d) - wanted(machine, chain, q, ball=BALL - d)) / (2 * h)
        np.testing.assert_allclose(s.table[:, i], slope, rtol=0, atol=1e-8)


@EACH_FIVE
def test_inverse_kinematics_and_back(chain):
    """Poses that the machine has taken: both ways reach them, and one of the two is the one that was taken."""
    q = amounts(chain, 1000, 8)[:, : chain.count]
    q[:, chain.rotary_columns] *= 0.3 if chain.carried else 0.9  # a slide that is turned along another is refused
    p, d = spindle_in_work(chain, q), tool_direction(chain, q)
    both = solutions(chain, d)
    order = [chain.index(a.letter) for a in (*chain.turning, *reversed(chain.swivelling))]
    if chain.carried:  # the other way turns a slide along another
        off = np.abs((both - q[:, order] + np.pi) % (2 * np.pi) - np.pi).sum(axis=2)
        both = both[np.argmin(off, axis=0), np.arange(len(q))][None]
    near = []
    for way in both:
        back = q.copy()
        back[:, order] = way
        back[:, chain.linear_columns] = linear_positions(chain, back, p)
        np.testing.assert_allclose(spindle_in_work(chain, back), p, rtol=0, atol=1e-12)
        np.testing.assert_allclose(tool_direction(chain, back), d, rtol=0, atol=1e-9)
        off = back - q
        off[:, chain.rotary_columns] = (off[:, chain.rotary_columns] + np.pi) % (2 * np.pi) - np.pi
        near.append(np.abs(off).max(axis=1))
    assert np.min(near, axis=0).max() < 1e-9
    # no way is the other one's twin
    assert chain.carried or np.median(np.max(near, axis=0)) > 0.1


@EACH_FIVE
def test_a_path_is_followed_without_jumps(chain):
    """The tool goes round on a cone that both axes have to follow, around a direction that the machine reaches."""
    middle = np.zeros((1, chain.count))
    middle[:, chain.rotary_columns] = [0.5, 0.6]
    axis, phi = tool_direction(chain, middle)[0], np.linspace(0, 4 * np.pi, 4001)
    side = np.cross(axis, [0.3, 1.0, 0.2])
    side /= np.linalg.norm(side)
    d = np.cos(0.1) * axis + np.sin(0.1) * (np.cos(phi)[:, None] * side + np.sin(phi)[:, None] * np.cross(axis, side))
    points = BALL + 0.1 * d
    q = pose(chain, points, d)
    assert np.abs(np.diff(q, axis=0)).max() < 0.02 and np.ptp(q[:, chain.rotary_columns], axis=0).min() > 0.1
    np.testing.assert_allclose(spindle_in_work(chain, q), points, rtol=0, atol=1e-12)
    np.testing.assert_allclose(tool_direction(chain, q), d, rtol=0, atol=1e-9)


@EACH
def test_location_errors_are_independent_and_complete(machine, chain):
    """Of all errors of all rotary axes, each that is left out is a sum of others, balls' offsets and axes' zeros; none
    that is there is.
    """
    q, h = amounts(chain, 60, 9)[:, : chain.count], 1e-6
    vectors = {}
    for name in [f"E{k}0{a}" for a in chain.rotary for k in "XYZABC" if "XYZABC".index(k) % 3 != "ABC".index(a)]:
        up, down = (oracle(machine, {name: s * h}) for s in (1, -1))
        at = dict(zip(chain.columns, q.T, strict=False))
        vectors[name] = ((up.bar(at, {}, BALL) - down.bar(at, {}, BALL)) / (2 * h)).ravel()
    kept = [e.name for e in chain.location_errors]
    rank = np.linalg.matrix_rank(np.array([vectors[n] for n in kept]).T, tol=1e-5) if kept else 0
    assert rank == len(kept)
    everything = np.array(list(vectors.values())).T if vectors else np.zeros((1, 0))
    assert np.linalg.matrix_rank(everything, tol=1e-5) == rank


@pytest.mark.parametrize(
    ("number", "axis", "order", "location"),
    [(7, "B", -2, "EA0B"), (8, "A", 2, "EB0A"), (11, "C", 1, "EB0A"), (12, "C", 1, "EA0B")],
)
def test_wobbles_that_are_location_errors_are_not_looked_for(number, axis, order, location):
    """With the phase that fits best, the oracle's bar is the same: only rounding and the balls' offsets are left."""
    chain = CHAINS[number]
    q, h = amounts(chain, 60, 15)[:, : chain.count], 1e-6
    at = dict(zip(chain.letters, q.T, strict=True))
    names = chain.error_motion(axis)[2:4]

    def bar(motion, location=None):
        return oracle(MACHINES[number], location).bar(at, motion, BALL).ravel()

    columns, zeros = [], []
    for phase in (0.0, np.pi / 2):
        angle = order * at[axis] + phase
        columns.append((bar(dict(zip(names, h * np.array([np.cos(angle), np.sin(angle)]), strict=True))) - bar({})) / h)
    for a in chain.rotary:  # zeros of the axes are set anew for every test
        shifted = at | {a: at[a] + h}
        zeros.append((oracle(MACHINES[number]).bar(shifted, {}, BALL).ravel() - bar({})) / h)
    wanted = (bar({}, {location: h}) - bar({})) / h
    basis = np.array([*columns, *zeros]).T
    left = wanted - basis @ np.linalg.lstsq(basis, wanted, rcond=1e-9)[0]
    assert np.linalg.norm(left) < 1e-4 * np.linalg.norm(wanted)
    orders = set(range(-6, 7)) - {0}
    assert order in orders - set(visible_orders(chain, axis, True))
    assert len(visible_orders(chain, "X", True)) == 12
    assert set(visible_orders(CHAINS[0], "C", True)) == set(visible_orders(CHAINS[0], "C", False)) == orders


def machine_toml(configuration, more=""):
    """A machine file with ordinary drives for every axis that the configuration names."""
    tables = [f'name = "m"\nconfiguration = "{configuration}"\n{more}']
    for a in sorted(set(configuration) & set("XYZABC")):
        gear = "lead_mm = 10" if a in "XYZ" else "worm_teeth = 72"
        tables.append(
            f"[drive.{a}]\n{gear}\nposition_gain_per_s = 45\nvelocity_gain_Nms_per_rad = 2\nintegral_time_s = 0.012\n"
            "inertia_kgm2 = 0.01\nviscous_Nms_per_rad = 0.01\n"
        )
    return "\n".join(tables)


def test_a_machine_file_places_its_axes(tmp_path):
    file = tmp_path / "machine.toml"
    file.write_text(
        machine_toml(
            "w-C'bXYZB-t", "tool_length_mm = 240\n[axis.B]\ndirection = [0, 2, 2]\noffset_mm = [1, 2, 3]\n[axis.C]\n"
            "offset_mm = [4, 0, 0]\n"
        )
    )  # fmt: skip
    chain = read_machine(file).chain
    assert chain.axis("B").unit == pytest.approx((0, 2**-0.5, 2**-0.5)) and chain.tool_length == 0.24
    np.testing.assert_allclose(chain.axis("B").centre, [0.001, 0.002, 0.243], rtol=0, atol=1e-15)
    np.testing.assert_allclose(chain.axis("C").centre, [0.004, 0, 0], rtol=0, atol=1e-15)
    assert chain_of("w-C'bXYZB-t") != chain


@pytest.mark.parametrize(
    ("configuration", "more", "message"),
    [
        ("w-C'bXYZB-t", "", "'tool_length_mm' is missing; allowed: the distance from the pivot of the head.* B turns"),
        ("w-C'A'Y'bXZ-t", "tool_length_mm = 200", "tool_length_mm = 200; allowed: no such key"),
        ("w-C'bXYZB-t", "tool_length_mm = -3", r"tool_length_mm.*-3.*greater|above 0"),
        ("w-C'A'Y'bXZ-t", "[axis.B]\noffset_mm = [1, 0, 0]", r"axis 'B' cannot be placed in .*; allowed: C, A"),
        ("w-C'A'Y'bXZ-t", "[axis.X]\noffset_mm = [1, 0, 0]", r"axis 'X' cannot be placed in .*; allowed: C, A"),
        ("w-C'A'Y'bXZ-t", "[axis.A]\ndirection = [0, 0, 1]", r"axis A: direction = .* allowed: within 60° of X"),
        ("w-C'A'Y'bXZ-t", "[axis.A]\ndirection = [0, 0, 0]", r"axis A: direction = .* allowed: within 60° of X"),
        ("w-C'A'Y'bXZ-t", "[axis.A]\ndirection = [1, 0]", r"direction"),
        ("w-C'A'Y'bXZ-t", "[axis.A]\noffset = 1", r"offset"),
    ],
)
def test_bad_placements_are_refused(tmp_path, configuration, more, message):
    file = tmp_path / "machine.toml"
    file.write_text(machine_toml(configuration, more))
    with pytest.raises(InputError, match=message) as error:
        read_machine(file)
    assert str(error.value).startswith(str(file)) and "\n" not in str(error.value)


@pytest.mark.parametrize("configuration", ["w-C'A'Y'bXZ-t", "w-C'bXYZB-t", "w-bXYZCA-t"])
def test_singular_passes_are_crossed_or_refused(configuration, tmp_path):
    """The tool tilts through the vertical, to which C is parallel."""
    lean = np.linspace(-0.4, 0.4, 801)
    path = np.column_stack([np.sin(lean), np.zeros_like(lean), np.cos(lean)])
    crossed = pose(chain_of(configuration), np.zeros((801, 3)), path)
    np.testing.assert_allclose(tool_direction(chain_of(configuration), crossed), path, rtol=0, atol=1e-9)
    if configuration != "w-C'A'Y'bXZ-t":  # whose tilt is never negative
        assert np.abs(np.diff(crossed, axis=0)).max() < 0.01
    refusing = chain_of(configuration, (), None, "refuse")
    with pytest.raises(InputError, match=r"within 0\.00° of the C axis.*singular_pass = .cross"):
        pose(refusing, np.zeros((801, 3)), path)
    assert pose(refusing, np.zeros((300, 3)), path[:300]).shape == (300, len(refusing.letters))


def test_the_machine_file_says_what_happens_at_a_singular_direction(tmp_path):
    file = tmp_path / "machine.toml"
    file.write_text(machine_toml("w-C'A'Y'bXZ-t", 'singular_pass = "refuse"'))
    assert read_machine(file).chain.singular == "refuse"
    cone = 'half_apex_deg = 15\ninclination_deg = 15.5\nsensitive_direction = "perpendicular"\ndirection = "CW"\n'
    (tmp_path / "campaign.toml").write_text(
        f'name = "x"\n[[test]]\nname = "t"\nkind = "cone_frustum"\n{cone}table_ball_mm = [0, 0, 155]\n'
        "bar_length_mm = 100\nfeed_mm_min = 1000\n"
    )
    with pytest.raises(InputError, match=r'"t": .* within 0\.50° of the C axis'):
        read_campaign(tmp_path)
    file.write_text(machine_toml("w-C'A'Y'bXZ-t"))
    assert read_campaign(tmp_path).tests
    file.write_text(machine_toml("w-C'A'Y'bXZ-t", 'singular_pass = "jump"'))
    with pytest.raises(InputError, match=r"singular_pass.*'jump'.*'cross' or 'refuse'"):
        read_machine(file)
