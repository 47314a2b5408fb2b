"""Whether an axis counts the other way than the machine file says.

A test that goes from one stated position of a rotary axis to another turns the other way then, and what the file knows
of the axis over its position is mirrored. What both leave is compared: lag and friction of the other axes, and location
errors, which are the same in all tests. A cone or a circle is the same motion of the machine in either sense.

What no model explains in a test has a size of its own, and a likelihood that is largest at its RMS. So the log odds of
the other sense are those before the data, and n·ln(RMS as given / RMS then) for each path, where n is the number of
independent values in what is not explained. Tests of one path in both directions leave much the same, and count as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit, logit

from mjsim.inference.mistakes.evidence import State, Variant, left_together
from mjsim.inference.mistakes.mistakes import Mistake
from mjsim.inference.samples import GRID_STEPS, Samples
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import SENSES, Chain, Placement
from mjsim.machine.kinematics import Geometry, bar_vector
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation.axes import time_grid
from mjsim.units import percent

#: Location errors and squareness of a machine in use, m and rad: one standard deviation (assumed).
_SHIFT, _TILT = 50e-6, 200e-6
#: A reading that changes by less is the same, m: a hundredth of a bar's noise.
_SAME = 1e-9


def with_other_sense(machine: Machine, axis: str) -> Machine:
    """The same file with the other sense of one axis; no other number of it changes."""
    chain = machine.chain
    placements = dict(chain.placements)
    one, own = placements.get(axis, Placement()), chain.axis(axis)
    if own.tilted:
        one = one._replace(direction=tuple(0.0 - u for u in own.unit), sense=None)
    else:
        one = one._replace(direction=None, sense=SENSES[chain.sense(axis) == SENSES[0]])
    placements[axis] = one
    return replace(machine, placements=tuple(sorted(placements.items())))


def sense_mistakes(state: State, machine: Machine) -> list[Mistake]:
    """Axes whose other sense explains what the one of the machine file does not.

    Args:
        state: The tests as they are.
        machine: The machine as given.
    """
    out = []
    for axis in machine.chain.rotary:
        other = with_other_sense(machine, axis)
        found = _other_variants(state, other, build(other), axis)
        if found is None:
            continue
        changed = [k for k, (a, b) in enumerate(zip(state.variants, found, strict=True)) if a is not b]
        given, turned = (left_by_geometry(v, state.traces, changed) for v in (state.variants, found))
        paths = [_path(state.variants[k].test) for k in changed]
        ratios = [float(np.mean(np.log(given / turned)[[q == p for q in paths]])) for p in _unlike(paths)]
        odds = logit(state.settings.wrong_sense) + state.settings.independent * sum(ratios)
        if odds < logit(state.settings.sure):
            continue
        before, after = (float(np.sqrt(np.mean(x**2))) * 1e6 for x in (given, turned))
        evidence = (
            f"with location errors that all tests share, these tests then leave {after:.2g} µm instead of {before:.2g} "
            f"µm, probability {percent(float(expit(odds)))}"
        )
        names = tuple(state.variants[k].test.name for k in changed)
        words = f'sense = "{other.chain.sense(axis)}" in [axis.{axis}] of the machine file'
        out.append(Mistake("sense", names, evidence, axis=axis, remedy=words))
    return out


def _other_variants(state: State, machine: Machine, plant: Plant, axis: str) -> list[Variant] | None:
    """The tests on a machine whose axis has the other sense; the same object where nothing changes.

    ``None`` where no test depends on the sense, or an NC program shows it: its positions belong to the test in one
    sense only.
    """
    tests = [v.test for v in state.variants]
    moving = [k for k, t in enumerate(tests) if np.ptp(_positions(t, axis)) > 0.0]
    if any(tests[k].commanded is not None for k in moving):
        return None
    stated = [k for k in moving if _states(tests[k], machine.chain, axis)]
    out = list(state.variants)
    for k in [*stated, *(k for k in moving if k not in stated)]:
        variant = Variant.of(replace(tests[k], chain=machine.chain), plant)
        if k not in stated and np.abs(variant.reading - out[k].reading).max() < _SAME:
            break  # what the file knows of the axis does not depend on its position
        out[k] = variant
    return out if any(a is not b for a, b in zip(out, state.variants, strict=True)) else None


def _positions(test: BallBarTest, axis: str) -> np.ndarray:
    """Commanded positions of an axis at some instants of a test."""
    program = Program(test)
    return program.commands(np.linspace(0.0, program.duration, 50))[:, test.chain.index(axis)]


def _states(test: BallBarTest, chain: Chain, axis: str) -> bool:
    """Whether positions of the axis stand in the test, so that its motion depends on the sense."""
    return bool(np.abs(_positions(test, axis) - _positions(replace(test, chain=chain), axis)).max() < 1e-9)


def _path(test: BallBarTest) -> BallBarTest:
    """The same for all tests that go along one path, one way or the other."""
    low, high = sorted((test.start, test.stop))
    same = {"name": "", "trace": None, "started": 0.0, "feed": 0.0, "revolutions": 1, "direction": "CCW"}
    return replace(test, start=low, stop=high, **same)


def _unlike(paths: Sequence[BallBarTest]) -> list[BallBarTest]:
    return [p for i, p in enumerate(paths) if p not in paths[:i]]


def left_by_geometry(variants: Sequence[Variant], traces: Sequence[Samples], among: list[int]) -> np.ndarray:
    """What tests leave when all share the location errors of the machine, and those of a set-up the offsets of the
    balls.

    Args:
        variants: All tests.
        traces: Of all tests.
        among: Tests whose residual is wanted.

    Returns:
        RMS of each of these tests, m.
    """
    setups = list(dict.fromkeys(v.test.setup for v in variants))
    shared = []
    for variant, s in zip(variants, traces, strict=True):
        balls = np.zeros((len(s.centre), 6 * len(setups)))
        at = 6 * setups.index(variant.test.setup)
        balls[:, at : at + 6] = variant.balls(s)
        shared.append(np.column_stack([balls, _location(variant, s)]))
    rows = left_together([(v, s, 1.0) for v, s in zip(variants, traces, strict=True)], shared)
    return np.array([np.sqrt(np.mean(rows[k] ** 2)) for k in among])


def _location(variant: Variant, s: Samples) -> np.ndarray:
    """Columns (blocks, errors) of the location errors and squareness of the machine, m per usual size."""
    test, chain = variant.test, variant.test.chain
    program = Program(test)
    q = program.commands(time_grid(program)[::GRID_STEPS])
    ball = np.array(test.table_ball)
    bar = bar_vector(chain, q, ball)
    unit = bar / np.linalg.norm(bar, axis=1)[:, None]
    errors = [({e.name: _TILT if e.rotation else _SHIFT}, {}) for e in chain.location_errors]
    errors += [({}, {e.name: _TILT}) for e in chain.squareness]
    grids = [((bar_vector(chain, q, ball, Geometry(*e)) - bar) * unit).sum(axis=1) for e in errors]
    return np.column_stack([s.sample(np.ascontiguousarray(g), 0.0) for g in grids])
