"""Motions of one axis that are worth a recording: strokes, constant speeds, small steps, slow reversals, circles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mjsim.machine.axis import COORDINATES, arc_words
from mjsim.machine.chain import Chain, usual_speed
from mjsim.units import DEG, MM

#: Acceleration of a usual control, m/s² and rad/s², and the time of a stop, s (assumed).
_ACCELERATION, _STOP = {False: 2.0, True: 20.0}, 0.3
#: Radius of the circle that is looked at, m (assumed).
_RADIUS = 10e-3
#: Lengths that are looked at, m and rad.
_SMALL, _SHORT, _LONG = {False: 0.1e-3, True: 0.02 * DEG}, {False: 1e-3, True: 0.5 * DEG}, {False: 0.06, True: 30 * DEG}


@dataclass(frozen=True)
class Motion:
    """A motion of one axis as an NC program commands it.

    Attributes:
        axis: Letter.
        kind: ``steps``, ``strokes``, ``constant speeds``, ``slow reversals`` or ``slow circle``.
        moves: Targets and speeds, axis units and axis units per s; a stop follows each.
        repeats: How often all of them run.
        rotary: Whether the axis turns.
        torque: Whether the torque or the current is recorded as well.
        gain: Factor on the velocity gain that is set for the recording.
    """

    axis: str
    kind: str
    moves: tuple[tuple[float, float], ...]
    repeats: int
    rotary: bool
    torque: bool = False
    gain: float = 1.0

    @property
    def name(self) -> str:
        """As a test is called."""
        more = ("-torque" if self.torque else "") + (f"-gain{self.gain:g}" if self.gain != 1.0 else "")
        return f"{self.kind.replace(' ', '-')}-{self.axis.lower()}-{self._speed:.3g}{more}"

    @property
    def _speed(self) -> float:
        unit = DEG if self.rotary else MM
        return max(v for _, v in self.moves) / unit

    @property
    def words(self) -> str:
        """In one sentence."""
        unit, symbol = (DEG, "°") if self.rotary else (MM, "mm")
        ways = dict.fromkeys(f"{abs(b - a) / unit:.3g}" for a, b in self._ways())
        speeds = dict.fromkeys(f"{v / unit:.3g}" for _, v in self.moves)
        many = self.repeats * len(self.moves)
        said = f"{self.axis}: {many} moves of {', '.join(ways)} {symbol} at {', '.join(speeds)} {symbol}/s, a stop of "
        return said + f"{_STOP:g} s after each" + self._settings

    @property
    def _settings(self) -> str:
        """What is recorded or set besides, in words."""
        said = "; record the torque or the current as well" if self.torque else ""
        if self.gain != 1.0:
            said += f"; set the velocity gain to {self.gain:g} of the present one for this recording"
        return said

    def _ways(self) -> list[tuple[float, float]]:
        targets = [p for p, _ in self.moves]
        return list(zip([targets[-1] if self.repeats > 1 else 0.0, *targets[:-1]], targets, strict=True))

    def command(self, step: float) -> np.ndarray:
        """Commanded positions from 0, (n,) axis units, ``step`` s apart: trapezoids of speed."""
        out, here = [np.zeros(int(_STOP / step))], 0.0
        for _ in range(self.repeats):
            for target, speed in self.moves:
                out.append(here + _trapezoid(target - here, speed, _ACCELERATION[self.rotary], step))
                out.append(np.full(int(_STOP / step), target))
                here = target
        return np.concatenate(out)

    def program(self) -> list[str]:
        """Lines of an NC program, relative to where the axis stands."""
        unit = DEG if self.rotary else MM
        out, here = ["G91"], 0.0
        for _ in range(self.repeats):
            for target, speed in self.moves:
                out.append(f"G1 {self.axis}{(target - here) / unit:.6g} F{60.0 * speed / unit:.6g}")
                out.append(f"G4 P{_STOP:g}")
                here = target
        return [*out, "G90"]


@dataclass(frozen=True)
class Circle(Motion):
    """One axis on a circle that it runs with another linear axis: smooth reversals, with the other one at full speed.

    Attributes:
        partner: Letter of the other axis.
        turns: How often round.
    """

    partner: str = ""
    turns: int = 1

    @property
    def radius(self) -> float:
        """Of the circle, m."""
        return 0.5 * max(p for p, _ in self.moves)

    @property
    def words(self) -> str:
        """In one sentence."""
        said = f"{self.axis} and {self.partner}: {self.turns} turns on a circle of {self.radius / MM:.3g} mm radius at "
        return said + f"{self._speed:.3g} mm/s" + self._settings

    def command(self, step: float) -> np.ndarray:
        """Commanded positions of the axis from 0, (n,) m, ``step`` s apart; it begins where the axis turns back."""
        way = _trapezoid(2.0 * np.pi * self.radius * self.turns, self.moves[0][1], _ACCELERATION[False], step)
        rest = np.zeros(int(_STOP / step))
        return np.concatenate([rest, self.radius * (1.0 - np.cos(way / self.radius)), rest])

    def program(self) -> list[str]:
        """Lines of an NC program, relative to where the axes stand."""
        plane, centre = arc_words(self.axis, self.partner)
        turn = f"G2 {self.axis}0 {self.partner}0 {centre}{self.radius / MM:.6g} F{60.0 * self.moves[0][1] / MM:.6g}"
        return [plane, "G91", *[turn] * self.turns, f"G4 P{_STOP:g}", "G90"]


def _trapezoid(way: float, speed: float, acceleration: float, step: float) -> np.ndarray:
    """Positions of one move from 0, (n,)."""
    size = abs(way)
    speed = min(speed, np.sqrt(size * acceleration))
    ramp, flat = speed / acceleration, size / speed - speed / acceleration
    t = np.arange(step, 2.0 * ramp + flat + step, step)
    up = 0.5 * acceleration * np.minimum(t, ramp) ** 2
    cruise = speed * np.clip(t - ramp, 0.0, flat)
    down = np.clip(t - ramp - flat, 0.0, ramp)
    return np.sign(way) * np.minimum(up + cruise + speed * down - 0.5 * acceleration * down**2, size)


def proposals(chain: Chain, axis: str) -> Iterator[Motion]:
    """Motions of one axis that are looked at first, as positions only.

    Args:
        chain: Axes of the machine.
        axis: Letter.
    """
    rotary, fastest = chain.is_rotary(axis), float(usual_speed(chain)[chain.index(axis)])
    small, short, long = _SMALL[rotary], _SHORT[rotary], _LONG[rotary]

    def motion(kind: str, moves: list[tuple[float, float]], repeats: int) -> Motion:
        return Motion(axis, kind, tuple(moves), repeats, rotary)

    yield motion("steps", [(small, fastest), (0.0, fastest)], 10)
    yield motion("slow reversals", [(short, 0.005 * fastest), (0.0, 0.005 * fastest)], 3)
    for share in (0.1, 0.5, 1.0):
        yield motion("strokes", [(long, share * fastest), (0.0, share * fastest)], 3)
    partner = next((a for a in chain.letters if a != axis and a in COORDINATES), None)
    if partner is not None and axis in COORDINATES:
        feed = 0.01 * fastest
        yield Circle(axis, "slow circle", ((2.0 * _RADIUS, feed), (0.0, feed)), 1, False, partner=partner, turns=2)
    slow = [s * fastest for s in (0.01, 0.05, 0.2, 0.8)]
    yield motion("constant speeds", [(p, v) for v in slow for p in (min(long, 2.0 * v), 0.0)], 1)


def variations(motion: Motion) -> Iterator[Motion]:
    """The same motion with the torque recorded, and with another velocity gain."""
    yield replace(motion, torque=True)
    yield replace(motion, gain=0.7)
