"""What stands between two encoders of one axis: its transmission, from the motor to the load.

Where the encoder at the load was recorded beside that of the motor, their difference shows the transmission alone. No
control is in it. The recorded motion of the motor goes through the operations of the effects of exactly this axis
(:mod:`mjsim.simulation.transmission`), and what comes out is held against the load's encoder:

    load(t) = transmission(motor(t)) + zero − late · velocity − (Jl / k) · acceleration

``zero`` and ``late``, the time by which the load's encoder is read later, are of each recording; so is the place in the
play where a recording begins. The last term is a compliant drive of stiffness k before the moving mass Jl, below its
resonance; where the moving mass is not known, Jl / k is a number of each recording, and no cause is named.

In a play, the load is free. Between the flanks only its slide's friction brakes it, by the deceleration ``glide``:
``y'' = −glide · sign(y')``; at a flank it takes the speed of the motor. A load with much friction stays until the
motor has turned back: that is the play of the catalogue. One that glides changes the flank where the motor slows down.

The search is that of :mod:`mjsim.estimation.axis_logs.selection`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.signal import savgol_filter

from mjsim.effects import registry
from mjsim.estimation.axis_logs.candidates import Candidate, wave_entries
from mjsim.estimation.axis_logs.data import AxisData, LogNoise, noise_of
from mjsim.estimation.axis_logs.derivatives import AxisRuns
from mjsim.estimation.axis_logs.discrepancy import pitch_limit
from mjsim.estimation.axis_logs.entries import GLIDE, LAG, PHASE, SHIFT, START_PLAY, ZERO, AxisModel, Entry
from mjsim.estimation.axis_logs.fit import AxisFit, LogFitter
from mjsim.estimation.axis_logs.found import FoundCause
from mjsim.estimation.axis_logs.probability import beyond_class
from mjsim.estimation.axis_logs.selection import AxisSearch
from mjsim.estimation.axis_logs.start import MOST_SHIFT
from mjsim.estimation.axis_logs.waves import near, orders_over
from mjsim.instruments.axis_log.measurement import AxisRecord
from mjsim.machine.bodies import has_model
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import PLAY
from mjsim.simulation.servo import ServoMotion
from mjsim.simulation.transmission import transmit
from mjsim.units import DEG

#: Kinds that a transmission of one axis shows between its ends.
BETWEEN = ("backlash", "scale_error", "pitch_error", "drive_compliance")
#: Prior standard deviation of an effect's size, in typical sizes (assumed).
_WIDE = 30.0
#: Time over which speeds and accelerations of the recorded motion are taken, s (assumed: no load moves faster).
_SMOOTH = 0.02
#: Orders of waves that are always looked at, in turns of the motor; most of all.
_USUAL, _MOST_WAVES = (1.0, 2.0), 8
#: Decelerations of a free load from which fits start, in the motor's largest: it stays, it glides.
_GLIDES = (10.0, 1e-3)
#: Usual Jl / k of a drive, s²: 40 Hz and more (assumed).
_LAG = 1e-6
#: Deviation of an encoder's zero against the other's, encoder steps: each counts from where it was switched on.
_ANYWHERE = 1e6


@dataclass(frozen=True)
class RecordedMotion:
    """The recorded motion of the motor in one recording, (n,) axis units each, and per s."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class EncoderFitter(LogFitter):
    """Fits models of the transmission of one axis to the differences of its two encoders; arguments as there."""

    def __init__(self, machine: Machine, data: Sequence[AxisData], threads: int = 2) -> None:
        super().__init__(machine, data, threads)
        self.measured = [d.means(self.difference(d)) for d in self.data]
        self._motions = [_motion(d) for d in self.data]
        self._column = machine.chain.index(self.data[0].axis)

    @staticmethod
    def difference(d: AxisData) -> np.ndarray:
        """Load less motor, (n,) axis units."""
        assert d.record.load is not None
        return d.record.load - d.record.actual

    def motion(self, model: AxisModel, vector: np.ndarray, k: int, axes: AxisRuns | None = None) -> ServoMotion:
        """The recorded motion of the motor, with the torque that its inertia needs."""
        m, drive = self._motions[k], self.machine.drives[model.axis]
        torque = drive.inertia * drive.gear * m.acceleration
        return ServoMotion(self.data[k].time, m.position, m.velocity, torque)

    def positions(self, model: AxisModel, vector: np.ndarray, k: int, axes: AxisRuns | None = None) -> np.ndarray:
        """Modelled difference of the encoders in recording ``k``, (n,) axis units."""
        d, m = self.data[k], self._motions[k]
        plant = build(_turned(model.at(vector), model, vector, d.test.setup))
        late, zero, start, brake = (model.nuisance(vector, n, d.name) for n in (SHIFT, ZERO, START_PLAY, GLIDE))
        ops = plant.op_table()
        ops = ops[ops[:, 1] == self._column]
        play = ops[:, 0] == PLAY
        half, out = float(ops[play, 3].sum()), np.zeros(len(d.time))
        if half > 0.0:
            out += behind_play(m.position, m.velocity, half, brake, d.step, start) - m.position
        if not play.all():
            motor = np.zeros((len(d.time), len(plant.chain.columns)))
            motor[:, self._column] = m.position
            out += transmit(ops[~play], motor, d.time)[:, self._column] - m.position
        drive = plant.axes[model.axis]
        lag = model.nuisance(vector, LAG, d.name)
        lag += drive.load_inertia / drive.stiffness if drive.load_inertia > 0.0 else 0.0
        return out + zero - late * m.velocity - lag * m.acceleration

    def means(self, axes: AxisRuns, model: AxisModel, vector: np.ndarray, k: int) -> np.ndarray:
        """Block means of :meth:`positions`."""
        return self.data[k].means(self.positions(model, vector, k))

    def axes(self, model: AxisModel, vector: np.ndarray) -> AxisRuns:
        """Nothing: no drive is simulated."""
        return {}

    def allowed(self, model: AxisModel, design: Sequence[np.ndarray]) -> tuple[float, ...]:
        """RMS that a sound transmission may leave in each recording: a pitch error of its class."""
        most = pitch_limit(self.machine, model.axis)
        return tuple(float(np.hypot(d.resolution, most)) for d in self.data)


class EncoderSearch(AxisSearch):
    """The search for what stands between two encoders; arguments as of the search on one axis."""

    def _prepare(self, machine: Machine, data: Sequence[AxisData], threads: int) -> None:
        self.fitter = EncoderFitter(machine, data, threads)
        self.catalogue = EncoderCatalogue(machine, data)
        self.gains = []

    def as_given(self) -> AxisFit:
        """The machine as it is: zeros and times of the encoders fitted."""
        return self.fitter.fit(nuisances_between(self.machine, self.fitter.data))

    def sheet(self) -> AxisFit:
        """The same: no number of the data sheet is between the encoders."""
        return self.as_given()

    def _opening(self, sheet: AxisFit) -> tuple[list[Candidate], list[AxisFit]]:
        return [], [sheet]

    def _against_competing(self, fit: AxisFit, candidate: Candidate, without: AxisFit | None) -> FoundCause:
        """As there; what a sound transmission may have is no cause."""
        cause = super()._against_competing(fit, candidate, without)
        large = beyond_class(candidate, fit)
        return cause if large is None or large >= 0.5 else replace(cause, gain=0.0)

    def orders(self, fit: AxisFit) -> list[float]:
        """Orders of waves over the position that stand out, in turns of the motor."""
        gear, best = self.machine.drives[self.axis].gear, []
        for d, r in zip(self.fitter.data, fit.residual, strict=True):
            best += orders_over(d.means(d.record.actual) * gear, r)
        return list(dict.fromkeys([*_USUAL, *best]))


class EncoderCatalogue:
    """Causes between the encoders of one axis.

    Args:
        machine: As given.
        data: Recordings of the axis.
    """

    def __init__(self, machine: Machine, data: Sequence[AxisData]) -> None:
        self.machine, self.axis, self.data = machine, data[0].axis, data

    def missing(self, model: AxisModel, orders: Sequence[float] = _USUAL) -> list[Candidate]:
        """Every cause that the model does not have yet.

        Args:
            model: As it is.
            orders: Of waves that stand out, in turns of the motor.
        """
        has = {e.owner for e in model.entries}
        out = []
        for kind in ("backlash", "scale_error"):
            effect = self._make(kind)
            if effect is not None and effect.id not in has:
                if kind == "backlash":  # a size that is far from the true one promises nothing
                    effect = self._as_wide_as_seen(effect)
                out += [Candidate(effect, (self._entry(effect), *more)) for more in self._ways(kind)]
        effect = self._make("drive_compliance")
        if effect is not None and effect.id not in has:
            p = effect.parameters_of(self.axis)[0]
            stiff = Entry(effect.id, p.name, effect.values[p.name], log=True, deviation=10.0, lower=p.lower, upper=1e12)
            out.append(Candidate(effect, (stiff,)))
        return out + self._waves(model, orders)

    def _ways(self, kind: str) -> list[tuple[Entry, ...]]:
        """What differs between the starts of a kind: a load that stays in the play, and one that glides."""
        if kind != "backlash":
            return [()]
        return [tuple(glide_entry(d, share) for d in self.data) for share in _GLIDES]

    def _waves(self, model: AxisModel, orders: Sequence[float]) -> list[Candidate]:
        present = model.machine.effect(f"pitch_error.{self.axis}")
        there = [row[0] for row in present.values["components"]] if present is not None else []
        of_turn = self.machine.drives[self.axis].gear if self.machine.chain.is_rotary(self.axis) else 1.0
        size = registry.kinds()["pitch_error"].parameters_of(self.axis)[0].scale
        fresh = [round(o * of_turn, 6) for o in orders if not near(o, [t / of_turn for t in there])]
        out = []
        for order in fresh if len(there) < _MOST_WAVES else []:
            effect = registry.make(f"pitch_error.{self.axis}", self.machine.chain, components=[[order, size, 0.0]])
            out.append(Candidate(effect, wave_entries(effect, size, f" {order:g}"), order=order))
        return out

    def _make(self, kind: str) -> Effect | None:
        """An effect of one typical size; nothing where the machine cannot have it."""
        chain, cls = self.machine.chain, registry.kinds()[kind]
        if self.axis not in cls.subjects_of(chain) or (kind == "drive_compliance" and not has_model(chain)):
            return None
        p = cls.parameters_of(self.axis)[0]
        return registry.make(f"{kind}.{self.axis}", chain, **{p.name: p.scale})

    def _as_wide_as_seen(self, effect: Effect) -> Effect:
        """A play of twice the RMS of the encoders' difference: it stands at one flank or the other."""
        p = effect.parameters_of(self.axis)[0]
        unit = effect.si(p.name) / effect.values[p.name]
        seen = 2.0 * max(float(np.std(EncoderFitter.difference(d))) for d in self.data) / unit
        return effect.replaced(**{p.name: min(max(seen, p.scale), p.upper)})

    def _entry(self, effect: Effect) -> Entry:
        p = effect.parameters_of(self.axis)[0]
        return Entry(
            effect.id,
            p.name,
            effect.values[p.name],
            scale=p.scale,
            deviation=_WIDE,
            centre=p.neutral,
            lower=p.lower,
            upper=p.upper,
        )


def encoder_data(data: Sequence[AxisData]) -> tuple[AxisData, ...]:
    """The recordings of an axis that have its load, with the noise of the difference of both encoders."""
    out = []
    for d in data:
        if d.record.load is None:
            continue
        load = noise_of(d.time, AxisRecord(d.record.command, d.record.load), d.resolution)
        out.append(
            replace(d, noise=LogNoise(float(np.hypot(d.noise.rms, load.rms)), f"{d.noise.source}, both encoders"))
        )
    return tuple(out)


def nuisances_between(machine: Machine, data: Sequence[AxisData]) -> AxisModel:
    """The model of the transmission as the machine file has it: zeros, times and places in the play are free."""
    entries = []
    for d in data:
        most = MOST_SHIFT * d.step
        entries.append(Entry(SHIFT, SHIFT, 0.0, d.name, 1.0, scale=d.step, lower=-most, upper=most))
        entries.append(Entry(ZERO, ZERO, 0.0, d.name, _ANYWHERE, scale=d.resolution))
        entries.append(Entry(START_PLAY, START_PLAY, 0.0, d.name, 1.0, lower=-1.0, upper=1.0))
        entries.append(glide_entry(d, _GLIDES[0]))
        if not has_model(machine.chain):
            entries.append(Entry(LAG, LAG, 0.0, d.name, _WIDE, scale=_LAG, lower=0.0, upper=1e3 * _LAG))
    return AxisModel(machine, data[0].axis, tuple(entries))


def glide_entry(d: AxisData, share: float) -> Entry:
    """Deceleration of a load that is free, in a recording: as a ``share`` of the motor's largest."""
    most = float(np.abs(_motion(d).acceleration).max())
    low, high = 1e-6 * most, 1e3 * most
    return Entry(GLIDE, GLIDE, share * most, d.name, 3.0, log=True, lower=low, upper=high, centre=most)


@njit(cache=True, nogil=True, error_model="numpy")
def behind_play(motor, speed, half, brake, step, start):
    """Positions of a load behind a play, (n,).

    Args:
        motor: Positions of the motor, (n,) axis units.
        speed: Its speeds, (n,) per s.
        half: Half of the play's width.
        brake: Deceleration of the load while it is free, per s².
        step: Time between two samples, s.
        start: Place in the play at the first sample, −1 to 1.
    """
    out = np.empty(len(motor))
    y, v = motor[0] + start * half, speed[0]
    for i in range(len(motor)):
        if i:
            lost = brake * step
            v = v - math.copysign(lost, v) if abs(v) > lost else 0.0
            y += v * step
        if y > motor[i] + half:
            y, v = motor[i] + half, speed[i]
        elif y < motor[i] - half:
            y, v = motor[i] - half, speed[i]
        out[i] = y
    return out


def _motion(d: AxisData) -> RecordedMotion:
    """The recorded motion of the motor, its speed and acceleration by parabolas through the samples around."""
    width = 2 * max(2, round(0.5 * _SMOOTH / d.step)) + 1
    speed, acceleration = (np.asarray(savgol_filter(d.record.actual, width, 2, deriv=n, delta=d.step)) for n in (1, 2))
    return RecordedMotion(d.record.actual, speed, acceleration)


def _turned(machine: Machine, model: AxisModel, vector: np.ndarray, setup: str) -> Machine:
    """The machine as it was in one set-up: its encoders may have counted from elsewhere."""
    effect = machine.effect(f"pitch_error.{model.axis}")
    if effect is None:
        return machine
    rows = [
        [o, a, p + model.nuisance(vector, PHASE, setup, f"pitch_error {o:g}") / DEG]
        for o, a, p in effect.values["components"]
    ]
    return machine.with_effect(effect.replaced(components=rows))
