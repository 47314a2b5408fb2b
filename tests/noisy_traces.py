"""Samples of a circular test with noise of a known kind."""

import numpy as np

from mjsim.inference.samples import Samples, revolution_time
from mjsim.instruments.ball_bar.measurement import BallBarTest

CIRCLE = BallBarTest("c", "circular", (0.0, 0.0, 0.155), 0.1, 1 / 60, revolutions=2)


def coloured(n, rms, tau, dt, rng):
    a, out, x = np.exp(-dt / tau), np.empty(n), rng.normal(0, rms)
    for i in range(n):
        x = a * x + rng.normal(0, rms * np.sqrt(1 - a * a))
        out[i] = x
    return out


def samples(rng, rms=0.1e-6, signal=3e-6, seconds=None):
    turn = revolution_time(CIRCLE)
    time = 1.0 + np.arange(int((seconds or 2 * turn) / 0.005)) * 0.005
    phi = 2 * np.pi * time / turn
    value = signal * np.cos(3 * phi) + signal * np.sign(np.sin(phi)) + coloured(len(time), rms, 0.05, 0.005, rng)
    return Samples(CIRCLE, time, value, np.ones(len(time), bool), 0.02)
