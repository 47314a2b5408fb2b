"""Orders of a pitch error: a spectrum of the residual over the position of one axis."""

from __future__ import annotations

import numpy as np

from mjsim.effects import registry
from mjsim.inference.fit import Fit
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import Candidate, SignatureBank
from mjsim.kinematics import AXES, ROTARY

#: Highest order that is looked for, per table turn or per screw turn.
HIGHEST = {"A": 800, "C": 800, "X": 12, "Y": 12, "Z": 12}
_BINS = 8192


def orders(problem: Problem, fit: Fit, bank: SignatureBank, axis: str, count: int = 6) -> list[int]:
    """The ``count`` orders whose sine and cosine explain most of the residual.

    Residual times sensitivity is gathered over the axis position (one turn) and transformed: this is the score of every order at
    once. Its variance follows from the noise spectrum at the frequency at which the order passes. Nuisances are projected out
    only afterwards, when the orders found are fitted.
    """
    i = AXES.index(axis)
    turn = 2 * np.pi if axis in ROTARY else 2 * np.pi / fit.base.drives[axis].gear
    highest = HIGHEST[axis]
    number = np.arange(1, highest + 1)
    rest = problem.residual(fit.readings, fit.nuisance)
    gathered = np.zeros(_BINS)
    variance = np.zeros(highest)
    spectrum = problem.noise
    for k, s in enumerate(problem.samples):
        q = bank.loads[k][:, i]
        if np.ptp(q) < turn / highest:
            continue
        shift = problem.shift(k, fit.nuisance)
        x, weight = s.sample(q, shift), s.sample(problem.sensitivity[k].axes[:, i], shift)
        # generalised least squares weights the residual with the inverse noise covariance: filter forwards and backwards
        taps = np.concatenate([[1.0], -spectrum.ar]) / spectrum.innovation
        whitened = np.convolve(np.where(s.good, rest[k], 0.0), taps)[: len(x)]
        score = np.convolve(whitened[::-1], taps)[: len(x)][::-1]
        gathered += np.bincount((np.floor(x / turn * _BINS) % _BINS).astype(int), weight * score, _BINS)
        speed = np.abs(np.gradient(x)) / turn
        bins = np.minimum((speed * highest * 1.001 * 2).astype(int), 400)
        power = np.bincount(bins, weight**2, 401)
        centre = (np.arange(401) + 0.5) / (2 * highest * 1.001)
        used = power > 0
        f = number[:, None] * centre[used][None]
        gain = np.abs(sum(taps[j] * np.exp(-2j * np.pi * f * j) for j in range(len(taps)))) ** 2
        gain[f > 0.45] = 0.0  # beyond the blocks' band
        variance += 0.5 * gain @ power[used]
    spectrum_of_score = np.fft.rfft(gathered)[1 : highest + 1]
    gains = np.abs(spectrum_of_score) ** 2 / np.maximum(variance, 1e-30 + 1e-6 * variance.max())
    return [int(n) for n in number[np.argsort(-gains, kind="stable")[:count]]]


def spectral_candidates(problem: Problem, fit: Fit, bank: SignatureBank, axis: str, count: int = 4) -> list[tuple[Candidate, np.ndarray]]:
    """Candidates whose order is read off the spectrum of one axis, with whitened columns (count, 2): sine and cosine, per typical size.

    Pitch errors at the ``count`` best orders, and a torque ripple at the best one: both make a wave of the axis position, but the
    drive passes a torque on differently at different speeds.
    """
    cls, subject = registry.effect_class(f"pitch_error.{axis}")
    have = {round(c[0]) for e in fit.machine.effects if e.id == f"pitch_error.{axis}" for c in e.values["components"]}
    scale = cls.parameters_of(subject)[0].scale
    found = orders(problem, fit, bank, axis, count + len(have))
    out = []
    for order in (n for n in found if n not in have):
        sides = []
        for phase in (0.0, 90.0):
            effect = cls(subject, components=[[float(order), 0.05 * scale, phase]])
            sides.append([d / 0.05 for d in bank.position_changes(effect)])
        columns = problem.whiten([np.column_stack(pair) for pair in zip(*sides, strict=True)])
        out.append((Candidate(cls(subject, components=[[float(order), scale, 0.0]]), ("components",)), columns))
    ripple, _ = registry.effect_class(f"torque_ripple.{axis}")
    if found and not fit.machine.effect(f"torque_ripple.{axis}"):
        per_motor_turn = found[0] if axis not in ROTARY else found[0] / fit.base.drives[axis].gear
        seed = Candidate(ripple(subject, amplitude_Nm=ripple.parameters[0].scale, order=float(per_motor_turn)), ripple.free)
        out.append((seed, problem.whiten(bank.columns(seed))))
    return out
