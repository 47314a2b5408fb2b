"""Torque ripple of a drive's motor."""

import math

from mjsim.effects.registry import register
from mjsim.machine.chain import AXES
from mjsim.machine.effect import Effect, Parameter


@register
class TorqueRipple(Effect):
    kind = "torque_ripple"
    subjects = AXES
    title = "Torque ripple of a motor"
    parameters = (
        Parameter("amplitude_Nm", "amplitude of the disturbance torque", 0.0, 100.0, neutral=0.0, scale=0.05),
        Parameter("order", "cycles per motor revolution", 0.01, 500.0, scale=1.0),
        Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "τ_disturbance = a sin(order·θm + phase)"
    source = "effect catalogue; cogging of permanent-magnet motors"
    signature = "A wave tied to the axis position whose height falls as the axis moves faster or slower than the loop's weak band."
    quasi_static = False

    free = ("amplitude_Nm", "phase_deg")

    @classmethod
    def seeds(cls, subject):
        """None: the order is found by the spectrum over the axis position."""
        return []

    def apply(self, plant):
        plant.axes[self.subject].ripple = (self.si("amplitude_Nm"), self.values["order"], math.radians(self.values["phase_deg"]))
