"""Limit of a drive's velocity set-point."""

from dataclasses import replace

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class SpeedLimit(Effect):
    kind = "speed_limit"
    subjects = every_axis
    for_logs = True
    title = "Speed limit of a drive"
    noun = "speed limit"
    parameters = (
        Parameter(
            "speed_rad_per_s",
            "largest velocity set-point, at the motor",
            1e-6,
            1e6,
            neutral=1e6,
            scale=1.0,
            inverse=True,
        ),
    )
    definition = "the velocity set-point Kpp (r − y) + ratio·dr/dt stays within ±speed"
    source = "drives: limit of the speed set-point before the velocity controller"
    signature = (
        "Where the command is faster, the axis goes at one speed and falls behind by more and more; afterwards it "
        "catches up at the same speed."
    )
    remedy = Remedy("adjust", "", "Raise the speed limit of the drive, or lower the rapid traverse of the axis.")
    search = SearchHints(quasi_static=False, stated=True, seeds=({"speed_rad_per_s": 10.0},))

    def apply(self, plant):
        axis = plant.axes[self.subject]
        axis.control = replace(axis.control, fastest=min(axis.control.fastest, self.si("speed_rad_per_s")))
