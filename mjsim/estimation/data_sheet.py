"""The data sheet's tolerances as parameters of the fit, each with its prior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from mjsim.estimation.parameters import Block
from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect
from mjsim.machine.model import FRICTION_PARAMETERS, TOLERANCE, Machine

#: Share of a number of an effect by which it has to move for the drive to be another one: more than the friction of a
#: sound machine is off its data sheet (assumed).
_MOVED = 0.25


@dataclass(frozen=True)
class SheetParameter:
    """One number of the data sheet: ``axis``, ``name`` as in :data:`TOLERANCE`, relative standard deviation ``sd``."""

    axis: str
    name: str
    sd: float

    @property
    def label(self) -> str:
        return f"{self.name}.{self.axis}"


@cache
def data_sheet(chain: Chain) -> tuple[SheetParameter, ...]:
    """The numbers of a machine's data sheet, axis by axis."""
    return tuple(SheetParameter(a, n, sd) for a in chain.letters for n, sd in TOLERANCE.items())


#: Name of the data sheet's block in the parameter vector.
DATA_SHEET = "data sheet"


def sheet_block(chain: Chain, frozen: np.ndarray) -> Block:
    """The data sheet as a block of the parameter vector, in standard deviations of its tolerances.

    Args:
        chain: The machine's axes.
        frozen: Numbers that stay as printed, (sheet,) bool.
    """
    return Block.normal(DATA_SHEET, [p.label for p in data_sheet(chain)], frozen=frozen)


def calibrated(machine: Machine, sheet_deviation: np.ndarray) -> Machine:
    """``machine`` with its data sheet moved by ``sheet_deviation`` (sheet,) standard deviations."""
    for p, t in zip(data_sheet(machine.chain), sheet_deviation, strict=True):
        if t == 0.0:
            continue
        factor = max(1.0 + p.sd * t, 0.05)
        if p.name in FRICTION_PARAMETERS:
            friction = machine.effect(f"friction.{p.axis}")
            if friction is not None and not friction.is_neutral:
                key = FRICTION_PARAMETERS[p.name]
                machine = machine.with_effect(friction.replaced(**{key: friction.values[key] * factor}))
        else:
            machine = machine.with_drive(p.axis, **{p.name: getattr(machine.drives[p.axis], p.name) * factor})
    return machine


def is_another_drive(machine: Machine, effect: Effect) -> bool:
    """Whether an effect of a drive makes it another one than that of ``machine``, so that the numbers of its data sheet
    do something else there: the machine lacks the effect, or has it in another size.
    """
    given = machine.effect(effect.key)
    if given is None:
        return True
    sizes = [p.name for p in effect.parameters_of(effect.subject) if p.leading and p.kind == "number"]
    return any(abs(effect.values[n] - given.values[n]) > _MOVED * abs(given.values[n]) for n in sizes)
