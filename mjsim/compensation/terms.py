"""What is to be corrected, as a neutral quantity per axis: the elementary errors that the effects write into the plant.

Everything is an error: where the load side is, less where it should be. A control corrects it with the other sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import BUMP, PLAY, POLYNOMIAL, SCALE, SETTLE, SINE


@dataclass(frozen=True)
class Term:
    """Error of one axis, or of what one axis carries, as a function of the position of one axis.

    Attributes:
        key: Of the effect that makes it.
        out: Letter of the axis that is wrong, or the name of a component error (ISO 230-1) of the source.
        source: Letter of the axis on whose position it depends.
        code: Operation of the plant: ``SINE``, ``BUMP``, ``POLYNOMIAL`` or ``SCALE``.
        parameters: Of the operation, SI.
    """

    key: str
    out: str
    source: str
    code: int
    parameters: tuple[float, ...]

    @property
    def direction(self) -> float:
        """+1 or −1 where it acts only while the source moves that way, 0 for both."""
        return self.parameters[3] if self.code in (SINE, BUMP) else 0.0

    @property
    def shortest(self) -> float:
        """Length over which it changes, m or rad: the period of a wave, four standard deviations of a worn stretch;
        infinite where any table is fine enough.
        """
        if self.code == SINE:
            return 2.0 * math.pi / self.parameters[1]
        return 4.0 * self.parameters[2] if self.code == BUMP else math.inf

    def error(self, x: np.ndarray, sign: float) -> np.ndarray:
        """Error (n,) m or rad at positions ``x`` (n,) of the source while it moves in the direction ``sign``."""
        p = self.parameters
        if self.direction not in (0.0, sign):
            return np.zeros(len(x))
        if self.code == SINE:
            return p[0] * np.sin(p[1] * x + p[2])
        if self.code == BUMP:
            away = (x - p[1] + math.pi) % (2.0 * math.pi) - math.pi
            return -p[0] * np.exp(-0.5 * (away / p[2]) ** 2)
        if self.code == POLYNOMIAL:
            u = x / p[2]
            return (p[0] + p[1] * u) * u * u
        return p[0] * x


@dataclass(frozen=True)
class Wanted:
    """Everything that could be corrected, before a control limits it.

    Attributes:
        chain: The machine's axes.
        terms: Errors that depend on position.
        play: Full width of the backlash, m or rad, by axis.
        location: Location errors of the rotary axes, m or rad, by name.
        gains: Position gain that restores the setting, 1/s, by axis; and the factor that is wrong.
        thermal: Final displacement in m and time constant in s, by axis.
        keys: Effects behind play, location errors, gains and thermal drift, by the same names.
    """

    chain: Chain
    terms: tuple[Term, ...] = ()
    play: dict[str, float] = field(default_factory=dict)
    location: dict[str, float] = field(default_factory=dict)
    gains: dict[str, tuple[float, float]] = field(default_factory=dict)
    thermal: dict[str, tuple[float, float]] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)


def wanted_of(machine: Machine, effects: list[Effect]) -> tuple[Wanted, list[str]]:
    """What the given effects ask to be corrected, and the keys of those that no table can take.

    Args:
        machine: The diagnosed machine.
        effects: Those of its effects that are worth correcting, reduced to what is.
    """
    chain, out, left = machine.chain, Wanted(machine.chain), []
    bare = replace(machine, effects=())
    normal = build(bare)
    terms: list[Term] = []
    for effect in effects:
        plant = build(replace(bare, effects=(effect,)))
        before = len(terms), len(out.keys)
        whole = True
        for op in plant.ops:
            component = op.out >= chain.count and op.code not in (SINE, POLYNOMIAL, SCALE)
            if component or op.source >= chain.count or op.code not in (SINE, BUMP, POLYNOMIAL, SCALE, PLAY, SETTLE):
                whole = False
            elif op.code == PLAY:
                axis = chain.letters[op.out]
                out.play[axis] = 2.0 * op.parameters[0]
                out.keys[axis] = effect.key
            elif op.code == SETTLE:
                axis = chain.letters[op.out]
                out.thermal[axis] = (op.parameters[0], op.parameters[1])
                out.keys[f"thermal {axis}"] = effect.key
            else:
                terms.append(Term(effect.key, chain.columns[op.out], chain.letters[op.source], op.code, op.parameters))
        for name, value in plant.geometry.location.items():
            out.location[name] = value
            out.keys[name] = effect.key
        for error in chain.squareness:
            if (slope := error.sign * plant.geometry.squareness.get(error.name, 0.0)) != 0.0:
                terms.append(Term(effect.key, chain.letters[error.along], error.axis, SCALE, (slope,)))
        for axis in chain.letters:
            gain, right = plant.axes[axis].position_gain, normal.axes[axis].position_gain
            if gain != right:
                out.gains[axis] = (right * right / gain, gain / right)
                out.keys[f"gain {axis}"] = effect.key
        if not whole or (len(terms), len(out.keys)) == before:
            left.append(effect.key)
    done = [t for t in terms if t.key not in left]
    return replace(out, terms=tuple(done)), left
