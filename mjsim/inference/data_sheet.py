"""The data sheet's tolerances as parameters of the fit, each with its prior."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mjsim.inference.parameters import Block
from mjsim.machine.chain import Chain
from mjsim.machine.model import FRICTION_PARAMETERS, TOLERANCE, Machine

#: Share of a number by which it has to move for the drive to be another one: more than the friction of a sound machine
#: is off its data sheet (assumed).
_MOVED = 0.25
#: Relative change of a number over which its derivatives are taken as the same. All torques of a drive times one factor
#: give the same motion, and derivatives over 10 % hide that: they seem to tell the factor.
LINEAR = 0.002
#: A setting that everybody can read in the control: a stated factor does not widen it for ball-bar tests.
_READ = "position_gain"
#: Effects whose size is a number of the data sheet over the stated one, by kind.
OF_SHEET = {
    "inertia": "inertia",
    "integral_time": "integral_time",
    "servo_gain": "position_gain",
    "velocity_gain": "velocity_gain",
    "viscous_friction": "viscous",
}
#: Standard deviations within which a number stays that is known within a factor only: beyond them is one of 370.
_FARTHEST = 3.0


@dataclass(frozen=True)
class SheetParameter:
    """One number of the data sheet.

    Attributes:
        axis: Letter.
        name: As in :data:`TOLERANCE`.
        sd: Relative standard deviation; of the logarithm where the number is wide.
        wide: Whether it is known within a factor only, so that it is fitted as a logarithm.
    """

    axis: str
    name: str
    sd: float
    wide: bool = False

    @property
    def label(self) -> str:
        """Name and axis."""
        return f"{self.name}.{self.axis}"

    @property
    def step(self) -> float:
        """Standard deviations over which the derivative with respect to it is taken."""
        return min(1.0, LINEAR / self.sd)

    def ratio(self, deviation: float) -> float:
        """The number over the printed one, ``deviation`` standard deviations from it."""
        if self.wide:
            return math.exp(self.sd * min(max(deviation, -_FARTHEST), _FARTHEST))
        return max(1.0 + self.sd * deviation, 0.05)


@cache
def data_sheet(chain: Chain, factor: float | None = None) -> tuple[SheetParameter, ...]:
    """The numbers of a machine's data sheet, axis by axis.

    Args:
        chain: Axes of the machine.
        factor: Within which the numbers are believed, two standard deviations; ``None``: as those of a data sheet.
    """
    spread = 0.0 if factor is None else 0.5 * math.log(factor)
    wide = {n: n != _READ and spread > sd for n, sd in TOLERANCE.items()}
    return tuple(
        SheetParameter(a, n, spread if wide[n] else sd, wide[n]) for a in chain.letters for n, sd in TOLERANCE.items()
    )


def sheet_of(machine: Machine) -> tuple[SheetParameter, ...]:
    """The numbers of a machine's data sheet, as far as the machine believes in them."""
    return data_sheet(machine.chain, machine.factor)


#: Name of the data sheet's block in the parameter vector.
DATA_SHEET = "data sheet"


def sheet_block(machine: Machine, frozen: np.ndarray) -> Block:
    """The data sheet as a block of the parameter vector, in standard deviations of its tolerances.

    Args:
        machine: As its file says.
        frozen: Numbers that stay as printed, (sheet,) bool.
    """
    sheet = sheet_of(machine)
    limit = np.array([_FARTHEST if p.wide else np.inf for p in sheet])
    block = Block.normal(DATA_SHEET, [p.label for p in sheet], frozen=frozen)
    return replace(block, lower=-limit, upper=limit)


def calibrated(machine: Machine, sheet_deviation: np.ndarray) -> Machine:
    """``machine`` with its data sheet moved by ``sheet_deviation`` (sheet,) standard deviations."""
    for p, t in zip(sheet_of(machine), sheet_deviation, strict=True):
        if t == 0.0:
            continue
        factor = p.ratio(t)
        if p.name in FRICTION_PARAMETERS:
            friction = machine.effect(f"friction.{p.axis}")
            if friction is not None and not friction.is_neutral:
                key = FRICTION_PARAMETERS[p.name]
                machine = machine.with_effect(friction.replaced(**{key: friction.values[key] * factor}))
        else:
            machine = machine.with_drive(p.axis, **{p.name: getattr(machine.drives[p.axis], p.name) * factor})
    return machine


def is_another_drive(machine: Machine, known: Machine, axis: str) -> bool:
    """Whether the drive of an axis is another one than that of ``known``, so that the numbers of its data sheet do
    something else there: one of them, or the size of an effect on the drive, has moved far; or an effect is gone, or
    new.
    """
    now, then, far = _numbers_of(machine, axis), _numbers_of(known, axis), LINEAR if machine.factor else _MOVED
    return now.keys() != then.keys() or any(abs(now[n] - then[n]) > far * abs(then[n]) for n in now)


def _numbers_of(machine: Machine, axis: str) -> dict[tuple[str, str], float]:
    """Numbers of an axis' data sheet, and the sizes of all effects on its drive."""
    out = {("", n): getattr(machine.drives[axis], n) for n in TOLERANCE if n not in FRICTION_PARAMETERS}
    for effect in machine.effects:
        if effect.subject == axis and not effect.search.quasi_static:
            sizes = [p.name for p in effect.parameters_of(axis) if p.leading and p.kind == "number"]
            out |= {(effect.key, n): effect.values[n] for n in sizes}
    return out
