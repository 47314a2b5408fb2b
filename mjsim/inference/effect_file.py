"""A ready-to-edit effect file in the form of an unexplained rest."""

from __future__ import annotations

import numpy as np

from mjsim.inference.curve_shape import bends
from mjsim.inference.curve_terms import RADIAL, TABLE, CurveTerm
from mjsim.machine.chain import Chain, is_linear, is_rotary

_ARGUMENT = {
    "position": "motion.position[:, AXIS]",
    "direction": "motion.position[:, AXIS]",
    "velocity": "motion.velocity[:, AXIS]",
    "acceleration": "motion.acceleration[:, AXIS]",
    "torque": "motion.torque[:, AXIS]",
    "time_since_reversal": "np.log10(np.maximum(motion.since_reversal[:, AXIS], 0.02))",
    "clock_time": "motion.clock",
}
_UNIT = {
    "velocity": ("m/s", "rad/s"),
    "acceleration": ("m/s²", "rad/s²"),
    "torque": ("N·m", "N·m"),
    "time_since_reversal": ("log10 of s", "log10 of s"),
    "clock_time": ("s", "s"),
}

#: Variables over which a curve with a straight end goes on beyond what was measured.
_GOES_ON = ("position", "direction", "velocity", "acceleration", "torque")
#: How far it goes on, in lengths of that end, and the least length of such an end, of the whole curve (assumed).
_FAR, _LONG_END = 10.0, 0.2

_TEMPLATE = '''"""{summary}

Written by mjsim from the measurement: an empirical curve, not an explanation. Replace the curve
by the physics that you suspect, rename the effect, and try it with `mjsim add CAMPAIGN {file_name}`.
"""

import numpy as np

import mjsim
{imports}
{columns}
#: {variable} at which the curve is given, {unit}
KNOTS = np.array([{knots}])
#: what is added to {target} there, {size}
VALUES = np.array([{values}])


@mjsim.register
class {class_name}(mjsim.Effect):
    kind = "{kind}"
    subjects = ("{subject}",)
    title = "{title}"
    parameters = (mjsim.Parameter("gain", "factor on the curve", -10.0, 10.0, neutral=0.0, scale=1.0),)
    definition = "{target} + gain · curve({variable})"
    source = "empirical, from this campaign"
    signature = "{signature}"

    def position_error(self, motion):
        {before}x = {argument}
        size = self.values["gain"] * {sign}np.interp(x, KNOTS, VALUES{period})
        out = np.zeros_like(motion.position)
        {act}
        return out
'''

_ON_AXIS = "out[:, MOVED] = size"
#: The work moves one way in the table's frame: seen from the machine, the spindle moves the other way.
_ON_TABLE = """moved = work_to_machine(CHAIN, motion.position, {direction})
        out[:, CHAIN.linear_columns] = -size[:, None] * moved"""
#: Where the ball stands about the axis, and which way is outwards.
_ALONG_RADIUS = """angle, outwards = radius_of(CHAIN.axis("{axis}"), motion.ball)
        """
#: The same where centrelines do not pass through the origin: the place of a point less that of the origin.
_ON_PLACED_TABLE = """origin = work_to_machine(CHAIN, motion.position, np.zeros(3))
        moved = work_to_machine(CHAIN, motion.position, {direction}) - origin
        out[:, CHAIN.linear_columns] = -size[:, None] * moved"""


def _chain_text(chain: Chain) -> str:
    """Python text that makes a chain."""
    more = f", {chain.placements!r}, {chain.tool_length!r}" if chain.placements else ""
    return f"chain_of({chain.configuration!r}{more})"


def effect_source(chain: Chain, term: CurveTerm, values: np.ndarray, summary: str, file_name: str) -> str:
    """Python text of an effect that adds an empirical curve.

    Args:
        chain: axes of the machine.
        term: on what it depends and what it moves.
        values: at the term's knots, (n,) m or rad.
        summary: first sentence of the file.
        file_name: for its own doc string.
    """
    knots, values = _continued(term, values)
    # a machine may have several unknown causes, each with a kind of its own
    moved = f"moves_{term.moves}" if term.moves != term.axis else ""
    kind = "_".join(filter(None, ("unexplained", term.variable, term.axis, moved))).replace(" ", "_").lower()
    unit = _UNIT.get(term.variable, ("m", "rad"))[0 if is_linear(term.axis) else 1]
    target, before, argument, direction = f"the {term.moves} axis", "", _ARGUMENT[term.variable], "DIRECTION"
    columns = imports = ""
    act = _ON_AXIS
    if term.axis:
        columns = f"AXIS = {chain.index(term.axis)}  # column of the {term.axis} axis in {', '.join(chain.letters)}\n"
    if term.moves == RADIAL:
        target, before = "the work on the table, along the ball's radius", _ALONG_RADIUS.format(axis=term.axis)
        argument, direction = f"{argument} + angle", "outwards"
    elif term.moves in TABLE:
        target = f"the work on the table, along {term.moves[-1]}"
        columns += f"DIRECTION = np.array({np.eye(3)[TABLE.index(term.moves)].tolist()})  # in the work frame"
    else:
        columns += f"MOVED = {chain.index(term.moves)}  # column of the {term.moves} axis"
    if term.moves in (RADIAL, *TABLE):
        columns = f"CHAIN = {_chain_text(chain)}\n{columns}"
        act = (_ON_PLACED_TABLE if chain.placements else _ON_TABLE).format(direction=direction)
        imports = (
            f"from mjsim.machine.chain import {'Placement, ' if chain.placements else ''}chain_of\n"
            "from mjsim.machine.kinematics import work_to_machine\n"
            f"{'from mjsim.machine.axis import radius_of' if term.moves == RADIAL else ''}\n"
        )
    return _TEMPLATE.format(
        summary=summary,
        file_name=file_name,
        imports=imports,
        columns=columns.rstrip(),
        before=before,
        variable=term.variable.replace("_", " ") + (f" of {term.axis}" if term.axis else ""),
        unit=unit,
        target=target,
        size="rad" if is_rotary(term.moves) else "m",
        knots=_numbers(knots),
        values=_numbers(values),
        class_name="".join(w.capitalize() for w in kind.split("_")),
        kind=kind,
        subject=term.axis or term.moves,
        title=f"Unexplained error of {target}",
        signature=summary.replace('"', "'"),
        argument=argument,
        sign="np.sign(motion.velocity[:, AXIS]) * " if term.signed else "",
        period=f", period={term.period:.12g}" if term.period else "",
        act=act,
    )


def _continued(term: CurveTerm, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knots and values of a curve that goes on beyond what was measured where its end is straight for long enough. It
    stays at its last value elsewhere.
    """
    knots, last = term.knots, len(term.knots) - 1
    if term.shape != "bends" or term.period is not None or term.variable not in _GOES_ON:
        return knots, values
    places, least = bends(term.coefficients), _LONG_END * last
    first, final = min(places, default=last), max(places, default=0)
    to_first, from_final = slice(int(first), None, -1), slice(int(np.ceil(final)), None)
    before = _beyond(knots[to_first], values[to_first]) if first >= least else ([], [])
    after = _beyond(knots[from_final], values[from_final]) if last - final >= least else ([], [])
    return np.concatenate([before[0], knots, after[0]]), np.concatenate([before[1], values, after[1]])


def _beyond(knots: np.ndarray, values: np.ndarray) -> tuple[list[float], list[float]]:
    """A knot far beyond the last of a straight end, and the value there."""
    far = knots[-1] + _FAR * (knots[-1] - knots[0])
    return [far], [np.polyval(np.polyfit(knots, values, 1), far)]


def _numbers(x: np.ndarray) -> str:
    lines = [", ".join(f"{v:.6g}" for v in x[i : i + 8]) for i in range(0, len(x), 8)]
    return "\n    " + ",\n    ".join(lines) + ",\n"
