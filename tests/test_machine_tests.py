"""Ball-bar tests on machines of any chain: the bar keeps its length, and no body passes through another."""

import re
from dataclasses import replace
from itertools import permutations

import mujoco
import numpy as np
import pytest
from independent import programs
from test_any_machine import BALL, CHAINS, LENGTH, MACHINES, named, oracle

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.base import table_of
from mjsim.machine.chain import chain_of, usual_travel
from mjsim.machine.modelling import machine_xml
from mjsim.units import DEG


def possible(chain):
    """One test of every kind and condition that the chain can follow."""
    base = BallBarTest("t", "circular", (0.05, -0.02, 0.155), LENGTH, 0.02, chain=chain, setup="1")
    for plane in chain.planes:
        yield replace(base, name=f"circle-{plane}", plane=plane)
    yield replace(base, name="circle-leaning", plane="XY", more={"lean": 15 * DEG, "lean_about": 70 * DEG})
    for axis, other in permutations(chain.rotary, 2):
        ends = [(-0.4, 2.0) if chain.axis(a).vertical else (-0.3, 0.8) for a in (axis, other)]
        for bar in chain.linear:
            test = replace(base, kind="simultaneous", name=f"{axis}{other}-{bar}", axis=axis, sensitive=bar)
            test = replace(test, start=ends[0][0], stop=ends[0][1], revolutions=1)
            yield replace(test, more={"second_start": ends[1][0], "second_stop": ends[1][1]})
    for axis in (*chain.turning, *chain.swivelling):
        ends = (-0.3, 2.0) if axis.vertical else (-0.3, 0.8)
        for sensitive in ("radial", "tangential", "axial"):
            test = replace(
                base, kind="rotary", name=f"{axis.letter}-{sensitive}", axis=axis.letter, sensitive=sensitive
            )
            name = f"{axis.letter}-{sensitive}"
            yield replace(test, name=name, start=ends[0], stop=ends[1], revolutions=1)
    for half, tilt, sensitive in ((15, 10, "perpendicular"), (20, 17, "parallel"), (10, 25, "perpendicular")):
        cone = replace(base, kind="cone_frustum", name=f"cone-{half}-{tilt}", half_apex=half * DEG, sensitive=sensitive)
        yield replace(cone, inclination=tilt * DEG, revolutions=1)


ABLE = [
    (m, t)
    for m, c in zip(MACHINES, CHAINS, strict=True)
    for t in possible(c)
    if not KINDS[t.kind].cannot(c) and not KINDS[t.kind].wrong(t)
]


def test_most_tests_can_be_followed():
    of = {c: {t.kind for _, t in ABLE if t.chain == c} for c in CHAINS}
    five = [c for c in CHAINS if len(c.rotary) == 2 and not c.idle and not c.carried]
    assert len(five) >= 14 and all(of[c] == {"circular", "rotary", "cone_frustum", "simultaneous"} for c in five)
    assert of[chain_of("w-X'Y'bZ-t")] == {"circular"}


@pytest.mark.parametrize("machine", MACHINES, ids=[named(c) for c in CHAINS])
def test_ideal_axes_keep_the_bars_length_along_every_test(machine):
    chain = chain_of(*machine)
    for _, test in (pair for pair in ABLE if pair[1].chain == chain):
        first, last = KINDS[test.kind].ends(test)
        phi = np.linspace(first, last, 1500)
        q = Program(test).path(phi)
        bar = oracle(machine).bar(dict(zip(chain.letters, q.T, strict=True)), {}, np.array(test.table_ball))
        assert np.abs(np.linalg.norm(bar, axis=1) - LENGTH).max() < 1e-9, test.name
        assert np.abs(np.diff(q, axis=0)).max() < 0.3, test.name
        back = KINDS[test.kind].angle(test, q) - phi
        assert np.abs(back - 2 * np.pi * np.round(back / (2 * np.pi))).max() < 1e-8, test.name


@pytest.mark.parametrize("chain", CHAINS, ids=named)
def test_no_body_passes_through_another(chain):
    """Along every test that stays inside the usual travel; the ends of the travel as well, one axis at a time."""
    model = mujoco.MjModel.from_xml_string(machine_xml(chain))
    data = mujoco.MjData(model)
    at = [model.joint(a).qposadr[0] for a in chain.letters]
    low, high = usual_travel(chain).T
    home = np.zeros(chain.count)
    home[2] = 0.5
    poses = []
    for i, axis in enumerate(chain.axes):
        for end in (max(low[i], -3.0), min(high[i], 3.0)):
            # down there is the table, and a Z that stands on a head does not lift the head from it
            if axis.letter != "Z" and not (axis.rotary and "Z" in chain.carried):
                poses.append(("end of travel", BALL, np.where(np.arange(chain.count) == i, end, home)))
    for _, test in (pair for pair in ABLE if pair[1].chain == chain):
        q = Program(test).path(np.linspace(*KINDS[test.kind].ends(test), 40))
        if "Z" in test.plane and test.kind == "circular":
            continue  # the lower half of an upright circle is below the table ball, on any machine
        if (q >= low).all() and (q <= high).all():
            poses += [(test.name, test.table_ball, row) for row in q]
    assert len(poses) > 40
    for name, ball, q in poses:
        model.body("table_fixture").pos[:] = ball
        data.qpos[at] = q
        mujoco.mj_forward(model, data)
        hits = {
            tuple(sorted(model.body(model.geom_bodyid[g]).name for g in (c.geom1, c.geom2)))
            for c in data.contact[: data.ncon]
            if c.dist < -1e-4
        }
        assert not hits, (name, q.round(3), hits)


def test_what_cannot_be_followed_is_refused():
    """With the reason, and the nearest that can be."""
    chain = chain_of("w-C'B'Y'bXZ-t", MACHINES[14][1])  # nutating: tilts up to 90°
    cone = BallBarTest("t", "cone_frustum", (0, 0, 0.155), LENGTH, 0.02, chain=chain, half_apex=60 * DEG)
    wrong = KINDS["cone_frustum"].wrong(replace(cone, inclination=40 * DEG))
    assert "100" in wrong and "90" in wrong and "inclination_deg = " in wrong
    nearest = float(wrong.partition("inclination_deg = ")[2].split()[0].rstrip(",;."))
    assert not KINDS["cone_frustum"].wrong(replace(cone, inclination=nearest * DEG))
    assert KINDS["cone_frustum"].wrong(replace(cone, inclination=(nearest + 0.2) * DEG))
    with pytest.raises(InputError, match="cannot point along"):
        Program(replace(cone, inclination=40 * DEG)).path(np.linspace(0, 6, 100))


@pytest.mark.parametrize("axis", "AC")
def test_the_generator_turns_both_axes_of_the_five_axis_machine_alike(axis):
    test = BallBarTest(
        "t", "simultaneous", (0.05, -0.02, 0.155), LENGTH, 0.02, chain=chain_of("w-C'A'Y'bXZ-t"), axis=axis,
        sensitive="Z", start=0.1, stop=1.2, more={"second_start": 0.0, "second_stop": 0.9}, setup="1",
    )  # fmt: skip
    mine, theirs = Program(test), programs.Program(table_of(test))
    time = np.linspace(0.0, mine.duration, 200)
    assert mine.duration == pytest.approx(theirs.duration, rel=1e-9)
    np.testing.assert_allclose(mine.commands(time), theirs.commands(time), rtol=0, atol=1e-8)


def test_turns_that_cannot_be_followed_end_where_they_can():
    """X stands on C: turned by 90°, it lies along Y. The nearest turn that is offered can be followed, and no more."""
    chain = chain_of("w-X'C'bYZA-t")
    base = BallBarTest("t", "rotary", (0.05, -0.02, 0.155), LENGTH, 0.02, chain=chain, axis="C", revolutions=1)
    both = replace(base, kind="simultaneous", sensitive="Z", more={"second_start": 0.0, "second_stop": 40 * DEG})
    for test, stop in ((replace(base, sensitive="radial"), -180), (both, 180)):
        kind = KINDS[test.kind]
        wrong = kind.wrong(replace(test, stop=stop * DEG))
        assert "X is turned along another linear axis" in wrong
        nearest = float(re.search(r"nearest possible: to_deg = (-?[\d.]+)", wrong)[1])
        assert not kind.wrong(kind.ending(replace(test, stop=stop * DEG), nearest * DEG))
        assert kind.wrong(kind.ending(replace(test, stop=stop * DEG), (nearest + 0.2 * np.sign(stop)) * DEG))
    assert f"second_to_deg = {np.floor(nearest / 180 * 400) / 10}" in wrong


@pytest.mark.parametrize(
    ("configuration", "changed", "said"),
    [
        ("w-C'bXYZ-t", {}, "the machine has 1; nearest possible: rotary, of C alone"),
        ("w-X'Y'bZ-t", {}, "the machine has none"),
        ("w-C'A'Y'bXZ-t", {"more": {"second_start": 0.0, "second_stop": 0.001}}, 'where A rests, .* kind "rotary"'),
        ("w-C'A'Y'bXZ-t", {"table_ball": (0.0, 0.0, -LENGTH)}, "C and A pass through the spindle ball"),
        ("w-C'A'Y'bXZ-t", {"stop": 0.0}, "from_deg and to_deg are both 0"),
    ],
)
def test_both_rotary_axes_have_to_move_something(configuration, changed, said):
    chain, kind = chain_of(configuration), KINDS["simultaneous"]
    test = BallBarTest(
        "t", "simultaneous", (0.05, 0, 0.155), LENGTH, 0.02, chain=chain, axis="C", sensitive="Z", stop=2.0
    )
    test = replace(replace(test, more={"second_start": 0.0, "second_stop": 1.0}), **changed)
    assert re.search(said, kind.cannot(chain) or kind.wrong(test))


def test_a_plan_looks_at_both_rotary_axes_of_any_machine():
    for chain in (c for c in CHAINS if len(c.rotary) == 2 and not c.carried):
        proposed = list(KINDS["simultaneous"].proposals(chain, LENGTH, 0.155))
        assert {t.sensitive for t in proposed} == set("XYZ") and {t.axis for t in proposed} < set(chain.rotary)


def test_a_singular_pass_that_is_refused_names_an_inclination():
    chain = chain_of("w-C'A'Y'bXZ-t", (), None, "refuse")
    cone = BallBarTest("t", "cone_frustum", (0, 0, 0.155), LENGTH, 0.02, chain=chain, half_apex=15 * DEG)
    wrong = KINDS["cone_frustum"].wrong(replace(cone, inclination=15.2 * DEG))
    nearest = float(wrong.partition("nearest possible: inclination_deg = ")[2])
    assert 14.0 <= nearest <= 16.5 and not KINDS["cone_frustum"].wrong(replace(cone, inclination=nearest * DEG))


@pytest.mark.parametrize("chain", CHAINS, ids=named)
def test_a_model_begins_with_the_bar_between_the_balls(chain):
    """Joints, actuators and sensors have one order; in the key frame the bar has its length and nothing touches."""
    model = mujoco.MjModel.from_xml_string(machine_xml(chain))
    joints = [model.joint(i).name for i in range(model.njnt)]
    assert joints == [model.actuator(i).name for i in range(model.nu)]
    assert [f"{a}_pos" for a in joints] == [model.sensor(i).name for i in range(model.njnt)]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    assert data.sensor("ball_bar_length").data[0] == pytest.approx(LENGTH, abs=1e-12)
    assert not any(c.dist < -1e-4 for c in data.contact[: data.ncon])
