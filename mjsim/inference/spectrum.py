"""Orders of a pitch error: a spectrum of the residual over the position of one axis."""

from __future__ import annotations

import numpy as np

from mjsim.effects import registry
from mjsim.inference.fit import Fit
from mjsim.inference.linearisation import OfTest
from mjsim.inference.noise import Noise
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import Candidate, Offer, SignatureBank
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect

#: Highest order that is looked for: per turn of a rotary axis, per turn of a linear axis' screw.
HIGHEST_ROTARY, HIGHEST_LINEAR = 800, 24
_BINS = 8192
#: Information about an order, over that about the best known one, below which it is not looked for.
_SEEN = 1e-6
#: Orders of the waves of a wheel that the spectrum may not see.
_SLOW_WAVES = (1, 2, 3)
#: A motor's torque ripples at least about once per turn.
_SLOWEST_RIPPLE = 0.95
#: Of a typical size: how far a wave is moved for its columns.
_PART = 0.05


def order_gains(problem: Problem, fit: Fit, bank: SignatureBank, axis: str) -> dict[str, np.ndarray]:
    """What sine and cosine of every order from 1 on explain of the residual, (highest,): in both directions of motion
    (key ``""``), and of a rotary axis in each in which it turns (``"CCW"``, ``"CW"``). Minus infinity where it passes
    faster than the blocks can follow.

    Residual times sensitivity is gathered over the axis position (one turn) and transformed: this is the score of every
    order at once. Its variance follows from the noise spectrum at the frequency at which the order passes. Nuisances
    are projected out only afterwards, when the orders found are fitted.
    """
    i, rotary = problem.chain.index(axis), is_rotary(axis)
    turn = 2 * np.pi if rotary else 2 * np.pi / fit.base.drives[axis].gear
    highest = HIGHEST_ROTARY if rotary else HIGHEST_LINEAR
    rest = problem.residual(fit.readings, fit.nuisance)

    def one(k: int) -> tuple[np.ndarray, np.ndarray]:
        gathered, variance = np.zeros((2, _BINS)), np.zeros((2, highest))
        s, q = problem.samples[k], bank.loads[k][:, i]
        if np.ptp(q) < turn / highest:
            return gathered, variance
        shift = problem.shift(k, fit.nuisance)
        x, weight = s.sample(q, shift), s.sample(problem.sensitivity[k].axes[:, i], shift)
        speed = np.gradient(x) / turn
        score = _backward(problem.noise_of(k), np.where(s.good, rest[k], 0.0))
        place = (np.floor(x / turn * _BINS) % _BINS).astype(int)
        for sense, there in enumerate((speed > 0.0, speed <= 0.0)):
            gathered[sense] = np.bincount(place[there], (weight * score)[there], _BINS)
            variance[sense] = _variance(problem.noise_of(k), highest, np.abs(speed[there]), weight[there])
        return gathered, variance

    gathered, variance = (np.sum(parts, axis=0) for parts in zip(*problem.map(one), strict=True))
    per_direction = {"": (gathered.sum(axis=0), variance.sum(axis=0))}
    if rotary:
        ways = ("CCW", "CW") if problem.chain.axis(axis).ccw > 0.0 else ("CW", "CCW")
        per_direction |= {way: (g, v) for way, g, v in zip(ways, gathered, variance, strict=True) if v.any()}
    out = {}
    for name, (g, v) in per_direction.items():
        seen = v > _SEEN * v.max()  # the others pass faster than the blocks can follow
        out[name] = np.where(seen, np.abs(np.fft.rfft(g)[1 : highest + 1]) ** 2 / np.where(seen, v, 1.0), -np.inf)
    return out


def orders(problem: Problem, fit: Fit, bank: SignatureBank, axis: str, count: int = 6) -> dict[str, list[int]]:
    """The ``count`` orders of largest :func:`order_gains` in both directions of motion, and in each alone where an axis
    turns both ways.
    """
    gains = order_gains(problem, fit, bank, axis)
    names = [*gains] if len(gains) == 3 else [""]
    best = {name: np.argsort(-gains[name], kind="stable")[:count] for name in names}
    return {name: [int(n) + 1 for n in rows if np.isfinite(gains[name][n])] for name, rows in best.items()}


def _backward(noise: Noise, rest: np.ndarray) -> np.ndarray:
    """The residual weighted with the inverse noise covariance (generalised least squares): filtered forwards and
    backwards.
    """
    taps = noise.taps
    whitened = np.convolve(rest, taps)[: len(rest)]
    return np.convolve(whitened[::-1], taps)[: len(rest)][::-1]


def _variance(noise: Noise, highest: int, speed: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Information about every order's amplitude, (highest,): by the noise at the frequency at which the order passes.

    ``speed`` is in turns per block.
    """
    taps = noise.taps
    bins = np.minimum((speed * highest * 1.001 * 2).astype(int), 400)
    power = np.bincount(bins, weight**2, 401)
    centre = (np.arange(401) + 0.5) / (2 * highest * 1.001)
    used = power > 0
    f = np.arange(1, highest + 1)[:, None] * centre[used][None]
    gain = np.abs(sum(taps[j] * np.exp(-2j * np.pi * f * j) for j in range(len(taps)))) ** 2
    gain[f > 0.45] = 0.0  # beyond the blocks' band
    return 0.5 * gain @ power[used]


def spectral_candidates(problem: Problem, fit: Fit, bank: SignatureBank, axis: str, count: int = 4) -> list[Offer]:
    """Candidates whose order is read off the spectrum of one axis, with whitened columns (count, 2): sine and cosine,
    per typical size.

    Pitch errors at the ``count`` best orders (at half as many where they act in one direction only), and a torque
    ripple at the best one: all make a wave of the axis position, but the drive passes a torque on differently at
    different speeds. A pitch error in the model leaves nothing of its orders for the spectrum to see, though a ripple
    may hide behind it: a ripple is also tried at these. Beside a pitch error of a rotary axis its slowest waves are
    tried as well, which hide behind errors of the set-up where the axis only swings.
    """
    cls, subject = registry.effect_class(f"pitch_error.{axis}", fit.machine.chain)
    present = {e.key: e for e in fit.machine.effects if e.id == f"pitch_error.{axis}"}
    slow = _SLOW_WAVES if is_rotary(axis) else ()
    teeth = fit.base.drives[axis].gear if is_rotary(axis) else 1.0
    most = max((len(e.values["components"]) for e in present.values()), default=0)
    found = orders(problem, fit, bank, axis, count + most)
    candidates, works = [], []
    for direction, numbers in found.items():
        values = {"direction": direction} if direction else {}
        empty = cls(subject, components=[], **values)
        own = present.get(empty.key)
        have = {round(c[0]) for c in own.values["components"]} if own else set()
        if direction:  # both flanks of a wheel are cut on one blank: what is longer than a tooth is common to them
            numbers = [n for n in numbers if n >= teeth]
        best = [n for n in numbers if n not in have][: count // 2 if direction else count]
        best += [n for n in slow if own and not direction and n not in (*have, *best)]
        candidates += [wave(empty, float(order)) for order in best]
        works += [sides_of(bank, empty, float(order)) for order in best]
    ripple, _ = registry.effect_class(f"torque_ripple.{axis}", fit.machine.chain)
    if fit.machine.effect(f"torque_ripple.{axis}"):
        return bank.whitened(candidates, works)
    modelled = {round(c[0]) for e in present.values() for c in e.values["components"]}
    fast = [n / teeth for n in found[""] if n / teeth > _SLOWEST_RIPPLE][:1]
    fast += [n / teeth for n in sorted(modelled) if n / teeth > _SLOWEST_RIPPLE]
    seed = {"amplitude_Nm": ripple.parameters[0].scale}
    ripples = [Candidate(ripple(subject, order=n, **seed), ripple.search.free) for n in dict.fromkeys(fast)]
    return bank.whitened([*candidates, *ripples], [*works, *map(bank.columns_of, ripples)])


def wave(pitch_error: Effect, order: float) -> Candidate:
    """A pitch error of one order alone as a candidate, of the axis and direction of ``pitch_error``."""
    scale = pitch_error.parameters_of(pitch_error.subject)[0].scale
    return Candidate(pitch_error.replaced(components=[[order, scale, 0.0]]), ("components",))


def sides_of(bank: SignatureBank, pitch_error: Effect, order: float) -> OfTest:
    """What computes sine and cosine of one order in one test: what each adds to the block means, (m, 2) m per typical
    size.
    """
    scale = pitch_error.parameters_of(pitch_error.subject)[0].scale
    parts = [pitch_error.replaced(components=[[order, _PART * scale, phase]]) for phase in (0.0, 90.0)]
    sides = [bank.linearisation.added_of(part) for part in parts]
    return lambda k: np.column_stack([side(k) for side in sides]) / _PART
