"""The next motion to record of an axis: what it would separate, before it is made.

Two explanations are told apart as ball-bar tests do it (:mod:`mjsim.inference.planning.separation`): the difference of
their predictions, in units of its noise, that is left when the second one has adapted what the recordings have left
open. Numbers of which only a combination is known are judged by how much of its uncertainty a recording would leave.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.effects import registry
from mjsim.inference.axis_logs.data import AxisData, LogNoise
from mjsim.inference.axis_logs.entries import NUISANCES, AxisModel, Entry
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.shared import known_numbers
from mjsim.inference.axis_logs.start import nuisance_entries, start_model
from mjsim.inference.least_squares import ridge_solution
from mjsim.inference.posterior import CompetingModel
from mjsim.inference.settings import PLAN, PlanSettings
from mjsim.instruments.axis_log.measurement import AxisRecord, LogTest
from mjsim.instruments.axis_log.motions import Motion, proposals, variations
from mjsim.machine.model import Machine
from mjsim.threads import one_blas_thread

#: Sampling time of a recording, s; time for starting it and fetching the file, and more where a number of the control
#: is changed and set back, s (assumed).
_STEP, _HANDLING, _SETTING = 1e-3, 60.0, 240.0
#: Share of its largest value within which a recorded torque is known (assumed), and share of the uncertainty of a
#: combination that a recording which decides leaves.
_TORQUE, _LEFT = 0.02, 0.25
#: Widest prior that counts: what is wider is unknown.
_UNKNOWN = 100.0


@dataclass(frozen=True)
class PlannedLog:
    """What one recording would do.

    Attributes:
        motion: What moves, and what is recorded.
        minutes: Machine time with handling.
        deviance: Squared distance of two explanations in units of the noise; that of a combination's present
            uncertainty where one is to be known.
        difference: RMS of the difference of two explanations after adaptation, axis units.
        left: Share of a combination's uncertainty that it leaves; nothing for explanations.
        settings: By which it is judged.
    """

    motion: Motion
    minutes: float
    deviance: float
    difference: float = 0.0
    left: float | None = None
    settings: PlanSettings = PLAN

    @property
    def decides(self) -> bool:
        """Whether it is expected to decide."""
        return self.deviance >= self.settings.decisive if self.left is None else self.left <= _LEFT

    @property
    def worth(self) -> tuple[float, float]:
        """Sort key: what decides by deviance per minute, before what does not by deviance."""
        return (1.0, min(self.deviance, self.settings.certain) / self.minutes) if self.decides else (0.0, self.deviance)


class LogPlanner:
    """Judges motions of one axis.

    Args:
        machine: As given: its chain, and which controllers there are.
        axis: Letter.
        fits: Explanations that were fitted to what there is; the first is taken for true.
        like: A recording of the axis, whose controller, encoder and noise are taken.
        settings: By which a recording is judged.
    """

    def __init__(
        self,
        machine: Machine,
        axis: str,
        fits: Sequence[AxisFit],
        like: AxisData | None = None,
        settings: PlanSettings = PLAN,
    ) -> None:
        self.machine, self.axis, self.fits, self.settings = machine, axis, fits, settings
        self.like, self.chain = like, machine.chain
        self.resolution = like.resolution if like else (1e-6 if self.chain.is_rotary(axis) else 0.1e-6)
        gain = max(machine.drives[axis].position_gain, 1.0)
        self.memory = like.memory if like else 3.0 / gain

    def motions(self) -> list[Motion]:
        """Everything that is looked at."""
        plain = list(proposals(self.chain, self.axis))
        return [*plain, *(v for m in plain for v in variations(m))]

    def minutes(self, motion: Motion) -> float:
        """Machine time with handling."""
        moving = len(motion.command(_STEP)) * _STEP
        return (moving + _HANDLING + (_SETTING if motion.gain != 1.0 else 0.0)) / 60.0

    # -- explanations --------------------------------------------------------------------------------------------------

    @one_blas_thread
    def apart(self, motions: Iterable[Motion] | None = None) -> list[PlannedLog]:
        """Motions by how well they separate the first two explanations, the best first."""
        first, second = self.fits[0], self.fits[1]
        out = []
        for motion in motions or self.motions():
            data = self._data(motion)
            here, there = self._model(first.model, motion, data), self._model(second.model, motion, data)
            fitter = LogFitter(there.machine, [data], 1)
            d = self._seen(LogFitter(here.machine, [data], 1), here, motion) - self._seen(fitter, there, motion)
            J = self._columns(fitter, there, motion)
            root = self._root(there, second)
            d, J = self._weighed(d, first, motion, data), self._weighed(J, first, motion, data) @ root
            rest = d - J @ ridge_solution(J.T @ J, J.T @ d, 1.0)
            positions = rest[: data.blocks] / self._weight(first, data)
            size = float(np.sqrt(np.mean(positions**2)))
            out.append(PlannedLog(motion, self.minutes(motion), float(max(d @ rest, 0.0)), size, None, self.settings))
        return sorted(out, key=lambda p: p.worth, reverse=True)

    # -- combinations --------------------------------------------------------------------------------------------------

    @one_blas_thread
    def known(self, labels: Sequence[str], motions: Iterable[Motion] | None = None) -> list[PlannedLog]:
        """Motions by how much of the uncertainty of some numbers' weakest combination they leave, the best first."""
        fit = self.fits[0]
        kept = [j for j, e in enumerate(fit.model.entries) if e.owner not in NUISANCES]
        before = fit.covariance[np.ix_(kept, kept)]
        names = [fit.model.entries[j].label for j in kept]
        at = [names.index(label) for label in labels if label in names]
        values, vectors = np.linalg.eigh(before[np.ix_(at, at)])
        weak = np.zeros(len(kept))
        weak[at] = vectors[:, -1]
        out = []
        for motion in motions or self.motions():
            data = self._data(motion)
            model = self._model(fit.model, motion, data)
            fitter = LogFitter(model.machine, [data], 1)
            J = self._weighed(self._columns(fitter, model, motion), fit, motion, data)
            root = self._root(model, fit)
            n = sum(e.owner not in NUISANCES for e in model.entries)
            normal = root.T @ (J.T @ J) @ root + np.eye(len(root))
            after = (root @ np.linalg.inv(normal) @ root.T)[:n, :n]
            share = float(np.sqrt(max(weak @ after @ weak, 0.0) / max(float(values[-1]), 1e-30)))
            out.append(
                PlannedLog(motion, self.minutes(motion), 1.0 / max(share, 1e-6) ** 2 - 1.0, 0.0, share, self.settings)
            )
        return sorted(out, key=lambda p: p.worth, reverse=True)

    # -- one recording -------------------------------------------------------------------------------------------------

    def _data(self, motion: Motion) -> AxisData:
        """The recording as it would be."""
        command = motion.command(_STEP)
        test = LogTest(motion.name, (self.axis,), self.like.test.controller if self.like else None, motion.name)
        noise = LogNoise(self.like.noise.rms if self.like else self.resolution / np.sqrt(12.0), "planned")
        time = _STEP * np.arange(len(command))
        record = AxisRecord(command, command)
        return AxisData(replace(test, chain=self.chain), self.axis, time, record, 1, (0.0, 0.0), noise,
                        self.resolution, self.memory)  # fmt: skip

    def _model(self, model: AxisModel, motion: Motion, data: AxisData) -> AxisModel:
        """An explanation in the new recording: its numbers, and fresh nuisances."""
        machine = model.machine
        if motion.gain != 1.0:
            has = machine.effect(f"velocity_gain.{self.axis}")
            ratio = motion.gain * (has.values["ratio"] if has is not None else 1.0)
            machine = machine.with_effect(registry.make(f"velocity_gain.{self.axis}", self.chain, ratio=ratio))
        entries = [e for e in model.entries if e.owner not in NUISANCES]
        return AxisModel(machine, self.axis, (*entries, *nuisance_entries(machine, [data])))

    def _seen(self, fitter: LogFitter, model: AxisModel, motion: Motion) -> np.ndarray:
        """What a recording shows: positions, and torques where they are recorded."""
        ran = fitter.motion(model, model.vector, 0)
        data = fitter.data[0]
        position = np.interp(data.time, ran.time, ran.position)
        return np.concatenate([position, np.interp(data.time, ran.time, ran.torque)]) if motion.torque else position

    def _columns(self, fitter: LogFitter, model: AxisModel, motion: Motion) -> np.ndarray:
        """Derivatives of what a recording shows, (n, p), by differences to both sides."""
        out, step = [], 1e-3
        n = len(fitter.data[0].time)
        for j, e in enumerate(model.entries):
            if e.owner in ("shift", "zero"):
                ran = fitter.motion(model, model.vector, 0)
                slope = -np.interp(fitter.data[0].time, ran.time, ran.velocity) if e.owner == "shift" else np.ones(n)
                column = e.scale * np.concatenate([slope, np.zeros(n)]) if motion.torque else e.scale * slope
            else:
                ends = []
                for sign in (1.0, -1.0):
                    moved = model.vector
                    moved[j] += sign * step
                    ends.append(self._seen(fitter, model.with_values(moved), motion))
                column = (ends[0] - ends[1]) / (2.0 * step)
            out.append(column)
        return np.column_stack(out)

    def _weight(self, fit: AxisFit, data: AxisData) -> float:
        """One over the standard deviation that one position counts with, from what the present recordings leave."""
        if fit.residual:
            rms = max(float(np.sqrt(fit.mean_squares[: fit.positions].max())), data.noise.rms)
            rows = zip(fit.independent[: fit.positions], fit.residual, strict=False)
            share = min(n / len(r) for n, r in rows)
        else:
            rms, share = data.noise.rms, _STEP / self.memory
        return float(np.sqrt(share) / rms)

    def _weighed(self, columns: np.ndarray, fit: AxisFit, motion: Motion, data: AxisData) -> np.ndarray:
        n = len(data.time)
        out = columns * self._weight(fit, data)
        if motion.torque:
            model = self._model(fit.model, motion, data)
            largest = np.abs(LogFitter(model.machine, [data], 1).motion(model, model.vector, 0).torque).max()
            out[n:] = columns[n:] * np.sqrt(_STEP / self.memory) / (_TORQUE * max(float(largest), 1e-9))
        return out

    def _root(self, model: AxisModel, fit: AxisFit) -> np.ndarray:
        """Cholesky factor of what is known before the recording: of the fit's numbers, and of fresh nuisances."""
        kept = [j for j, e in enumerate(fit.model.entries) if e.owner not in NUISANCES]
        root = np.zeros((len(model.entries), len(model.entries)))
        covariance = _bounded(fit.covariance[np.ix_(kept, kept)])
        root[: len(kept), : len(kept)] = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(kept)))
        for j in range(len(kept), len(model.entries)):
            root[j, j] = _width(model.entries[j])
        return root


def unmeasured(machine: Machine, axis: str, model: CompetingModel | None) -> AxisFit:
    """One axis that no log was recorded of, as its data sheet and the ball bar have it.

    Args:
        machine: As given.
        axis: Letter.
        model: What the ball bar has found; nothing where it has not measured.
    """
    here = model.machine if model is not None else machine
    planner = LogPlanner(here, axis, ())
    data = planner._data(planner.motions()[0])
    known = known_numbers(model, axis, machine.factor is None) if model is not None else None
    return AxisFit(start_model(here, [data], (), known), (), (), (), (), ())


def _bounded(covariance: np.ndarray) -> np.ndarray:
    """A covariance in which nothing is wider than what is unknown."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    scale = np.minimum(1.0, _UNKNOWN / sd)
    return covariance * np.outer(scale, scale)


def _width(entry: Entry) -> float:
    return min(entry.deviation, _UNKNOWN)
