"""Limit of a drive's torque, as its current limit sets it."""

from dataclasses import replace

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class CurrentClip(Effect):
    kind = "current_clip"
    subjects = every_axis
    for_logs = True
    title = "Torque limit of a drive"
    noun = "torque limit"
    parameters = (
        Parameter("torque_Nm", "largest torque of the motor", 1e-6, 1e5, neutral=1e5, scale=0.1, inverse=True),
    )
    definition = "the motor's torque stays within ±torque"
    source = "amplifier and control: current and output limits"
    signature = "The axis falls behind where it accelerates hardest; an integrator that runs on overshoots afterwards."
    remedy = Remedy("adjust", "", "Raise the torque limit of the drive, or lower the acceleration of the axis.")
    search = SearchHints(quasi_static=False, stated=True, seeds=({"torque_Nm": 1.0},))

    def apply(self, plant):
        axis = plant.axes[self.subject]
        axis.control = replace(axis.control, clip=min(axis.control.clip, self.si("torque_Nm")))
