"""What each recorded channel is like: held values, steps, a limit, copies of each other, units that cannot be; and the
clock of a recording.

Nothing here knows the machine. Each function looks at one thing in a recording and says it with its numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from mjsim.instruments.axis_log.measurement import LogTest, Recorder, Recording
from mjsim.units import AMPERE, DEG, MM

#: Most samples for which a channel is held that is looked for, and the share of intervals that are a multiple of it.
_LONGEST_HOLD, _REGULAR = 50, 0.9
#: Channels that are measured: between two readings they go on. A command or a torque may really stand still.
_MEASURED = ("actual", "load", "velocity")
#: Samples in which a channel has to move by at least three of its steps, for its hold to be told.
_ENOUGH = 20
#: A channel that stands at its extreme for so many samples in a row is at a limit (assumed).
_FLAT, _AT_MOST = 10, 1e-4
#: Channels are copies where one is the other, times a number, within this share of its own spread: rounding.
_SAME = 1e-6
#: Largest values of drives of machine tools (assumed): N·m, N, V, A, shares.
_LARGEST = {"torque": 1e4, "force": 1e6, "control": 1e3, "current": 1e3}
_LARGEST |= dict.fromkeys(("torque_share", "current_share", "control_share"), 10.0)
#: Channels whose values the diagnosis never uses, and why.
NOT_USED = {
    "velocity": "the position says the same",
}
_UNITS = {"torque": "N·m", "force": "N", "control": "V", "current": AMPERE}


@dataclass(frozen=True)
class LogMistake:
    """One mistake in a log.

    Attributes:
        kind: ``exchanged``, ``swapped_axes``, ``unit``, ``time``, ``copy`` or ``impossible``.
        test: Name of the log.
        axes: Letters that it concerns.
        sentence: What is wrong, from what it follows, and what to do.
    """

    kind: str
    test: str
    axes: tuple[str, ...]
    sentence: str

    @property
    def tests(self) -> tuple[str, ...]:
        """Name of the log, as of other instruments' mistakes."""
        return (self.test,)

    def to_json(self) -> dict:
        """Plain data."""
        return {"kind": self.kind, "tests": [self.test], "axes": list(self.axes), "sentence": self.sentence}


@dataclass(frozen=True)
class Finding(LogMistake):
    """Something that a recording shows of itself: ``held``, ``step``, ``clock``, ``limit``, ``copy``, ``impossible``,
    ``used`` or ``not used``.

    Attributes:
        refused: Whether a comparison with a model would be wrong.
    """

    refused: bool = False

    def to_json(self) -> dict:
        """Plain data."""
        return super().to_json() | {"refused": self.refused}


def findings(tests: Sequence[LogTest], recordings: Mapping[str, Recording], recorder: Recorder) -> list[Finding]:
    """All that the recordings of some logs show of themselves."""
    out = []
    for test in tests:
        recording = recordings[test.name]
        out += clock(test, recording)
        out += held(test, recording)
        out += steps(test, recording, recorder)
        out += limits(test, recording)
        out += copies(test, recording)
        out += impossible(test, recording)
        out += not_used(test, recording)
    return out


def hold(values: np.ndarray) -> int:
    """For how many samples a channel (n,) keeps a value before it takes the next one; 1 where it does not.

    Where a channel goes on by many of its own steps from sample to sample, it changes at each of them. One that changes
    at every n-th only, and jumps there by n times as much, is read anew at every n-th sample.
    """
    change = np.flatnonzero(np.diff(values) != 0.0)
    if len(change) < _ENOUGH:
        return 1
    fine = step_of(values)
    gaps = np.diff(change)
    jumps = np.abs(np.diff(values)[change[1:]])
    moving = (jumps > 3.0 * fine * gaps) & (gaps <= _LONGEST_HOLD)
    if moving.sum() < _ENOUGH:
        return 1
    usual = int(np.median(gaps[moving]))
    return usual if usual > 1 and np.mean(gaps[moving] % usual == 0) >= _REGULAR else 1


def released(time: np.ndarray, values: np.ndarray, samples: int) -> np.ndarray:
    """A held channel (n,) with straight lines between the instants at which it was read.

    Args:
        time: (n,) s.
        values: (n,).
        samples: For which each value is held.
    """
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if not len(changes):
        return values
    phase = int(np.bincount(changes % samples, minlength=samples).argmax())
    read = np.unique(np.concatenate([np.arange(phase, len(values), samples), changes]))
    return np.interp(time, time[read], values[read])


def without_holds(recording: Recording) -> Recording:
    """The recording with its held channels released; ``held`` says which they were."""
    axes, found = {}, {}
    for axis, record in recording.axes.items():
        more = {}
        for name, values in record.channels.items():
            n = hold(values)
            if n > 1:
                found[axis, name] = n
            if n > 1 and name in _MEASURED:
                more[name] = released(recording.time, values, n)
        axes[axis] = replace(record, **more) if more else record
    return replace(recording, axes=axes, held=found) if found else recording


def step_of(values: np.ndarray) -> float:
    """The step of a channel (n,) whose values all lie on a grid; 0 where they do not.

    A steady motion makes a grid of its own, by the same way from sample to sample. Rounding makes that way change.
    """
    there = np.unique(values)
    apart = np.diff(there)
    apart = apart[apart > 1e-9 * max(float(np.abs(there).max()), 1e-12)]
    if len(apart) < _ENOUGH:
        return 0.0
    step = float(np.quantile(apart, 0.05))
    place = np.cumsum(np.round(apart / step))
    grid, first = np.polyfit(place, there[0] + np.cumsum(apart), 1)
    off = np.abs(there[0] + np.cumsum(apart) - first - grid * place)
    moved = np.round(np.diff(values) / grid)
    moving = (moved[1:] != 0.0) | (moved[:-1] != 0.0)
    varied = np.mean(moved[1:][moving] != moved[:-1][moving]) > 0.1
    return float(grid) if varied and np.mean(off < 0.1 * grid) > 0.99 else 0.0


def held(test: LogTest, recording: Recording) -> list[Finding]:
    """Channels that are read anew at every n-th sample only."""
    return [
        _finding(
            "held",
            test.name,
            axis,
            f"the {_words(name)} of {axis} is held: it takes a new value at every {_ordinal(n)} sample only, each "
            f"{1e3 * n * recording.step:.4g} ms; "
            + ("straight lines join them" if name in _MEASURED else "it is taken as it is"),
        )
        for (axis, name), n in recording.held.items()
    ]


def steps(test: LogTest, recording: Recording, recorder: Recorder) -> list[Finding]:
    """Encoder steps that are larger than campaign.toml states."""
    out = []
    for axis in test.axes:
        stated, found = recorder.stated_step_of(test.chain, axis), encoder_step(recording, axis)
        if found > 1.5 * stated:
            size, unit, key = _shown(test, axis)
            said = f"the encoder of {axis} has steps of {found / size:.4g} {unit} in the file, "
            said += f"{key} = {stated / size:.4g} in campaign.toml; the larger one is taken"
            out.append(_finding("step", test.name, axis, said))
    return out


def encoder_step(recording: Recording, axis: str) -> float:
    """The smallest step of the actual position of one axis, m or rad; 0 where it was held or has no step."""
    return 0.0 if (axis, "actual") in recording.held else step_of(recording.axes[axis].actual)


def clock(test: LogTest, recording: Recording) -> list[Finding]:
    """Times that are not even: samples that are missing, and jitter."""
    apart = np.diff(recording.time)
    usual = recording.step
    lost = apart > 1.5 * usual
    jitter = float(np.abs(apart[~lost] - usual).max()) if (~lost).any() else 0.0
    said = []
    if lost.any():
        missing = int(np.sum(np.round(apart[lost] / usual) - 1))
        said.append(f"{missing} samples are missing in {int(lost.sum())} places, {1e3 * apart.max():.4g} ms at most")
    if jitter > 0.01 * usual:
        said.append(
            f"the time from sample to sample is off its usual {1e3 * usual:.4g} ms by up to {1e3 * jitter:.3g} ms"
        )
    return (
        [Finding("clock", test.name, test.axes, f"{test.name}: {', and '.join(said)}; the times of the file are taken")]
        if said
        else []
    )


def limits(test: LogTest, recording: Recording) -> list[Finding]:
    """Channels of a drive that stand at their largest size while the following error goes on changing."""
    out = []
    for axis in test.axes:
        record = recording.axes[axis]
        error = record.command - record.actual
        for name, unit in _UNITS.items():
            values = record.channels.get(name)
            if values is None or not limit_of(values, error, encoder_step(recording, axis)):
                continue
            most = float(np.abs(values).max())
            at = np.abs(values) > most * (1.0 - _AT_MOST)
            longest = _longest(at)[1]
            said = f"the {_words(name)} of {axis} stands at {most:.4g} {unit} in {int(at.sum())} samples, "
            said += f"{longest * recording.step:.3g} s on end, while the following error changes: a limit of the drive,"
            out.append(_finding("limit", test.name, axis, f"{said} which the machine file states as clip_Nm or clip_V"))
    return out


def limit_of(values: np.ndarray, error: np.ndarray, step: float) -> float:
    """The size at which a channel (n,) stands while the following error (n,) goes on changing; 0 where it does not.

    Args:
        values: Of the channel.
        error: Command less actual position, axis units.
        step: Of the encoder, axis units.
    """
    most = float(np.abs(values).max())
    first, longest = _longest(np.abs(values) > most * (1.0 - _AT_MOST))
    changing = longest >= _FLAT and np.ptp(error[first : first + longest]) >= 3.0 * max(step, 1e-9)
    return most if changing and np.ptp(values) else 0.0


def copies(test: LogTest, recording: Recording) -> list[Finding]:
    """Channels that are another one, times a number: of one axis or of two.

    A position that is a copy of the command is refused where no load side was recorded: nothing was measured.
    """
    out = []
    there = [(axis, name, x) for axis in test.axes for name, x in recording.axes[axis].channels.items() if np.ptp(x)]
    for (axis, name, x), (other, second, y) in combinations(there, 2):
        u, v = x - x.mean(), y - y.mean()
        factor = float(u @ v / (u @ u))
        if np.abs(v - factor * u).max() > _SAME * float(np.abs(v).max()):
            continue
        measured = {name, second} == {"command", "actual"} and axis == other
        two = axis != other and name == second == "actual"
        times = "" if abs(factor - 1.0) < 1e-6 else f", times {factor:.6g}"
        said = f"{test.name}: the {_words(second)} of {other} is a copy of the {_words(name)} of {axis}{times}"
        alone = measured and recording.axes[axis].load is None
        what = (
            ": nothing was measured" if alone else ": one column was taken twice" if two else ": it says nothing more"
        )
        out.append(Finding("copy", test.name, tuple(dict.fromkeys((axis, other))), said + what, alone or two))
    return out


def impossible(test: LogTest, recording: Recording) -> list[Finding]:
    """Values that no drive of a machine tool has: a wrong unit."""
    out = []
    for axis in test.axes:
        channels = recording.axes[axis].channels
        for name, most in _LARGEST.items():
            if name in channels and (largest := float(np.abs(channels[name]).max())) > most:
                unit = _UNITS.get(name, "times the rated value")
                said = (
                    f"the {_words(name)} of {axis} reaches {largest:,.6g} {unit}, and no drive of a machine tool more "
                )
                said += f"than {most:,.6g}; correct the column's unit"
                out.append(_finding("impossible", test.name, axis, said, refused=True))
        for name in ("velocity", "velocity_command"):
            if name in channels and (ratio := _of_motion(recording, axis, name)) and not 0.5 < ratio < 2.0:
                said = f"the {_words(name)} of {axis} is {ratio:.4g} times the velocity of its command; "
                out.append(_finding("impossible", test.name, axis, f"{said}correct the column's unit", refused=True))
    return out


def _of_motion(recording: Recording, axis: str, name: str) -> float:
    """A velocity over that of the command, by the ways that they go; 0 where nothing moves."""
    record = recording.axes[axis]
    way = np.gradient(record.command, recording.time)
    gone, said = (float(np.abs(x[np.abs(x) > 0.05 * np.abs(x).max()]).sum()) for x in (way, record.channels[name]))
    return said / gone if gone else 0.0


def not_used(test: LogTest, recording: Recording) -> list[Finding]:
    """Channels that the diagnosis does not use, with the reason."""
    return [
        not_used_because(test.name, axis, name, NOT_USED[name])
        for axis in test.axes
        for name in recording.axes[axis].channels
        if name in NOT_USED
    ]


def not_used_because(test: str, axis: str, name: str, why: str) -> Finding:
    """The sentence that a channel of a log is not used."""
    return _finding("not used", test, axis, f"the {_words(name)} of {axis} is recorded and not used by diagnose: {why}")


def counts_against(test: str, axis: str, name: str) -> Finding:
    """The sentence that a channel of a log has the sign against the direction of its axis."""
    said = f"the {_words(name)} of {axis} counts against the direction of the position; its sign is turned"
    return _finding("used", test, axis, said)


def used_without_law(test: str, axis: str, name: str, why: str) -> Finding:
    """The sentence that a channel of a log is held against the model's torque, and says nothing about the control."""
    number = "" if name in ("torque", "force") else " times a number that is not known"
    said = f"the {_words(name)} of {axis} is held against the torque of the model{number}; no gain of the control is "
    return _finding("used", test, axis, f"{said}read from it: {why}")


def fed_forward(test: str, axis: str, share: float, stated: float) -> Finding:
    """The sentence that a velocity set-point has another feedforward in it than the machine file states."""
    said = f"the velocity set-point of {axis} has {share:.3g} times the commanded speed in it: "
    return _finding("used", test, axis, f"{said}a feedforward, where the machine file states {stated:.3g}")


def used_up_to_a_factor(test: str, axis: str, name: str, said: Sequence[str]) -> Finding:
    """The sentence that a channel of a log counts as a torque times an unknown number.

    Args:
        test: Name of the log.
        axis: Letter.
        name: Of the channel.
        said: Settings of the control that follow from it, in words.
    """
    what = " and ".join(said)
    constant = "; the torque constant, torque_constant_Nm_per_A of the drive, gives the velocity gain and separates it "
    constant += "from the inertia"
    said = f"the {_words(name)} of {axis} is taken for the torque of the motor times a number that is not known, of "
    said += f"either sign: {what} of the control follow from it, and what share of it is friction; no inertia"
    return _finding(
        "used", test, axis, said + (constant if name == "current" else "; record the torque in N m for that")
    )


def _finding(kind: str, test: str, axis: str, said: str, refused: bool = False) -> Finding:
    return Finding(kind, test, (axis,), f"{test}: {said}", refused)


def _words(name: str) -> str:
    """A channel's name in a sentence."""
    words = {"actual": "actual position", "load": "load-side position", "command": "command"}
    return words.get(name, name.replace("_share", " in %").replace("_", " "))


def _ordinal(n: int) -> str:
    return {2: "second", 3: "third"}.get(n, f"{n}th")


def _shown(test: LogTest, axis: str) -> tuple[float, str, str]:
    """Size of the unit in which an encoder's step is said, the unit, and the key of campaign.toml."""
    return (DEG, "°", "resolution_deg") if test.chain.is_rotary(axis) else (1e-3 * MM, "µm", "resolution_um")


def _longest(there: np.ndarray) -> tuple[int, int]:
    """Beginning and length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    if not len(edges):
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    longest = int(np.argmax(lengths))
    return int(edges[2 * longest]), int(lengths[longest])
