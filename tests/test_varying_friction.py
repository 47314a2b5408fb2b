"""Friction that varies as a part of what is in no model: what it leaves in the readings, and whether it is seen."""

from dataclasses import replace

import numpy as np
import pytest
from independent import drives, machines
from small_errors import small_errors_and

from mjsim.commands.diagnosis import common_sentence
from mjsim.effects.registry import effect_class
from mjsim.inference.findings import explain
from mjsim.inference.samples import GRID_STEPS
from mjsim.inference.varying_friction import variation_of_friction
from mjsim.inference.vibration import Separated
from mjsim.machine.model import build

AXES = "XYZAC"


def problem_of(folder, share):
    """The tests of a sound machine of the generator whose friction varies by up to so much in a turn of the motors."""
    rng = np.random.default_rng(11)
    varying = [
        {
            "id": f"varying_friction.{axis}",
            "place_share": share,
            "order": float(order),
            "phase_deg": float(rng.uniform(-180.0, 180.0)),
            "way_share": 0.0,
        }
        for axis, order in zip(AXES, (1, 2, 1, 2, 1), strict=True)
    ]
    tests, machine, _ = small_errors_and(folder, varying if share else ())
    return tests, machine


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    """Tests of a machine whose friction is the same everywhere."""
    return problem_of(tmp_path_factory.mktemp("level"), 0.0)


@pytest.mark.parametrize("axis", "XYA")
@pytest.mark.parametrize(
    "varying",
    [
        {"place_share": 0.05, "order": 1.0},
        {"place_share": 0.05, "order": 2.0},
        {"place_share": 0.05, "order": 0.005},
        {"way_share": 0.05},
    ],
    ids=["once a turn", "twice a turn", "along the travel", "with the way"],
)
def test_the_shapes_are_what_the_drives_of_the_generator_do(problem, axis, varying):
    """Any phase is a sum of two shapes; what is long beside the travel is a slope and a bow, beside another level. The
    generator gives the motor, so the machine has no play.
    """
    tests, machine = problem
    machine = replace(machine, effects=tuple(e for e in machine.effects if e.kind != "backlash"))
    i, model = AXES.index(axis), machines.nominal("M1")
    shapes = next(np.vstack(e.readings) for e in variation_of_friction(tests, machine) if e.name[-1] == axis)

    def reading(**friction):
        effects = {e["id"]: e for e in model["effect"]} | {f"varying_friction.{axis}": friction}
        out = []
        for motion, sensitivity in zip(tests.motions, tests.sensitivity, strict=True):
            command = np.ascontiguousarray(motion.commands[:, i])
            position = drives.run_axis(axis, model["drive"][axis], effects, command)[0]
            out.append(position[::GRID_STEPS] * sensitivity.axes[:, i])
        return np.concatenate(out)

    given = reading()
    change = reading(phase_deg=35.0, **varying) - given
    known = np.column_stack([shapes, reading(place_share=0.01, order=0.0) - given])
    rest = change - known @ np.linalg.lstsq(known, change, rcond=None)[0]
    assert np.std(change) > 1e-9 and np.std(rest) < 0.05 * np.std(change)


@pytest.mark.parametrize("axis", "XA")
@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ({"place_share": 0.4, "order": 1.0, "phase_deg": 30.0}, ("friction_ripple", 0.4, 1.0, 120.0)),
        ({"way_share": -0.3}, ("friction_direction", -0.3)),
    ],
    ids=["a turn", "the way"],
)
def test_a_drive_with_friction_that_varies_much_is_that_of_the_generator(problem, axis, theirs, ours):
    """An error of 0.02 µm at the ball, 0.25 m from a rotary axis, is that of its steps."""
    tests, machine = problem
    model = machines.nominal("M1")
    i, effects = AXES.index(axis), {e["id"]: e for e in model["effect"]}
    kind, *values = ours
    cls, subject = effect_class(f"{kind}.{axis}", machine.chain)
    varying = machine.with_effect(cls(subject, **dict(zip((p.name for p in cls.parameters), values, strict=True))))
    motion = next(m for m in tests.motions if m.moves[i])
    command = np.ascontiguousarray(motion.commands[:, i])
    expected = drives.run_axis(axis, model["drive"][axis], effects | {f"varying_friction.{axis}": theirs}, command)[0]
    level = drives.run_axis(axis, model["drive"][axis], effects, command)[0]
    lever = 0.25 if axis == "A" else 1.0
    found = motion.motor(axis, build(varying).axes[axis])
    assert lever * np.abs(found - expected).max() < 0.02e-6 < lever * np.abs(level - expected).max()


def test_a_machine_whose_friction_varies_is_sound_and_told_so(tmp_path):
    """Without these shapes the model names three torque ripples and has four curves of unknown causes."""
    varying, machine = problem_of(tmp_path, 0.2)
    found = explain(Separated(varying, machine, ()))
    assert found.common and all(name.startswith("friction_varies.") for name in found.common)
    assert all(0.07 < share < 0.3 for share in found.common.values())
    assert not found.selection.found and found.unexplained is None


def test_the_share_is_told():
    sentence = common_sentence({"friction_varies_percent": {"X": 19.2, "Z": 41.0}}, ())
    assert "about 19 % on X and 41 % on Z" in sentence
    three = common_sentence({"friction_varies_percent": {"X": 19.2, "Y": 7.0, "Z": 41.0}}, ())
    assert "about 19 % on X, 7 % on Y and 41 % on Z" in three
    assert "counts all of it" in common_sentence({"friction_varies_percent": {"X": 19.2}, "slide_turns_urad": 5.0}, ())
