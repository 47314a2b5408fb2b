"""Measurement files of other systems into a campaign: the command ``mjsim import`` as functions."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.campaign.machine_file import read_machine
from mjsim.errors import InputError, SimulationError
from mjsim.importing import into_campaign as into
from mjsim.importing.reading import Options, Recording, read_columns
from mjsim.importing.sources import sources
from mjsim.importing.units import LENGTH
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarData, BallBarTest, Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.files import check_writable
from mjsim.machine.model import Machine
from mjsim.simulation.multibody import simulate
from mjsim.units import DEG, UM

# -- when each sample of a recording was taken, on the clock of the test's program -------------------------------------

# -- samples whose times or angles have few digits, put back where an even clock took them -----------------------------
# Recorders sample evenly. Rounded angles make the samples a little early, a little late, or fall on one place; taken at
# their word, that jitter would pass for noise and for gaps in the trace.

#: Off the even clock by less than this part of a step, times are left as they are.
_EXACT = 1e-3


def quantum(x: np.ndarray) -> float:
    """The last decimal place that ``x`` (n,) uses, as a number (0.001 for three decimals); 0 where it uses more
    than six.
    """
    for decimals in range(7):
        scaled = x * 10.0**decimals
        if np.abs(scaled - np.round(scaled)).max(initial=0.0) < 1e-4:
            return 10.0**-decimals
    return 0.0


def evenly(time: np.ndarray, deviation: np.ndarray, step: float, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Times that grow, with their deviations; on an even clock where rounding explains all that they are off it.

    Args:
        time: (n,) s. deviation: (n,) m. step: what the file's rounding is as a time, s. notes: gets what was done.
    """
    forward = np.append(True, time[1:] > np.maximum.accumulate(time)[:-1]) if len(time) else np.zeros(0, bool)
    kept, count = time[forward], int(forward.sum())
    if count > 2:
        steps = np.diff(kept)
        usual = float(np.median(steps))
        listed = np.abs(steps - usual).max() < 1e-3 * usual or np.mean(np.abs(steps - usual) < 1e-3 * usual) > 0.9
        if step < 0.7 * usual or (listed and count > 0.95 * len(time)):
            # steps can be counted one by one, over gaps as well
            single = steps[steps < 1.5 * usual].mean()
            even, values = _line(kept, np.append(0, np.cumsum(np.round(steps / single))), step), deviation[forward]
        else:
            even, values = _line(time, np.arange(len(time)), step), deviation
        if even is not None:
            clock, off, rate = even
            if off > _EXACT / rate:
                notes.append(
                    f"angles or times are rounded: the {len(clock)} samples are taken as evenly spaced, {rate:.6g} Hz"
                )
                return clock, values
    if count < len(time):
        notes.append(f"{len(time) - count} samples are left out: their angle was there already")
    return kept, deviation[forward]


def _line(time: np.ndarray, number: np.ndarray, step: float) -> tuple[np.ndarray, float, float] | None:
    """Times on the even clock that fits best, how far off it the given ones are, its rate; ``None`` where rounding
    does not explain it.
    """
    slope, first = np.polyfit(number, time, 1)
    off = float(np.abs(time - first - slope * number).max())
    if slope <= 0 or off > 0.75 * step + 1e-9 or len(np.unique(number)) < len(number):
        return None
    return first + slope * number, off, 1.0 / slope


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


# -- whether a trace's size is one that a ball bar can have seen -------------------------------------------------------
# Nothing is corrected here: what looks wrong becomes a question that names the option which would mend it.

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


@dataclass(frozen=True)
class ImportedTrace:
    """One trace as it was brought in, or as it would be.

    Attributes:
        source: the measurement file. file: the trace's file in the campaign. test: its test; ``added`` whether
            campaign.toml got it or its ``trace``, ``new_test`` whether it got the test.
        trace: what was kept. unit: of the deviation in ``source``. notes: what was found and concluded. questions: what
            looks wrong.
        written: false for a preview.
    """

    source: Path
    file: Path
    test: BallBarTest
    added: bool
    trace: Trace
    unit: str
    notes: tuple[str, ...]
    questions: tuple[str, ...]
    written: bool
    new_test: bool = False

    def to_json(self) -> dict:
        """Plain numbers in s, degrees and µm, as ``mjsim import --json`` prints them."""
        t, program = self.trace, Program(self.test)
        lo, hi = program.measured_span
        deviation = t.deviation[t.valid] / UM
        return {
            "source": str(self.source),
            "test": self.test.name,
            "trace": str(self.file),
            "added": self.added,
            "new_test": self.new_test,
            "written": self.written,
            "samples": len(t.time),
            "samples_missing": int((~t.valid).sum()),
            "rate_Hz": round(1.0 / float(np.median(np.diff(t.time))), 3),
            "duration_s": round(float(t.time[-1] - t.time[0]), 4),
            "program_s": round(hi - lo, 4),
            "unit": self.unit,
            "min_um": round(float(deviation.min()), 4),
            "max_um": round(float(deviation.max()), 4),
            "rms_um": round(float(deviation.std()), 4),
            "first_rows": [
                {
                    "time_s": round(float(s), 6),
                    "phi_deg": round(float(p / DEG), 4),
                    "deviation_um": round(float(d / UM), 4),
                }
                for s, p, d in zip(t.time[:5], program.phi(t.time[:5]), t.deviation[:5], strict=True)
            ],
            "notes": list(self.notes),
            "questions": list(self.questions),
        }


def import_traces(
    campaign: str | Path,
    files: Sequence[str | Path],
    test: str | Sequence[str | None] | None = None,
    keys: dict[str, Any] | None = None,
    options: Options | None = None,
    force: bool = False,
    preview: bool = False,
    check: bool = True,
) -> list[ImportedTrace]:
    """Bring recorded traces into a campaign, from text files and the runs of ``.b5r`` files: all of them, or none.

    Args:
        campaign: a folder with a campaign.toml, or the path of one.
        files: tables as text, each with one run of one test; or ``.b5r`` files, whose runs go to the tests that fit
            their header.
        test: the test's name for a single file, or a name (or ``None``) for each file. Without one the file's name is
            the test's.
        keys: keys of the ``[[test]]`` table, as in campaign.toml, of tests that are not there yet; the files' headers
            come second.
        options: how the files are read. force: replace traces that are there. preview: write nothing.
        check: also compare the trace's size with what the campaign's model gives, which simulates the test.

    Raises:
        InputError: names the file, the place, what was found and what is allowed; nothing is written.
    """
    o = options or Options()
    file, text, known = into.read_document(Path(campaign))
    if isinstance(test, str) and len(files) > 1:
        raise InputError(
            f"--test {test} names one test, {len(files)} files were given; allowed: FILE=TEST for each of them"
        )
    names = [test] * len(files) if test is None or isinstance(test, str) else test
    instrument = known.instruments.get(BallBarTest.instrument, BallBarData()) if known else BallBarData()
    out, contents = [], {}
    for item in sources([Path(f) for f in files], names, dict(keys or {}), o, known):
        source, table, name = item.path, item.table, item.name
        entry = into.entry(file, text, name, dict(keys or {}), item.header, source)
        if entry.file in contents:
            raise InputError(
                f"{source}: another of these files is test {name!r} as well; allowed: one file for each test "
                f"(FILE=TEST names it)"
            )
        if not preview:
            check_writable(entry.file, force)
        text = entry.text
        own, assumed = item.timed(entry.test)
        recording = read_columns(table, entry.test, own)
        time, deviation, placed = place(source, recording, entry.test, own)
        trace = into.checked_trace(source, entry.test, time, deviation, instrument)
        notes = (
            *table.notes,
            *assumed,
            *recording.notes,
            *placed,
            "a shorter bar is positive in the file: signs turned" if o.inward else "",
        )
        if trace.saturated:
            notes = (
                *notes,
                f"{trace.saturated} samples of a sensor at its stop, or beyond its range: they count as missing",
            )
        asked = questions(
            entry.test, trace, recording.unit, _machine(file, text) if check else None, known.tests if known else ()
        )
        asked += item.questions(entry.test)
        contents[entry.file] = into.trace_bytes(entry.file, time, deviation)
        kept = (
            source,
            entry.file,
            entry.test,
            entry.added,
            trace,
            item.unit or recording.unit,
            tuple(n for n in notes if n),
            tuple(asked),
        )
        out.append(ImportedTrace(*kept, written=not preview, new_test=entry.new_test))
    if not preview:
        into.write(file, text, contents, force)
    return out


def import_trace(campaign: str | Path, file: str | Path, test: str | None = None, **more: Any) -> ImportedTrace:
    """Bring one recorded trace into a campaign; arguments as :func:`import_traces`, and those of :class:`Options` by
    name.

    Raises:
        InputError: as :func:`import_traces`.
    """
    own = {k: more.pop(k) for k in ("keys", "force", "preview", "check") if k in more}
    made = import_traces(campaign, [file], test, options=Options(**more), **own)
    if not made:
        raise InputError(
            f"{file}: no run fits a test of the campaign; allowed: the name of its test, or keys of a new one"
        )
    return made[0]


def _machine(file: Path, text: str):
    """The campaign's machine, for what is to be expected; ``None`` where it cannot be read: an import needs none."""
    try:
        return read_machine(file.parent / str(tomllib.loads(text).get("machine", "machine.toml")))
    except InputError:
        return None
