"""Friction that varies with the angle of a screw or motor."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class FrictionRipple(Effect):
    kind = "friction_ripple"
    subjects = every_axis
    for_logs = True
    title = "Friction that varies once per screw turn"
    parameters = (
        Parameter("amplitude_ratio", "amplitude over the friction level", 0.0, 0.95, neutral=0.0, scale=0.05),
        Parameter("order", "cycles per motor revolution", 0.01, 500.0, default=1.0, scale=1.0),
        Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "the friction level g(ω) is multiplied by 1 + amplitude_ratio·sin(order·θm + phase)"
    source = "a screw that is bent or out of line loads its nut once per turn; form assumed"
    signature = "A wave tied to the screw's angle that turns round with the direction of motion."
    remedy = Remedy(
        "maintain",
        "cyclic error",
        "Check whether the screw is bent or out of line with its nut.",
        "Check whether the worm is bent or out of line with its wheel.",
    )
    search = SearchHints(quasi_static=False, free=("amplitude_ratio", "phase_deg"))

    def apply(self, plant):
        plant.axes[self.subject].friction_ripple = (
            self.values["amplitude_ratio"],
            self.values["order"],
            math.radians(self.values["phase_deg"]),
        )
