"""The commanded motion that drives a ball-bar test in place of its own: an NC file, or what a control told its axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.axis_log.files import read_recording
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.files import BallBarTable
from mjsim.instruments.ball_bar.follow import RANGE, counted_otherwise
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import driven_by
from mjsim.io.inputs import named_file
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import reading
from mjsim.nc.limits import check_travel, model_limits
from mjsim.nc.read import read_nc

#: Samples at rest that stay at both ends, and a rest that separates the path from what comes before and after it, s.
_REST, _STOP = 2, 0.1


def driven(file: Path, test: BallBarTest, t: BallBarTable) -> BallBarTest:
    """The test with the motion of its NC file or of a record, where it has one.

    Args:
        file: The campaign's file.
        test: As its table describes it.
        t: The table.

    Raises:
        InputError: Keys do not go together, or the program does not fit the test.
    """
    place = f'{file}: [[test]] "{t.name}"'
    check_keys(place, t)
    if t.program is not None:
        return with_program(named_file(file, t.program, f"{place} program"), test, t)
    if t.driven_by is not None:
        return with_record(named_file(file, t.driven_by, f"{place} driven_by"), test)
    return test


def check_keys(place: str, t: BallBarTable) -> None:
    """Refuse keys of a commanded motion that do not go together.

    Raises:
        InputError: names the place and the keys.
    """
    for key in ("program_dialect", "program_reversed", "program_rollover"):
        if t.program is None and getattr(t, key) is not None:
            raise InputError(f"{place}: the key {key!r} needs program, the NC file that it describes")
    if t.program is not None and t.driven_by is not None:
        raise InputError(f"{place}: has program and driven_by; allowed: one of them")


def with_program(path: Path, test: BallBarTest, t: BallBarTable) -> BallBarTest:
    """The test with the motion that its NC file commands.

    Args:
        path: The NC file.
        test: As the campaign has it.
        t: Its table.
    """
    nc = read_nc(path, t.program_dialect, tuple(t.program_reversed or ()), t.program_rollover, chain=test.chain)
    check_travel(nc.motion, model_limits(test.chain), nc.place)
    return driven_by(test, nc.motion, str(path))


def with_record(path: Path, test: BallBarTest) -> BallBarTest:
    """The test with the motion that a control told its axes.

    Args:
        path: An axis log with the command of every axis; what it records before and after the path is left out.
        test: As the campaign has it.
    """
    return driven_by(test, on_path(read_record(path, test.chain), test, path), str(path))


def read_record(path: Path, chain: Chain) -> Commanded:
    """The commands of an axis log as a motion on the control's own clock.

    Args:
        path: The log, with all axes of the machine.
        chain: Axes of the machine.

    Raises:
        InputError: It cannot be read, or lacks an axis.
    """
    recording = read_recording(path, LogTest(path.stem, chain.letters, chain=chain))
    q = np.column_stack([recording.axes[a].command for a in chain.letters])
    return Commanded(np.diff(recording.time), q, chain=chain, clocked=True)


def on_path(motion: Commanded, test: BallBarTest, path: Path) -> Commanded:
    """The part of a recorded motion in which the balls keep their distance, from rest to rest.

    Raises:
        InputError: They never do.
    """
    off = reading(test.chain, motion.points, np.asarray(test.table_ball), test.length)
    near = np.abs(off) <= RANGE
    moves = np.abs(np.diff(motion.points, axis=0)).max(axis=1, initial=0.0) > 1e-12
    on = np.flatnonzero(moves & near[1:] & near[:-1])
    if not len(on):
        otherwise = counted_otherwise(test, motion.points[1:][moves])
        raise InputError(
            f'{path}: is no record of test "{test.name}": nothing moves while the balls are {test.length * 1e3:g} mm '
            f"apart; allowed: a record of this test, with the zero point of its program"
            + (f" (with {otherwise})" if otherwise else "")
        )
    stops = np.flatnonzero(np.diff(motion.knots[on]) > _STOP) + 1
    part = max(np.split(on, stops), key=len)
    first, last = int(part[0]), int(part[-1]) + 1
    first -= int((~moves[max(0, first - _REST) : first]).sum())
    last += int((~moves[last : last + _REST]).sum())
    return Commanded(motion.seconds[first:last], motion.points[first : last + 1], chain=test.chain, clocked=True)
