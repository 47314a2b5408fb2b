"""Pitch-error curves of a tangential test over the axis' actual position (paper, section 2.3, and its Fig. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID_STEPS
from mjsim.machine.model import build
from mjsim.units import DEG

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


def acting(fit: Fit, kind: str, direction: TurnDirection) -> list[EffectVector]:
    """Fitted effects of one kind that act while the axis turns in a direction."""
    mine = (f for f in fit.effects if f.effect.id == f"{kind}.{direction.axis}")
    return [f for f in mine if f.effect.values.get("direction", direction.direction) == direction.direction]


def components_of(fit: Fit, direction: TurnDirection) -> list[list[float]]:
    """The waves of this direction from the tooth order on, by order: order, amplitude and phase in degrees."""
    rows = [row for f in acting(fit, "pitch_error", direction) for row in f.effect.values["components"]]
    return sorted(row for row in rows if row[0] >= direction.teeth)


def reached(problem: Problem, fit: Fit, k: int, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Position of an axis that its drive has reached in test ``k``, rad, and the reading per rad there, m, (m,) each at
    the middles of the blocks.
    """
    s, shift = problem.samples[k], problem.shift(k, fit.nuisance)
    position = problem.motions[k].motor(axis, build(fit.machine).axes[axis], GRID_STEPS)
    per_rad = problem.sensitivity[k].axes[:, problem.chain.index(axis)]
    return s.sample(position, shift), s.sample(per_rad, shift)


def curve(problem: Problem, fit: Fit, direction: TurnDirection, k: int) -> Curve:
    """The curves of test ``k``: reading over radius against the position that the drive has reached when the sample was
    taken.

    What lies below the tooth order is described by cosines of half and whole periods over the arc, up to one resolution
    below the tooth order, least squares together with the components and the worn stretches: nothing is folded round at
    the ends of an arc, as zeroing lines of an FFT would, and no component leaks into what is taken out.
    """
    s, good = problem.samples[k], problem.samples[k].good
    x, per_rad = (v[good] for v in reached(problem, fit, k, direction.axis))
    raw = s.mean[good] / per_rad
    u = (x - x.min()) / np.ptp(x)
    slow = np.arange(int(2.0 * np.ptp(x) / (2 * np.pi) * direction.lowest) + 1)
    low = np.column_stack([np.cos(np.pi * u[:, None] * slow), u])
    worn = [f.effect for f in acting(fit, "worm_wear", direction)]
    faults = [_bell(x, e.si("centre_deg"), e.si("width_deg")) for e in worn]
    rows = components_of(fit, direction)
    fast = [side(n * x) for n, _, _ in rows for side in (np.sin, np.cos)]
    design = np.column_stack([low, *faults, *fast])
    fitted = np.linalg.lstsq(design, raw, rcond=1e-8)[0]
    count = low.shape[1] + len(faults)
    modified = raw - design[:, :count] @ fitted[:count]
    identified = sum((a * DEG * np.sin(n * x + phase * DEG) for n, a, phase in rows), np.zeros(len(x)))
    time = s.centre[good] - problem.shift(k, fit.nuisance)
    return Curve(x, raw, modified, identified, at_reversals(problem, k, time))


def _bell(x: np.ndarray, centre: float, width: float) -> np.ndarray:
    """Shape of a worn stretch at positions (n,) rad, its height 1."""
    return np.exp(-0.5 * (((x - centre + np.pi) % (2 * np.pi) - np.pi) / width) ** 2)


def at_reversals(problem: Problem, k: int, time: np.ndarray) -> np.ndarray:
    """Which instants (n,) s of the program lie at a turning point of a linear axis, (n,) bool."""
    m = problem.motions[k]
    step = np.sign(np.round(np.diff(m.commands[:, problem.chain.linear_columns], axis=0), 12))
    out = np.zeros(len(time), bool)
    for j in range(step.shape[1]):
        moving = np.flatnonzero(step[:, j])
        for i in moving[1:][np.diff(step[moving, j]) != 0.0]:
            out |= (time > m.time[i] - BEFORE) & (time < m.time[i] + AFTER)
    return out
