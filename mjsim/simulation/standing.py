"""A machine that stands still while it is measured: what its drives' errors of position leave there.

At rest a drive is where it was told to be: its controller integrates. What is between motor and load still acts: pitch
errors, play by the side of the last move, error motions, drift with the clock.
"""

from __future__ import annotations

import numpy as np

from mjsim.instruments.base import Stops
from mjsim.machine.plant import VIBRATE, Plant
from mjsim.simulation.axes import added
from mjsim.simulation.transmission import transmit


def standing(plant: Plant, stops: Stops, name: str = "") -> np.ndarray:
    """Positions of the axes behind their drives at every stop.

    Args:
        plant: The machine's numbers.
        stops: Where it comes from and stands.
        name: Of the test.

    Returns:
        (n, axes), or with error motions behind where the plant has some, m and rad: the commanded positions with the
        errors of the places where the machine stood.
    """
    ops = plant.op_table(name)
    ops = ops[ops[:, 0] != VIBRATE]  # a centre is the mean of many touches
    q = np.zeros((len(stops.route), plant.width))
    q[:, : plant.chain.count] = stops.route
    if len(ops):
        q = transmit(ops, q, stops.clock)
    if plant.python_effects:
        # a second between two positions: the rates that a user's effect asks for are those of slow moves
        time = np.arange(len(q), dtype=float)
        axes = q[:, : plant.chain.count]
        axes += added(plant, 0.0, time, axes, 1.0, (0.0, 0.0, 0.0))
    out = q[stops.at].mean(axis=1)
    out[:, : plant.chain.count] -= stops.away
    return out
