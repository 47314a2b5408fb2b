"""From the motor to the load: the elementary operations that position effects are made of, compiled.

An effect file combines these; ``docs/effects.md`` has the definitions. Each operation changes one axis
position as a function of one axis position (or the clock) and has three numbers of memory; the stages of
:data:`mjsim.machine.plant.STAGES` act one after the other.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.machine.plant import BUMP, FOLLOW, PLAY, POLYNOMIAL, SCALE, SETTLE, SINE, STAGE, VIBRATE

MEMORY = 3
#: Travel after a reversal over which a direction-dependent component fades in, rad (assumed: 0.05°).
BLEND = 0.05 * math.pi / 180.0
#: Distance from a dent's centre, in units of its width, beyond which it is nothing: less than 1e-17 of its depth.
FAR = 9.0


# The helpers take numbers alone: an array that is handed to one is counted as in use at every step, which costs ten
# times the arithmetic.
@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _value(code, a, b, c, x, clock):
    """What an operation without memory adds at its source's position ``x``; ``a``, ``b`` and ``c`` are its numbers."""
    if code == SINE:  # amplitude, order, phase
        return a * math.sin(b * x + c)
    if code == BUMP:  # depth, centre, width; once per turn
        d = x - b
        d -= 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5)
        return 0.0 if abs(d) > FAR * c else -a * math.exp(-0.5 * (d / c) ** 2)
    if code == POLYNOMIAL:  # quadratic, cubic, reference length
        u = x / c
        return (a + b * u) * u * u
    if code == SCALE:
        return a * x
    if code == SETTLE:  # amplitude, time constant
        return a * (1.0 - math.exp(-clock / b))
    if code == VIBRATE:  # amplitude, angular frequency, phase
        return a * math.sin(b * clock + c)
    if code == FOLLOW:  # factor; what it follows stands in the place of the clock
        return a * clock
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _increment(code, a, b, c, direction, x, clock, first, last, share):
    """What an operation adds at its source's position ``x``, and its memory: a position, and how much of a
    direction-dependent term acts (0 to 1).
    """
    if code == PLAY:  # half width
        y = x if first else last
        y = min(max(y, x - a), x + a)
        return y - x, y, share
    value = _value(code, a, b, c, x, clock)
    if direction != 0.0:
        step = 0.0 if first else x - last
        toward = abs(step) / BLEND if step * direction > 0.0 else -abs(step) / BLEND
        share = 0.0 if first else min(1.0, max(0.0, share + toward))
        value *= share
        last = x
    return value, last, share


@njit(cache=True, nogil=True, error_model="numpy")
def _followed(ops, k, clock):
    """What operation ``k`` of the table, a FOLLOW, follows at an instant ``clock``, s: a straight line between its
    knots.
    """
    low, high = 0, int(ops[k, 4]) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if ops[k + 1 + middle // 3, 3 + 2 * (middle % 3)] > clock:
            high = middle
        else:
            low = middle
    row, other, place, beside = k + 1 + low // 3, k + 1 + high // 3, 2 * (low % 3), 2 * (high % 3)
    step = ops[other, 3 + beside] - ops[row, 3 + place]
    share = min(1.0, max(0.0, (clock - ops[row, 3 + place]) / step)) if step > 0.0 else 0.0
    return ops[row, 4 + place] + share * (ops[other, 4 + beside] - ops[row, 4 + place])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _behind(ops, k):
    """Where the operation behind operation ``k`` stands in the table: rows between hold what a FOLLOW follows."""
    return k + 1 + (int(ops[k, 4]) // 3 if ops[k, 0] == FOLLOW else 0)


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
            at = _followed(ops, end, clock) if ops[end, 0] == FOLLOW else clock
            memory[end, 2], memory[end, 0], memory[end, 1] = _increment(
                int(ops[end, 0]), ops[end, 3], ops[end, 4], ops[end, 5], ops[end, 6],
                q[int(ops[end, 2])], at, first, memory[end, 0], memory[end, 1],
            )  # fmt: skip
            end = _behind(ops, end)
        while k < end:
            q[int(ops[k, 1])] += memory[k, 2]
            k = _behind(ops, k)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(ops, k, source, clock, out):
    """Add to ``out`` (n,) what operation ``k`` of the table does along a whole motion of its ``source`` (n,)."""
    code, a, b, c, direction = int(ops[k, 0]), ops[k, 3], ops[k, 4], ops[k, 5], ops[k, 6]
    last, share = 0.0, 0.0
    for i in range(len(source)):
        at = _followed(ops, k, clock[i]) if code == FOLLOW else clock[i]
        added, last, share = _increment(code, a, b, c, direction, source[i], at, i == 0, last, share)
        out[i] += added


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(ops, motor, clock):
    """Load-side positions (n, axes) of a whole motion ``motor`` (n, axes) at campaign times ``clock`` (n,): as
    :func:`apply_ops`, one operation after the other.
    """
    load, n = motor.copy(), ops.shape[0]
    k = 0
    while k < n:
        stage, before = ops[k, STAGE], load.copy()
        while k < n and ops[k, STAGE] == stage:
            _add(ops, k, before[:, int(ops[k, 2])], clock, load[:, int(ops[k, 1])])
            k = _behind(ops, k)
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
    out = np.zeros(len(load))
    if ops.shape[0] == 1:  # most signatures are those of a single operation
        _add(ops, 0, load[:, int(ops[0, 2])], clock, out)
        return out * weight[:, int(ops[0, 1])]
    moved = transmit(ops, load, clock)
    for j in range(weight.shape[1]):
        out += weight[:, j] * (moved[:, j] - load[:, j])
    return out
