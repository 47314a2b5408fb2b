"""Wind-up of the tilting axis under its unbalance."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, tilting_axes
from mjsim.machine.plant import SINE


@register
class GravityWindup(Effect):
    kind = "gravity_windup"
    subjects = tilting_axes
    title = "Wind-up of the tilting axis under gravity"
    noun = "wind-up under gravity"
    parameters = (
        Parameter("amplitude_deg", "unbalance torque times worm compliance", -0.1, 0.1, neutral=0.0, scale=0.001),
        Parameter("phase_deg", "direction of the unbalance", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "x + amplitude·sin(x + phase)"
    source = "static moment equilibrium of an unbalanced cradle on a compliant worm"
    signature = "A slow wave tied to the tilt angle, largest where the cradle tilts far."
    remedy = Remedy("adjust", "", "Adjust the counterbalance, or enter a compensation table over the tilting angle.")
    search = SearchHints(free=("amplitude_deg", "phase_deg"))

    def apply(self, plant):
        plant.add_op(
            "gravity_windup",
            SINE,
            self.subject,
            self.si("amplitude_deg"),
            1.0,
            math.radians(self.values["phase_deg"]),
            0.0,
        )
