"""The ``[controller.NAME.AXIS]`` tables of a machine file: reading, and writing what an identification changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mjsim.campaign.schema import ControllerTable
from mjsim.errors import InputError
from mjsim.machine.chain import Chain, is_rotary
from mjsim.machine.control import Control, Controller, Law
from mjsim.units import DEG, MM


def read_controllers(
    path: Path, tables: dict[str, Any], chain: Chain, gears: dict[str, float]
) -> dict[str, dict[str, Controller]]:
    """Controllers by name and axis.

    Args:
        path: The machine file, for messages.
        tables: Checked tables by name.
        chain: Axes of the machine.
        gears: Motor angle per axis position, by axis.

    Raises:
        InputError: A table has neither gains nor a law, or both.
    """
    out: dict[str, dict[str, Controller]] = {}
    for name, axes in tables.items():
        out[name] = {}
        for axis in chain.letters:
            table = getattr(axes, axis)
            if table is not None:
                unit = DEG if is_rotary(axis) else MM
                out[name][axis] = _controller(f"{path}: [controller.{name}.{axis}]", table, gears[axis] * unit)
    return out


def _controller(place: str, t: ControllerTable, angle: float) -> Controller:
    """One controller; ``angle`` is the motor's per mm or degree of the axis, rad."""
    law = None
    given = [k for k in ("R", "S", "T") if getattr(t, k) is not None]
    gains = [k for k in ("position_gain_per_s", "velocity_gain_Nms_per_rad") if getattr(t, k) is not None]
    if given and gains:
        raise InputError(f"{place}: {given[0]} and {gains[0]}; allowed: a law R, S, T or the gains of a cascade")
    if given:
        needed = ("R", "S", "T", "sample_time_s", "torque_per_V")
        if missing := [k for k in needed if not getattr(t, k)]:
            raise InputError(f"{place}: the key {missing[0]!r} is missing; a law needs {', '.join(needed)}")
        R, S, T = t.R or [], t.S or [], t.T or []
        if R[0] == 0.0:
            raise InputError(f"{place}: R = {R}; allowed: a first coefficient that is not 0")
        law = Law(tuple(R), tuple(s / angle for s in S), tuple(c / angle for c in T))
    elif len(gains) < 2:
        missing = next(k for k in ("position_gain_per_s", "velocity_gain_Nms_per_rad") if k not in gains)
        raise InputError(f"{place}: the key {missing!r} is missing")
    if t.clip_V is not None and t.clip_Nm is not None:
        raise InputError(f"{place}: clip_V and clip_Nm; allowed: one of the two")
    clip = np.inf if t.clip_Nm is None else t.clip_Nm
    if t.clip_V is not None and t.torque_per_V is not None:
        clip = t.clip_V * t.torque_per_V
    control = Control(t.sample_time_s, t.torque_lag_s, t.loop_delay_s, clip, t.anti_windup, t.velocity_samples, law)
    return Controller(
        t.position_gain_per_s or 1.0,
        (t.torque_per_V if law else t.velocity_gain_Nms_per_rad) or 1.0,
        t.integral_time_s,
        t.velocity_feedforward,
        control,
    )


#: Numbers of a controller that a fit may change -> its key in the machine file.
CONTROLLER_KEYS = {
    "position_gain": "position_gain_per_s",
    "velocity_gain": "velocity_gain_Nms_per_rad",
    "integral_time": "integral_time_s",
    "feedforward": "velocity_feedforward",
}
CONTROL_KEYS = {
    "torque_lag": "torque_lag_s",
    "loop_delay": "loop_delay_s",
    "velocity_samples": "velocity_samples",
}


def edit_controllers(document: Any, now: dict[str, dict[str, Controller]], base: dict[str, dict[str, Controller]]):
    """Put changed numbers of controllers into the parsed machine file ``document``."""
    for name, axes in now.items():
        for axis, controller in axes.items():
            table, former = document["controller"][name][axis], base[name][axis]
            law = controller.control.law is not None
            for attribute, key in CONTROLLER_KEYS.items():
                value = getattr(controller, attribute)
                if value != getattr(former, attribute):
                    table["torque_per_V" if law and attribute == "velocity_gain" else key] = float(f"{value:.9g}")
            for attribute, key in CONTROL_KEYS.items():
                value = getattr(controller.control, attribute)
                if value != getattr(former.control, attribute):
                    table[key] = value if isinstance(value, int) else float(f"{value:.9g}")
