"""What can be done about a cause, and what ball-bar software calls it.

``kind`` is ``adjust`` (a setting or a mechanical adjustment), ``compensate`` (a table or parameter of the control),
``maintain`` (a part, or the machine's surroundings) or ``share`` (belongs to every machine: taking it out of a
simulation only says how much it makes).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Remedy:
    """``kind`` as above, ``term`` in ball-bar software's vocabulary (empty: it has none), ``text`` in one sentence."""

    kind: str
    term: str
    text: str

    @property
    def repairable(self) -> bool:
        """Whether a repair is meant, not only a share."""
        return self.kind != "share"


_REMEDIES = {
    "axis_location": Remedy(
        "compensate", "", "Measure the rotary axis' centre line again and enter it in the control's kinematics."
    ),
    "backlash": Remedy(
        "adjust",
        "backlash",
        "Adjust the worm mesh or the preload. Until then, use the control's backlash compensation.",
    ),
    "drive_compliance": Remedy("maintain", "lateral play", "Check coupling, bearings and nut or worm for stiffness."),
    "friction": Remedy(
        "share", "reversal spikes", "Every drive has friction. Lubrication and friction compensation reduce it."
    ),
    "gravity_windup": Remedy(
        "adjust", "", "Adjust the counterbalance, or enter a compensation table over the tilting angle."
    ),
    "pitch_error": Remedy(
        "compensate",
        "cyclic error",
        "Enter a pitch-error compensation table. Check how the worm or the encoder is seated.",
    ),
    "radial_error_motion": Remedy("maintain", "", "Check the table's bearing and its seat."),
    "scale_error": Remedy(
        "compensate", "scale mismatch", "Correct the axis' scale by linear compensation. Check temperatures."
    ),
    "servo_delay": Remedy(
        "adjust", "servo mismatch", "Match interpolation delays and filters of the axes in the control."
    ),
    "servo_gain": Remedy("adjust", "servo mismatch", "Set the position gain to that of the other axes in the control."),
    "squareness": Remedy("adjust", "squareness", "Align the guideways, or enter a squareness compensation."),
    "straightness": Remedy(
        "compensate", "straightness", "Align the guideway, or enter a straightness compensation table."
    ),
    "thermal_drift": Remedy(
        "maintain", "", "Warm the machine up before measuring and cutting. Check cooling and thermal compensation."
    ),
    "tilt_error_motion": Remedy("maintain", "", "Check the table's bearing, its preload and clamping."),
    "torque_ripple": Remedy(
        "maintain", "cyclic error", "Check motor and drive. Use the drive's torque-ripple compensation."
    ),
    "velocity_feedforward": Remedy("adjust", "servo mismatch", "Set the same feedforward on all axes in the control."),
    "velocity_gain": Remedy("adjust", "reversal spikes", "Tune the velocity loop in the drive."),
    "vibration": Remedy(
        "maintain", "vibration", "Find what vibrates at this frequency: foundation, pump, spindle or another machine."
    ),
    "viscous_friction": Remedy("maintain", "", "Check lubrication, seals and temperature of the axis."),
    "worm_wear": Remedy("maintain", "", "Replace or re-cut the worn worm wheel. Until then, use a compensation table."),
}


def remedy(kind: str) -> Remedy:
    """The remedy for an effect of that kind; an effect of the user's own counts as one that can be repaired."""
    return _REMEDIES.get(kind, Remedy("maintain", "", "Your own effect. The catalogue has no remedy for it."))
