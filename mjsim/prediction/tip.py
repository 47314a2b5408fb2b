"""A program on a machine: commands, positions that the axes reach, and where the tool's tip then is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import bar_vector, spindle_ball, spindle_in_work, table_ball
from mjsim.machine.plant import Plant
from mjsim.simulation.axes import load_of


@dataclass(frozen=True)
class Run:
    """One program on one machine; arrays over the kept instants.

    Attributes:
        chain: The machine's axes.
        time: From the program's start, all instants, (m,) s.
        commands: (m, axes) m and rad, with the slide along the tool moved by the tool's length.
        kept: Which instants are looked at, (n,).
        tool: Tool's length less that of the spindle ball's holder, m.
        zero: Zero point of the part in the work frame, (3,) m.
        clock: Start on the campaign clock, s.
    """

    chain: Chain
    time: np.ndarray
    commands: np.ndarray
    kept: np.ndarray
    tool: float
    zero: np.ndarray
    clock: float

    @property
    def path(self) -> np.ndarray:
        """Programmed places of the tip in the work frame at the kept instants, (n, 3) m."""
        return self._tips(self.commands[self.kept])

    @property
    def whole_path(self) -> np.ndarray:
        """The same at all instants, (m, 3) m."""
        return self._tips(self.commands)

    def _tips(self, commands: np.ndarray) -> np.ndarray:
        q = commands.copy()
        q[:, 2] -= self.tool
        return spindle_in_work(self.chain, q)

    def load(self, plant: Plant) -> np.ndarray:
        """Load-side positions at the kept instants, (n, width)."""
        return np.ascontiguousarray(load_of(plant, self.time, self.commands, self.clock)[self.kept])

    def machine_deviation(self, plant: Plant, load: np.ndarray, path: np.ndarray) -> np.ndarray:
        """Tip less its programmed place ``path`` (n, 3) at positions ``load`` (n, width), in machine axes, (n, 3) m."""
        return bar_vector(self.chain, load, path, plant.geometry, (0.0, 0.0, -self.tool))

    def set_up(self, plant: Plant, at_zero: np.ndarray, path: np.ndarray) -> np.ndarray:
        """Where the workpiece's points ``path`` (n, 3) lie on the real table, (n, 3) m.

        The part is aligned with the linear axes and its zero point is probed while the rotary axes are at 0: what the
        machine errs there is no error of the part.

        Args:
            plant: The machine's numbers.
            at_zero: Positions of the load side there, (1, width).
            path: Programmed places.
        """
        return on_real_table(plant, at_zero, path, self.zero, self.tool)


def on_real_table(
    plant: Plant,
    at_zero: np.ndarray,
    points: np.ndarray,
    zero: np.ndarray,
    tool: float,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """Where the workpiece's ``points`` (n, 3) lie on the real table, (n, 3) m, as :meth:`Run.set_up` says.

    Args:
        plant: The machine's numbers.
        at_zero: Positions of the load side where the zero point is probed, (1, width).
        points: Of the workpiece, in the work frame.
        zero: Zero point in the work frame, (3,) m.
        tool: Tool's length less that of the spindle ball's holder, m.
        axes: Directions that the control gives to its X, Y and Z there, with which the part is aligned, one a column,
            (3, 3); ``None`` is those of the machine.
    """
    corners = np.vstack([np.zeros(3), np.eye(3)])
    placed = table_ball(plant.chain, np.repeat(at_zero, 4, axis=0), corners, plant.geometry)
    turn = (placed[1:] - placed[0]).T
    probed = spindle_ball(plant.chain, at_zero, plant.geometry, (0.0, 0.0, -tool))[0] - zero
    if axes is not None:
        points = zero + (points - zero) @ axes.T
    return (points + probed - placed[0]) @ np.linalg.inv(turn).T
