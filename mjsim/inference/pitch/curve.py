"""Pitch-error curves of a tangential test over the axis' actual position (paper, section 2.3, and its Fig. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.pitch.model import PitchModel, State
from mjsim.inference.pitch.terms import Fault, Term, Wave

#: Around a reversal of a linear axis its friction shows in the reading: from so long before the command turns to so
#: long after, s.
BEFORE, AFTER = 0.1, 0.5


@dataclass(frozen=True)
class Curve:
    """One test's curve, (n,) each: position and values in rad, middles of blocks; ``at_reversal`` bool."""

    position: np.ndarray
    raw: np.ndarray
    modified: np.ndarray
    identified: np.ndarray
    at_reversal: np.ndarray


def terms_of(state: State, direction: TurnDirection) -> list[Term]:
    """The terms that act while the axis turns in this direction."""
    return [t for t in state.terms if t.axis == direction.axis and t.direction in (direction.direction, "")]


def components_of(state: State, direction: TurnDirection) -> list[Wave]:
    """The waves of this direction from the tooth order on, by order."""
    return sorted(
        (t for t in terms_of(state, direction) if isinstance(t, Wave) and t.test is None), key=lambda t: t.order
    )


def curve(model: PitchModel, state: State, direction: TurnDirection, k: int) -> Curve:
    """The curves of test ``k``: reading over radius against the position that the drive has reached when the sample was
    taken.

    What lies below the tooth order is described by cosines of half and whole periods over the arc, up to one resolution
    below the tooth order, least squares together with the components and the local faults: nothing is folded round at
    the ends of an arc, as zeroing lines of an FFT would, and no component leaks into what is taken out.
    """
    p = model.problem
    s, shift = p.samples[k], p.shift(k, state.nuisance)
    x = s.sample(model.position[k][direction.axis], shift)
    sens = s.sample(p.sensitivity[k].axes[:, p.chain.index(direction.axis)], shift)
    good = s.good
    x, raw = x[good], (s.mean / sens)[good]
    mine = [t for t in terms_of(state, direction) if t.test in (None, p.tests[k].name)]
    waves = [t for t in mine if isinstance(t, Wave) and t.test is None]
    u = (x - x.min()) / np.ptp(x)
    slow = np.arange(int(2.0 * np.ptp(x) / (2 * np.pi) * direction.lowest) + 1)
    low = np.column_stack([np.cos(np.pi * u[:, None] * slow), u])
    faults = [c for t in mine if isinstance(t, Fault) for c in t.columns(x)[:1]]
    fast = [c for t in waves for c in t.columns(x)[:2]]
    design = np.column_stack([low, *faults, *fast])
    fitted = np.linalg.lstsq(design, raw, rcond=1e-8)[0]
    count = low.shape[1] + len(faults)
    modified = raw - design[:, :count] @ fitted[:count]
    identified = sum((t.value(x) for t in waves), np.zeros(len(x)))
    return Curve(x, raw, modified, identified, at_reversals(model, k, s.centre[good] - shift))


def at_reversals(model: PitchModel, k: int, time: np.ndarray) -> np.ndarray:
    """Which instants (n,) s of the program lie at a turning point of a linear axis, (n,) bool."""
    m = model.problem.motions[k]
    step = np.sign(np.round(np.diff(m.commands[:, model.problem.chain.linear_columns], axis=0), 12))
    out = np.zeros(len(time), bool)
    for j in range(step.shape[1]):
        moving = np.flatnonzero(step[:, j])
        for i in moving[1:][np.diff(step[moving, j]) != 0.0]:
            out |= (time > m.time[i] - BEFORE) & (time < m.time[i] + AFTER)
    return out
