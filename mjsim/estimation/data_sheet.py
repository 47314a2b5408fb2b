"""The data sheet's tolerances as parameters of the fit, each with its prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.machine.chain import AXES
from mjsim.machine.model import FRICTION_PARAMETERS, TOLERANCE, Machine


@dataclass(frozen=True)
class SheetParameter:
    """One number of the data sheet: ``axis``, ``name`` as in :data:`TOLERANCE`, relative standard deviation ``sd``."""

    axis: str
    name: str
    sd: float

    @property
    def label(self) -> str:
        return f"{self.name}.{self.axis}"


SHEET: tuple[SheetParameter, ...] = tuple(SheetParameter(a, n, sd) for a in AXES for n, sd in TOLERANCE.items())


def calibrated(machine: Machine, sheet_deviation: np.ndarray) -> Machine:
    """``machine`` with its data sheet moved by ``sheet_deviation`` (len(SHEET),) standard deviations."""
    for p, t in zip(SHEET, sheet_deviation, strict=True):
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
