"""What the instrument makes of the true bar length: set-up errors, trigger, coloured noise, resolution, range, knocks
and gaps.

Figures: typical set-up errors and resolution from the documentation; the noise's colour from the
revolution-to-revolution differences of measured traces (first-order, 50 ms, on a white floor; 0.12 µm RMS in all,
quantisation included).
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

SAMPLE_RATE = 200.0
RESOLUTION = 0.1
RANGE = 1000.0
NOISE = 0.12
#: Correlation time of the coloured part, s, and its share of the variance without quantisation.
CORRELATION = 0.05
COLOURED = 0.84
#: One standard deviation: table ball and spindle ball per component and bar length in µm, trigger in s.
TABLE_BALL, SPINDLE_BALL, LENGTH, TRIGGER = 10.0, 2.0, 3.0, 0.020


@dataclass(frozen=True)
class SetupErrors:
    """One campaign's set-up errors: m, and s for the trigger."""

    table: dict[str, np.ndarray]
    spindle: dict[str, np.ndarray]
    length: float
    trigger: tuple[float, ...]
    phases: tuple[dict[str, float], ...]


def draw_setup(tests: list[dict], seed: int) -> SetupErrors:
    """Errors of the set-ups, shared by tests of one set-up; trigger and vibration phase belong to each test.

    Each name has random numbers of its own: a test that is added to a campaign leaves the others as they were.
    """

    def rng(name: str) -> np.random.Generator:
        return np.random.default_rng([seed, 1, zlib.crc32(name.encode())])

    names = list(dict.fromkeys(t["setup"] for t in tests))
    table = {n: TABLE_BALL * 1e-6 * rng("table " + n).standard_normal(3) for n in names}
    spindle = {n: SPINDLE_BALL * 1e-6 * rng("spindle " + n).standard_normal(3) for n in names}
    length = LENGTH * 1e-6 * rng("length").standard_normal()
    trigger = tuple(float(TRIGGER * rng("trigger " + t["name"]).standard_normal()) for t in tests)
    draws = (rng("phases " + t["name"]).uniform(0.0, 2.0 * np.pi, 3) for t in tests)
    phases = tuple(dict(zip("XYZ", map(float, three), strict=True)) for three in draws)
    return SetupErrors(table, spindle, float(length), trigger, phases)


def recorded_clock(window: tuple[float, float], trigger: float) -> np.ndarray:
    """The instrument's sample times while the program is inside its window, s; true time is this minus ``trigger``."""
    first, last = (np.array(window) + trigger) * SAMPLE_RATE
    return np.arange(int(np.ceil(first - 1e-9)), int(np.floor(last + 1e-9)) + 1) / SAMPLE_RATE


def noise(n: int, rms: float, rng: np.random.Generator) -> np.ndarray:
    """Coloured sensor noise in µm; with quantisation added it has the wanted RMS."""
    before = np.sqrt(max(rms**2 - RESOLUTION**2 / 12.0, 0.0))
    keep = np.exp(-1.0 / (CORRELATION * SAMPLE_RATE))
    drive = np.sqrt(1.0 - keep**2) * rng.standard_normal(n)
    start = rng.standard_normal()
    coloured, _ = lfilter([1.0], [1.0, -keep], drive, zi=[keep * start])
    return before * (np.sqrt(COLOURED) * coloured + np.sqrt(1.0 - COLOURED) * rng.standard_normal(n))


def knocks(time: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Knocks on the bar, µm: most ring for some 50 ms, one in four lets the ball creep to a new seat 1 to 4 µm off."""
    out = np.zeros_like(time)
    for _ in range(count):
        start, sign = rng.uniform(time[0] + 1.0, time[-1] - 1.0), rng.choice([-1.0, 1.0])
        size, after = rng.uniform(4.0, 30.0), np.maximum(time - start, 0.0)
        if rng.uniform() < 0.25:
            out += (time >= start) * sign * rng.uniform(1.0, 4.0) * (1.0 - np.exp(-after / 0.02))
        else:
            swing = np.cos(2.0 * np.pi * rng.uniform(8.0, 25.0) * after)
            out += (time >= start) * sign * size * np.exp(-after / rng.uniform(0.02, 0.10)) * swing
    return out


def digitise(deviation_um: np.ndarray) -> np.ndarray:
    """Resolution and range of the sensor, µm."""
    return np.clip(np.round(deviation_um / RESOLUTION) * RESOLUTION, -RANGE, RANGE)


def gaps(time: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Which samples were kept, (n,) bool: ``count`` stretches of 0.3 to 4 s are missing."""
    keep = np.ones(len(time), bool)
    for _ in range(count):
        start = rng.uniform(time[0], time[-1])
        keep &= (time < start) | (time > start + rng.uniform(0.3, 4.0))
    return keep
