"""The paper's scheme (section 2.3, step 3): amplitude and phase of one component after the other, by turns.

``W1`` is taken from the amplitude spectrum; ``φ1`` is the one that minimises the difference between the curve and
``W1 sin(N1 x + φ1)``; with it ``W1`` is found again by the same criterion, then ``φ1``, until both stay; then the next
component, on what the ones before leave. Components are taken in the order of their size. The paper does not say what
it does about the glitches where linear axes turn back; here they are left out, since four glitches per turn make lines
at every multiple of four.
"""

from __future__ import annotations

import numpy as np

from mjsim.inference.pitch.curve import Curve
from mjsim.inference.pitch.parts import Alternation
from mjsim.inference.pitch.spectrum import amplitude
from mjsim.units import DEG

#: Relative change of the amplitude, and change of the phase in rad, below which the scheme has converged; rounds at
#: most.
_SAME, _MOST = 1e-6, 50


def alternate(curve: Curve, orders: list[float]) -> list[Alternation]:
    """Components of the given orders, in that order, from a modified curve."""
    keep = ~curve.at_reversal
    x, rest = curve.position[keep], curve.modified[keep].copy()
    weight = np.abs(np.gradient(curve.position))[keep]
    first = amplitude(curve.position, curve.modified, np.asarray(orders, float)) if orders else np.zeros(0)
    found: dict[int, Alternation] = {}
    for i in np.argsort(-first, kind="stable"):
        n, size, phase, rounds = orders[i], float(first[i]), 0.0, 0
        sin, cos = np.sin(n * x), np.cos(n * x)
        while rounds < _MOST:
            rounds += 1
            before = size, phase
            phase = _best_phase(weight, rest, size, sin, cos, phase)
            wave = np.cos(phase) * sin + np.sin(phase) * cos
            size = float((weight * rest) @ wave / ((weight * wave) @ wave))
            if abs(size - before[0]) < _SAME * abs(size) and abs(phase - before[1]) < _SAME:
                break
        rest -= size * (np.cos(phase) * sin + np.sin(phase) * cos)
        if size < 0.0:
            size, phase = -size, phase + np.pi
        found[int(i)] = Alternation(n, size / DEG, float((phase / DEG + 180.0) % 360.0 - 180.0), rounds)
    return [found[i] for i in range(len(orders))]


def _best_phase(
    weight: np.ndarray, rest: np.ndarray, size: float, sin: np.ndarray, cos: np.ndarray, phase: float
) -> float:
    """Phase that minimises ``Σ weight (rest - size sin(N x + phase))²``, by Newton's method from the best of twelve."""
    b = (weight * rest) @ sin, (weight * rest) @ cos
    g = (weight * sin) @ sin, (weight * sin) @ cos, (weight * cos) @ cos

    def cost(p):
        c, s = np.cos(p), np.sin(p)
        return size * (c * c * g[0] + 2 * c * s * g[1] + s * s * g[2]) - 2.0 * (c * b[0] + s * b[1])

    p = min((phase, *np.linspace(-np.pi, np.pi, 12, endpoint=False)), key=cost)
    h = 1e-3
    for _ in range(20):
        slope, bend = (cost(p + h) - cost(p - h)) / (2 * h), (cost(p + h) - 2 * cost(p) + cost(p - h)) / h**2
        if bend <= 0.0:
            break
        step = float(np.clip(-slope / bend, -0.3, 0.3))
        p += step
        if abs(step) < 1e-9:
            break
    return float(p)
