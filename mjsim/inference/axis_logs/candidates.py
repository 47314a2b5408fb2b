"""Causes that a search on axis logs tries, each from where its fit starts on this axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjsim.effects import registry
from mjsim.inference.axis_logs.data import AxisData, coulomb_friction
from mjsim.inference.axis_logs.entries import SHIFT, AxisModel, Entry
from mjsim.inference.axis_logs.gains import GainsRead, speed_limit, torque_limit
from mjsim.inference.axis_logs.start import nuisance_entries, typical_torque
from mjsim.inference.axis_logs.waves import near
from mjsim.inference.hypotheses import CAUSE, ORDERS
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine

#: Each kind's like that is not sought beside it: while an axis slides, a friction that depends on the direction is a
#: constant force.
_LIKE = {"constant_force": "friction_direction", "friction_direction": "constant_force"}
#: Ids that belong to the same effect of the machine file: a falling friction is a shape of the friction.
FRICTION = "friction"
#: Presliding ways from which fits start, m of the axis (assumed: rolling bearings and nuts).
_PRESLIDING = (2e-6, 15e-6)
_PRESLIDING_DEG = (1e-5, 1e-4)
#: Ways of the axis, m or rad, over which the friction of a rest goes, from which fits start; time in which it forms, s,
#: and the prior deviation of its logarithm: recordings are short, and nobody knows how long an axis rested before them.
_RENEWED, _RENEWED_DEG = (2e-5, 2e-4), (1e-4, 1e-3)
_REST, _REST_WIDE = 10.0, 2.0


#: Prior standard deviation of a size, in typical ones, and of the logarithm of one that may be anything (assumed).
_WIDE, _ANY = 30.0, 10.0
#: Delays of the command from which fits start, ms.
_DELAYS_MS = (5.0, 40.0)
#: Limits of the torque from which fits start, in the largest torque that the motion needs; and how well a recorded one
#: says it, relative (assumed: its scale).
_LIMITS, _LIMIT_READ = (0.7, 0.9, 1.0), 0.02
#: Limits of the speed from which fits start, in the set-point of the largest recorded speed.
_SPEEDS = (0.95, 1.0, 1.05)
#: Voltages from which fits start: speed without load in the largest recorded speed, torque at rest in the largest
#: torque that the motion needs.
_VOLTAGES = ((1.0, 3.0), (1.3, 1.5), (2.0, 1.5))
#: Speeds without load from which fits start where the axis runs at full voltage, in the largest recorded speed.
_AT_FULL_VOLTAGE = (1.1, 1.4, 2.0)
#: Widths of a play from which fits start, in usual ones.
_PLAYS = (1.0, 5.0)
#: Filters of the command from which fits start, ms.
_FILTERS_MS = (("lag_ms", 3.0), ("lag_ms", 15.0), ("mean_ms", 5.0), ("mean_ms", 30.0))
#: Samples of a velocity loop for which its set-point may be held.
_HELD = (2, 3, 4, 5, 6, 8, 10, 16)
#: Orders of the cyclic error of an encoder: off centre, unequal windings, crosstalk; its amplitude, ° of the motor.
_OF_ENCODERS, _READ_WRONG = (1.0, 2.0, 4.0), 0.02
#: Most waves of cogging beside a torque ripple (assumed).
_MOST_WAVES = 3
#: Least motor speed that is taken for a motion, rad/s.
_SLOWEST = 0.02
#: A friction that rises below this share of the largest speed cannot be told from a constant one (assumed).
_SLOW = 0.01


@dataclass(frozen=True)
class Candidate:
    """One cause at one starting point.

    Attributes:
        effect: With its starting values.
        entries: What is free.
        shape: Whether it is another shape of an effect that the model has already.
        order: Of the wave that it adds to an effect of several waves.
        variant: What tells it from other causes of the same effect, each tried for itself.
        sheet: Entries of the data sheet that its own take the place of, as stated.
        among: So many values are possible, of which it has one and nothing is free.
    """

    effect: Effect
    entries: tuple[Entry, ...]
    shape: bool = False
    order: float | None = None
    variant: str = ""
    sheet: tuple[Entry, ...] = ()
    among: int = 1

    @property
    def key(self) -> str:
        """Same for all starting points of one cause."""
        if self.wave:
            return f"{self.effect.id} order {self.cycles:g}"
        return " ".join(filter(None, (self.effect.id, "shape" if self.shape else "", self.variant)))

    @property
    def log_odds(self) -> float:
        """Logarithm of its prior odds: a wave may have one of many orders."""
        return CAUSE - math.log(ORDERS if self.wave else self.among)

    @property
    def cycles(self) -> float:
        """Waves per revolution of the motor."""
        return self.order if self.order is not None else float(self.effect.values["order"])

    @property
    def wave(self) -> str:
        """What the phase of its wave is called; empty where it is no wave."""
        if self.order is not None:
            return f"{self.effect.kind} {self.order:g}"
        return self.effect.kind if any(e.name == "cosine" for e in self.entries) else ""

    def extend(self, model: AxisModel) -> AxisModel:
        """A model with this cause as well."""
        present = model.machine.effect(self.effect.id)
        effect = self.effect
        if self.shape and present is not None:
            effect = present.replaced(**{e.name: self.effect.values[e.name] for e in self.entries})
        if self.order is not None and present is not None:
            effect = present.replaced(components=[*present.values["components"], *effect.values["components"]])
        return model.extended(effect, self.entries)

    def taken_from(self, model: AxisModel, former: Machine) -> AxisModel:
        """A model without this cause.

        Args:
            model: With it.
            former: The machine as given, whose effect of the same id comes back.
        """
        effect = model.machine.effect(self.effect.id)
        assert effect is not None
        if self.sheet:
            return model.extended(effect.replaced(**{e.name: e.value for e in self.sheet}), self.sheet)
        if self.order is not None:
            return model.without_wave(effect.id, self.order)
        if not self.shape:
            return model.without(effect.id, former.effect(effect.id))
        names = {e.label for e in self.entries}
        specs = {p.name: p.default for p in effect.parameters_of(effect.subject)}
        plain = effect.replaced(**{e.name: specs[e.name] for e in self.entries})
        kept = tuple(e for e in model.entries if e.label not in names)
        return replace(model, machine=model.machine.with_effect(plain), entries=kept)


class Catalogue:
    """All causes that one axis may have.

    Args:
        machine: As given.
        data: Recordings of the axis.
        gains: Read back from what the controls recorded of themselves.
    """

    def __init__(self, machine: Machine, data: Sequence[AxisData], gains: Sequence[GainsRead] = ()) -> None:
        self.machine, self.axis, self.gains = machine, data[0].axis, gains
        self.torque = typical_torque(machine, data)
        self.limit, self.most = torque_limit(machine, data), _largest_torque(machine, data)
        self.fastest, self.set_point = _largest_speed(machine, data), speed_limit(machine, data)
        gear = machine.drives[self.axis].gear
        speeds = [np.abs(np.diff(d.record.command)).max() / d.step for d in data]
        self.speed = max(max(speeds) * gear, _SLOWEST)
        ran = {d.test.controller for d in data}
        self.drives = [machine.under(name).drives[self.axis] for name in ran]
        self.setups = len({d.test.setup for d in data})
        self.step = max(d.step for d in data)
        # a delay begins with recordings that are in time: only together are the two known
        self.shifts = [e for e in nuisance_entries(machine, data) if e.owner == SHIFT]
        self.gear, self.rotary = gear, machine.chain.is_rotary(self.axis)

    def missing(self, model: AxisModel, orders: Sequence[float] = (1.0,)) -> list[Candidate]:
        """Every cause that the model does not have yet.

        Args:
            model: As it is.
            orders: Of the waves over the motor's angle that stand out.
        """
        has = {e.owner for e in model.entries}
        friction = model.machine.effect(f"{FRICTION}.{self.axis}")
        out = [*self._control(), *self._forces(), *self._waves(model, orders), *self._play()]
        out += [*self._encoder(orders), *self._held(model)]
        if friction is None:
            out += self._friction()
        else:
            out += self._shapes(orders)
            shaped = any(e.owner == friction.id and e.name == "static_ratio" for e in model.entries)
            out = [c for c in out if not (c.shape and shaped)]
            out += self._torque(model, friction)
        like = {f"{_LIKE[kind]}.{self.axis}" for kind in _LIKE if f"{kind}.{self.axis}" in has}
        return [c for c in out if c.shape or c.order or c.effect.id not in has | like]

    def _make(self, kind: str, **values: Any) -> Effect:
        """An effect near where a fit starts, with its numbers inside their bounds: the sheet of a drive may be wrong by
        any factor.
        """
        specs = {p.name: p for p in registry.kinds()[kind].parameters_of(self.axis)}
        inside = {n: float(np.clip(v, specs[n].lower, specs[n].upper)) for n, v in values.items() if n != "components"}
        return registry.make(f"{kind}.{self.axis}", self.machine.chain, **values | inside)

    def _log(self, effect: Effect, name: str) -> Entry:
        p = next(p for p in effect.parameters_of(self.axis) if p.name == name)
        low = max(p.lower, 1e-6 * effect.values[name])
        return Entry(effect.id, name, effect.values[name], log=True, lower=low, upper=p.upper, deviation=_ANY)

    def _linear(self, effect: Effect, name: str, scale: float) -> Entry:
        p = next(p for p in effect.parameters_of(self.axis) if p.name == name)
        value = effect.values[name]
        return Entry(
            effect.id, name, value, scale=scale, lower=p.lower, upper=p.upper, deviation=_WIDE, centre=p.neutral or 0.0
        )

    def _control(self) -> list[Candidate]:
        """Settings of the control that are not those of the sheet."""
        out = []
        if any(np.isfinite(d.integral_time) and d.control.law is None for d in self.drives):
            for ratio in (0.4, 2.5):
                e = self._make("integral_time", ratio=ratio)
                out.append(Candidate(e, (self._log(e, "ratio"),)))
        sample = max(d.control.sample_time for d in self.drives) or 1e-4
        for samples in (0.5, 4.0):
            e = self._make("loop_delay", delay_ms=1e3 * samples * sample)
            out.append(Candidate(e, (self._linear(e, "delay_ms", 1e3 * sample),)))
        if self.machine.effect(f"servo_delay.{self.axis}") is None:
            for delay in _DELAYS_MS:
                e = self._make("servo_delay", delay_ms=delay)
                out.append(Candidate(e, (self._linear(e, "delay_ms", 1e3 * self.step), *self.shifts)))
        if self.machine.effect(f"command_filter.{self.axis}") is None:
            for name, time in _FILTERS_MS:
                e = self._make("command_filter", **{name: time})
                out.append(Candidate(e, (self._linear(e, name, 1.0),), variant=name))
        if any(d.control.law is None for d in self.drives):
            known = self._feedforward()
            e = self._make("velocity_feedforward", ratio=0.02 if known is None else known[0])
            # no control feeds a speed forward with the wrong sign
            entry = replace(self._linear(e, "ratio", 0.02), lower=-min(d.feedforward for d in self.drives))
            if known is not None:
                entry = replace(entry, deviation=known[1] / entry.scale, centre=known[0])
            out.append(Candidate(e, (entry,)))
        if self.machine.factor is None:
            for kind in ("inertia", "viscous_friction", "velocity_gain", "servo_gain"):
                known = self._position_gain() if kind == "servo_gain" else None
                for ratio in (0.7, 1.4) if known is None else (known[0],):
                    e = self._make(kind, ratio=ratio)
                    entry = self._log(e, "ratio")
                    if known is not None:
                        entry = replace(entry, deviation=known[1], centre=ratio)
                    out.append(Candidate(e, (entry,)))
        return out

    def _held(self, model: AxisModel) -> list[Candidate]:
        """A position loop that is slower than a velocity loop of stated sample time: by whole samples."""
        if model.machine.effect(f"held_set_point.{self.axis}") is not None:
            return []
        controls = [d.control for d in self.drives]
        if any(c.law is not None or c.sample_time == 0.0 or c.position_sample_time for c in controls):
            return []
        slowest = max(c.sample_time for c in controls)
        most = 2.0 / max(d.position_gain for d in self.drives)  # slower, it swings
        times = [n * slowest for n in _HELD if n * slowest < most]
        made = [self._make("held_set_point", time_ms=1e3 * t) for t in times]
        return [Candidate(e, (), among=len(times)) for e in made]

    def _position_gain(self) -> tuple[float, float] | None:
        """Position gain over the stated one where a recorded velocity set-point says it, and how well it is known."""
        for g in self.gains:
            if g.channel == "velocity_command" and g.values:
                stated = self.machine.under(g.controller).drives[self.axis].position_gain
                p = next(p for p in self._make("servo_gain", ratio=1.0).parameters_of(self.axis) if p.name == "ratio")
                return min(max(g.values["position_gain"] / stated, p.lower), p.upper), g.deviations["position_gain"]
        return None

    def _feedforward(self) -> tuple[float, float] | None:
        """Feedforward beyond the stated one where a recorded velocity set-point says it, and its deviation."""
        for g in self.gains:
            if g.feedforward is not None:
                stated = self.machine.under(g.controller).drives[self.axis].feedforward
                most = registry.kinds()["velocity_feedforward"].parameters_of(self.axis)[0].upper
                return min(max(g.feedforward[0] - stated, -stated), most), g.feedforward[1]
        return None

    def _play(self) -> list[Candidate]:
        """A play inside a position loop whose only encoder is at the load."""
        if self.machine.drives[self.axis].encoder != "load":
            return []
        out = []
        for times in _PLAYS:
            p = registry.kinds()["backlash"].parameters_of(self.axis)[0]
            e = self._make("backlash", **{p.name: times * p.scale})
            out.append(Candidate(e, (self._linear(e, p.name, p.scale),)))
        return out

    def _forces(self) -> list[Candidate]:
        """Torques beside the ordinary friction."""
        e = self._make("constant_force", torque_Nm=0.1 * self.torque)
        return [Candidate(e, (self._linear(e, "torque_Nm", 0.1 * self.torque),)), *self._limits()]

    def _limits(self) -> list[Candidate]:
        """Limits of torque, speed and voltage, about the largest values of the motion.

        Those of torque and speed stand where a recorded torque or set-point does.
        """
        out = []
        if any(d.control.law is None for d in self.drives):
            for speed in (self.set_point,) if self.set_point else [share * self._asked() for share in _SPEEDS]:
                e = self._make("speed_limit", speed_rad_per_s=speed)
                out.append(Candidate(e, (self._log(e, "speed_rad_per_s"),)))
        voltages = [(speed * self.fastest, torque * self.most) for speed, torque in _VOLTAGES]
        # at full voltage an axis runs as fast as its load lets it
        voltages += [(ratio * self.fastest, self._load() / (1.0 - 1.0 / ratio)) for ratio in _AT_FULL_VOLTAGE]
        # a motor at full voltage that is as stiff as the velocity loop: what looks most like a limit of the speed
        voltages.append((self._asked(), self.drives[0].velocity_gain * self._asked()))
        for speed, torque in voltages:
            e = self._make("voltage_limit", no_load_rad_per_s=speed, stall_Nm=torque)
            out.append(Candidate(e, (self._log(e, "no_load_rad_per_s"), self._log(e, "stall_Nm"))))
        for torque in (self.limit,) if self.limit else [share * self.most for share in _LIMITS]:
            e = self._make("current_clip", torque_Nm=torque)
            entry = self._log(e, "torque_Nm")
            if self.limit:
                entry = replace(entry, deviation=_LIMIT_READ, centre=torque)
            out.append(Candidate(e, (entry,)))
        return out

    def _asked(self) -> float:
        """Set-point of the largest recorded speed by the data sheet, rad/s: without an integrator, it is ahead of the
        speed by what the friction takes.
        """
        drive = self.drives[0]
        if np.isfinite(drive.integral_time) or drive.control.law is not None:
            return self.fastest
        return self.fastest + self._load() / drive.velocity_gain

    def _load(self) -> float:
        """Torque that friction takes at the largest recorded speed by the data sheet, N·m."""
        return coulomb_friction(self.machine, self.axis) + self.drives[0].viscous * self.fastest

    def _encoder(self, orders: Sequence[float]) -> list[Candidate]:
        """A cyclic error of the motor's encoder, where the position loop is closed on it."""
        if self.machine.drives[self.axis].encoder != "motor":
            return []
        every = dict.fromkeys([*_OF_ENCODERS, *orders])
        made = [self._make("encoder_error", amplitude_deg=_READ_WRONG, order=o, phase_deg=0.0) for o in every]
        return [Candidate(e, wave_entries(e, _READ_WRONG)) for e in made]

    def _waves(self, model: AxisModel, orders: Sequence[float]) -> list[Candidate]:
        """Torques over the motor's angle: the first is a torque ripple, further ones are waves of its cogging."""
        size = 0.1 * self.torque
        ripple, cogging = (model.machine.effect(f"{kind}.{self.axis}") for kind in ("torque_ripple", "cogging"))
        if ripple is None:
            made = [self._make("torque_ripple", amplitude_Nm=size, order=o, phase_deg=0.0) for o in orders]
            return [Candidate(e, wave_entries(e, size)) for e in made]
        there = [ripple.values["order"], *([row[0] for row in cogging.values["components"]] if cogging else [])]
        fresh = [o for o in orders if not near(o, there)] if len(there) <= _MOST_WAVES else []
        made = [(o, self._make("cogging", components=[[o, size, 0.0]])) for o in fresh]
        return [Candidate(e, wave_entries(e, size, f" {o:g}"), order=o) for o, e in made]

    def _friction(self) -> list[Candidate]:
        out = []
        for way in _PRESLIDING_DEG if self.rotary else _PRESLIDING:
            e = self._make(FRICTION, coulomb_Nm=0.5 * self.torque, presliding_rad=way * self.gear)
            out.append(Candidate(e, (self._log(e, "coulomb_Nm"), self._log(e, "presliding_rad"))))
        return out

    def _torque(self, model: AxisModel, friction: Effect) -> list[Candidate]:
        """The Coulomb torque of a friction of the data sheet, half and twice of what is stated."""
        place = model.place(f"{friction.id}.coulomb_Nm")
        if place is None or self.machine.factor or model.entries[place].deviation >= _ANY:
            return []
        stated = model.entries[place]
        stated = replace(stated, value=stated.decode(stated.mean))
        out = []
        for ratio in (0.5, 2.0):
            e = friction.replaced(coulomb_Nm=ratio * stated.value)
            own = replace(self._log(e, "coulomb_Nm"), centre=stated.value)
            out.append(Candidate(e, (own,), True, variant="torque", sheet=(stated,)))
        return out

    def _shapes(self, orders: Sequence[float]) -> list[Candidate]:
        """Other shapes of a friction that is there."""
        out = []
        for part in (0.01, 0.1):
            e = self._make(
                FRICTION,
                coulomb_Nm=self.torque,
                static_ratio=1.2,
                stribeck_velocity_rad_per_s=part * self.speed,
            )
            static = replace(self._linear(e, "static_ratio", 0.1), centre=1.0)
            speed = replace(
                self._log(e, "stribeck_velocity_rad_per_s"), lower=1e-4 * self.speed, upper=min(self.speed, 1e3)
            )
            out.append(Candidate(e, (static, speed), True))
        for part in (0.05, 0.3):
            e = self._make("rising_friction", torque_Nm=0.1 * self.torque, velocity_rad_per_s=part * self.speed)
            speed = self._log(e, "velocity_rad_per_s")
            speed = replace(speed, lower=_SLOW * self.speed, upper=min(speed.upper, 10.0 * self.speed))
            out.append(Candidate(e, (self._linear(e, "torque_Nm", 0.1 * self.torque), speed)))
        for way in _RENEWED_DEG if self.rotary else _RENEWED:
            e = self._make("rest_friction", excess_ratio=0.3, way_rad=way * self.gear, rest_s=_REST)
            rest = replace(self._log(e, "rest_s"), deviation=_REST_WIDE)
            out.append(Candidate(e, (self._linear(e, "excess_ratio", 0.1), self._log(e, "way_rad"), rest)))
        e = self._make("torque_loss", share_ratio=0.1)
        out.append(Candidate(e, (self._linear(e, "share_ratio", 0.1),)))
        e = self._make("viscous_direction", share_ratio=0.05)
        out.append(Candidate(e, (self._linear(e, "share_ratio", 0.05),)))
        e = self._make("friction_direction", share_ratio=0.05)
        out.append(Candidate(e, (self._linear(e, "share_ratio", 0.05),)))
        if self.setups == 1:  # the zero of every set-up is its own
            e = self._make("friction_position", linear_ratio=0.05, quadratic_ratio=0.0)
            names = ("linear_ratio", "quadratic_ratio")
            out.append(Candidate(e, tuple(replace(self._linear(e, n, 0.05), deviation=20.0) for n in names)))
        for order in dict.fromkeys([1.0, *orders]):
            e = self._make("friction_ripple", amplitude_ratio=0.05, order=order)
            out.append(Candidate(e, wave_entries(e, 0.05)))
        e = self._make("elastic_presliding", share_ratio=0.5)
        out.append(Candidate(e, (self._linear(e, "share_ratio", 0.1),)))
        return out


def _largest_torque(machine: Machine, data: Sequence[AxisData]) -> float:
    """Torque that the recorded motion needs by the data sheet, friction included, at its largest, N·m: a limited one
    stands there for more than one percent of the time.
    """
    drive, found = machine.drives[data[0].axis], [1e-6]
    friction = coulomb_friction(machine, data[0].axis)
    for d in data:
        n = max(1, int(0.01 / d.step))
        smooth = np.convolve(d.record.actual, np.ones(n) / n, "valid")[::n] * drive.gear
        speed = np.gradient(smooth, n * d.step)
        torque = drive.inertia * np.gradient(speed, n * d.step) + drive.viscous * speed
        torque += friction * np.sign(speed)
        found.append(float(np.quantile(np.abs(torque), 0.99)))
    return max(found)


def _largest_speed(machine: Machine, data: Sequence[AxisData]) -> float:
    """Largest recorded speed of the motor, rad/s: a limited one stands there for more than one percent of the time."""
    gear, found = machine.drives[data[0].axis].gear, [_SLOWEST]
    for d in data:
        n = max(1, int(0.01 / d.step))
        smooth = np.convolve(d.record.actual, np.ones(n) / n, "valid")[::n] * gear
        found.append(float(np.quantile(np.abs(np.gradient(smooth, n * d.step)), 0.99)))
    return max(found)


def wave_entries(effect: Effect, size: float, order: str = "") -> tuple[Entry, Entry]:
    """The two parts of a wave as entries: the motion is linear in them, unlike in amplitude and phase."""
    cosine = Entry(effect.id, f"cosine{order}", size, scale=size, deviation=_WIDE, centre=0.0)
    return cosine, replace(cosine, name=f"sine{order}", value=0.0)
