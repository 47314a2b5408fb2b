"""Torque ripple of a drive's motor."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class TorqueRipple(Effect):
    kind = "torque_ripple"
    subjects = every_axis
    title = "Torque ripple of a motor"
    parameters = (
        Parameter("amplitude_Nm", "amplitude of the disturbance torque", 0.0, 100.0, neutral=0.0, scale=0.05),
        Parameter("order", "cycles per motor revolution", 0.01, 500.0, scale=1.0),
        Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "τ_disturbance = a sin(order·θm + phase)"
    source = "cogging of permanent-magnet motors"
    signature = (
        "A wave tied to the axis position whose height falls as the axis moves faster or slower than the loop's "
        "weak band."
    )
    remedy = Remedy("maintain", "cyclic error", "Check motor and drive. Use the drive's torque-ripple compensation.")
    # no seeds: the order is found by the spectrum over the axis position
    search = SearchHints(quasi_static=False, free=("amplitude_Nm", "phase_deg"), seeds=())

    def apply(self, plant):
        plant.axes[self.subject].ripple = (
            self.si("amplitude_Nm"),
            self.values["order"],
            math.radians(self.values["phase_deg"]),
        )
