"""Delay between the sampling of a position and the torque that answers it."""

from dataclasses import replace

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class LoopDelay(Effect):
    kind = "loop_delay"
    subjects = every_axis
    for_logs = True
    title = "Delay in the control loop"
    parameters = (
        Parameter(
            "delay_ms",
            "time from sampling to torque, beyond that of the machine file",
            0.0,
            20.0,
            neutral=0.0,
            scale=0.1,
        ),
    )
    definition = "the torque of an instant acts delay later"
    source = "digital control: computing time and current loop"
    signature = "Less damping: motion rings after every change of the acceleration."
    remedy = Remedy("adjust", "", "Check cycle times and filters of the drive. Lower the gains if the axis rings.")
    search = SearchHints(quasi_static=False, stated=True, seeds=({"delay_ms": 0.1}, {"delay_ms": 1.0}))

    def apply(self, plant):
        axis = plant.axes[self.subject]
        axis.control = replace(axis.control, loop_delay=axis.control.loop_delay + self.si("delay_ms"))
