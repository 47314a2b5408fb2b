"""What LinuxCNC told the axes: a commanded motion, and an axis log."""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.linuxcnc.configuration import CYCLE
from mjsim.machine.chain import Chain
from mjsim.nc.limits import scale

#: Kinds of motion (motion.h of LinuxCNC) that are feeds: straight lines and arcs.
FEEDS = (2, 3)
#: Cycles at rest that are kept before and after the path.
_REST = 100


@dataclass(frozen=True, eq=False)
class Record:
    """Every servo cycle of one run.

    Attributes:
        told: Set-points that the drives got, with the control's corrections, (n, axes) m and rad.
        path: Set-points before the corrections, (n, axes) m and rad.
        line: Line of the program, (n,).
        kind: Of the motion, as LinuxCNC numbers it, (n,).
        chain: Axes of the machine.
        seconds: The run took on the clock of the wall, s.
        probed: What it wrote of its probings, (n, 9) mm and degrees; ``None`` where it has not probed.
    """

    told: np.ndarray
    path: np.ndarray
    line: np.ndarray
    kind: np.ndarray
    chain: Chain
    seconds: float
    probed: np.ndarray | None = None

    @cached_property
    def feed(self) -> slice:
        """The cycles of the path: from rest before its first feed block to rest after its last one.

        Raises:
            InputError: the program has no feed block that moves.
        """
        moves = np.abs(np.diff(self.path, axis=0)).max(axis=1) > 1e-13
        on = np.flatnonzero(moves & np.isin(self.kind[1:], FEEDS))
        if not len(on):
            raise InputError("LinuxCNC: the program has no feed block that moves an axis")
        return slice(int(on[0]), int(on[-1]) + 2)

    @property
    def motion(self) -> Commanded:
        """What the drives were told on the path, as a commanded motion on the control's own clock."""
        q = self.told[self.feed]
        return Commanded(np.full(len(q) - 1, CYCLE), q, chain=self.chain, clocked=True)

    @property
    def duration(self) -> float:
        """Of the path, s."""
        part = self.feed
        return (part.stop - part.start - 1) * CYCLE

    def to_csv(self, actual: np.ndarray | None = None) -> str:
        """As an axis log, with a little rest at both ends: command and actual position of every axis.

        Args:
            actual: Positions of the encoders in every cycle, (n, axes) m and rad; nothing: LinuxCNC's simulated joints,
                which follow at once.
        """
        part = slice(max(0, self.feed.start - _REST), self.feed.stop + _REST)
        units = np.array([scale(a) for a in self.chain.letters])
        q = self.told[part] / units
        y = q if actual is None else actual[part] / units
        names, columns = ["time_s"], [np.arange(len(q)) * CYCLE]
        for i, axis in enumerate(self.chain.letters):
            unit = "deg" if self.chain.is_rotary(axis) else "mm"
            names += [f"{axis}_command_{unit}", f"{axis}_actual_{unit}"]
            columns += [q[:, i], y[:, i]]
        text = io.StringIO()
        form = ["%.3f", *["%.9f"] * (len(columns) - 1)]
        np.savetxt(text, np.column_stack(columns), form, ",", header=",".join(names), comments="")
        return text.getvalue()
