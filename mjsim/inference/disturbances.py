"""What happened once in a measurement is left out.

There are two kinds: outliers, which are short disturbances that do not repeat, such as a knocked bar; and lasting jumps
of a trace, where a knock has put a ball into another seat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation, median_filter

from mjsim.inference.hypotheses import CAUSE
from mjsim.inference.nuisance import AFTER_KNOCK
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.problem import Problem
from mjsim.inference.samples import Samples, revolution_time
from mjsim.inference.settings import OUTLIERS, OutlierSettings
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.program import Program

#: Height of a jump between two revolutions, over how far they lie apart: less is a drift, more the machine's own step
#: (assumed).
_AS_FAR = (0.5, 2.0)
#: Lags that are tried between two tests within :attr:`OutlierSettings.same_place`.
_LAGS = 21
#: Half-width of the middle 90 % of a normal distribution, standard deviations.
_DEVIATIONS = 1.645
#: Reach of an axis that counts as none, m/rad (assumed).
_NO_REACH = 1e-9


def without_disturbances(
    problem: Problem, readings: Sequence[np.ndarray], nuisance: np.ndarray | None = None
) -> Problem:
    """The problem without what happened once; the same one where there is nothing of that kind.

    The waves of a worm gear hide a knock. So it is worth to look again once a model follows them: what was found before
    stays left out.

    Args:
        problem: The measured tests.
        readings: Simulated readings on the GRID, one per test, m: of the machine as given, or of a fitted model.
        nuisance: Of the fitted model; fitted to the readings where it is missing.
    """
    rest = problem.sample_residuals(readings, fit_nuisance(problem, readings) if nuisance is None else nuisance)
    samples = [s.copy() for s in problem.samples]
    tests, events = list(problem.tests), {t.name: 0 for t in problem.tests}
    noise, settings = [problem.noise_of(k).rms for k in range(len(samples))], problem.settings.outliers
    for s, r, n in zip(samples, rest, noise, strict=True):
        events[s.test.name] = mark_outliers(s, r, n, settings)
    witnesses = _Witnesses(problem, rest)
    for name, count in _readmit_what_returns(problem, samples, witnesses).items():
        events[name] = max(0, events[name] - count)
    for _ in range(settings.most_events):
        found = {k: largest_jump(s, rest[k], noise[k], settings) for k, s in enumerate(samples)}
        jumps = {k: at for k, at in found.items() if at is not None}
        axis, of_machine = _at_reversals_of_one_axis(samples, [*jumps.items()], settings)
        if axis is not None:
            for s in samples:
                s.turns = _turns(s)[axis]
        accidents = [
            k
            for k, at in jumps.items()
            if (k, at) not in of_machine and not witnesses.confirm(k, _around(samples[k], at, settings))
        ]
        for k in accidents:
            if leave_out_shorter_side(samples[k], jumps[k], rest[k], settings):  # the ball sits anew in what is kept
                tests[k] = replace(tests[k], setup=f"{tests[k].name} {AFTER_KNOCK}")
            events[tests[k].name] += 1
        if not accidents:
            break
    is_news = any(len(s.turns) != len(b.turns) for s, b in zip(samples, problem.samples, strict=True))
    if not is_news and not any(events.values()):
        return problem
    events = {name: count + problem.outliers.get(name, 0) for name, count in events.items()}
    return problem.with_samples(samples, tuple(tests), events).with_noise_of_samples()


def readmitted(problem: Problem, readings: Sequence[np.ndarray], nuisance: np.ndarray) -> Problem:
    """The problem with those disturbances counted again that a fitted model follows; the same one where there are none.

    Fits made before have other rows then.

    Args:
        problem: The measured tests without disturbances.
        readings: Simulated readings of the fitted model on the GRID, one per test, m.
        nuisance: Its nuisances.
    """
    samples, events = [s.copy() for s in problem.samples], dict(problem.outliers)
    found = 0
    rest = problem.sample_residuals(readings, nuisance)
    for k, (s, r) in enumerate(zip(samples, rest, strict=True)):
        back = readmit_outliers(s, s.given, r, problem.noise_of(k).rms, problem.settings.outliers)
        events[s.test.name] = max(0, events[s.test.name] - back)
        found += back
    return problem.with_samples(samples, problem.tests, events) if found else problem


class _Witnesses:
    """Whether other tests show what stands out of one: a displacement of a rotary axis at the same place is the
    machine's, and no accident.

    Args:
        problem: The measured tests.
        rest: Residual of each, (n,) m.
    """

    def __init__(self, problem: Problem, rest: Sequence[np.ndarray]) -> None:
        self.problem, self.rest = problem, rest
        self._known: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def _of(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions of all axes in a test, and how far its reading moves with each, (n, axes)."""
        if k not in self._known:
            s, along = self.problem.samples[k], self.problem.sensitivity[k].axes.T
            reach = np.column_stack([s.sample_all(x, 0.0) for x in along])
            self._known[k] = self.problem.motions[k].program.commands(s.time), reach
        return self._known[k]

    def confirm(self, k: int, at: np.ndarray) -> bool:
        """Whether another test is off by the same displacement of a rotary axis.

        Two explanations of the other test are compared, pass by pass. What it shows there has nothing to do with the
        stretch: it is normally distributed with the variance that it has. Or the displacement that the stretch shows is
        in it, at one of some lags, and the rest is normally distributed. Both have even odds, those of the second
        shared out over all passes and lags.

        Args:
            k: Number of the test.
            at: Samples that stand out, (n,) bool.
        """
        chain, motions = self.problem.motions[k].test.chain, self.problem.motions
        axes = [i for i in map(chain.index, chain.rotary) if motions[k].moves[i]]
        others = [j for j in range(len(motions)) if j != k]
        gains = [g for i in axes for j in others if motions[j].moves[i] for g in self._gains(k, at, j, i)]
        return bool(gains) and max(gains) > np.log(len(gains))

    def _gains(self, k: int, at: np.ndarray, j: int, i: int) -> list[float]:
        """Gain in log likelihood of each pass of test ``j`` at each lag, if the displacement of one axis that a stretch
        of test ``k`` shows is in it.
        """
        (places, reaches), (places_j, reaches_j), s = self._of(k), self._of(j), self.problem.samples[j]
        order = np.flatnonzero(at)[np.argsort(places[at, i])]
        reach = reaches[order, i]
        reach = np.where(np.abs(reach) < _NO_REACH, _NO_REACH, reach)
        place, moved, near = places[order, i], self.rest[k][order] / reach, self.problem.settings.outliers.same_place
        passes, count = stretches(s.valid & (places_j[:, i] >= place[0]) & (places_j[:, i] <= place[-1]))
        noise, noise_j = (self.problem.noise_of(n).rms for n in (k, j))
        seconds = float(np.median(np.diff(s.time))) / self.problem.settings.outliers.correlation
        out = []
        for g in range(1, count + 1):
            there = passes == g
            lever, own = reaches_j[there, i], self.rest[j][there]
            for lag in np.linspace(-near, near, _LAGS):
                seen, spread = (np.interp(places_j[there, i] + lag, place, y) for y in (moved, noise / reach))
                least = noise_j**2 + float(np.mean((lever * spread) ** 2))
                left = max(float(np.var(own - lever * seen)), least)
                out.append(0.5 * there.sum() * seconds * float(np.log(max(own.var(), noise_j**2) / left)))
        return out


def _readmit_what_returns(before: Problem, samples: Sequence[Samples], witnesses: _Witnesses) -> dict[str, int]:
    """Count stretches again that were marked as disturbances and that other tests confirm, or that the reversals of
    one axis do.

    Args:
        before: The tests as they were.
        samples: With what was marked; ``valid`` is changed in place.
        witnesses: The other tests.

    Returns:
        Number of stretches taken back, by test.
    """
    marked: dict[tuple[int, int], np.ndarray] = {}
    for k, s in enumerate(samples):
        groups, count = stretches(before.samples[k].valid & ~s.valid)
        stretches_of_test = (np.flatnonzero(groups == g) for g in range(1, count + 1))
        marked |= {(k, int(at[len(at) // 2])): at for at in stretches_of_test}
    _, of_machine = _at_reversals_of_one_axis(samples, [*marked], before.settings.outliers)
    out: dict[str, int] = {}
    for (k, middle), at in marked.items():
        s = samples[k]
        if (k, middle) in of_machine or witnesses.confirm(k, np.isin(np.arange(len(s.valid)), at)):
            s.valid[at] = True
            s.refresh()
            out[s.test.name] = out.get(s.test.name, 0) + 1
    return out


def _at_reversals_of_one_axis(
    samples: Sequence[Samples], events: Sequence[tuple[int, int]], settings: OutlierSettings
) -> tuple[int | None, set[tuple[int, int]]]:
    """Number of the axis at whose reversals several events are, ``None`` where these are accidents; and those that are
    there, and the machine's: an accident does not wait for a reversal.

    Two explanations are compared for each axis. The events near its reversals are accidents, which may happen at any
    instant. Or something on the axis stands elsewhere after a reversal, as likely as any cause that a machine may have.

    Args:
        samples: Of all tests.
        events: Number of the test and of the sample.
        settings: How long a reversal lasts.
    """
    axes = samples[0].test.chain.letters
    odds, own = np.full(len(axes), CAUSE - np.log(len(axes))), [set[tuple[int, int]]() for _ in axes]
    for k, at in events:
        for i, turns in enumerate(_turns(samples[k])):
            near = _near(samples[k], turns, settings.abrupt)
            if near[at]:
                odds[i] -= np.log(near.mean())
                own[i].add((k, at))
    best = int(np.argmax(odds))
    return (best, own[best]) if odds[best] > 0.0 else (None, set())


def _around(s: Samples, at: int, settings: OutlierSettings) -> np.ndarray:
    """Samples on both sides of a jump, (n,) bool."""
    return s.valid & (np.abs(s.time - s.time[at]) < settings.side)


# -- outliers ----------------------------------------------------------------------------------------------------------


def mark_outliers(s: Samples, residual: np.ndarray, noise: float, settings: OutlierSettings = OUTLIERS) -> int:
    """Mark outlying samples of one test as invalid.

    Args:
        s: The samples; ``valid`` is changed in place.
        residual: Per sample, of the model as given, (n,) m.
        noise: RMS, m.
        settings: What decides.

    Returns:
        Number of disturbances found.
    """
    dt = float(np.median(np.diff(s.time)))
    repeats = kind_of(s.test).repeats(s.test)
    rest = np.where(s.valid, residual - _followed(residual, settings.window, dt), 0.0)
    scale = max(noise, 1.4826 * float(np.median(np.abs(rest[s.valid]))))
    high = np.abs(rest) > (settings.height if repeats else settings.height_alone) * scale
    if not repeats:  # something short, where the axes are smooth
        quick = np.where(s.valid, residual - _followed(residual, settings.window_alone, dt), 0.0)
        high |= (np.abs(quick) > settings.height * scale) & ~_near(s, np.concatenate(_turns(s)), settings.abrupt)
    if repeats:
        lag = round(revolution_time(s.test) / dt)
        wide = binary_dilation(np.abs(rest) > 0.4 * settings.height * scale, iterations=max(1, int(0.15 / dt)))
        again = np.zeros(len(high), bool)
        again[lag:] |= wide[:-lag]
        again[:-lag] |= wide[lag:]
        high &= ~again  # what comes back in the other revolution is the machine's
    edge = int(0.25 * settings.window / dt)
    high[:edge] = high[-edge:] = False  # there the running median hangs in the air
    if not high.any():
        return 0
    before, after = (max(1, round(m / dt)) for m in (settings.margin, settings.ringing))
    wide = (
        np.convolve(high, np.ones(before + after + 1))[before : before + len(high)] > 0.5
    )  # from ``before`` ahead to ``after`` behind
    groups, count = stretches(wide)
    long = any(
        (groups == g).sum() * dt > 0.5 * settings.window + settings.margin + settings.ringing
        for g in range(1, count + 1)
    )
    if count > settings.most_events or long:
        return 0
    s.valid &= groups == 0
    s.refresh()
    return count


def readmit_outliers(
    s: Samples, given: np.ndarray, residual: np.ndarray, noise: float, settings: OutlierSettings = OUTLIERS
) -> int:
    """Count stretches again that were left out as disturbances and that a model follows: where nothing repeats, a quick
    local fault of the machine looks like a knock until the model has it.

    Args:
        s: The samples; ``valid`` is changed in place.
        given: ``valid`` before anything was left out, (n,) bool.
        residual: Per sample, of the fitted model, (n,) m.
        noise: RMS, m.
        settings: What decides.

    Returns:
        Number of stretches taken back.
    """
    groups, count = stretches(given & ~s.valid)
    back = [g for g in range(1, count + 1) if np.abs(residual[groups == g]).max() < 0.5 * settings.height * noise]
    s.valid |= np.isin(groups, back)
    s.refresh()
    return len(back)


def stretches(mask: np.ndarray) -> tuple[np.ndarray, int]:
    """Number of the unbroken stretch of ``mask`` that each place is in, from 1 on, (n,), 0 outside; and how many
    stretches there are.
    """
    first = np.diff(mask, prepend=False) & mask
    return np.where(mask, np.cumsum(first), 0), int(first.sum())


def _followed(x: np.ndarray, window: float, dt: float) -> np.ndarray:
    """Running median over ``window`` s, (n,)."""
    width = int(window / dt) | 1
    every = max(1, width // 101)  # the median need not be finer than this
    coarse = median_filter(x[::every], size=max(3, (width // every) | 1))
    return np.interp(np.arange(len(x)), np.arange(0, len(x), every), coarse)


def _near(s: Samples, turns: np.ndarray, abrupt: float) -> np.ndarray:
    """Samples within ``abrupt`` s of turning points, (turns,) s, where the machine itself is abrupt, (n,) bool."""
    near = np.zeros(len(s.time), bool)
    for at in turns:
        near |= np.abs(s.time - at) < abrupt
    return near


def _turns(s: Samples) -> list[np.ndarray]:
    """When each axis is told to turn back, (turns,) s each."""
    commands = Program(s.test).commands(s.time)
    step = np.sign(np.round(np.diff(commands, axis=0, prepend=commands[:1]), 12))
    return [s.time[np.flatnonzero(back)] for back in (step[1:] * step[:-1] < 0.0).T]


# -- jumps -------------------------------------------------------------------------------------------------------------


def largest_jump(s: Samples, residual: np.ndarray, noise: float, settings: OutlierSettings = OUTLIERS) -> int | None:
    """First sample after the largest lasting jump of one test, such as a ball that a knock has put into another seat;
    or ``None``.

    A jump shows in the difference of two revolutions, where what belongs to the machine's cycle is gone. The ball stays
    in its new seat: after a jump in the first revolution both agree, and before one in the second. A test that does not
    repeat must show it far above everything else that it does, and only once.

    Args:
        s: The samples, without outliers.
        residual: Per sample, of the model as given, (n,) m.
        noise: RMS, m.
        settings: What decides.
    """
    if kind_of(s.test).repeats(s.test):
        return _jump_of_revolutions(s, residual, noise, settings)
    side, short = _short_jumps(s, residual, settings)
    at = int(np.argmax(np.abs(short)))
    again = _next(short, at, side)
    usual = _usual(short, (at, again), side)
    is_unusual = abs(short[at]) > max(settings.jump_alone * usual, 2.0 * settings.least_jump)
    if is_unusual and not _is_as_far(abs(short[at]), abs(short[again]), usual / _DEVIATIONS):
        return at
    return _jump_over_gap(residual, s.valid, side, settings)


def _short_jumps(s: Samples, residual: np.ndarray, settings: OutlierSettings) -> tuple[int, np.ndarray]:
    """Samples of a mean where the place of a jump counts, and how far the residual jumps between such means, (n,) m."""
    side = max(3, _side(s, settings) // 4)
    return side, _jumps(residual, s.valid, side)


def _usual(short: np.ndarray, at: Sequence[int], side: int) -> float:
    """90 % quantile of how far a residual jumps elsewhere, m; infinite with too little to compare with.

    Args:
        short: How far it jumps, (n,) m.
        at: Where it jumps: places that share a sample with these do not count.
        side: Samples of a mean.
    """
    apart = np.min([np.abs(np.arange(len(short)) - place) for place in at], axis=0) > 2 * side
    elsewhere = np.abs(short[apart & (short != 0.0)])
    return float(np.quantile(elsewhere, 0.9)) if len(elsewhere) > side else np.inf


def _next(short: np.ndarray, at: int, side: int) -> int:
    """Where a residual jumps most of all other places, up or down.

    Args:
        short: How far it jumps, (n,) m.
        at: Where it jumps most: what shares a sample with this place counts in the other direction alone.
        side: Samples of a mean.
    """
    apart = np.abs(np.arange(len(short)) - at) > 2 * side
    return int(np.argmax(np.where(apart, np.abs(short), -np.sign(short[at]) * short)))


def _is_as_far(height: float, again: float, deviation: float) -> bool:
    """Whether a residual jumps a second time by as much: a machine does the same at both ends of a dent and at each
    reversal, and no two knocks move a ball alike.

    Two explanations of the second jump are compared, with even odds. It has the height of the first one, but for what
    the residual does elsewhere. Or it is of any height up to that.

    Args:
        height: Of the largest jump, m.
        again: Of the next one, m.
        deviation: Standard deviation of how far the residual jumps elsewhere, m.
    """
    of_both = np.sqrt(2.0) * deviation
    density = np.exp(-0.5 * ((height - again) / of_both) ** 2) / (np.sqrt(2.0 * np.pi) * of_both)
    return bool(density * height > 1.0)


def _side(s: Samples, settings: OutlierSettings) -> int:
    """Samples of the mean on either side of a jump."""
    return max(3, round(settings.side / float(np.median(np.diff(s.time)))))


def _jump_of_revolutions(s: Samples, residual: np.ndarray, noise: float, settings: OutlierSettings) -> int | None:
    """The jump in how far two revolutions lie apart, or the one that parts them as a whole; or ``None``."""
    n, lag = _side(s, settings), round(revolution_time(s.test) / float(np.median(np.diff(s.time))))
    # what is left out counts as no time: the ball may have moved while the signal was lost
    at = np.flatnonzero(s.valid[lag:] & s.valid[:-lag])
    apart, there = residual[at + lag] - residual[at], np.ones(len(at), bool)
    if len(at) <= 2 * n:
        return None
    before, after = _means(apart, there, n)
    most = int(np.argmax(np.abs(after - before)))
    # of the difference of two means, of two revolutions
    deviation = noise * np.sqrt(2.0 * 2.0 * settings.correlation / settings.side)
    least = max(settings.jump * deviation, settings.least_jump)
    if abs(after[most] - before[most]) < least:
        height = float(np.median(apart))
        if abs(height) < least:
            return None
        return _jump_between(s, residual, height, (at[-1] - n, at[0] + lag + n), settings)
    near = slice(max(0, most - n), most + n)
    here = int(at[near.start + int(np.argmax(np.abs(_jumps(apart[near], there[near], max(3, n // 10)))))])
    return here if abs(before[most]) > abs(after[most]) else here + lag


def _jump_over_gap(x: np.ndarray, valid: np.ndarray, n: int, settings: OutlierSettings) -> int | None:
    """First sample behind a gap over which a reading jumps far above what it does elsewhere in the same time, or
    ``None``: what has moved the ball often takes the signal as well.

    Args:
        x: The residual, (n,) m.
        valid: Which samples count.
        n: Samples of a mean on either side.
        settings: What decides.
    """
    number, total = (np.concatenate([[0.0], np.cumsum(v)]) for v in (valid, np.where(valid, x, 0.0)))
    count = number[n:] - number[:-n]
    means = np.where(count > 0.6 * n, (total[n:] - total[:-n]) / np.maximum(count, 1.0), np.nan)
    gaps, last = stretches(~valid)
    for g in range(1, last + 1):
        first, length = int(np.argmax(gaps == g)), int((gaps == g).sum())
        change = np.abs(means[n + length :] - means[: -n - length])
        place, here = np.arange(len(change)), first - n
        usual = change[(place > first + length) | (place + 2 * n + length < first)]
        usual = usual[np.isfinite(usual)]
        if not 0 <= here < len(change) or len(usual) < n:
            continue  # too little on one side, or to compare with
        if change[here] > max(settings.jump_alone * float(np.quantile(usual, 0.9)), 2.0 * settings.least_jump):
            return first + length
    return None


def _jump_between(
    s: Samples, residual: np.ndarray, height: float, between: tuple[int, int], settings: OutlierSettings
) -> int | None:
    """Where the ball has moved in front of or behind the stretches in which both revolutions have a mean: at the seam
    of the revolutions, or at an angle at which one of them has lost the signal. Only how far the revolutions lie apart
    tells of a jump there. ``None`` where the reading does not jump by as much.

    Args:
        s: The samples.
        residual: Per sample, (n,) m.
        height: How far the revolutions lie apart, m.
        between: The samples around.
        settings: What decides.
    """
    side, short = _short_jumps(s, residual, settings)
    rise, place = short * np.sign(height), np.arange(len(short))
    here = int(np.argmax(np.where(s.valid & (place > between[0]) & (place < between[1]), rise, -np.inf)))
    as_far = _AS_FAR[0] * abs(height) < rise[here] < _AS_FAR[1] * abs(height)
    return here if as_far and rise[here] > settings.jump_alone * _usual(short, [here], side) else None


def leave_out_shorter_side(s: Samples, here: int, residual: np.ndarray, settings: OutlierSettings = OUTLIERS) -> bool:
    """Leave out the shorter side of a jump before sample ``here``.

    Returns:
        Whether the later side is kept: there the ball sits anew, and the jump's height is taken off the reading and the
        residual.
    """
    dt = float(np.median(np.diff(s.time)))
    later = np.arange(len(s.time)) >= here
    before, after = int((s.valid & ~later).sum()), int((s.valid & later).sum())
    kept_later = after >= before
    if kept_later:
        height = float(_jumps(residual, s.valid, max(3, round(0.5 * settings.side / dt)))[min(here, len(residual) - 1)])
        s.value = np.where(later, s.value - height, s.value)
        residual[later] -= height
        s.mean = s.average(s.value - s.left_out)
    s.valid &= (later if kept_later else ~later) & (np.abs(np.arange(len(s.time)) - here) > settings.margin / dt)
    s.refresh()
    return kept_later


def _jumps(x: np.ndarray, valid: np.ndarray, n: int) -> np.ndarray:
    """Mean of the ``n`` values from each place on less that of the ``n`` before it, (len(x),); 0 where too few are
    valid.
    """
    before, after = _means(x, valid, n)
    return after - before


def _means(x: np.ndarray, valid: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the ``n`` values before each place, and of those from there on, (len(x),) each; 0 where too few are
    valid.
    """
    total = np.concatenate([[0.0], np.cumsum(np.where(valid, x, 0.0))])
    number = np.concatenate([[0], np.cumsum(valid)])
    before, after = np.zeros(len(x)), np.zeros(len(x))
    k = np.arange(n, len(x) - n)
    counts = number[k] - number[k - n], number[k + n] - number[k]
    enough = np.minimum(*counts) > 0.6 * n
    k = k[enough]
    before[k] = (total[k] - total[k - n]) / counts[0][enough]
    after[k] = (total[k + n] - total[k]) / counts[1][enough]
    return before, after
