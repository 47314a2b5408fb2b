"""What a trace's clock says about the program: another feed, another number of turns, another unit of time, another
origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program

#: Durations that differ by less than this share, and starts by less than this many s (triggers, margins), are the same.
_SAME, _START = 0.02, 0.3
#: Feeds are usually multiples of this, mm/min; a feed found from a duration that comes so close to one is that one.
_ROUND, _NEAR = 10.0, 0.004
#: By so much, s, a start has to fit another feed better than the given one before a short trace is not simply cut.
_CERTAIN = 0.15
_CLOCKS = {"ms": 1e-3, "minutes": 60.0, "µs": 1e-6}
#: Feeds and turns that are looked for, as multiples of the ones given.
_MOST = 60.0


@dataclass(frozen=True)
class ClockMistake:
    """What would make a trace's times right.

    Attributes:
        kind: feed, revolutions, time_unit, origin, or unclear (a feed, or a trace that was cut). value: the feed (m/s),
            the turns, the factor of the times, or what has to be added to them (s). sentence: the same for the user.
    """

    kind: str
    value: float
    sentence: str

    @property
    def usual(self) -> bool:
        """Whether this is what people do: of feeds, a round one."""
        return self.kind in ("time_unit", "origin") or (
            self.kind == "feed" and abs(math.remainder(self.value * 60e3, _ROUND)) < 1e-6
        )


def explain(test: BallBarTest, first: float, last: float) -> ClockMistake | None:
    """Why a trace that runs from ``first`` to ``last`` s does not fit its test's program; ``None`` where nothing
    ordinary explains it.
    """
    begin, end = Program(test).measured_span
    have, want = last - first, end - begin
    if have <= 0:
        return None
    for unit, factor in _CLOCKS.items():
        if abs(have * factor / want - 1.0) < _SAME:
            return ClockMistake("time_unit", factor, f"time_s is in {unit}, multiply it by {factor:g}")
    if abs(have / want - 1.0) < _SAME:
        shift = begin - first
        if abs(shift) < _START:
            return None
        return ClockMistake(
            "origin",
            shift,
            f"time_s counts from another instant than the start of the NC program, add {shift:.2f} s to all times",
        )
    if test.commanded is not None:
        return None
    turns = round(test.revolutions * have / want)
    if kind_of(test).goes_round and turns >= 1 and turns != test.revolutions:
        b, e = Program(replace(test, revolutions=turns)).measured_span
        if abs(have / (e - b) - 1.0) < _SAME / 4 and abs(first - b) < abs(first - _lead(test, _feed(test, have))):
            return ClockMistake(
                "revolutions", turns, f"it has {turns} revolution{'s' if turns > 1 else ''}, set revolutions = {turns}"
            )
    feed = _feed(test, have)
    if not test.feed / _MOST < feed < test.feed * _MOST or abs(first - _lead(test, feed)) > _START:
        return None
    mm_min = feed * 60e3
    nice = _ROUND * round(mm_min / _ROUND)
    if nice and abs(mm_min / nice - 1.0) < _NEAR:
        feed, mm_min = nice / 60e3, nice
    inch = " (the feed is given in inch/min)" if abs(feed / test.feed / 25.4 - 1.0) < _SAME else ""
    told = f"was run with another feed, set feed_mm_min = {mm_min:.6g}{inch}"
    if have < want and abs(first - begin) < abs(first - _lead(test, feed)) + _CERTAIN:
        return ClockMistake("unclear", feed, f"it stops {end - last:.2f} s early, or {told}")
    return ClockMistake("feed", feed, f"it {told}")


def _span(test: BallBarTest, feed: float) -> tuple[float, float]:
    return Program(replace(test, feed=feed)).measured_span


def _lead(test: BallBarTest, feed: float) -> float:
    return _span(test, feed)[0]


def _feed(test: BallBarTest, duration: float) -> float:
    """The feed (m/s) at which the measured part takes ``duration`` s."""
    low, high = test.feed / _MOST, test.feed * _MOST
    for _ in range(60):
        middle = math.sqrt(low * high)
        begin, end = _span(test, middle)
        if end - begin > duration:
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)
