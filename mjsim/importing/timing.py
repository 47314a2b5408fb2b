"""When each sample of a recording was taken, on the clock of the test's program: from its times, or from its angles
through the feed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.even import evenly, quantum
from mjsim.importing.reading import Options, Recording
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.units import DEG

#: A trace may reach so far beyond the measured part without being cut: the trigger is not exact. In s, and as an angle.
EDGE = 0.05
EDGE_ANGLE = 0.5 * DEG
#: Angles that fall back by no more than this come from the encoder's noise, rad.
_JITTER = 0.5 * DEG
_TURN = 2 * np.pi


def place(path: Path, recording: Recording, test: BallBarTest, o: Options) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Program times (n,) s, deviations (n,) m, and what was concluded.

    Raises:
        InputError: the recording does not fit the program, or could fit it in two ways; the message names the option
            that decides.
    """
    notes: list[str] = []
    program = Program(test)
    if recording.angle is None and (o.start_angle is None or not kind_of(test).goes_round):
        _grows(path, recording)
        assert recording.time is not None
        time = _clock(path, recording.time, program, o, notes)
        time, deviation = _cut(time, recording.deviation, program.measured_span, EDGE, notes)
        step = quantum(recording.time)
    else:
        if recording.angle is not None:
            phi, deviation = _angles(path, recording, test, o, notes)
        else:
            phi, deviation = _from_start_angle(path, recording, program, o)
        phi, deviation = _into_range(phi, deviation, program, notes)
        time = times_of(program, phi)
        step = (
            quantum(recording.angle / DEG) * DEG * kind_of(test).radius(test) / test.feed
            if recording.angle is not None
            else 0.0
        )
    return *evenly(time, deviation, step, notes), notes


def _from_start_angle(path: Path, r: Recording, program: Program, o: Options) -> tuple[np.ndarray, np.ndarray]:
    """φ (n,) rad of a recording that began at another angle, at the constant feed."""
    _grows(path, r)
    assert r.time is not None and o.start_angle is not None
    sign = np.sign(program.ends[1] - program.ends[0])
    return o.start_angle + sign * (r.time - r.time[0]) * program.test.feed / program.kind.radius(
        program.test
    ), r.deviation


def times_of(program: Program, phi: np.ndarray) -> np.ndarray:
    """Program times (n,) s at which the program reaches φ (n,) rad: its angle over time, ramps included, inverted
    by bisection.
    """
    sign = np.sign(program.ends[1] - program.ends[0])
    low, high = np.zeros(len(phi)), np.full(len(phi), program.duration)
    for _ in range(52):
        middle = 0.5 * (low + high)
        early = sign * (program.phi(middle) - phi) < 0
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    return 0.5 * (low + high)


def _grows(path: Path, r: Recording) -> None:
    assert r.time is not None
    back = np.flatnonzero(np.diff(r.time) <= 0)
    if len(back):
        i = int(back[0])
        raise InputError(
            f"{path}, line {r.lines[i + 1]}: time {r.time[i + 1]:g} s after {r.time[i]:g} s; allowed: times that "
            f"grow from line to line "
            "(--rows FIRST LAST takes one run of several)"
        )


def _clock(path: Path, time: np.ndarray, program: Program, o: Options, notes: list[str]) -> np.ndarray:
    """The times on the program's clock."""
    lo, hi = program.measured_span
    want, have = hi - lo, float(time[-1] - time[0])
    if o.start_angle is not None:
        return time - time[0] + times_of(program, np.array([o.start_angle]))[0]
    clock = o.clock
    if clock is None:
        if time[0] >= lo - EDGE and time[-1] <= hi + EDGE:
            clock = "program"
        elif abs(have - want) <= 0.02 * want + 0.1:
            clock = "trace"
            where = "φ = 0" if program.kind.goes_round else f"{program.measured_ends[0] / DEG:g}°"
            notes.append(
                f"first sample taken for {where}: the trace lasts as long as the measured part (--clock program)"
            )
        elif have > want and -0.5 <= time[0] <= lo and time[-1] <= program.duration + 0.5:
            clock = "program"
            notes.append("times taken as counting from the start of the NC program: they cover it (--clock)")
        else:
            raise InputError(
                f'{path}: the times run from {time[0]:.2f} to {time[-1]:.2f} s; test "{program.test.name}" is '
                f"measured for {want:.2f} s, "
                f"from {lo:.2f} to {hi:.2f} s of its program; check feed, length, revolutions or angles, or say "
                f"--clock or --start-angle"
            )
    return time if clock == "program" else time - time[0] + lo


def _cut(time: np.ndarray, deviation: np.ndarray, span: tuple[float, float], edge: float, notes: list[str]):
    """The samples inside the measured part, where others reach far beyond it."""
    keep = (time >= span[0] - edge) & (time <= span[1] + edge)
    if not keep.all():
        keep = (time >= span[0]) & (time <= span[1])
        notes.append(f"{int((~keep).sum())} samples are left out: they lie before or after the measured part")
    return time[keep], deviation[keep]


def _angles(path: Path, r: Recording, test: BallBarTest, o: Options, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Signed φ (n,) rad in the order of the motion, and the deviations in that order."""
    assert r.angle is not None
    a = np.unwrap(r.angle - o.angle_zero)
    first, last = Program(test).ends
    motion = np.sign(last - first)
    grows = np.sign((a - a[0])[np.argmax(np.abs(a - a[0]))])
    _one_way(path, r, grows * a)
    if o.angle_sense is None and grows != motion:
        raise InputError(
            f'{path}: the angle {"grows" if grows > 0 else "falls"} while test "{test.name}" runs '
            f"{test.direction}; say --angle-sense cw "
            "if the file's angle counts clockwise, or --angle-sense ccw if its samples are listed by place, "
            "against the motion"
        )
    phi = -a if o.angle_sense == "cw" else a
    deviation = r.deviation
    if (phi[-1] - phi[0]) * motion < 0:
        phi, deviation = phi[::-1], deviation[::-1]
        notes.append("the samples are listed against the motion: turned round")
    return phi, deviation


def _one_way(path: Path, r: Recording, ahead: np.ndarray) -> None:
    """Refuse angles that turn back: two runs in one file."""
    fall = np.maximum.accumulate(ahead) - ahead
    if fall.max() > _JITTER:
        top = int(np.argmax(ahead[: int(np.argmax(fall > _JITTER)) + 1]))
        raise InputError(
            f"{path}, line {r.lines[min(top + 1, len(r.lines) - 1)]}: the angle turns back; allowed: one run in "
            f"one direction "
            "(--rows FIRST LAST takes one run of several)"
        )


def _into_range(
    phi: np.ndarray, deviation: np.ndarray, program: Program, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """φ by whole turns into the measured part. What a circle that began elsewhere has beyond its end goes to its
    beginning.
    """
    begin, end = program.measured_ends
    sign, whole = np.sign(end - begin), abs(end - begin)
    ahead = sign * (phi - begin)
    if not program.kind.goes_round:
        ahead = ahead - _TURN * np.round(ahead[0] / _TURN)
    else:
        ahead = ahead - _TURN * np.floor((ahead[0] + program.kind.margin) / _TURN)
        if ahead[0] > program.kind.margin and ahead[-1] > whole + EDGE_ANGLE:
            over = (ahead > whole) & (ahead - whole < ahead[0])
            stay = ahead <= whole
            notes.append(
                f"begins at φ = {sign * ahead[0] / DEG:.1f}°: its last {int(over.sum())} samples go to the beginning, "
                "as a circle at constant feed repeats"
            )
            dropped = len(ahead) - int(over.sum()) - int(stay.sum())
            ahead, deviation = np.append(ahead[over] - whole, ahead[stay]), np.append(deviation[over], deviation[stay])
            if dropped:
                notes.append(f"{dropped} samples are left out: they lie beyond the test's revolutions")
    ahead, deviation = _cut(ahead, deviation, (0.0, whole), EDGE_ANGLE, notes)
    return begin + sign * ahead, deviation
