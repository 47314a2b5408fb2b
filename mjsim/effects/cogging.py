"""Torque ripple of several orders: cogging of a motor, and what a screw adds."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class Cogging(Effect):
    kind = "cogging"
    subjects = every_axis
    for_logs = True
    title = "Torque ripple of several orders"
    noun = "cogging"
    parameters = (
        Parameter(
            "components", "[cycles per motor revolution, amplitude N·m, phase °]", upper=100.0, kind="components"
        ),
    )
    definition = "τ_disturbance grows by Σ a sin(order·θm + phase)"
    source = "cogging of permanent-magnet motors, screws out of line, passing balls; form assumed"
    signature = "Waves tied to the screw's angle, the same in both directions, larger where the axis moves slowly."
    remedy = Remedy(
        "maintain",
        "cyclic error",
        "Check motor and drive, and the screw. Use the drive's cogging compensation.",
        "Check motor and drive, and the worm. Use the drive's cogging compensation.",
    )
    search = SearchHints(quasi_static=False, free=("components",))

    def apply(self, plant):
        waves = [(a, order, math.radians(phase)) for order, a, phase in self.values["components"]]
        plant.axes[self.subject].waves += tuple(waves)
