"""Wild machines of the independent generator, against closed forms; and what their causes outside the catalogue are."""

import hashlib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from independent import (
    bank,
    chain_campaigns,
    drives,
    layouts,
    machines,
    measurement,
    odd_causes,
    simulate,
    structure,
    transmission,
    wild,
)
from independent.chains import CHAINS, Kinematics
from independent.kinematics import DEG
from independent.unlisted import unit

PAPER = Kinematics(CHAINS["paper"][0])
BALL = np.array([0.02, -0.03, 0.155])


@cache
def cases():
    return bank.cases()


def short_tests():
    """Quick tests of each kind."""
    cone = layouts.cone(15, (30, -20), "CW", 3000.0, revolutions=1)
    return layouts.arrange([cone, layouts.rotary("A", 60, 20, (0, 40), "radial", 3000.0)])


def case(**more):
    return chain_campaigns.ChainCase("wild", "paper", 5, real=True, plan=tuple(short_tests()), **more)


def at(**positions):
    """Axis positions of one instant, m and rad."""
    return {a: np.array([positions.get(a, 0.0)]) for a in PAPER.axes}


def test_without_its_nature_a_wild_machine_is_a_real_one():
    """All sizes at 0 give the reading of the other, closed-form kinematics of the paper's machine."""
    tame = case(nature=tuple(wild.draw_nature(case().model(), 0.0, np.random.default_rng(1))))
    assert {e["id"].split(".")[0] for e in tame.nature} == {
        *("varying_friction", "varying_play", "tooth_errors", "slide_angles", "drift", "structural_mode", "egg")
    }
    drive, effects = tame.true()
    plain = {k: e for k, e in effects.items() if k not in {e["id"] for e in tame.nature}}
    for test in tame.tests():
        instants = np.arange(0.1, tame.program(test).duration, 0.02)
        ours = chain_campaigns.reading(tame, test, drive, effects, instants)
        real = simulate.reading(test, drive, plain, instants, phases=dict.fromkeys("XYZ", 0.0))
        assert np.std(real) > 1e-6
        np.testing.assert_allclose(ours, real, rtol=0, atol=1e-12)


def test_wild_sizes_show_and_a_campaign_is_the_same_twice(tmp_path):
    nature = tuple(wild.draw_nature(case().model(), 1.0, np.random.default_rng(1)))
    odd = odd_causes.OilFilm("X", moves="Y")
    one = case(hidden=(odd,), target_um=1.3, nature=nature, bar=wild.draw_bar(np.random.default_rng(2)))
    assert chain_campaigns.signature_sizes(one.resolved) == pytest.approx([1.3], rel=1e-3)
    digests = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        answer = bank.write_case(replace(one), folder, heldout=False)
        digests.append([hashlib.md5(f.read_bytes()).hexdigest() for f in sorted(folder.rglob("*.*"))])
    assert digests[0] == digests[1] and len(digests[0]) == 4
    assert (answer["verdict"], answer["hidden"], answer["axes"]) == ("unknown", "oil_film.X", ["X", "Y"])
    bare = replace(one.resolved, nature=())
    (drive, effects), (_, without) = one.resolved.true(), bare.true()
    test = one.tests()[0]
    instants = np.arange(2.0, 6.0, 0.02)
    change = [chain_campaigns.reading(one, test, drive, e, instants) for e in (effects, without)]
    assert 1e-7 < np.std(change[0] - change[1]) < 2e-5


def test_a_cause_that_does_not_show_is_not_made_absurd(monkeypatch):
    monkeypatch.setattr(chain_campaigns, "signature_sizes", lambda case: [1e-7])
    (odd,) = case(hidden=(odd_causes.OilFilm("X", -1.0, moves="Y"),), target_um=1.3).resolved.hidden
    assert odd.amplitude == -chain_campaigns.LARGEST


def test_a_slide_that_turns_moves_the_ball_by_angle_times_arm():
    """10 µrad about Y at x = 100 mm: the arm of X goes up to the ball that Z carries, that of Z does not."""
    table = {"A": [0.0] * 3, "B": [10.0, 0.0, 0.0], "C": [0.0] * 3, "point_mm": [0.0, 40.0, -300.0]}
    q = at(X=0.1, Z=0.2)
    moved = structure.turn_by_slides(PAPER, {"slide_angles.X": table}, q, BALL)
    np.testing.assert_allclose(moved, [[10e-6 * 0.5, 0.0, 0.0]], atol=1e-15)
    moved = structure.turn_by_slides(PAPER, {"slide_angles.Z": table}, q, BALL)
    np.testing.assert_allclose(moved, [[20e-6 * 0.3, 0.0, 0.0]], atol=1e-15)
    # the table's slide carries the other ball: through A, and the other way round
    table = {"A": [0.0, 8.0, 0.0], "B": [0.0] * 3, "C": [0.0] * 3, "point_mm": [0.0, 0.0, -100.0]}
    moved = structure.turn_by_slides(PAPER, {"slide_angles.Y": table}, at(Y=-0.1, A=np.pi / 2), BALL)
    ball = [0.02, -0.155, -0.03 + 0.1]  # from the slide's point
    np.testing.assert_allclose(moved, -np.cross([[8e-6, 0.0, 0.0]], [ball]), atol=1e-15)


def test_a_head_that_swivels_changes_the_arm_of_its_slides():
    text, directions, length, _, _ = CHAINS["head_table"]
    head = Kinematics(text, directions, None, length)
    table = {"A": [0.0] * 3, "B": [0.0] * 3, "C": [5.0, 0.0, 0.0], "point_mm": [0.0] * 3}
    q = {a: np.array([{"X": 0.2, "Y": 0.03, "B": 0.5}.get(a, 0.0)]) for a in head.axes}
    moved = structure.turn_by_slides(head, {"slide_angles.X": table}, q, BALL)
    arm = [-length * np.sin(0.5), 0.03]
    np.testing.assert_allclose(moved, [[-10e-6 * arm[1], 10e-6 * arm[0], 0.0]], atol=1e-15)


def test_a_structural_mode_rings_at_its_frequency_and_decays_by_its_damping():
    step, frequency, damping = 1e-3, 17.0, 0.04
    push = np.where(np.arange(2000) < 1000, 0.3, 0.0)
    u = structure.ring(push, frequency, damping, step)
    omega = 2.0 * np.pi * frequency
    assert u[995] == pytest.approx(-0.3 / omega**2, rel=0.05)  # a spring under a constant push
    free = u[1010:]
    peaks = np.flatnonzero((free[1:-1] > free[:-2]) & (free[1:-1] > free[2:])) + 1
    assert np.diff(peaks).mean() * step == pytest.approx(1.0 / (frequency * np.sqrt(1.0 - damping**2)), rel=0.01)
    decrement = np.log(free[peaks[:-1]] / free[peaks[1:]]).mean()
    assert decrement == pytest.approx(2.0 * np.pi * damping / np.sqrt(1.0 - damping**2), rel=0.03)


def test_a_mode_of_the_tool_and_one_of_the_table_follow_what_they_carry():
    """X moves the tool, Y the table: each rings its own mode, with opposite signs in the reading."""
    time = np.arange(0.0, 1.0, 1e-3)
    swing = 0.01 * np.sin(2.0 * np.pi * 2.0 * time)
    mode = {"frequency_Hz": 30.0, "damping_ratio": 0.05, "share": 0.5}
    effects = {
        "structural_mode.tool": {**mode, "along": [2.0, 0.0, 0.0]},
        "structural_mode.table": {**mode, "along": [0.0, 1.0, 0.0]},
    }
    still = {a: np.zeros(len(time)) for a in PAPER.axes}
    moved = structure.ring_modes(PAPER, effects, {**still, "X": swing, "Y": swing}, BALL, 1e-3)
    # far below its frequency a mode lags by the acceleration over the square of its frequency; Y moves the table by -Y
    quasi = 0.5 * (2.0 / 30.0) ** 2 * swing
    np.testing.assert_allclose(moved[300:, 0], quasi[300:], atol=0.15 * quasi.max())
    np.testing.assert_allclose(moved[:, 1], moved[:, 0], atol=1e-12)
    assert not moved[:, 2].any()
    fork = Kinematics(CHAINS["fork_head"][0], length=0.25)  # its table stands on the bed
    moved = structure.ring_modes(fork, effects, {a: swing * (a == "X") for a in fork.axes}, BALL, 1e-3)
    np.testing.assert_allclose(moved[300:, 0], quasi[300:], atol=0.15 * quasi.max())
    assert not moved[:, 1:].any()


def test_an_egg_adds_twice_a_turn_and_turns_with_its_table():
    phi = np.linspace(0.0, 2.0 * np.pi, 50)
    q = {a: np.zeros(len(phi)) for a in PAPER.axes}
    q |= {"X": BALL[0] + 0.1 * np.cos(phi), "Y": BALL[1] + 0.1 * np.sin(phi), "Z": BALL[2] + 0.0 * phi}
    effects = {"egg.spindle": {"amplitude_um": 0.7, "axis": [3.0, 0.0, 0.0]}}
    got = structure.read_eggs(PAPER, effects, q, BALL)
    np.testing.assert_allclose(got, 0.7e-6 * (np.cos(phi) ** 2 - 1.0 / 3.0), atol=1e-12)
    q |= {"X": 0.1 + 0.0 * phi, "Y": 0.0 * phi, "Z": 0.155 + 0.0 * phi, "C": phi}
    got = structure.read_eggs(PAPER, {"egg.table": effects["egg.spindle"]}, q, np.array([0.0, 0.0, 0.155]))
    np.testing.assert_allclose(got, 0.7e-6 * (np.cos(phi) ** 2 - 1.0 / 3.0), atol=1e-12)


def test_friction_depends_on_place_and_direction():
    """At constant speed the torque is viscous friction plus the Coulomb level of that place and direction."""
    model = machines.nominal("M1")
    drive = model["drive"]["X"]
    level, place, way = 1.0, 0.3, 0.1
    effects = machines.by_id(model["effect"])
    effects["varying_friction.X"] = {"place_share": place, "order": 0.02, "phase_deg": 40.0, "way_share": way}
    speed, gear = 0.02, drives.gear(drive)
    for sign in (1.0, -1.0):
        position, torque = drives.run_axis("X", drive, effects, sign * speed * np.arange(0.0, 1.5, drives.GRID))
        wave = level * (1.0 + place * np.cos(0.02 * gear * position + 40.0 * DEG)) * (1.0 + way * sign)
        expected = sign * (wave + drive["viscous_Nms_per_rad"] * speed * gear)
        np.testing.assert_allclose(torque[1000:1490], expected[1000:1490], atol=1e-3)


def test_single_teeth_stand_out_and_hand_over_smoothly():
    error = np.zeros(60)
    error[[7, 59]] = 0.002, -0.001
    pitch = 2.0 * np.pi / 60
    x = np.array([7.0, 7.5, 6.0, 8.0, 59.0, 59.5, -1.0, 60.0]) * pitch
    expected = [0.002, 0.001, 0.0, 0.0, -0.001, -0.0005, -0.001, 0.0]
    np.testing.assert_allclose(transmission.interpolate_teeth(x, error.tolist()), np.array(expected) * DEG, atol=1e-12)


def test_play_varies_along_the_axis():
    """Lost motion where the axis reverses is the play of that place."""
    wave = {"share": 0.5, "wave_number": 2.0 * np.pi / 0.1, "phase_deg": 0.0}
    effects = {"backlash.X": {"width_um": 4.0}, "varying_play.X": wave}
    for turn, expected in ((0.1, 6e-6), (0.15, 2e-6)):
        there = np.linspace(turn - 0.02, turn, 400)
        x = np.concatenate([there, there[::-1]])
        moved = transmission.load_side(
            np.column_stack([x, *[0.0 * x] * 4]), x, machines.nominal("M1")["drive"], effects
        )
        lost = moved[430, 0] - moved[369, 0]  # the same command, from both sides
        assert lost == pytest.approx(expected, rel=0.05)


def test_an_axis_at_rest_does_not_stick_because_others_displace_it():
    """Out of square, a circle in X and Z moves the ball along Y. The slide stands still, and nothing sticks there."""
    program = simulate.Program({**layouts.circle("ZX", feed=3000.0), "started_s": 0.0})
    machine = machines.nominal("M1")
    effects = machines.by_id(machine["effect"]) | {"squareness.YZ": {"angle_urad": 200.0}}
    sticking = {a: odd_causes.StickSlip(a, 10.0) for a in "XY"}
    alone, _ = simulate.motion(program, 0.0, machine["drive"], effects)
    moved = {a: simulate.motion(program, 0.0, machine["drive"], effects, (s,))[0] for a, s in sticking.items()}
    assert np.ptp(alone[:, 1]) > 10e-6
    assert np.array_equal(moved["Y"], alone)
    assert np.abs(moved["X"] - alone).max() > 5e-6


def test_a_drift_passes_through_its_knots():
    clock = np.array([0.0, 240.0, 300.0, 480.0, 9e9])
    effects = {"drift.Y": {"clock_s": [0.0, 240.0, 480.0], "um": [0.0, 1.0, -0.5]}}
    moved = transmission.load_side(np.zeros((5, 5)), clock, machines.nominal("M1")["drive"], effects)
    np.testing.assert_allclose(moved[[0, 1, 3, 4], 1], [0.0, 1e-6, -0.5e-6, -0.5e-6], atol=1e-15)
    assert -0.5e-6 < moved[2, 1] < 1e-6


def test_heavy_tails_have_their_kurtosis():
    share, times = 0.02, 6.0
    x = measurement.heavy_tailed(1_000_000, share, times, np.random.default_rng(3))
    expected = 3.0 * (1.0 - share + share * times**4) / (1.0 - share + share * times**2) ** 2
    assert np.var(x) == pytest.approx(1.0, rel=0.02)
    assert np.mean(x**4) == pytest.approx(expected, rel=0.05) and expected > 20.0


def test_hum_is_a_line_at_its_frequency():
    bar = measurement.Bar(hum_um=0.08, hum_Hz=49.9)
    x = measurement.noise(8000, 0.12, np.random.default_rng(4), bar)
    turns = 49.9 * np.arange(8000) / measurement.SAMPLE_RATE
    assert 2.0 * abs(np.mean(x * np.exp(-2j * np.pi * turns))) == pytest.approx(0.08, abs=0.005)


def test_a_bar_has_a_gain_and_a_clock_of_its_own():
    """Read of a ramp of 1 µm/s: the slope has the gain, and runs slower by a clock that runs faster."""
    bar = measurement.Bar(gain=0.02, clock=0.005)
    setup = measurement.SetupErrors({}, {}, 0.0, (0.25,), ())
    ((clock, deviation),) = measurement.record(
        lambda k, instants: 1e-6 * instants, [(1.0, 400.0)], setup, bar, 0.05, lambda s: np.random.default_rng(s)
    )
    slope, start = np.polyfit(clock, deviation, 1)
    assert slope == pytest.approx(1.02 / 1.005, rel=1e-4) and start == pytest.approx(-0.25 * 1.02, abs=0.02)


@cache
def state():
    """A motion of all axes for 60 s that is no simple one, with the torque of friction, mass and a load."""
    time = np.arange(0.0, 60.0, 1e-3)
    swing = [(0.09, 5.3, 17.0), (0.07, 7.1, 23.0), (0.05, 11.3, 29.0), (0.4, 8.7, 19.0), (2.0, 13.1, 31.0)]
    position = np.column_stack(
        [a * np.sin(2.0 * np.pi * time / p) * (0.6 + 0.4 * np.cos(2.0 * np.pi * time / q)) for a, p, q in swing]
    )
    velocity = np.gradient(position, 1e-3, axis=0)
    scale = np.abs(velocity).max(axis=0)
    torque = (
        np.tanh(20.0 * velocity / scale)
        + 0.4 * np.gradient(velocity, 1e-3, axis=0) / scale
        + 0.3 * np.sin(time)[:, None]
    )
    return simulate.State(time, 500.0 + time, position, torque)


def explained_by_one_curve(y, s):
    """Largest share of the variance that a free curve explains as the diagnosis has them: of one variable of one axis,
    position and time since reversal with the sign of the motion too; of the clock in steps of a quarter of a minute.
    """
    clock = np.floor((s.clock - s.clock[0]) / 15.0)
    curves = [(clock, np.ones(len(y)), 4)]
    for i in range(5):
        since = np.log10(np.clip(s.since_reversal[:, i], 0.02, 100.0))
        plain = (s.position, s.velocity, s.acceleration, s.torque)
        curves += [(x[:, i], np.ones(len(y)), 40) for x in plain]
        curves += [(x, s.direction[:, i], 40) for x in (s.position[:, i], since)]
    best = 0.0
    for x, sign, bins in curves:
        place = np.clip(((x - x.min()) / np.ptp(x) * bins).astype(int), 0, bins - 1)
        curve = np.bincount(place, y * sign, bins) / np.maximum(np.bincount(place, sign**2, bins), 1.0)
        best = max(best, 1.0 - np.var(y - curve[place] * sign) / np.var(y))
    return best


@pytest.mark.parametrize("number", range(8))
def test_no_curve_of_one_variable_has_the_shape_of_a_wild_cause(number):
    cause = odd_causes.draw_makers("XYZAC", np.random.default_rng(number))[number]()
    y = cause.shape(state(), state().axes.index(cause.axis))
    assert np.isfinite(y).all() and 0.05 < np.std(y) < 50.0
    assert explained_by_one_curve(y, state()) < 0.9
    target = cause.moves or cause.axis
    moved = cause.scaled(3.0).displacement(state())[:, state().axes.index(target)]
    np.testing.assert_allclose(moved, 3.0 * cause.amplitude * unit(target) * y)


def test_a_key_remembers_how_often_its_axis_turned():
    time = np.arange(0.0, 6.0, 1e-3)
    position = np.zeros((len(time), 5))
    position[:, 0] = -0.05 * np.cos(np.pi * time)  # from a lower end; back there after 2 and 4 s
    seat = odd_causes.AlternatingKey("X").shape(simulate.State(time, time, position, 0.0 * position), 0)
    np.testing.assert_allclose(seat[[1000, 1900, 2200, 3900, 4200, 5900]], [1.0, 1.0, -1.0, -1.0, 1.0, 1.0], atol=1e-3)


def test_halves_share_no_seed_and_the_worlds_have_both():
    halves = {h: [c for c in cases() if c.half == h] for h in ("tune", "publish")}
    seeds = {h: {c.seed for c in mine} for h, mine in halves.items()}
    assert not seeds["tune"] & seeds["publish"]
    assert len(seeds["tune"]) == len(halves["tune"]) and len(seeds["publish"]) == len(halves["publish"])
    assert not {c.name for c in halves["tune"]} & {c.name for c in halves["publish"]}
    for half, mine in halves.items():
        assert {bank.world(c.category) for c in mine} == {"ideal", "real", "wild"}
        assert sum(c.category.endswith("knocked") for c in mine) == 40, half
        assert sum(c.category in ("null", "real-sound") for c in mine) >= 300


def test_wild_machines_of_the_bank_are_what_they_are_said_to_be():
    found = [c for c in cases() if bank.world(c.category) == "wild"]
    assert {c.family for c in found} == set(CHAINS)
    assert {t.get("bar_length_mm", 100.0) for c in found for t in c.plan} == {100.0, 150.0}
    assert {c.stated for c in found if c.half == "publish"} == {True, False}
    for c in found:
        known, strange = len(c.catalogue()), len(c.unlisted())
        assert (bool(known), strange) == {"sound": (False, 0), "faulty": (True, 0), "unlisted": (False, 1)}.get(
            c.category.removeprefix("wild-"), (c.category == "wild-beside", 1 if c.category == "wild-beside" else 2)
        )
        low, high = wild.WRONG_BY
        assert all(low <= f <= high for f in (*c.spread.values(), *c.level.values()))
        assert len(c.plan) >= 4


def test_plans_are_no_longer_than_the_drift():
    """The slowest plan of twenty draws, with the tests outside the campaign."""
    for seed in range(20):
        plan = tuple(wild.draw_plan("XYZAC", "", np.random.default_rng(seed)))
        one = chain_campaigns.ChainCase("long", "paper", 1, plan=plan)
        assert len({t["name"] for t in one.tests()}) == len(one.plan)
        assert one.other_tests()[-1]["started_s"] < 9000.0
