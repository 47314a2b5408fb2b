"""What stands between two encoders of one axis: its transmission, from the motor to the load.

Where the encoder at the load was recorded beside that of the motor, their difference shows the transmission alone. No
control is in it. The recorded motion of the motor goes through the operations of the effects of exactly this axis
(:mod:`mjsim.simulation.transmission`), and what comes out is held against the load's encoder:

    load(t) = transmission(motor(t)) + twist(t) + zero − late · velocity
    twist'' + 2 ζ ω twist' + ω² twist = −motor'',  ω² = k / Jl

``zero`` and ``late``, the time by which the load's encoder is read later, are of each recording; so is the place in the
play where a recording begins. The twist is that of a compliant drive of stiffness k, behind which the moving mass Jl
swings with the damping ratio ζ: −(Jl / k) · acceleration where the motor moves slowly against the swing, and a ringing
where it does not. The recordings know Jl / k. So a stiffness is known no better than the moving mass. Where there is no
model of that, Jl / k is a number of each recording, by which the load lags without a swing, and no cause is named.

In a play, the load is free. Between the flanks only its slide's friction brakes it, by a deceleration ``glide`` and by
a ``drag`` that grows with the speed: ``y'' = −glide · sign(y') − drag · y'``; at a flank it takes the speed of what
moves it, the motor and the twist. A load with much friction stays until that has turned back: that is the play of the
catalogue. One that glides changes the flank where it slows down.

The recorded motion of the motor has noise, which the load does not follow: noise that went to and fro at a flank would
push the load off it, and the play would come out too wide. So the load leaves a flank only where the motor would have
to pull it by more than the largest acceleration that noise makes in a recording.

The search is that of :mod:`mjsim.inference.axis_logs.search`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.linalg import expm
from scipy.ndimage import minimum_filter1d

from mjsim.effects import registry
from mjsim.inference.axis_logs.candidates import Candidate, wave_entries
from mjsim.inference.axis_logs.data import AxisData, LogNoise, declared_noise, noise_at_rest, noise_of
from mjsim.inference.axis_logs.derivatives import AxisRuns
from mjsim.inference.axis_logs.discrepancy import pitch_limit
from mjsim.inference.axis_logs.entries import DRAG, GLIDE, LAG, LOAD, OFFSET, PHASE, SHIFT, START_PLAY, AxisModel, Entry
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.search import AxisSearch
from mjsim.inference.axis_logs.start import MOST_SHIFT
from mjsim.inference.axis_logs.waves import near, orders_over
from mjsim.instruments.axis_log.measurement import AxisRecord
from mjsim.machine.bodies import has_model
from mjsim.machine.effect import MOST_ORDER, Effect
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import PLAY, AxisPlant
from mjsim.simulation.servo import ServoMotion
from mjsim.simulation.transmission import transmit
from mjsim.units import DEG

#: Kinds that a transmission of one axis shows between its ends.
BETWEEN = ("backlash", "scale_error", "pitch_error", "drive_compliance")
#: Prior standard deviation of an effect's size, in typical sizes (assumed).
_WIDE = 30.0
#: Time over which speeds and accelerations of the recorded motion are taken, s (assumed: no load moves faster).
_SMOOTH = 0.02
#: How often what is left is taken anew for the weights of a fit.
_REWEIGHTED = 2
#: Orders of waves that are always looked at, in turns of the motor; most of all.
_USUAL, _MOST_WAVES = (1.0, 2.0), 8
#: Decelerations of a free load from which fits start, in the motor's largest: it stays, it glides.
_GLIDES = (10.0, 0.1, 1e-3)
#: Usual drag of a free load, 1/s, and prior deviations of the logarithms of drag and glide (assumed).
_DRAG, _BRAKED = 1.0, 3.0
#: Nuisances of every recording that has a play.
_OF_EACH = (SHIFT, OFFSET, START_PLAY, GLIDE, DRAG)
#: Usual Jl / k of a drive, s²: 40 Hz and more (assumed).
_LAG = 1e-6
#: Usual damping ratio of a load on its drive, and prior deviation of its logarithm (assumed).
_DAMPING, _DAMPED = 0.05, 1.0
#: Relative deviations of what an axis moves from the solids of the machine's model, which are those of a usual machine
#: without a workpiece, and of a damping from one that grows with the speed (assumed). By what they make unsure.
_GRANTED = {"stiffness_": 0.2, "damping_ratio": 0.1}
#: Deviation of an encoder's zero against the other's, encoder steps: each counts from where it was switched on.
_ANYWHERE = 1e6


@dataclass(frozen=True)
class RecordedMotion:
    """A motion in one recording, (n,) axis units each, and per s: that of the motor as recorded, or of what stands
    behind a compliant drive.

    Attributes:
        position: With the noise of the encoder.
        velocity: Of a parabola through the samples around.
        acceleration: The same.
        smooth: With less noise.
        speed: Change of the parabola's position since the sample before.
        way: Direction of the motion, −1, 0, 1; 0 where its speed is no more than noise.
        least: The largest acceleration that noise makes of it.
        noise: RMS of that of the position.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    smooth: np.ndarray
    speed: np.ndarray
    way: np.ndarray
    least: float
    noise: float


class EncoderFitter(LogFitter):
    """Fits models of the transmission of one axis to the differences of its two encoders; arguments as there."""

    #: At rest, the rounding of an encoder is the same in every sample: means over noise of a fifth of a step are off by
    #: a tenth of it.
    true = 0.1
    has_outputs = False

    def __init__(self, machine: Machine, data: Sequence[AxisData], threads: int = 2) -> None:
        super().__init__(machine, data, threads)
        self.measured = [d.means(self.difference(d)) for d in self.data]
        self._motions = [_motor(d) for d in self.data]
        self._bends = [_bend(d) for d in self.data]
        self._sure = [np.ones(len(m)) for m in self.measured]
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
        late, zero, start, brake, drag = (model.nuisance(vector, n, d.name) for n in _OF_EACH)
        ops = plant.op_table()
        ops = ops[ops[:, 1] == self._column]
        play = ops[:, 0] == PLAY
        drive = plant.axes[model.axis]
        half = float(ops[play, 3].sum()) + drive.play / drive.gear  # the latter is inside the position loop
        if drive.load_inertia > 0.0:
            moves = _swinging(m, self._bends[k], d.step, drive)
        else:
            moves = replace(m, smooth=m.smooth - model.nuisance(vector, LAG, d.name) * m.acceleration)
        out = moves.smooth - m.position  # the load does not follow the noise of the motor's encoder
        if half > 0.0:
            told = moves.smooth, moves.speed, moves.way, moves.acceleration, moves.least
            out += behind_play(*told, half, brake, drag, d.step, start)
        if not play.all():
            motor = np.zeros((len(d.time), len(plant.chain.columns)))
            motor[:, self._column] = m.position
            out += transmit(ops[~play], motor, d.time)[:, self._column] - m.position
        return out + zero - late * moves.velocity

    def means(self, axes: AxisRuns, model: AxisModel, vector: np.ndarray, k: int) -> tuple[np.ndarray, ...]:
        """Block means of :meth:`positions`, times how sure they are."""
        return (self._sure[k] * self.data[k].means(self.positions(model, vector, k)),)

    def polished(self, fit: AxisFit, steps: int = 3) -> AxisFit:
        """As there, with what is left counted where it is.

        A load that changes its flank hits it and rings: there, more is left than elsewhere. Weighted alike, these few
        samples would move the width of the play by more than its interval says.
        """
        fit, recorded = super().polished(fit, steps), self.measured
        try:
            for _ in range(_REWEIGHTED):
                self._sure = [_sureness(d, r) for d, r in zip(self.data, fit.residual, strict=True)]
                self.measured = [s * m for s, m in zip(self._sure, recorded, strict=True)]
                again = self.fit(fit.model, steps, 1, central=True)
                weight = tuple(w * s for w, s in zip(again.weight, self._sure, strict=True))
                residual = tuple(r / s for r, s in zip(again.residual, self._sure, strict=True))
                fit = replace(fit, model=again.model, residual=residual, independent=again.independent, weight=weight)
        finally:
            self._sure, self.measured = [np.ones(len(m)) for m in recorded], recorded
        return _as_the_model(fit)

    def axes(self, model: AxisModel, vector: np.ndarray) -> AxisRuns:
        """Nothing: no drive is simulated."""
        return {}

    def allowed(self, model: AxisModel, design: Sequence[np.ndarray]) -> tuple[float, ...]:
        """RMS that a sound transmission may leave in each recording: a pitch error of its class."""
        most = pitch_limit(self.machine, model.axis)
        return tuple(float(np.hypot(d.resolution, most)) for d in self.data)


def _as_the_model(fit: AxisFit) -> AxisFit:
    """A fit with factors on what the model of a compliant drive takes for granted: on its moving mass, which changes
    recordings as one over the stiffness does, and on its damping.
    """
    entries, design = list(fit.model.entries), list(fit.design)
    for name, deviation in _GRANTED.items():
        there = next((j for j, e in enumerate(fit.model.entries) if e.name.startswith(name)), None)
        if there is not None:
            entries.append(Entry(LOAD, name, 1.0, fit.model.axis, deviation, log=True))
            design = [np.column_stack([d, -d[:, there]]) for d in design]
    return replace(fit, model=replace(fit.model, entries=tuple(entries)), design=tuple(design))


def _sureness(d: AxisData, residual: np.ndarray) -> np.ndarray:
    """How sure every block of a recording is against the others, (blocks,): by what is left around it."""
    width = max(3, round(_SMOOTH / (d.step * d.block)))
    around = np.sqrt(np.convolve(residual**2, np.ones(width) / width, "same"))
    sure = 1.0 / np.maximum(around, d.noise.rms)
    # what is left stays as large in all
    return sure * float(np.sqrt((residual @ residual) / np.sum((sure * residual) ** 2)))


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
            effect = self._as_soft_as_seen(effect)
            p, z = effect.parameters_of(self.axis)
            stiff = Entry(effect.id, p.name, effect.values[p.name], log=True, deviation=10.0, lower=p.lower, upper=1e12)
            damped = {"log": True, "deviation": _DAMPED, "lower": z.lower, "upper": z.upper}
            free = stiff, Entry(effect.id, z.name, _DAMPING, **damped)
            # a load that seemed to glide in its play may only have rung
            held = tuple(glide_entry(d, _GLIDES[0]) for d in self.data)
            out += [Candidate(effect, (*free, *more)) for more in ((), held)]
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
        fresh = [o for o in fresh if o <= MOST_ORDER]
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

    def _as_soft_as_seen(self, effect: Effect) -> Effect:
        """A drive as soft as the part of the encoders' difference that goes with the acceleration says."""
        drive = build(self.machine.with_effect(effect)).axes[self.axis]
        lags = []
        for d in self.data:
            m = _motor(d)
            beside = np.column_stack([-m.acceleration, m.way, np.ones(len(m.way))])  # a play goes with the direction
            lags.append(float(np.linalg.lstsq(beside, EncoderFitter.difference(d))[0][0]))
        p, lag = effect.parameters_of(self.axis)[0], max(lags)
        stiff = effect.values[p.name] * drive.load_inertia / drive.stiffness / max(lag, 1e-30)
        return effect.replaced(**{p.name: max(stiff, p.lower)}) if lag > 0.0 else effect

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


def encoder_data(data: Sequence[AxisData], machine: Machine) -> tuple[AxisData, ...]:
    """The recordings of an axis that have motor and load, with the noise of the difference of both encoders."""
    out = []
    for d in data:
        if d.record.load is None or machine.drives[d.axis].encoder == "load":
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
        entries.append(Entry(OFFSET, OFFSET, 0.0, d.name, _ANYWHERE, scale=d.resolution))
        entries.append(Entry(START_PLAY, START_PLAY, 0.0, d.name, 1.0, lower=-1.0, upper=1.0))
        entries.append(glide_entry(d, _GLIDES[0]))
        limits = {"lower": 1e-6 * _DRAG, "upper": 1e3 * _DRAG}
        entries.append(Entry(DRAG, DRAG, _DRAG, d.name, _BRAKED, log=True, **limits))
        if not has_model(machine.chain):
            entries.append(Entry(LAG, LAG, 0.0, d.name, _WIDE, scale=_LAG, lower=0.0, upper=1e3 * _LAG))
    return AxisModel(machine, data[0].axis, tuple(entries))


def glide_entry(d: AxisData, share: float) -> Entry:
    """Deceleration of a load that is free, in a recording: as a ``share`` of the motor's largest."""
    most = float(np.abs(_motor(d).acceleration).max())
    low, high = 1e-6 * most, 1e3 * most
    return Entry(GLIDE, GLIDE, share * most, d.name, _BRAKED, log=True, lower=low, upper=high, centre=most)


@njit(cache=True, nogil=True, error_model="numpy")
def behind_play(motor, speed, way, acceleration, least, half, brake, drag, step, start):
    """Positions of a load behind a play less those of what moves it, (n,).

    Args:
        motor: Positions of what moves it, the motor or what stands behind a compliant drive, with little noise, (n,)
            axis units.
        speed: Its speeds, (n,) per s.
        way: Direction in which it moves, −1, 0, 1 (n,).
        acceleration: (n,) per s².
        least: The largest that noise makes of an acceleration, per s².
        half: Half of the play's width.
        brake: Deceleration of the load while it is free, per s².
        drag: The part of it that grows with the speed, 1/s.
        step: Time between two samples, s.
        start: Place in the play at the first sample, −1 to 1.
    """
    out = np.empty(len(motor))
    y, v, flank, farthest = motor[0] + start * half, 0.0, 0.0, motor[0]
    for i in range(len(motor)):
        if flank != 0.0:
            # a motor that turns back has pushed the load no farther than to where it turned
            if (motor[i] - farthest) * flank < 0.0 or way[i - 1] * flank > 0.0:
                farthest = motor[i]
            if (acceleration[i] + brake * way[i] + drag * speed[i]) * flank > least:  # it would have to pull the load
                y, v, flank = farthest + flank * half, speed[i], 0.0
        else:
            lost = brake * step
            v = (v - math.copysign(lost, v)) / (1.0 + drag * step) if abs(v) > lost else 0.0
            y += v * step
            ahead = y - motor[i]
            if abs(ahead) >= half:
                flank, farthest = math.copysign(1.0, ahead), motor[i]
        out[i] = flank * half if flank != 0.0 else y - motor[i]
    return out


def twist(acceleration: np.ndarray, step: float, lag: float, ratio: float) -> np.ndarray:
    """Positions of a mass on a spring less those of the motor that drives it, (n,). It does not swing at the start.

    Args:
        acceleration: Of the motor, (n,) axis units per s², straight between samples that are ``step`` apart.
        step: s.
        lag: Mass over stiffness, s².
        ratio: Damping ratio.
    """
    turn = step / math.sqrt(lag)
    way = expm(turn * np.array([[0.0, 1.0], [-1.0, -2.0 * ratio]]))
    return _swung(lag * acceleration, way, turn, ratio)


@njit(cache=True, nogil=True, error_model="numpy")
def _swung(bend, way, turn, ratio):
    """Solution of x'' + 2 ratio x' + x = −bend at the times 0, turn, …; bend (n,) is straight between them.

    Args:
        bend: (n,)
        way: What becomes of x and x' alone from one time to the next, (2, 2).
        turn: Between two times.
        ratio: Damping ratio.
    """
    out = np.empty(len(bend))
    x, v = -bend[0], 0.0
    for i in range(len(bend)):
        out[i] = x
        if i + 1 < len(bend):
            rate = (bend[i + 1] - bend[i]) / turn  # x = 2 ratio · rate − bend solves it, with x' = −rate
            free, swing = x + bend[i] - 2.0 * ratio * rate, v + rate
            x = way[0, 0] * free + way[0, 1] * swing - bend[i + 1] + 2.0 * ratio * rate
            v = way[1, 0] * free + way[1, 1] * swing - rate
    return out


def _motor(d: AxisData) -> RecordedMotion:
    """The recorded motion of the motor."""
    recorded, noise = d.record.actual, _least_noise(d)
    return _motion(recorded, _smoothed(recorded, noise, 2 * _reach(_SMOOTH, d.step) + 1), d.step, noise, _SMOOTH)


def _swinging(m: RecordedMotion, bend: np.ndarray, step: float, drive: AxisPlant) -> RecordedMotion:
    """The motion behind a compliant drive.

    A swing with fewer than three samples in a half of it is not seen: there the load lags as below its resonance, and
    leaves a flank when the motor does.

    Args:
        m: Of the motor.
        bend: Accelerations of the motor, (n,).
        step: Time between two samples, s.
        drive: Compliant.
    """
    lag = drive.load_inertia / drive.stiffness
    ratio, half = drive.damping / (2.0 * drive.stiffness * math.sqrt(lag)), math.pi * math.sqrt(lag)
    if half < 3.0 * step:
        return replace(m, smooth=m.smooth - lag * m.acceleration)
    bent = twist(bend, step, lag, ratio)
    return _motion(m.position + bent, m.smooth + bent, step, m.noise, half)


def _reach(over: float, step: float) -> int:
    """Samples to each side of one within a time."""
    return max(2, round(0.5 * min(over, _SMOOTH) / step))


def _motion(recorded: np.ndarray, smooth: np.ndarray, step: float, noise: float, over: float) -> RecordedMotion:
    """A motion, by parabolas through the samples around.

    Args:
        recorded: Positions, (n,) axis units.
        smooth: The same with less noise.
        step: Between them, s.
        noise: RMS of theirs.
        over: Time that a parabola spans, s.
    """
    from scipy.signal import savgol_coeffs, savgol_filter  # slow to load

    width = 2 * _reach(over, step) + 1
    wide, velocity, acceleration = (
        np.asarray(savgol_filter(recorded, width, 2, deriv=n, delta=step)) for n in range(3)
    )
    # what a free load goes on with: the last change of exactly this position, half a step before
    speed = np.diff(wide, prepend=wide[:1]) / step
    # noise of a sum of samples by their weights, and the largest of n normal values
    weights, most = savgol_coeffs(width, 2), noise * float(np.sqrt(2.0 * np.log(len(recorded))))
    of_position, of_speed, of_acceleration = (
        most * float(np.linalg.norm(w))
        for w in (weights, np.diff(np.pad(weights, 1)) / step, savgol_coeffs(width, 2, deriv=2, delta=step))
    )
    way = _way(wide, speed, 2.0 * of_position, of_speed)
    return RecordedMotion(recorded, velocity, acceleration, smooth, speed, way, of_acceleration, noise)


def _smoothed(recorded: np.ndarray, noise: float, widest: int) -> np.ndarray:
    """Recorded positions (n,) with less noise: by the widest parabolas that leave no more than the noise around."""
    from scipy.signal import savgol_filter  # slow to load

    out, width = recorded, 5
    while width <= widest:
        smooth = np.asarray(savgol_filter(recorded, width, 2))
        left = np.convolve((recorded - smooth) ** 2, np.ones(width) / width, "same")
        out = np.where(left < noise**2 * (1.0 + 3.0 * np.sqrt(2.0 / width)), smooth, out)
        width = 2 * width - 1
    return out


def _least_noise(d: AxisData) -> float:
    """RMS of the noise of the motor's encoder that is seen at rest: what is smoothed by more loses its turns."""
    return (noise_at_rest(d.time, d.record, d.resolution) or declared_noise(d.resolution)).rms


def _bend(d: AxisData) -> np.ndarray:
    """Accelerations of the motor, (n,), with as little noise as goes, and whole where it swings.

    They are those of a cubic spline, through the widest quartics that leave no more than the noise anywhere around. A
    swing of the motor that is lost here is missed in that of the load, times the resonance.
    """
    from scipy.interpolate import CubicSpline  # slow to load
    from scipy.signal import savgol_filter

    recorded, noise, width = d.record.actual, _least_noise(d), 7
    out = recorded
    while width <= 2.0 * _SMOOTH / d.step:
        smooth, free = np.asarray(savgol_filter(recorded, width, 4)), 1.0 - 5.0 / width
        left = np.convolve((recorded - smooth) ** 2, np.ones(width) / width, "same")
        fits = left < noise**2 * (free + 3.0 * np.sqrt(2.0 * free / width))
        out = np.where(minimum_filter1d(fits, width), smooth, out)
        width = 2 * width - 1
    time = d.step * np.arange(len(out))
    return np.asarray(CubicSpline(time, out)(time, 2))


@njit(cache=True, nogil=True, error_model="numpy")
def _way(position, speed, far, fast):
    """Direction of a motion, −1, 0, 1 (n,): faster than ``fast``, or ``far`` from where it last moved."""
    out, here = np.zeros(len(position)), position[0]
    for i in range(len(position)):
        gone = position[i] - here
        if abs(speed[i]) > fast or abs(gone) > far:
            out[i], here = np.sign(speed[i]) if abs(speed[i]) > fast else np.sign(gone), position[i]
    return out


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
