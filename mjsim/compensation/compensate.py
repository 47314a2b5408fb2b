"""``compensate``: from what was found to the files of a control, with a forecast of what they will bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.diagnose import diagnose
from mjsim.commands.saved import SavedDiagnosis, keep, read_saved
from mjsim.compensation.controls import Control, Settings, control
from mjsim.compensation.forecast import Forecast, forecast, forecast_at_rest
from mjsim.compensation.result import Compensation, summary
from mjsim.compensation.tables import Corrections, Left, ranges_of, tuned, wanted_of, worth_typing
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.files import write_all
from mjsim.machine.chain import is_rotary
from mjsim.machine.model import Machine
from mjsim.progress import Progress, counted, silent
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, MM


@one_blas_thread
def compensate(
    campaign: Campaign,
    machine: Machine,
    control_name: str,
    settings: Settings | None = None,
    ranges: dict[str, tuple[float, float]] | None = None,
    threads: int = 2,
    progress: Progress = silent,
    saved: SavedDiagnosis | None = None,
    friction: bool = False,
) -> Compensation:
    """Corrections of what was found for one control.

    The diagnosis that stands beside the campaign is used where it is up to date; otherwise the campaign is diagnosed.

    Args:
        campaign: With at least one measured test.
        machine: As given, without the diagnosis.
        control_name: One of :data:`mjsim.compensation.controls.CONTROLS`.
        settings: What is set in the control.
        ranges: Positions that tables cover, m or rad, by axis; of other axes what the tests cover.
        threads: Tests simulated side by side.
        progress: Called as work gets on.
        saved: A diagnosis to use in any case.
        friction: Tune the friction (quadrant) compensation as well. The tests have to be measured with it off.

    Raises:
        InputError: unknown control, nothing measured, or a range that is none.
    """
    who = control(control_name, settings)
    bars = campaign.in_motion
    points = campaign.of(*(name for name, i in INSTRUMENTS.items() if i.at_rest))
    if not bars.measured and not points.measured:
        bars.need_traces("a correction needs measured tests of a ball bar, or of an instrument that measures at rest")
    tests = bars.measured
    if saved is None:
        saved = read_saved(campaign, machine)
    if saved is None:
        saved = keep(diagnose(campaign, machine, threads=threads, progress=progress), machine)
    worth, left = worth_typing(saved)
    wanted, beyond = wanted_of(saved.machine, [w.effect for w in worth])
    left += [Left(k, "no table or offset of a control has this form") for k in beyond]
    worth = [w for w in worth if w.effect.key not in beyond]
    chain = saved.machine.chain
    covered = ranges_of(tests, chain, [_stood(t, points.traces[t.name]) for t in points.measured])
    for axis, (low, high) in (ranges or {}).items():
        if axis not in covered:
            raise InputError(f"range of {axis}: no such axis; allowed: {', '.join(covered)}")
        if not low < high:
            unit, size = ("°", DEG) if is_rotary(axis) else ("mm", MM)
            raise InputError(f"range of {axis}: {low / size:g} to {high / size:g} {unit}; allowed: the lower end first")
        covered[axis] = (low, high)
    corrections = who.corrections(wanted, covered)
    if friction:
        bars.need_traces("friction shows in ball-bar tests only")
        corrections, more = _with_pulses(who, corrections, saved, tests, progress)
        left += more
    corrections = replace(corrections, left=tuple(dict.fromkeys([*left, *corrections.left])))
    result = Compensation(campaign, who, saved, tuple(worth), corrections, Forecast(()), {})
    done = counted(progress, "simulating the corrected machine", len(tests))
    sound = saved.machine
    for w in worth:
        if w.effect.key in result.corrected:
            sound = sound.without(w.effect.key)
    for axis in corrections.pulses:
        sound = sound.without(f"friction.{axis}")
    how = who.arithmetic(chain)
    expected = forecast(saved.machine, sound, tests, corrections, how, threads, done) if tests else Forecast(())
    if points.measured:
        more = forecast_at_rest(saved.machine, sound, points, corrections, how)
        expected = Forecast((*expected.tests, *more.tests))
    result = replace(result, forecast=expected)
    files = who.files(corrections)
    return replace(result, files={"corrections.txt": summary(result), **files})


def _stood(test: Any, recording: Any) -> np.ndarray:
    """Where the axes stood in a test at rest, (n, axes) m and rad."""
    stops = INSTRUMENTS[test.instrument].stops(test, recording)
    assert stops is not None
    return stops.route[stops.at[:, 0]]


def _with_pulses(
    who: Control, corrections: Corrections, saved: SavedDiagnosis, tests: Sequence[BallBarTest], progress: Progress
) -> tuple[Corrections, list[Left]]:
    """Corrections with the friction compensation of every axis that has friction, and what cannot be compensated."""
    machine, pulses, left = saved.machine, {}, []
    known = {k.effect.key: k for k in saved.known if k.effect.kind == "friction"}
    for i, (key, k) in enumerate(known.items()):
        progress("tuning the friction compensation", i, len(known))
        axis, torque = k.effect.subject, k.effect.values["coulomb_Nm"]
        if not who.pulses:
            left.append(Left(key, who.friction_advice(axis, torque)))
        elif k.alternatives:
            left.append(Left(key, f"ambiguous: the data cannot tell it from {', '.join(k.alternatives)}"))
        elif pulse := tuned(machine, axis, tests, who.pulse_digit(machine.chain, axis)):
            pulses[axis] = pulse
        else:
            left.append(Left(key, "a pulse at the reversals of these tests would take less than a fifth of its error"))
    return replace(corrections, pulses=pulses), left


def write_compensation(
    result: Compensation, folder: Path | str, force: bool = False, more: dict[str, bytes] | None = None
) -> list[Path]:
    """Write the files into ``folder``, all or none; their paths.

    Args:
        result: The corrections.
        folder: Made where it is not there.
        force: Replace files that are there.
        more: Further files by name, such as a picture.

    Raises:
        InputError: one is there already, or the folder cannot be written.
    """
    paths: dict[Path, str | bytes] = {
        Path(folder) / name: text for name, text in {**result.files, **(more or {})}.items()
    }
    write_all(paths, force)
    return list(paths)
