"""What the instrument makes of the true bar length: set-up errors, trigger, coloured noise, resolution, range, knocks
and gaps.

Figures: typical set-up errors and resolution from the documentation; the noise's colour from the
revolution-to-revolution differences of measured traces (first-order, 50 ms, on a white floor; 0.12 µm RMS in all,
quantisation included).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
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


@dataclass(frozen=True)
class Bar:
    """What is wrong with an instrument, and what disturbs it; the defaults are a bar without faults.

    Attributes:
        gain: relative error of its deviations. clock: relative error of its clock.
        hum_um, hum_Hz: mains hum, its phase is drawn for each test.
        tail_share, tail_times: share of the noise whose standard deviation is so many times as large.
        outliers, gaps: knocks and missing stretches in the whole campaign.
    """

    gain: float = 0.0
    clock: float = 0.0
    hum_um: float = 0.0
    hum_Hz: float = 50.0
    tail_share: float = 0.0
    tail_times: float = 1.0
    outliers: int = 0
    gaps: int = 0


#: A bar without faults.
GOOD_BAR = Bar()


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


def recorded_clock(window: tuple[float, float], trigger: float, clock: float = 0.0) -> np.ndarray:
    """The instrument's sample times while the program is inside its window, s; true time is this over 1 + ``clock``,
    minus ``trigger``.
    """
    first, last = (np.array(window) + trigger) * (1.0 + clock) * SAMPLE_RATE
    return np.arange(int(np.ceil(first - 1e-9)), int(np.floor(last + 1e-9)) + 1) / SAMPLE_RATE


def heavy_tailed(n: int, share: float, times: float, rng: np.random.Generator) -> np.ndarray:
    """Random numbers of mean 0 and variance 1, a ``share`` of them from a distribution ``times`` as wide (the
    contaminated normal distribution, Tukey 1960).
    """
    if not share:
        return rng.standard_normal(n)
    wide = np.where(rng.uniform(size=n) < share, times, 1.0)
    return wide * rng.standard_normal(n) / np.sqrt(1.0 - share + share * times**2)


def noise(n: int, rms: float, rng: np.random.Generator, bar: Bar = GOOD_BAR) -> np.ndarray:
    """Coloured sensor noise in µm; with quantisation added it has the wanted RMS. The hum of a ``bar`` comes on top."""
    before = np.sqrt(max(rms**2 - RESOLUTION**2 / 12.0, 0.0))
    keep = np.exp(-1.0 / (CORRELATION * SAMPLE_RATE))
    drive = np.sqrt(1.0 - keep**2) * heavy_tailed(n, bar.tail_share, bar.tail_times, rng)
    start = rng.standard_normal()
    coloured, _ = lfilter([1.0], [1.0, -keep], drive, zi=[keep * start])
    white = heavy_tailed(n, bar.tail_share, bar.tail_times, rng)
    out = before * (np.sqrt(COLOURED) * coloured + np.sqrt(1.0 - COLOURED) * white)
    if bar.hum_um:
        turns = bar.hum_Hz * np.arange(n) / SAMPLE_RATE + rng.uniform()
        out += bar.hum_um * np.sin(2.0 * np.pi * turns)
    return out


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


def record(
    read: Callable[[int, np.ndarray], np.ndarray],
    windows: list[tuple[float, float]],
    setup: SetupErrors,
    bar: Bar,
    noise_um: float,
    rng: Callable[[int], np.random.Generator],
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The recorded traces of a campaign: time in s and deviation in µm for each test.

    Args:
        read: true reading of a test, by its number and instants from its program's start (s), in m, with the balls
            where they are. windows: of the tests' programs, s. setup: errors drawn. bar: the instrument.
        noise_um: RMS of a sample. rng: random numbers of a stream: 2 for disturbances, 10 … for each test's noise.
    """
    odd, count = rng(2), len(windows)
    knocked = np.bincount(odd.integers(0, count, bar.outliers), minlength=count)
    missing = np.bincount(odd.integers(0, count, bar.gaps), minlength=count)
    out = []
    for k, window in enumerate(windows):
        clock = recorded_clock(window, setup.trigger[k], bar.clock)
        true = read(k, clock / (1.0 + bar.clock) - setup.trigger[k])
        deviation = (1.0 + bar.gain) * (true + setup.length) * 1e6 + noise(len(clock), noise_um, rng(10 + k), bar)
        deviation += knocks(clock, int(knocked[k]), odd)
        keep = gaps(clock, int(missing[k]), odd)
        out.append((clock[keep], digitise(deviation)[keep]))
    return out
