"""Whether a trace's size is one that a ball bar can have seen: a wrong unit is the most common mistake of an import.

Nothing is corrected here: what looks wrong becomes a question that names the option which would mend it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjsim.errors import InputError, SimulationError
from mjsim.importing.units import LENGTH
from mjsim.instruments.ball_bar.measurement import BallBarTest, Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.model import Machine
from mjsim.simulation.multibody import simulate
from mjsim.units import UM

#: RMS, about the mean, that a ball bar's trace can have, m: below is less than noise, above more than its range.
SMALLEST, LARGEST = 0.2 * UM, 1000.0 * UM
#: What a machine in use shows, m: only units that lead here are proposed.
_USUAL = (0.5 * UM, 100.0 * UM)
#: A machine may err so many times more, or less, than its model before a unit is in question; a unit has to explain all
#: but this much.
_STRANGE, _EXPLAINED = 10.0, 4.0
#: A trace may last so much longer or shorter than its test, as a ratio, without a question; a trigger is exact to some
#: ms.
_LASTS = 0.01
#: What even a perfect model leaves, m: noise and small errors (assumed).
_UNMODELLED = 0.5 * UM


def spread(test: BallBarTest, time: np.ndarray, deviation: np.ndarray) -> float:
    """RMS of a trace (m) without what the set-up alone makes of it: its mean and its eccentricity."""
    phi = Program(test).phi(time)
    basis = np.column_stack([np.ones_like(phi), np.cos(phi), np.sin(phi)])
    rest = deviation - basis @ np.linalg.lstsq(basis, deviation, rcond=None)[0]
    return float(np.sqrt(np.mean(rest**2)))


def expected(machine: Machine, test: BallBarTest) -> float | None:
    """The same of the model's reading, m; ``None`` where the model cannot be simulated."""
    try:
        (s,) = simulate(machine, [test], 1)
    except (InputError, SimulationError):
        return None
    lo, hi = Program(test).measured_span
    keep = (s.time >= lo) & (s.time <= hi)
    return spread(test, s.time[keep], s.deviation[keep])


def duration_question(test: BallBarTest, trace: Trace, tests: Sequence[BallBarTest] = ()) -> str:
    """What has to be asked where a trace does not last as long as its test; empty where it does.

    Args:
        test: the trace's test.
        trace: as it is kept.
        tests: of the campaign; those that last as long as the trace are named.
    """
    lasts = float(trace.time[-1] - trace.time[0])
    begin, end = Program(test).measured_span
    if abs(lasts - (end - begin)) <= _LASTS * (end - begin) + 0.1:
        return ""
    spans = {t.name: float(np.diff(Program(t).measured_span)[0]) for t in tests if t.name != test.name}
    others = [name for name, span in spans.items() if abs(lasts - span) <= 0.5 * _LASTS * span]
    other = f" The test {' or '.join(others[:3])} lasts as long." if others else ""
    return (
        f"the trace lasts {lasts:.2f} s, the test {end - begin:.2f} s ({100 * (lasts / (end - begin) - 1):+.1f} "
        f"%).{other} "
        "Is it the trace of this test, and is the feed right?"
    )


def questions(
    test: BallBarTest, trace: Trace, unit: str, machine: Machine | None = None, tests: Sequence[BallBarTest] = ()
) -> list[str]:
    """What has to be asked about a trace; empty where nothing is strange.

    Args:
        test: the trace's test. trace: as it would be kept. unit: the one that it was read in, a key of
            :data:`mjsim.importing.units.LENGTH`. machine: its model, for what is to be expected; ``None`` leaves that
            out. tests: of the campaign.
    """
    duration = duration_question(test, trace, tests)
    return [*([duration] if duration else []), *_size_questions(test, trace, unit, machine)]


def _size_questions(test: BallBarTest, trace: Trace, unit: str, machine: Machine | None) -> list[str]:
    time, deviation = trace.time[trace.valid], trace.deviation[trace.valid]
    size = float(np.std(deviation))
    if not SMALLEST <= size <= LARGEST:
        what = "less than a ball bar can tell" if size < SMALLEST else "more than a ball bar can show"
        return [f"the trace's RMS is {_um(size)}, {what}{_proposal(unit, size, _USUAL)}"]
    model = expected(machine, test) if machine is not None else None
    if model is None:
        return []
    size, model = spread(test, time, deviation), float(np.hypot(model, _UNMODELLED))
    if model / _STRANGE <= size <= model * _STRANGE:
        return []
    proposal = _proposal(unit, size, (model / _EXPLAINED, model * _EXPLAINED))
    if not proposal:
        return []  # the machine may be far from its model; that is what a diagnosis is for
    return [
        f"the trace's RMS without eccentricity is {_um(size)}, {size / model:.3g} times what the model gives "
        f"({_um(model)}){proposal}"
    ]


def _proposal(unit: str, size: float, usual: tuple[float, float]) -> str:
    """The unit that would bring ``size`` into what is usual, as the end of the question."""
    if unit == "V":
        return ": is --scale right?"
    ratios = {u: f / LENGTH[unit][0] for u, (f, _) in LENGTH.items() if u not in (unit, "V")}
    fits = [u for u, ratio in ratios.items() if usual[0] <= size * ratio <= usual[1]]
    if not fits:
        return ""
    middle = np.sqrt(usual[0] * usual[1])
    best = min(fits, key=lambda u: abs(np.log(size * ratios[u] / middle)))
    others = "".join(f" or {u}" for u in fits if u != best)
    return f": is the deviation in {best}{others}, not {unit}? then import again with --deviation-unit {best} --force"


def _um(x: float) -> str:
    return f"{x / UM:.3g} µm"
