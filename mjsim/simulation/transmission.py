"""From the motor to the load: the elementary operations that position effects are made of, compiled.

An effect file combines these; ``docs/effects.md`` has the definitions. Each operation changes one axis
position as a function of one axis position (or the clock) and has three numbers of memory; the stages of
:data:`mjsim.machine.plant.STAGES` act one after the other.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.machine.plant import BUMP, PLAY, POLYNOMIAL, SCALE, SETTLE, SINE, STAGE, VIBRATE

MEMORY = 3
#: Travel after a reversal over which a direction-dependent component fades in, rad (assumed: 0.05°).
BLEND = 0.05 * math.pi / 180.0
#: Distance from a dent's centre, in units of its width, beyond which it is nothing: less than 1e-17 of its depth.
FAR = 9.0


# Both helpers stand inside the loop that calls them and index the whole tables: a call and a view of a row each cost as
# much as the arithmetic.
@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _share(x, direction, memory, k, first):
    """How much of a direction-dependent term acts (0 to 1): row ``k`` of memory is (last position, share, -)."""
    if direction == 0.0:
        return 1.0
    if first:
        memory[k, 0], memory[k, 1] = x, 0.0
    step = x - memory[k, 0]
    memory[k, 0] = x
    toward = abs(step) / BLEND if step * direction > 0.0 else -abs(step) / BLEND
    memory[k, 1] = min(1.0, max(0.0, memory[k, 1] + toward))
    return memory[k, 1]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _increment(ops, memory, k, x, clock, first):
    """What operation ``k`` adds, from its source's position ``x``."""
    code = int(ops[k, 0])
    if code == SINE:  # amplitude, order, phase, direction
        return ops[k, 3] * math.sin(ops[k, 4] * x + ops[k, 5]) * _share(x, ops[k, 6], memory, k, first)
    if code == PLAY:  # half width
        y = x if first else memory[k, 0]
        y = min(max(y, x - ops[k, 3]), x + ops[k, 3])
        memory[k, 0] = y
        return y - x
    if code == BUMP:  # depth, centre, width, direction; once per turn
        d = x - ops[k, 4]
        d -= 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5)
        share = _share(x, ops[k, 6], memory, k, first)
        if abs(d) > FAR * ops[k, 5]:
            return 0.0
        return -ops[k, 3] * math.exp(-0.5 * (d / ops[k, 5]) ** 2) * share
    if code == POLYNOMIAL:  # quadratic, cubic, reference length
        u = x / ops[k, 5]
        return (ops[k, 3] + ops[k, 4] * u) * u * u
    if code == SCALE:
        return ops[k, 3] * x
    if code == SETTLE:  # amplitude, time constant
        return ops[k, 3] * (1.0 - math.exp(-clock / ops[k, 4]))
    if code == VIBRATE:  # amplitude, angular frequency, phase
        return ops[k, 3] * math.sin(ops[k, 4] * clock + ops[k, 5])
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def apply_ops(ops, memory, q, clock, first):
    """Motor-side axis positions ``q`` (axes,) to load-side ones, in place.

    Operations of one stage all start from the positions that the stage before left (a pitch error is a sum over one x),
    so their order within a stage does not matter.

    Args:
        ops: (n, OP_SIZE) code, out, source, parameters, stage; in acting order.
        memory: (n, MEMORY) state of each operation; the last column holds what it adds.
        q: axis positions, m and rad.
        clock: campaign clock, s.
        first: True on the first instant of a test (memories start there).
    """
    n = ops.shape[0]
    k = 0
    while k < n:
        stage, end = ops[k, STAGE], k
        while end < n and ops[end, STAGE] == stage:
            memory[end, 2] = _increment(ops, memory, end, q[int(ops[end, 2])], clock, first)
            end += 1
        for i in range(k, end):
            q[int(ops[i, 1])] += memory[i, 2]
        k = end


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(ops, motor, clock):
    """Load-side positions (n, axes) of a whole motion ``motor`` (n, axes) at campaign times ``clock`` (n,)."""
    load = motor.copy()
    memory = np.zeros((ops.shape[0], MEMORY))
    for i in range(len(motor)):
        apply_ops(ops, memory, load[i], clock[i], i == 0)
    return load


@njit(cache=True, nogil=True, error_model="numpy")
def reading_change(ops, load, clock, weight):
    """What operations change in a reading, (n,) m.

    Args:
        ops: as :func:`apply_ops`.
        load: motion (n, axes), or with the table's error motion behind.
        clock: (n,) s on the campaign clock.
        weight: (n, axes) derivatives of the reading by the axes.
    """
    row, out = np.empty(load.shape[1]), np.empty(len(load))
    memory = np.zeros((ops.shape[0], MEMORY))
    if ops.shape[0] == 1:  # most signatures are those of a single operation
        moved, source = int(ops[0, 1]), int(ops[0, 2])
        for i in range(len(load)):
            out[i] = weight[i, moved] * _increment(ops, memory, 0, load[i, source], clock[i], i == 0)
        return out
    for i in range(len(load)):
        for j in range(len(row)):
            row[j] = load[i, j]
        apply_ops(ops, memory, row, clock[i], i == 0)
        total = 0.0
        for j in range(weight.shape[1]):
            total += weight[i, j] * (row[j] - load[i, j])
        out[i] = total
    return out
