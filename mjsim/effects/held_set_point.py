"""Position loop that is slower than the velocity loop of a digital control."""

from dataclasses import replace

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class HeldSetPoint(Effect):
    kind = "held_set_point"
    subjects = every_axis
    for_logs = True
    title = "Position loop slower than the velocity loop"
    noun = "held set-point"
    parameters = (
        Parameter(
            "time_ms",
            "time between two velocity set-points, a multiple of the control's sample time",
            0.0,
            100.0,
            neutral=0.0,
            scale=1.0,
        ),
    )
    definition = "the velocity set-point Kpp (r − y) + ratio·dr/dt is computed once in this time, and held"
    source = "digital drives: a position loop of 1 to 4 ms above a velocity loop of 0.1 to 1 ms"
    signature = "Steps in the torque at every new set-point; the axis follows as with half of the time as a delay."
    remedy = Remedy("adjust", "", "Check the cycle times of the position and the velocity loop.")
    search = SearchHints(quasi_static=False, stated=True, seeds=({"time_ms": 2.0},))

    def apply(self, plant):
        axis = plant.axes[self.subject]
        axis.control = replace(axis.control, position_sample_time=self.si("time_ms"))
