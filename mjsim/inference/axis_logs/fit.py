"""Fit of one axis to all its recordings: bounded least squares on block means, weighted by what each test leaves.

What a model fails to explain counts as noise: a recording's residuals are divided by their own RMS (never below the
noise), and counted by how many independent ones they are worth, from their correlation. So priors keep their weight
while a model is poor, and intervals are those of correlated residuals. How much the final model leaves,
and how probable that makes it, is the subject of :mod:`mjsim.inference.axis_logs.discrepancy`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mjsim.inference.axis_logs.data import AxisData, output_row
from mjsim.inference.axis_logs.derivatives import AxisRuns, along_torques, columns
from mjsim.inference.axis_logs.descent import FALL, Descended, descend, mean_logs
from mjsim.inference.axis_logs.discrepancy import LogDiscrepancy, allowed_in, discrepancy_of
from mjsim.inference.axis_logs.entries import (
    OUTPUT_LATE,
    OUTPUT_ZERO,
    PER_TORQUE,
    PHASE,
    SHIFT,
    START_TORQUE,
    ZERO,
    AxisModel,
)
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.servo import ServoMotion, ServoStart, block_means, follow_sampled, sampled
from mjsim.threads import Workers

#: Number of the plant -> kind of the effect that puts a wave there, whose phase is free in every set-up; so are those
#: of the waves of ``cogging``.
WAVES = {"ripple": "torque_ripple", "friction_ripple": "friction_ripple", "encoder_error": "encoder_error"}
#: A pass is the last where no logarithm of a mean square moved more.
_SAME = 0.02
#: Correlation at which the sum over a series' correlations ends.
_UNCORRELATED = 0.05


@dataclass(frozen=True)
class AxisFit:
    """A fitted model of one axis.

    Attributes:
        model: Its entries have the fitted values.
        residual: Measured less modelled block means per test, (blocks,) axis units.
        design: Derivatives of the modelled block means per test, (blocks, p), at the last step but one of the fit.
        independent: How many independent residuals each test's are worth.
        weight: One over the standard deviation that each test's block means are given, 1/axis units; one number, or
            one of each block.
        noise: RMS of each test's noise, axis units.
        allowed: RMS that a sound machine may leave in each, axis units.
        positions: How many of the rows are positions; those of recorded torques and currents follow, in their units.
            Nothing: all are.
    """

    model: AxisModel
    residual: tuple[np.ndarray, ...]
    design: tuple[np.ndarray, ...]
    independent: tuple[float, ...]
    weight: tuple[float | np.ndarray, ...]
    noise: tuple[float, ...]
    allowed: tuple[float, ...] = ()
    positions: int | None = None

    @cached_property
    def discrepancy(self) -> LogDiscrepancy:
        """What the model leaves beside the noise, and its log evidence. What is left of positions is judged."""
        judged = self.allowed[: self.positions]
        return discrepancy_of(self.model, self.residual, self.design, self.noise, judged)

    @property
    def evidence(self) -> float:
        """Log evidence of the recordings, everything that is free marginalised."""
        return self.discrepancy.evidence

    @property
    def mean_squares(self) -> np.ndarray:
        """Mean square of the residuals, one per test."""
        return np.array([r @ r / len(r) for r in self.residual])

    @property
    def squares(self) -> float:
        """Sum of the squared residuals in the noise of each test."""
        return sum(float(r @ r) / rms**2 for r, rms in zip(self.residual, self.noise, strict=True))

    @property
    def rms(self) -> float:
        """Of the positions of all tests together, axis units."""
        return float(np.sqrt(np.mean(self.mean_squares[: self.positions])))

    @property
    def precision(self) -> np.ndarray:
        """Inverse covariance of the vector, (p, p)."""
        normal = self.model.priors.precision
        for w, d in zip(self.weight, self.design, strict=True):
            weighted = np.reshape(w, (-1, 1)) * d
            normal = normal + weighted.T @ weighted
        return normal

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the vector, (p, p)."""
        p = self.precision
        scale = 1.0 / np.sqrt(np.maximum(np.diag(p), 1e-30))
        inverse = np.linalg.pinv(p * np.outer(scale, scale), rcond=1e-13, hermitian=True)
        return inverse * np.outer(scale, scale)


class LogFitter:
    """Fits models of one axis to its recordings.

    Args:
        machine: As given: gears and sampling times of the controls.
        data: All recordings of the axis.
        threads: Simulations side by side.
    """

    #: Share of its step within which an encoder, and what is computed of it, is true (assumed: interpolation errors).
    true = 0.03
    #: Whether recorded torques and currents are rows of their own.
    has_outputs = True

    def __init__(self, machine: Machine, data: Sequence[AxisData], threads: int = 2) -> None:
        self.machine, self.data = machine, tuple(data)
        rows = [output_row(d) if self.has_outputs else None for d in self.data]
        self.outputs = dict(enumerate(rows))
        self.rows = (*self.data, *(r for r in rows if r is not None))
        places = np.cumsum([r is not None for r in rows]) + len(rows) - 1
        self.rows_of = [(k,) if r is None else (k, int(at)) for k, (r, at) in enumerate(zip(rows, places, strict=True))]
        self._commands = [
            sampled(build(machine.under(d.test.controller)).axes[d.axis], d.time, d.record.command) for d in self.data
        ]
        self.measured = [d.means(d.recorded) for d in self.rows]
        self._controllers = tuple(dict.fromkeys(d.test.controller for d in self.data))
        self._workers = Workers(threads)
        self.noise = tuple(d.noise.rms for d in self.rows)
        # phases count from the set-up that shows most of a wave
        self.first_setup = max(self.data, key=lambda d: np.ptp(d.record.command)).test.setup

    # -- simulation ----------------------------------------------------------------------------------------------------

    def axes(self, model: AxisModel, vector: np.ndarray) -> AxisRuns:
        """The axis of a model as each controller runs it."""
        machine = model.at(vector)
        return {c: build(machine.under(c)).axes[model.axis] for c in self._controllers}

    def motion(self, model: AxisModel, vector: np.ndarray, k: int, axes: AxisRuns | None = None) -> ServoMotion:
        """The simulated motion of recording ``k``; ``axes`` where those of the model at the vector are made already."""
        axis, start = self._under(axes or self.axes(model, vector), model, vector, k)
        return follow_sampled(axis, self._commands[k], start)

    def _under(self, axes: AxisRuns, model: AxisModel, vector: np.ndarray, k: int) -> tuple[AxisPlant, ServoStart]:
        """The axis as it ran in recording ``k``, and where it began."""
        d = self.data[k]
        plant = replace(axes[d.test.controller])
        for attribute, kind in WAVES.items():
            phase = model.nuisance(vector, PHASE, d.test.setup, kind)
            if phase:
                amplitude, order, angle = getattr(plant, attribute)
                setattr(plant, attribute, (amplitude, order, angle + phase))
        plant.waves = tuple(
            (a, o, p + model.nuisance(vector, PHASE, d.test.setup, f"cogging {o:g}")) for a, o, p in plant.waves
        )
        return plant, ServoStart(*d.start, model.nuisance(vector, START_TORQUE, d.name))

    def positions(self, model: AxisModel, vector: np.ndarray, k: int, axes: AxisRuns | None = None) -> np.ndarray:
        """Modelled samples of recording ``k``, (n,) axis units: the simulated motion with the nuisances."""
        d = self.data[k]
        motion = self.motion(model, vector, k, axes)
        shift, zero = self._late(model, vector, d, axes), model.nuisance(vector, ZERO, d.name)
        if not shift and self._commands[k].as_recorded:
            return motion.position + zero
        return motion.at(d.time - shift) + zero

    def _late(self, model: AxisModel, vector: np.ndarray, d: AxisData, axes: AxisRuns | None) -> float:
        """Time, s, by which a recording is late: by its clock, and by a delay of the command that is fitted.

        A delay that the machine file has is none of the second kind. Its recording may have the command behind it.
        """
        shift = model.nuisance(vector, SHIFT, d.name)
        if not any(e.owner == f"servo_delay.{model.axis}" for e in model.entries):
            return shift
        return shift + (axes or self.axes(model, vector))[d.test.controller].delay

    def means(self, axes: AxisRuns, model: AxisModel, vector: np.ndarray, k: int) -> tuple[np.ndarray, ...]:
        """Modelled block means of every row of recording ``k``, (blocks,) axis units, and those of its torque.

        Args:
            axes: Of the model at the vector, see :meth:`axes`.
            model: What is free.
            vector: Where.
            k: Number of the recording.
        """
        d, command = self.data[k], self._commands[k]
        shift, zero = self._late(model, vector, d, axes), model.nuisance(vector, ZERO, d.name)
        axis, start = self._under(axes, model, vector, k)
        if command.as_recorded:
            positions, torque = block_means(axis, command, start, shift, d.block)
            positions = positions[: d.blocks]
        else:
            motion = follow_sampled(axis, command, start)
            positions, torque = d.means(motion.at(d.time - shift)), motion.torque
        row = self.outputs[k]
        return (
            (positions + zero,)
            if row is None
            else (positions + zero, self._output(row, model, vector, shift, torque, k))
        )

    def _output(
        self, row: AxisData, model: AxisModel, vector: np.ndarray, shift: float, torque: np.ndarray, k: int
    ) -> np.ndarray:
        """Modelled block means of a recorded torque or current, (blocks,) in its unit.

        Args:
            row: Of the fit.
            model: What is free.
            vector: Where.
            shift: Time by which the recording is late, s.
            torque: Simulated, at the samples of the control, N·m.
            k: Number of the recording.
        """
        late = shift + model.nuisance(vector, OUTPUT_LATE, row.name)
        seen = np.interp(row.time - late, self._commands[k].time, torque)
        zero = model.nuisance(vector, OUTPUT_ZERO, row.name)
        return model.nuisance(vector, PER_TORQUE, row.channel) * row.means(seen) + zero

    def map(self, jobs: Sequence) -> list:
        """Results of ``f(*arguments)`` for every job ``(f, *arguments)``, in order."""
        return self._workers.map(lambda job: job[0](*job[1:]), jobs)

    def residual(self, model: AxisModel, vector: np.ndarray) -> tuple[np.ndarray, ...]:
        """Measured less modelled block means of every recording."""
        axes = self.axes(model, vector)
        modelled = self.map([(self.means, axes, model, vector, k) for k in range(len(self.data))])
        of_row = {
            i: x for rows, found in zip(self.rows_of, modelled, strict=True) for i, x in zip(rows, found, strict=True)
        }
        return tuple(
            np.nan_to_num(np.clip(m - of_row[i], -d.lost, d.lost), nan=d.lost)
            for i, (m, d) in enumerate(zip(self.measured, self.rows, strict=True))
        )

    def columns(
        self, model: AxisModel, vector: np.ndarray, residual, entries=None, central: bool = False
    ) -> tuple[np.ndarray, ...]:
        """Derivatives, see :func:`mjsim.inference.axis_logs.derivatives.columns`; those of both sides are right along
        the size of all torques.
        """
        design = columns(self, model, vector, residual, entries, central)
        return along_torques(self, model, vector, design) if central and entries is None else design

    # -- fit -----------------------------------------------------------------------------------------------------------

    def independent(self, residual: Sequence[np.ndarray]) -> tuple[float, ...]:
        """Number of independent residuals per test; no mean of them is known better than the encoder is true."""
        out = []
        for d, r in zip(self.rows, residual, strict=True):
            most = float(r @ r) / len(r) / (self.true * d.resolution) ** 2
            out.append(max(min(independent_count(r, d.memory / (d.step * d.block)), most), 1.0))
        return tuple(out)

    def weights(self, residual: Sequence[np.ndarray]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Number of independent residuals per test, and the weight of one block mean."""
        independent, weight = self.independent(residual), []
        for d, r, n in zip(self.rows, residual, independent, strict=True):
            rms = max(float(np.sqrt(r @ r / len(r))), d.noise.rms)
            weight.append(float(np.sqrt(n / len(r)) / rms))
        return independent, tuple(weight)

    def evaluated(self, model: AxisModel) -> AxisFit:
        """A model as it stands, with the derivatives there."""
        residual = self.residual(model, model.vector)
        return self._fit(model, residual, self.columns(model, model.vector, residual))

    def _fit(self, model: AxisModel, residual, design: Sequence[np.ndarray]) -> AxisFit:
        """The fit with these residuals and derivatives."""
        allowed = self.allowed(model, design)
        weights = self.weights(residual)
        return AxisFit(model, tuple(residual), tuple(design), *weights, self.noise, allowed, len(self.data))

    def polished(self, fit: AxisFit, steps: int = 3) -> AxisFit:
        """A fit after some steps with central derivatives, which it keeps.

        Along combinations that only the priors fix, one-sided derivatives lead astray.
        """
        fit = self.fit(fit.model, steps, 1, central=True)
        return self._fit(fit.model, fit.residual, self.columns(fit.model, fit.model.vector, fit.residual, central=True))

    def allowed(self, model: AxisModel, design: Sequence[np.ndarray]) -> tuple[float, ...]:
        """RMS that a sound machine may leave in each recording, axis units."""
        return allowed_in(self.machine, model, design, self.rows)

    def _carried(self, model: AxisModel, residual, former: AxisFit, anew: Collection[str]) -> tuple[np.ndarray, ...]:
        """Derivatives at the start of a model: those of a similar one, and new ones for what that one has not, and for
        the labels ``anew``.
        """
        places = [None if e.label in anew else former.model.place(e.label) for e in model.entries]
        fresh = [j for j, p in enumerate(places) if p is None]
        there = [(j, p) for j, p in enumerate(places) if p is not None]
        out = []
        for old, new in zip(former.design, self.columns(model, model.vector, residual, fresh), strict=True):
            design = np.empty((len(old), len(places)))
            design[:, [j for j, _ in there]] = old[:, [p for _, p in there]]
            design[:, fresh] = new
            out.append(design)
        return tuple(out)

    def fit(
        self,
        model: AxisModel,
        steps: int = 15,
        passes: int = 2,
        central: bool = False,
        least: float = FALL,
        former: AxisFit | None = None,
        anew: Collection[str] = (),
        renew: bool = True,
    ) -> AxisFit:
        """Fit all entries of a model, see :mod:`mjsim.inference.axis_logs.descent`.

        Args:
            model: At its starting values.
            steps: At most so many steps in one pass.
            passes: How often the number of independent residuals is taken anew.
            central: Take derivatives from both sides.
            least: A pass ends where the objective falls by less in a step.
            former: Fit of a similar model, whose derivatives serve for the first steps.
            anew: Labels of entries that both have, whose derivatives are new as well.
            renew: Take new derivatives where those of the ``former`` fit fail.
        """
        priors = model.priors
        vector = priors.inside(model.vector)
        residual = self.residual(model, vector)
        design = (
            self._carried(model, residual, former, anew) if former else tuple(np.zeros((len(r), 0)) for r in residual)
        )
        at = Descended(vector, residual, design)
        for _ in range(passes if model.entries else 0):
            begun = mean_logs(at.residual, self.noise)
            at = descend(
                at,
                priors,
                self.independent(at.residual),
                self.noise,
                lambda x: self.residual(model, x),
                lambda x, r: self.columns(model, x, r, central=central),
                steps,
                least,
                renew,
            )
            if np.abs(mean_logs(at.residual, self.noise) - begun).max() < _SAME:
                break
        return self._fit(model.with_values(at.vector), at.residual, at.design)


def independent_count(residual: np.ndarray, memory: float) -> float:
    """Number of independent residuals that a correlated series (n,) is worth: n over its integrated correlation.

    Args:
        residual: (n,)
        memory: Number of samples beyond which a correlation belongs to what the model lacks, not to noise.
    """
    n = len(residual)
    r = residual - residual.mean()
    power = np.abs(np.fft.rfft(r, 2 * n)) ** 2
    correlation = np.fft.irfft(power)[:n]
    if correlation[0] <= 0.0:
        return float(n)
    correlation = correlation / correlation[0]
    below = np.flatnonzero(correlation < _UNCORRELATED)
    end = int(below[0]) if len(below) else n
    return float(n / min(1.0 + 2.0 * correlation[1:end].sum(), max(memory, 1.0)))
