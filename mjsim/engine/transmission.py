"""From the motor to the load: the elementary operations that position effects are made of, compiled.

An effect file combines these; definitions and order are the effect catalogue's. Each operation changes one axis position as a
function of one axis position (or the clock) and has three numbers of memory; the stages of :data:`mjsim.engine.plant.STAGES` act one
after the other.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.engine.plant import BUMP, PLAY, POLYNOMIAL, SCALE, SETTLE, SINE, STAGE, VIBRATE

MEMORY = 3
#: Travel after a reversal over which a direction-dependent component fades in, rad (effect catalogue: 0.05°).
BLEND = 0.05 * math.pi / 180.0


@njit(cache=True, nogil=True, error_model="numpy")
def _share(x, direction, m, first):
    """How much of a direction-dependent term acts (0 to 1): m = (last position, share, -)."""
    if direction == 0.0:
        return 1.0
    if first:
        m[0], m[1] = x, 0.0
    step = x - m[0]
    m[0] = x
    toward = abs(step) / BLEND if step * direction > 0.0 else -abs(step) / BLEND
    m[1] = min(1.0, max(0.0, m[1] + toward))
    return m[1]


@njit(cache=True, nogil=True, error_model="numpy")
def _increment(op, m, x, clock, first):
    """What one operation adds, from its source's position ``x``; ``m`` is its memory."""
    code = int(op[0])
    if code == SINE:  # amplitude, order, phase, direction
        return op[3] * math.sin(op[4] * x + op[5]) * _share(x, op[6], m, first)
    if code == PLAY:  # half width
        y = x if first else m[0]
        y = min(max(y, x - op[3]), x + op[3])
        m[0] = y
        return y - x
    if code == BUMP:  # depth, centre, width, direction; once per turn
        d = x - op[4]
        d -= 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5)
        return -op[3] * math.exp(-0.5 * (d / op[5]) ** 2) * _share(x, op[6], m, first)
    if code == POLYNOMIAL:  # quadratic, cubic, reference length
        u = x / op[5]
        return (op[3] + op[4] * u) * u * u
    if code == SCALE:
        return op[3] * x
    if code == SETTLE:  # amplitude, time constant
        return op[3] * (1.0 - math.exp(-clock / op[4]))
    if code == VIBRATE:  # amplitude, angular frequency, phase
        return op[3] * math.sin(op[4] * clock + op[5])
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def apply_ops(ops, memory, q, clock, first):
    """Motor-side axis positions ``q`` (5,) to load-side ones, in place.

    Operations of one stage all start from the positions that the stage before left (a pitch error is a sum over one x), so
    their order within a stage does not matter.

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
        end = k
        while end < n and ops[end, STAGE] == ops[k, STAGE]:
            memory[end, 2] = _increment(ops[end], memory[end], q[int(ops[end, 2])], clock, first)
            end += 1
        for i in range(k, end):
            q[int(ops[i, 1])] += memory[i, 2]
        k = end


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(ops, motor, clock):
    """Load-side positions (n, 5) of a whole motion ``motor`` (n, 5) at campaign times ``clock`` (n,)."""
    load = motor.copy()
    memory = np.zeros((ops.shape[0], MEMORY))
    for i in range(len(motor)):
        apply_ops(ops, memory, load[i], clock[i], i == 0)
    return load
