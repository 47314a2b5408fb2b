"""Axis logs of the machines of the bank: one axis of the same hidden machine that the ball bar measured, as its control
would record it. No code of mjsim.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from . import drives
from .campaign import Case, _true
from .kinematics import AXES, DEG
from .logs import to_and_fro

#: Noise of the encoder and its step, m and rad at the load.
NOISE, STEP = {False: 0.05e-6, True: 0.5e-6}, {False: 0.1e-6, True: 1e-6}
#: Travel of a linear axis per metre of :func:`to_and_fro`, and of a rotary one, rad.
_LINEAR, _ROTARY = 1.0, 200.0 * DEG
INSTRUMENT = """
[instrument.bar]
kind = "ball_bar"
resolution_um = 0.1
range_mm = 1.0
sample_rate_Hz = 200.0

[instrument.control]
kind = "axis_log"
sample_rate_Hz = 1000.0
resolution_um = 0.1
resolution_deg = {step}

"""


def strokes(axis: str) -> np.ndarray:
    """Command of one axis, (n,) m or rad, 1 ms apart: strokes with stops, and a sine of growing speed."""
    return to_and_fro(drives.GRID) * (_ROTARY if axis in "ABC" else _LINEAR)


def recorded(case: Case, axis: str, command: np.ndarray, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Encoder positions (n,) m or rad and torques (n,) N·m of one axis of a case's true machine."""
    drive, effects = _true(case.resolved())
    late = drives.delay(axis, effects)
    time = drives.GRID * np.arange(len(command))
    seen = np.interp(time - late, time, command) if late else command
    position, torque = drives.run_axis(axis, drive[axis], effects, seen)
    rotary = axis in "ABC"
    noisy = position + NOISE[rotary] * np.random.default_rng([case.seed, 500, seed]).normal(size=len(position))
    return np.round(noisy / STEP[rotary]) * STEP[rotary], torque


def csv(axis: str, command: np.ndarray, position: np.ndarray, torque: np.ndarray | None = None) -> str:
    """The log as campaigns have it."""
    unit, name = (DEG, "deg") if axis in "ABC" else (1e-3, "mm")
    columns = [drives.GRID * np.arange(len(command)), command / unit, position / unit]
    names = ["time_s", f"{axis}_command_{name}", f"{axis}_actual_{name}"]
    if torque is not None:
        columns, names = [*columns, torque], [*names, f"{axis}_torque_Nm"]
    rows = "\n".join(",".join(f"{v:.7f}" for v in row) for row in zip(*columns, strict=True))
    return f"{','.join(names)}\n{rows}\n"


def add(case: Case, folder: Path, axis: str, torque: bool = False, name: str = "") -> None:
    """Puts a log of one axis into a campaign that :func:`campaign.write_files` has written."""
    assert axis in AXES
    name = name or f"strokes-{axis.lower()}"
    command = strokes(axis)
    position, torques = recorded(case, axis, command)
    (folder / "traces" / f"{name}.csv").write_text(csv(axis, command, position, torques if torque else None))
    file = folder / "campaign.toml"
    text = file.read_text()
    if "[instrument.bar]" not in text:
        before, _, rest = text.partition("[instrument]")
        _, _, tests = rest.partition("[[test]]")
        text = before + INSTRUMENT.format(step=STEP[True] / DEG) + "[[test]]" + tests
    table = f'\n[[test]]\nname = "{name}"\nkind = "log"\ntrace = "traces/{name}.csv"\naxes = ["{axis}"]\n'
    file.write_text(text.rstrip() + "\n" + table)
