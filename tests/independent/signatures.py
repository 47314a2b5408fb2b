"""Signatures of causes on a layout: what one of them adds to the bar readings, before and after the set-up errors take
their share.

A ``Bench`` is one machine on one list of tests, decimated; it keeps single-axis motions, so that a drive effect costs
one axis' simulation.
"""

from __future__ import annotations

import functools
import json

import numpy as np

from . import drives, measurement, transmission
from .kinematics import AXES, bar_reading
from .machines import by_id, nominal, with_hidden
from .programs import Program
from .simulate import State, grid

#: Samples of a signature are this many grid steps apart (25 ms), transmissions are followed every fifth step.
EVERY, FINE = 25, 5
#: Coarser integration than for traces, enough for signatures: 100 µs.
SUBSTEPS = 10
#: Noise of one decimated sample, µm: the trace's, widened for its correlation.
SIGMA = 0.2


class Bench:
    """Signatures on one machine and one list of tests; vectors are over all tests' samples, µm."""

    def __init__(self, tests: list[dict], machine: str) -> None:
        model = nominal(machine)
        self.tests, self.drive, self.model = tests, model["drive"], by_id(model["effect"])
        self.programs = [Program(t) for t in tests]
        self.time = [grid(p) for p in self.programs]
        self.commands = [p.commands(t) for p, t in zip(self.programs, self.time, strict=True)]
        self.pick = [
            np.arange(
                int(np.ceil(p.window[0] / drives.GRID / EVERY)) * EVERY, int(p.window[1] / drives.GRID) + 1, EVERY
            )
            // FINE
            for p in self.programs
        ]
        self.slices, start = [], 0
        for k in self.pick:
            self.slices.append(slice(start, start + len(k)))
            start += len(k)
        self.size = start
        self._motions: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}
        self._vectors: dict[str, np.ndarray] = {}
        self._nominal = self.readings(self.model)
        self._basis, self._solve = self._nuisances()

    def _motion(self, k: int, axis: str, effects: dict, keep: bool) -> tuple[np.ndarray, np.ndarray]:
        late = drives.delay(axis, effects)
        key = (k, axis, late, drives.parameters(axis, self.drive[axis], effects))
        if key in self._motions:
            return self._motions[key]
        i = AXES.index(axis)
        command = self.commands[k][:, i]
        if late and np.ptp(command):
            command = self.programs[k].commands(self.time[k] - late)[:, i]
        position, torque = drives.run_axis(axis, self.drive[axis], effects, command, SUBSTEPS)
        out = position[::FINE].copy(), torque[::FINE].copy()
        if keep:
            self._motions[key] = out
        return out

    def loads(self, k: int, effects: dict, keep: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Load-side positions and motor torques of test k, (n, 5) every FINE grid steps."""
        both = [self._motion(k, a, effects, keep) for a in AXES]
        motor = np.column_stack([b[0] for b in both])
        clock = self.tests[k]["started_s"] + self.time[k][::FINE]
        return transmission.load_side(motor, clock, self.drive, effects), np.column_stack([b[1] for b in both])

    def readings(self, effects: dict, unlisted: tuple = (), ball=None, spindle=None) -> np.ndarray:
        """Readings of all tests, µm; ``ball`` and ``spindle`` are test number -> shift in m."""
        out = np.empty(self.size)
        rng = np.random.default_rng(5)
        for k, program in enumerate(self.programs):
            load, torque = self.loads(k, effects, keep=effects is self.model)
            time, extra = self.time[k][::FINE], None
            if unlisted:
                state = State(time, self.tests[k]["started_s"] + time, load, torque)
                load = load + sum(u.displacement(state) for u in unlisted)
                extra = (sum(u.table(state, program.ball) for u in unlisted) + np.zeros((len(time), 3)))[self.pick[k]]
            load, time = load[self.pick[k]], time[self.pick[k]]
            phases = dict(zip("XYZ", rng.uniform(0.0, 2.0 * np.pi, 3), strict=True))
            load = load + transmission.vibration(time, effects, phases)
            at = program.ball + (ball[k] if ball else 0.0)
            out[self.slices[k]] = bar_reading(load, at, program.length, effects, spindle[k] if spindle else None, extra)
        return out * 1e6

    def _nuisances(self) -> tuple[np.ndarray, np.ndarray]:
        """Columns for one standard deviation of every set-up error, and the inverse of their information matrix."""
        columns, n = [], len(self.tests)
        for setup in dict.fromkeys(t["setup"] for t in self.tests):
            here = [t["setup"] == setup for t in self.tests]
            for size, what in ((measurement.TABLE_BALL, "ball"), (measurement.SPINDLE_BALL, "spindle")):
                for axis in range(3):
                    shift = [np.eye(3)[axis] * size * 1e-6 * h for h in here]
                    columns.append(self.readings(self.model, **{what: shift}) - self._nominal)
        columns.append(np.full(self.size, measurement.LENGTH))
        for k in range(n):
            column = np.zeros(self.size)
            column[self.slices[k]] = (
                np.gradient(self._nominal[self.slices[k]], EVERY * drives.GRID) * measurement.TRIGGER
            )
            columns.append(column)
        basis = np.column_stack(columns)
        return basis, np.linalg.inv(basis.T @ basis + SIGMA**2 * np.eye(basis.shape[1]))

    def project(self, s: np.ndarray) -> np.ndarray:
        """What set-up errors of typical size leave of a signature (columns of (n,) or (n, k))."""
        return s - self._basis @ (self._solve @ (self._basis.T @ s))

    def signature(self, cause) -> np.ndarray:
        """(n,) contribution of a catalogue effect (dict) or of an unlisted cause, not projected."""
        if not isinstance(cause, dict):
            return self.readings(self.model, (cause,)) - self._nominal
        key = json.dumps(cause, sort_keys=True)
        if key not in self._vectors:
            self._vectors[key] = self.readings(with_hidden(self.model, [cause])) - self._nominal
        return self._vectors[key]

    def rms(self, cause) -> float:
        """RMS over the campaign's samples of the projected signature, µm."""
        return float(np.sqrt(np.mean(self.project(self.signature(cause)) ** 2)))

    def rms_by_test(self, cause) -> dict[str, float]:
        """The same for each test by name."""
        left = self.project(self.signature(cause))
        return {t["name"]: float(np.sqrt(np.mean(left[s] ** 2))) for t, s in zip(self.tests, self.slices, strict=True)}


@functools.lru_cache(maxsize=6)
def _bench(tests: str, machine: str) -> Bench:
    return Bench(json.loads(tests), machine)


def bench(tests: list[dict], machine: str) -> Bench:
    """The bench of a layout and a machine, kept while it is among the last six used."""
    return _bench(json.dumps(list(tests), sort_keys=True), machine)
