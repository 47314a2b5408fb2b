"""What a trace says about the program that it was recorded with, whatever is wrong with the machine.

Two things are hard to fake. *Reversals*: friction leaves a short spike where an axis turns round; its place, sign and
size belong to one program, and effects that one looks for are broader or elsewhere. *Set-up*: tests of one set-up share
the balls' offsets, so that their eccentricities have to agree. :class:`State` has the tests as they are believed to be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mjsim.inference.least_squares import ridge_solution
from mjsim.inference.mistakes.mistakes import MISTAKES, MistakeSettings, unit_of
from mjsim.inference.nuisance import LENGTH, SPINDLE_BALL, TABLE_BALL, TRIGGER
from mjsim.inference.samples import GRID, GRID_STEPS, Samples
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.kinematics import BarSensitivity
from mjsim.machine.plant import Plant
from mjsim.simulation.axes import AxesMotion

#: Spikes are what is left above this time constant of a Gaussian, s: friction's last some 0.1 s at every feed.
_SHARP = 0.1
#: Triggers that are tried, s: three standard deviations either way.
_SHIFTS = np.arange(-12, 13) * GRID
#: Median size of the second differences of white noise of variance one.
_MEDIAN = 0.6745 * np.sqrt(6.0)
#: Noise of a sample, m, against which the balls' priors are weighed.
_NOISE = 0.1e-6
#: What a model may leave in a test, m, and as how many independent values that counts: it must not drive the balls far
#: from their priors.
_REST, _POINTS = 1e-6, 50.0


@dataclass(frozen=True)
class Variant:
    """A test as it may have been run: what the machine as given would have measured, and how the reading follows the
    balls.

    Attributes:
        test: the test. reading: (n,) m on the GRID. sensitivity: along it.
    """

    test: BallBarTest
    reading: np.ndarray
    sensitivity: BarSensitivity

    @classmethod
    def of(cls, test: BallBarTest, plant: Plant) -> Variant:
        """Simulate a test's motion."""
        motion = AxesMotion(test)
        return cls(test, motion.reading(plant, GRID_STEPS), motion.sensitivity(plant, GRID_STEPS))

    def balls(self, s: Samples) -> np.ndarray:
        """Columns (blocks, 6) of a trace: m per prior standard deviation of the table ball's and the spindle ball's
        offsets.
        """
        grids = [*(self.sensitivity.table.T * TABLE_BALL), *(self.sensitivity.spindle.T * SPINDLE_BALL)]
        return np.column_stack([s.sample(np.ascontiguousarray(g), 0.0) for g in grids])


@dataclass(frozen=True)
class Spikes:
    """How a trace's spikes compare with a variant's.

    Attributes:
        factor: measured over modelled size. agreement: correlation, -1 to 1. visible: whether the model has spikes to
            compare with.
    """

    factor: float
    agreement: float
    visible: bool


def spikes(variant: Variant, s: Samples, visible: float = MISTAKES.visible_spike) -> Spikes:
    """Compare the sharp part of a trace with a variant's, at the trigger where they agree best (with either sign).

    Args:
        variant: What is simulated.
        s: The samples of the trace.
        visible: RMS from which the variant's spikes count as visible, m.
    """
    width = _SHARP / s.block
    good = s.good & ~_near(~s.good, width)
    margin = int(np.ceil(2 * width))
    good[:margin] = good[len(good) - margin :] = False
    if good.sum() < 50:
        return Spikes(0.0, 0.0, False)
    columns = np.column_stack([*(_sharp(c, width) for c in variant.balls(s).T), np.ones(len(s.mean))])[good]
    # with their priors: what is sharp in these columns is next to nothing, and without them it would take any spike up
    priors = _NOISE**2 * np.array([1.0] * 6 + [0.0])
    fit = ridge_solution(columns.T @ columns, columns.T, priors)
    y = _sharp(s.mean, width)[good]
    y = y - columns @ (fit @ y)
    best = Spikes(0.0, 0.0, False)
    for shift in _SHIFTS:
        x = _sharp(s.sample(variant.reading, shift), width)[good]
        x = x - columns @ (fit @ x)
        xx, xy, yy = x @ x, x @ y, y @ y
        if xx < len(x) * visible**2 or yy == 0.0:
            continue
        agreement = xy / np.sqrt(xx * yy)
        if abs(agreement) > abs(best.agreement):
            best = Spikes(float(xy / xx), float(agreement), True)
    return best


def level(s: Samples) -> float:
    """Noise of a trace's blocks, m: from their second differences, in which a machine shows next to nothing. What is
    sharp beside that is the machine's: the waves of a worm are in the tests that turn it and in no other.
    """
    kinks = np.abs(np.diff(s.mean, 2))[s.good[2:] & s.good[1:-1] & s.good[:-2]]
    return float(np.median(kinks)) / _MEDIAN if len(kinks) else 0.0


def disagreement(parts: list[tuple[Variant, Samples, float]]) -> float:
    """What the tests of one set-up leave when they share their balls' offsets: each a variant, a trace, the trace's
    factor.

    As the RMS (m) that one test would have, were it all in that one.
    """
    rows = left_together(parts, [variant.balls(s) for variant, s, _ in parts])
    total = sum(float(np.sum(r**2)) for r in rows)
    return float(np.sqrt(total / max(1.0, np.median([len(r) for r in rows]))))


def left_together(parts: list[tuple[Variant, Samples, float]], shared: Sequence[np.ndarray]) -> list[np.ndarray]:
    """What tests leave when they share some errors and the bar's length, and each has its own trigger and level.

    Args:
        parts: Of each test a variant, a trace, the trace's factor.
        shared: Columns of the shared errors, (blocks, k) m per usual size.

    Returns:
        The residual of the good blocks of each test, m.
    """
    rows = []
    for (variant, s, factor), errors in zip(parts, shared, strict=True):
        modelled = s.sample(variant.reading, 0.0)
        lag = np.gradient(modelled, s.block) * TRIGGER
        own = np.column_stack([lag, np.ones(len(lag))])[s.good]
        q = np.linalg.qr(own)[0]
        columns = np.column_stack([errors, np.full(len(lag), LENGTH)])[s.good]
        d = (factor * s.mean - modelled)[s.good]
        rows.append((columns - q @ (q.T @ columns), d - q @ (q.T @ d)))
    a = sum(_POINTS / max(1, len(d)) * columns.T @ columns for columns, d in rows)
    b = sum(_POINTS / max(1, len(d)) * columns.T @ d for columns, d in rows)
    x = ridge_solution(np.asarray(a), np.asarray(b), _REST**2)
    return [d - columns @ x for columns, d in rows]


def _sharp(x: np.ndarray, width: float) -> np.ndarray:
    return x - gaussian_filter1d(x, width)


def _near(bad: np.ndarray, width: float) -> np.ndarray:
    return np.convolve(bad, np.ones(2 * int(2 * width) + 1), mode="same") > 0 if bad.any() else bad


#: A test as it may have been run: its variant, its trace, and what the trace is multiplied with.
Part = tuple[Variant, Samples, float]


@dataclass
class State:
    """The tests as they are believed to be."""

    variants: list[Variant]
    traces: list[Samples]
    factors: list[float]
    settings: MistakeSettings
    _known: dict = field(default_factory=dict)

    def part(self, k: int) -> Part:
        return self.variants[k], self.traces[k], self.factors[k]

    def spikes_of(self, variant: Variant, s: Samples, factor: float = 1.0) -> Spikes:
        key = (id(variant), id(s))
        if key not in self._known:
            self._known[key] = spikes(variant, s, self.settings.visible_spike)
        found = self._known[key]
        return replace(found, factor=factor * found.factor, agreement=float(np.sign(factor)) * found.agreement)

    def fit(self, part: Part) -> float | None:
        """Agreement of a test's spikes, zero where their size is no machine's; ``None`` where there are none to see."""
        found = self.spikes_of(*part)
        if not found.visible:
            return None
        known = unit_of(found.factor)
        return found.agreement if known is not None and not known[1] else 0.0

    def disagrees(self, k: int) -> bool:
        """Whether the set-up of test ``k`` leaves much more than its tests do on their own: else no correction
        makes it agree.
        """
        members = self.members(k)
        disagreement_of = self.disagreement_of(k, {})
        if disagreement_of <= self.settings.setup_disagrees:
            return False
        apart = float(np.sqrt(sum(disagreement([self.part(j)]) ** 2 for j in members if j != k)))
        return apart < self.settings.setup_share * disagreement_of

    def disagreement_of(self, k: int, parts: dict[int, Part]) -> float:
        """Disagreement (m) of the set-up of test ``k`` with some tests changed; zero where the test is alone in it."""
        members = self.members(k)
        return disagreement([parts.get(j, self.part(j)) for j in members]) if len(members) > 1 else 0.0

    def members(self, k: int) -> list[int]:
        """Tests of the set-up of test ``k``."""
        setup = self.variants[k].test.setup
        return [j for j, v in enumerate(self.variants) if v.test.setup == setup]
