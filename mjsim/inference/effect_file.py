"""A ready-to-edit effect file in the form of an unexplained rest."""

from __future__ import annotations

import numpy as np

from mjsim.kinematics import AXES, LINEAR

_ARGUMENT = {
    "position": "motion.position[:, AXIS]",
    "direction": "motion.position[:, AXIS]",
    "velocity": "motion.velocity[:, AXIS]",
    "acceleration": "motion.acceleration[:, AXIS]",
    "time_since_reversal": "np.log10(np.maximum(motion.since_reversal[:, AXIS], 0.02))",
    "clock_time": "motion.clock",
}
_UNIT = {
    "velocity": ("m/s", "rad/s"),
    "acceleration": ("m/s²", "rad/s²"),
    "time_since_reversal": ("log10 of s", "log10 of s"),
    "clock_time": ("s", "s"),
}

_TEMPLATE = '''"""{summary}

Written by mjsim from the measurement: an empirical curve, not an explanation. Replace the curve by the physics you suspect, rename
the effect, and try it with `mjsim add CAMPAIGN {file_name}`.
"""

import numpy as np

import mjsim

AXIS = {index}  # column of the {axis} axis in X, Y, Z, A, C
#: {variable} at which the curve is given, {unit}
KNOTS = np.array([{knots}])
#: what is added to the axis position there, {size}
VALUES = np.array([{values}])


@mjsim.register
class {class_name}(mjsim.Effect):
    kind = "{kind}"
    subjects = ("{axis}",)
    title = "Unexplained error of the {axis} axis"
    parameters = (mjsim.Parameter("gain", "factor on the curve", -10.0, 10.0, neutral=0.0, scale=1.0),)
    definition = "axis position + gain · curve({variable})"
    source = "empirical, from this campaign"
    signature = "{signature}"

    def position_error(self, motion):
        x = {argument}
        out = np.zeros_like(motion.position)
        out[:, AXIS] = self.values["gain"] * {sign}np.interp(x, KNOTS, VALUES{period})
        return out
'''


def effect_source(
    axis: str, variable: str, knots: np.ndarray, values: np.ndarray, period: float | None, summary: str, file_name: str
) -> str:
    """Python text of an effect that adds an empirical curve to one axis.

    Args:
        knots: (n,) in SI (rad, m, s ...). values: (n,) m or rad. period: of the variable, SI, or ``None``.
    """
    linear = axis in LINEAR
    kind = f"unexplained_{variable}"
    unit = _UNIT.get(variable, ("m", "rad"))[0 if linear else 1]
    return _TEMPLATE.format(
        summary=summary,
        file_name=file_name,
        index=AXES.index(axis),
        axis=axis,
        variable=variable.replace("_", " "),
        unit=unit,
        size="m" if linear else "rad",
        knots=_numbers(knots),
        values=_numbers(values),
        class_name="".join(w.capitalize() for w in kind.split("_")),
        kind=kind,
        signature=summary.replace('"', "'"),
        argument=_ARGUMENT[variable],
        sign="np.sign(motion.velocity[:, AXIS]) * " if variable in ("direction", "time_since_reversal") else "",
        period=f", period={period:.12g}" if period else "",
    )


def _numbers(x: np.ndarray) -> str:
    lines = [", ".join(f"{v:.6g}" for v in x[i : i + 8]) for i in range(0, len(x), 8)]
    return "\n    " + ",\n    ".join(lines) + ",\n"
