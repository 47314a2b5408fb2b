"""The forecast: the tests simulated as the machine is, with the corrections in its control, and after a perfect repair.

The drives are simulated axis by axis (:mod:`mjsim.simulation.axes`), with the commands as the control corrects them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.compensation.arithmetic import Arithmetic, corrected
from mjsim.compensation.tables import Corrections
from mjsim.inference.at_rest import taken_by
from mjsim.inference.nuisance import set_up_columns
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.r_test.measurement import USUAL_NOISE
from mjsim.machine.kinematics import sensitivity
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation.axes import load_of, time_grid
from mjsim.simulation.bar import reading_in
from mjsim.simulation.drive import STEP
from mjsim.simulation.standing import standing

#: Every so many steps of a reading are judged.
_EVERY = 5


@dataclass(frozen=True)
class TestForecast:
    """One test. Readings about the set-up: what ball offsets and the bar's length can make is taken out.

    Attributes:
        test: The test.
        phi: (n,) rad; of points, their numbers.
        before: Of the machine as it is, (n,) m.
        after: With the corrections, (n,) m.
        perfect: Without the errors that are corrected, (n,) m.
    """

    __test__ = False

    test: Any
    phi: np.ndarray
    before: np.ndarray
    after: np.ndarray
    perfect: np.ndarray

    def rms(self) -> tuple[float, float, float]:
        """RMS before, after and perfect, m."""
        return _rms(self.before), _rms(self.after), _rms(self.perfect)


@dataclass(frozen=True)
class Forecast:
    """What the corrections will bring.

    Attributes:
        tests: One entry per test.
    """

    tests: tuple[TestForecast, ...]

    def rms(self) -> tuple[float, float, float]:
        """RMS over all tests before, after and perfect, m."""
        stacked = [np.concatenate([getattr(t, n) for t in self.tests]) for n in ("before", "after", "perfect")]
        return _rms(stacked[0]), _rms(stacked[1]), _rms(stacked[2])

    @property
    def gone(self) -> float | None:
        """Share of the squared error of the corrected causes that goes; ``None`` where they make none."""
        before, after, perfect = (x * x for x in self.rms())
        return (before - after) / (before - perfect) if before - perfect > 1e-18 else None


def forecast(
    machine: Machine,
    sound: Machine,
    tests: Sequence[BallBarTest],
    corrections: Corrections,
    how: Arithmetic,
    threads: int = 2,
    done: Callable[[], None] = lambda: None,
) -> Forecast:
    """Simulate the tests before and after the corrections.

    Args:
        machine: As diagnosed.
        sound: The same without the errors that are corrected.
        tests: What is run.
        corrections: What the control is told.
        how: How it uses that.
        threads: Tests side by side.
        done: Called after each test.
    """
    plant, ideal = build(machine), build(sound)
    changed = machine
    for axis, gain in corrections.gains.items():
        changed = changed.with_drive(axis, position_gain=gain)
    repaired = build(changed)

    def one(test: BallBarTest) -> tuple[TestForecast, np.ndarray]:
        program = Program(test)
        time = time_grid(program)
        commands = program.commands(time)
        low, high = program.measured_span
        span = slice(int(np.ceil(low / STEP)), int(high / STEP) + 1, _EVERY)
        base = _columns(plant, test, commands[span])
        before = _reading(plant, test, time, commands)[span]
        after = _reading(repaired, test, time, corrected(commands, corrections, how, STEP))[span]
        perfect = _reading(ideal, test, time, commands)[span]
        done()
        return TestForecast(test, program.phi(time[span]), before, after, perfect), base

    with ThreadPoolExecutor(max(1, min(threads, len(tests)))) as pool:
        found = list(pool.map(one, tests))
    for setup in dict.fromkeys(t.setup for t in tests if t.component):
        mine = [i for i, t in enumerate(tests) if t.component and t.setup == setup]
        for i, about in zip(mine, _about_sphere([found[i] for i in mine]), strict=True):
            found[i] = about, found[i][1]
    return Forecast(tuple(t if t.test.component else _about_balls(t, base) for t, base in found))


def forecast_at_rest(
    machine: Machine, sound: Machine, points: Campaign, corrections: Corrections, how: Arithmetic
) -> Forecast:
    """:func:`forecast` of tests that were measured while the machine stood still.

    Args:
        machine: As diagnosed.
        sound: The same without the errors that are corrected.
        points: Tests of instruments that measure at rest.
        corrections: What the control is told.
        how: How it uses that.
    """
    plant, ideal = build(machine), build(sound)
    out = []
    for test in points.measured:
        instrument, recording = INSTRUMENTS[test.instrument], points.traces[test.name]
        stops, time = instrument.stops(test, recording), instrument.observe(test, recording).time
        assert stops is not None
        set_up = instrument.nuisances_of(test, recording, time, points.instruments[test.instrument])
        noise = np.tile(instrument.noise(test, recording, points.instruments[test.instrument]), len(time))
        columns = (set_up.columns * set_up.spread).reshape(-1, len(set_up.names))
        moved = replace(stops, route=corrected(stops.route, corrections, how, STEP))
        rows = [
            instrument.reading_at(test, standing(p, s, test.name), p.geometry, stops).ravel()
            for p, s in ((plant, stops), (plant, moved), (ideal, stops))
        ]
        rows = [r - columns @ taken_by(columns, r, noise) for r in rows]
        out.append(TestForecast(test, np.arange(len(rows[0]), dtype=float), *rows))
    return Forecast(tuple(out))


def _reading(plant: Plant, test: BallBarTest, time: np.ndarray, commands: np.ndarray) -> np.ndarray:
    q = np.ascontiguousarray(load_of(plant, time, commands, test.started, test.recording, test.table_ball))
    return reading_in(test, q, plant.geometry)


def _columns(plant: Plant, test: BallBarTest, q: np.ndarray) -> np.ndarray:
    """What set-up and instrument add to the reading: the bar's length and the offsets of both balls, (n, 7); or of an
    R-test the places of sphere and nest, (n, 6), in standard deviations of their priors.
    """
    s = sensitivity(plant.chain, q, np.asarray(test.table_ball), test.component)
    if test.component:
        return set_up_columns(test, s, np.zeros((len(q), 3)))[:, :6]
    return np.column_stack([np.ones(len(q)), s.table, s.spindle])


def _about_balls(t: TestForecast, columns: np.ndarray) -> TestForecast:
    """A ball-bar test without what its own balls and bar can make."""
    rows = (x - columns @ np.linalg.lstsq(columns, x, rcond=1e-8)[0] for x in (t.before, t.after, t.perfect))
    return TestForecast(t.test, t.phi, *rows)


def _about_sphere(found: list[tuple[TestForecast, np.ndarray]]) -> list[TestForecast]:
    """Readings of one set-up of an R-test without what the places of sphere and nest can make of all of them."""
    columns, ends = np.vstack([c for _, c in found]), np.cumsum([len(c) for _, c in found])[:-1]
    parts = []
    for name in ("before", "after", "perfect"):
        whole = np.concatenate([getattr(t, name) for t, _ in found])
        left = whole - columns @ taken_by(columns, whole, np.full(len(whole), USUAL_NOISE))
        parts.append(np.split(left, ends))
    return [TestForecast(t.test, t.phi, *rows) for (t, _), *rows in zip(found, *parts, strict=True)]


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x * x)))
