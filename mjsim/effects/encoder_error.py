"""Cyclic error of the encoder in the position loop."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class EncoderError(Effect):
    kind = "encoder_error"
    subjects = every_axis
    for_logs = True
    title = "Cyclic error of a motor's encoder"
    parameters = (
        Parameter("amplitude_deg", "amplitude, ° of the motor", 0.0, 5.0, neutral=0.0, scale=0.02),
        Parameter("order", "cycles per motor revolution", 0.01, 500.0, default=2.0, scale=1.0),
        Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "the control, and the log, have θm + a sin(order·θm + phase) for the motor's angle θm"
    source = "a resolver or encoder that sits off centre (order 1), has unequal windings (2) or crosstalk (4)"
    signature = (
        "A wave tied to the motor's angle that grows with the speed. The control moves the motor by what the encoder "
        "reads wrong: at a low speed nothing of it is left in the log, and a ball bar shows a pitch error."
    )
    remedy = Remedy(
        "maintain",
        "cyclic error",
        "Check how the motor's encoder is seated, and its cable. Use the drive's encoder compensation.",
    )
    search = SearchHints(quasi_static=False, free=("amplitude_deg", "phase_deg"), seeds=())

    def apply(self, plant):
        plant.axes[self.subject].encoder_error = (
            self.si("amplitude_deg"),
            self.values["order"],
            math.radians(self.values["phase_deg"]),
        )
