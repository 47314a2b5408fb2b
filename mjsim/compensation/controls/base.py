"""What a control is to this room: what it can take, how it rounds, how it uses it, and its files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import ClassVar

import numpy as np

from mjsim.compensation.arithmetic import Arithmetic
from mjsim.compensation.tables import Corrections, Grid, Left, Table, Term, Wanted, rounded, sampled, scale
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM


@dataclass(frozen=True)
class Settings:
    """What is set in the control and decides how corrections act.

    Attributes:
        detection_unit: Fanuc's detection unit, mm or degrees.
        acceleration: LinuxCNC's MAX_ACCELERATION, m/s² or rad/s², by axis; axes that are missing have the usual one.
        transforms: Whether the programs use tool centre point control, so that kinematic data act.
    """

    detection_unit: float = 1e-4
    acceleration: dict[str, float] = field(default_factory=dict)
    transforms: bool = True


class Control(ABC):
    """One kind of control. A subclass is one file of this folder.

    Attributes:
        name: As on the command line.
        title: As its maker calls it.
        crossed: Whether one axis can be corrected by the position of another.
        directed: Whether tables may have values for each direction.
        directions_of_axes: Whether the kinematic data take the direction of a rotary axis, not only its place.
        most_cross: Most tables of one axis by another.
        components: Whether it has tables for the component errors of an axis, which turn and displace what it carries
            and act over the arm to the tool.
        pulses: Whether it has a friction compensation whose numbers follow from the model.
        thermal_tool: What takes a drift with time out, as the beginning of a sentence; empty where nothing does.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    crossed: ClassVar[bool] = True
    directed: ClassVar[bool] = True
    directions_of_axes: ClassVar[bool] = True
    most_cross: ClassVar[int] = 1000
    gains: ClassVar[bool] = True
    components: ClassVar[bool] = False
    pulses: ClassVar[bool] = False
    thermal_tool: ClassVar[str] = ""
    location_decimals: ClassVar[int] = 6

    def __init__(self, settings: Settings | None = None) -> None:
        self.settings = settings or Settings()

    @abstractmethod
    def grid(self, chain: Chain, out: str, source: str) -> Grid:
        """What one table may be."""

    @abstractmethod
    def files(self, corrections: Corrections) -> dict[str, str]:
        """Files that the control reads, or lists of what is typed, by name."""

    @abstractmethod
    def where(self) -> list[str]:
        """Where to type or load each file, one sentence each."""

    def arithmetic(self, chain: Chain) -> Arithmetic:
        """How the control uses the corrections."""
        return Arithmetic(transforms=self.settings.transforms)

    def corrections(self, wanted: Wanted, ranges: dict[str, tuple[float, float]]) -> Corrections:
        """What of ``wanted`` this control can take, as it will hold it.

        Args:
            wanted: What should be corrected.
            ranges: Positions of every axis between which it was measured, m and rad.
        """
        chain = wanted.chain
        out = Corrections(chain)
        tables, left = self._tables(wanted, ranges)
        backlash: dict[str, float] = {}
        for axis, width in wanted.play.items():
            own = next((t for t in tables if t.out == t.source == axis), None)
            if own is not None and self.takes_over(own):
                continue
            held = self._held(chain, axis, axis, width)
            if held:
                backlash[axis] = held
            else:
                left.append(Left(wanted.keys[axis], "smaller than the last digit that the control holds"))
        kinematics, more = self._kinematics(wanted)
        left += more
        gains = {a: float(f"{new:.6g}") for a, (new, _) in wanted.gains.items()} if self.gains else {}
        left += [
            Left(wanted.keys[f"gain {a}"], "the position gain stands in the drive, not in this control's files")
            for a in wanted.gains
            if a not in gains
        ]
        for axis, (size, constant) in wanted.thermal.items():
            left.append(Left(wanted.keys[f"thermal {axis}"], self.thermal_advice(axis, size, constant)))
        merged = tuple(dict.fromkeys(left))
        return replace(out, backlash=backlash, tables=tuple(tables), kinematics=kinematics, gains=gains, left=merged)

    def pulse_digit(self, chain: Chain, axis: str) -> float:
        """Last digit of a pulse's amplitude, m/s or rad/s."""
        return (DEG * 360.0 if chain.is_rotary(axis) else MM) / 60.0 * (1e-6 if chain.is_rotary(axis) else 1e-3)

    def friction_advice(self, axis: str, torque: float) -> str:
        """What to do about friction where the control has no such numbers."""
        return f"{self.title} has no friction compensation; the torque to be overcome is {torque:.3g} N·m"

    def held(self, table: Table) -> Table:
        """A table as the control holds it, where rounding its values is not all."""
        return table

    def takes_over(self, table: Table) -> bool:
        """Whether an axis' own table holds its backlash as well, in place of the backlash parameter."""
        return False

    def thermal_advice(self, axis: str, size: float, constant: float) -> str:
        """What to do about a drift with time."""
        return (
            f"a drift with time: {axis} goes {size / MM * 1e3:+.1f} µm with a time constant of {constant:.0f} s; "
            f"{self.thermal_tool}warm the machine up, or measure the datum again"
        )

    def _held(self, chain: Chain, out: str, source: str, value: float) -> float:
        unit = scale(chain, out)
        return float(rounded(np.array([value / unit]), self.grid(chain, out, source))[0] * unit)

    def _tables(self, wanted: Wanted, ranges: dict) -> tuple[list[Table], list[Left]]:
        chain, tables, left = wanted.chain, [], []
        cross = 0

        def pair(t: Term) -> tuple[bool, int, int]:
            return t.out != t.source, chain.columns.index(t.out), chain.index(t.source)

        for _, group in groupby(sorted(wanted.terms, key=pair), key=pair):
            terms = list(group)
            out, source = terms[0].out, terms[0].source
            if out not in chain.letters and not self.components:
                reason = f"mjsim writes no table of {self.title} for what an axis does to all that it carries"
                left += [Left(t.key, reason) for t in terms]
                continue
            if out != source and not self.crossed:
                left += [Left(t.key, f"{self.title} has no table of one axis by another") for t in terms]
                continue
            if out != source and cross >= self.most_cross:
                left += [Left(t.key, f"{self.title} has {self.most_cross} such tables at most") for t in terms]
                continue
            if not self.directed and any(t.direction for t in terms):
                left += [Left(t.key, f"{self.title} has no table for one direction") for t in terms if t.direction]
                terms = [t for t in terms if not t.direction]
                if not terms:
                    continue
            width = wanted.play.get(out, 0.0) if out == source and self.merges else 0.0
            table, rest = sampled(
                chain, terms, ranges[source], self.grid(chain, out, source), (0.5 * width, -0.5 * width)
            )
            left += rest
            if table is not None:
                tables.append(self.held(table))
                cross += out != source
        return tables, left

    #: Whether :meth:`takes_over` can be true: the table then gets the backlash.
    merges: ClassVar[bool] = False

    def _kinematics(self, wanted: Wanted) -> tuple[dict[str, float], list[Left]]:
        held: dict[str, float] = {}
        left = []
        if wanted.location and not has_tilting_table(wanted.chain):
            return held, [
                Left(wanted.keys[n], "kinematic data are written for a tilting rotary table only")
                for n in wanted.location
            ]
        for error in wanted.chain.location_errors:
            value = wanted.location.get(error.name, 0.0)
            if not value:
                continue
            if error.rotation and not self.directions_of_axes:
                left.append(Left(wanted.keys[error.name], f"{self.title} has no number for the direction of an axis"))
                continue
            unit = 1.0 if error.rotation else MM
            held[error.name] = round(value / unit, self.location_decimals + (2 if error.rotation else 0)) * unit
        return held, left


def has_tilting_table(chain: Chain) -> bool:
    """Whether two rotary axes carry the workpiece, none the tool, and all linear axes stand on the ground."""
    return len(chain.turning) == 2 and not chain.swivelling and not chain.carried


def table_and_tilt(chain: Chain) -> tuple[str, str]:
    """Letters of the axis next to the workpiece and of the one that carries it."""
    table, tilt = chain.turning
    return table.letter, tilt.letter
