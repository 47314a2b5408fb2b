"""Traces for the interactive plots: whole numbers, one common set of angles per test, every glitch kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjsim.commands.ball_bar.compare import ComparedBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import is_rotary
from mjsim.plots.output import residual_trace
from mjsim.plots.polar import centre_of
from mjsim.plots.residual import reversal_angles
from mjsim.units import DEG, MM, UM

#: Samples per turn that are kept, about; axis positions are given at this many instants, in between they are
#: interpolated.
PER_TURN, POSITIONS = 1000, 181


def test_traces(models: list[ComparedBarTest], start: int, noise: float) -> dict:
    """One test under every model of the ladder.

    Args:
        models: the test's comparison per model. start: place of the machine as given. noise: RMS of one sample [m].

    Returns:
        ``phi`` (n,) in 0.01°; ``measured`` (n,) and ``models`` (k, n) in 0.001 µm, measured with None where a sample is
        left out; ``centre``: the eccentricity [a, b, c] in 0.001 µm that is taken out, a cos φ + b sin φ + c, of the
        measured trace and of every model's; ``full``: a whole circle; ``events``
        [axis, angle °]; ``axes``: φ in 0.01° and the commanded positions of the axes [0.01 mm or 0.01°]; ``noise``
        [µm]. The long lists are :func:`steps`.
    """
    t = models[start]
    keep = kept(t.phi, t.residual)
    trace = residual_trace(t, noise)
    measured = [round(v / UM * 1e3) if ok else None for v, ok in zip(t.measured[keep], t.valid[keep], strict=True)]
    traces = [t.measured, *(m.simulated for m in models)]
    return {
        "name": t.test.name,
        "phi": steps(_whole(t.phi[keep] / DEG, 100.0)),
        "measured": steps(measured),
        "models": [steps(_whole(m.simulated[keep] / UM, 1e3)) for m in models],
        "centre": [_whole(centre_of(t.test, t.phi[t.valid], x[t.valid]) / UM, 1e3) for x in traces],
        "full": bool(trace.full_circle()),
        "events": [[axis, round(angle, 2)] for axis, angle in reversal_angles(trace)],
        "axes": _positions(t),
        "noise": round(noise / UM, 4),
    }


def kept(phi: np.ndarray, signal: np.ndarray, per_turn: int = PER_TURN) -> np.ndarray:
    """Indices of about ``per_turn`` samples per turn: the smallest and the largest ``signal`` of each stretch, and
    both ends.
    """
    turns = max(float(np.ptp(phi)) / (2.0 * np.pi), 0.8)
    stretch = int(np.ceil(2.0 * len(phi) / (turns * per_turn)))
    if stretch < 3:
        return np.arange(len(phi))
    keep = {0, len(phi) - 1}
    for begin in range(0, len(phi), stretch):
        part = signal[begin : begin + stretch]
        keep |= {begin + int(np.argmin(part)), begin + int(np.argmax(part))}
    return np.array(sorted(keep))


def _positions(t: ComparedBarTest) -> dict:
    program = Program(t.test)
    time = np.linspace(*program.measured_span, POSITIONS)
    axes = t.test.chain.letters
    q = program.commands(time) / [DEG if is_rotary(a) else MM for a in axes]
    return {
        "phi": steps(_whole(program.phi(time) / DEG, 100.0)),
        **{a: steps(_whole(q[:, i], 100.0)) for i, a in enumerate(axes)},
    }


def _whole(x: np.ndarray, factor: float) -> list[int]:
    return np.round(np.asarray(x) * factor).astype(int).tolist()


def steps(values: Sequence[int | None]) -> list[int | None]:
    """Every number less the one before it, which takes half the characters; the first as it is, None where there is
    none.
    """
    out, before = [], 0
    for value in values:
        out.append(None if value is None else value - before)
        before = before if value is None else value
    return out
