"""Structures that ring: a spindle head, a column or a table swings on its own flexibility when the axes accelerate.

Every machine has such modes, and no data sheet states them. One mode is a mass on a spring whose foot is accelerated,

    u'' + 2 ζ ω u' + ω² u = −a

with a the acceleration of what the axes move. How far each of these swings the spindle against the table in each
direction is free: these are the coefficients of a mode beside its frequency and damping. Far below its frequency, or
without a peak, it is the sag of a structure under its own inertia: that is no mode, but a curve of an acceleration.

Two modes of near frequencies look like one that is damped more. So a further mode is looked for beside those that a
model has, and each of these is then moved to where it explains most beside the others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
from scipy.optimize import minimize

from mjsim.inference.curve_terms import STRUCTURE, CurveTerm, CurveTerms, SwingColumns
from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.inference.variables import SWING
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import grounded, spindle_ball, table_ball, tool_side, work_side
from mjsim.units import UM

#: Frequencies that are looked at first, Hz: below, a machine would be useless; above, block means show little.
_FREQUENCIES = np.geomspace(6.0, 40.0, 16)
#: Damping ratio there, so that a frequency covers all up to the next: also the largest that a mode may have (assumed:
#: machine structures have 0.01 to 0.1).
_DAMPING = 0.1
#: Modes that are looked at more closely: that of the tool's side and that of the table's.
_CLOSER = 2


def swing(acceleration: np.ndarray, frequency: float, damping: float, step: float) -> np.ndarray:
    """Deflection of a mass on a spring whose foot is accelerated, exact for one that is straight between its samples.

    Args:
        acceleration: Of the foot, (n, k) m/s².
        frequency: Undamped, Hz.
        damping: Damping ratio.
        step: Of the samples, s.

    Returns:
        Of the mass, (n, k) m. It is at rest until the acceleration rises, in the step before the first instant.
    """
    from scipy.signal import cont2discrete, lfilter  # slow to load, and most machines do not ring

    omega = 2.0 * np.pi * frequency
    mass = ([-1.0], [1.0, 2.0 * damping * omega, omega**2])
    top, bottom, *_ = cast(tuple[np.ndarray, ...], cont2discrete(mass, step, method="foh"))
    return np.asarray(lfilter(top.ravel(), bottom.ravel(), acceleration, axis=0))


def driving(chain: Chain, q: np.ndarray, ball: np.ndarray, step: float) -> np.ndarray:
    """What shakes a structure, (n, k) m/s²: the acceleration of every linear axis, and of what the rotary axes carry,
    on the side of the work and of the tool.

    Args:
        chain: The machine's axes.
        q: Where their load sides are, (n, axes) m and rad, or with error motions behind.
        ball: Centre of the table ball in the work frame, (3,) m.
        step: Between the instants, s.
    """
    moved = [q[:, [chain.index(a) for a in chain.linear]]]
    if work_side(chain):
        moved.append(table_ball(chain, q, ball))
    if tool_side(chain):
        moved.append(spindle_ball(chain, q) - grounded(chain, q))
    return np.pad(np.diff(np.hstack(moved), 2, axis=0) / step**2, ((1, 1), (0, 0)))


class Modes:
    """Makes terms of modes for one fitted model.

    Args:
        terms: Of the model.
    """

    def __init__(self, terms: CurveTerms) -> None:
        chain, problem = terms.chain, terms.problem
        self._along = [np.column_stack([s[a] for a in chain.linear]) for s in terms.sensitivities]
        self._means, self._workers = terms.averages.of_tests, problem.workers

        def one(k: int) -> np.ndarray:
            motion = problem.motions[k]
            return driving(chain, motion.load(terms.plant, GRID_STEPS), np.array(motion.test.table_ball), GRID)

        self._driving = problem.map(one)

    def of(self, frequency: float, damping: float, found_at: float = 0.0) -> CurveTerm:
        """The term of one mode. With a coefficient of 1 it swings by 1 µm at most.

        Args:
            frequency: Undamped, Hz.
            damping: Damping ratio.
            found_at: Frequency at which it was found first, Hz; 0 where that is its own.
        """
        moved = [swing(a, frequency, damping, GRID) for a in self._driving]
        scale = UM / max(max(float(np.abs(u).max()) for u in moved), 1e-12)
        rows = [
            (np.asarray(mean @ (scale * u))[:, :, None] * along[:, None, :]).reshape(len(along), -1)
            for mean, along, u in zip(self._means, self._along, moved, strict=True)
        ]
        knots = np.arange(self._driving[0].shape[1] * self._along[0].shape[1])
        columns = SwingColumns(rows, (frequency, damping), found_at or frequency)
        return CurveTerm("", STRUCTURE, SWING, knots, None, columns)

    def best(self, evidence: Callable[[CurveTerm], float]) -> list[CurveTerm]:
        """The modes that explain most, each at its best frequency and damping.

        Args:
            evidence: Log evidence of a term.
        """
        coarse = self._workers.map(lambda f: evidence(self.of(f, _DAMPING)), _FREQUENCIES)
        inside = range(1, len(coarse) - 1)
        peaks = [i for i in inside if coarse[i] > 0.0 and coarse[i] == max(coarse[i - 1 : i + 2])]
        best = sorted(peaks, key=lambda i: -coarse[i])[:_CLOSER]
        return self._workers.map(lambda i: self._moved(_FREQUENCIES[i], 0.5 * _DAMPING, 0.0, evidence), best)

    def moved(self, term: CurveTerm, evidence: Callable[[CurveTerm], float]) -> CurveTerm:
        """A mode at the frequency and damping near its own that explain most.

        Args:
            term: The mode.
            evidence: Log evidence of a term.
        """
        return self._moved(*cast(tuple[float, float], term.mode), term.found_at, evidence)

    def _moved(
        self, frequency: float, damping: float, found_at: float, evidence: Callable[[CurveTerm], float]
    ) -> CurveTerm:
        def at(x: np.ndarray) -> CurveTerm:
            frequency, damping = np.exp(x).tolist()
            return self.of(frequency, min(damping, _DAMPING), found_at)

        simplex = np.log([frequency, damping]) + np.array([[0.0, 0.0], [0.04, 0.0], [0.0, -0.7]])
        options = {"maxfev": 24, "initial_simplex": simplex, "xatol": 0.003, "fatol": 0.5}
        return at(minimize(lambda x: -evidence(at(x)), simplex[0], method="Nelder-Mead", options=options).x)
