"""Filter of the command before the position loop: exponential smoothing, or a mean over a time (jerk filter)."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class CommandFilter(Effect):
    kind = "command_filter"
    subjects = every_axis
    for_logs = True
    title = "Filter of the command of an axis"
    noun = "command filter"
    parameters = (
        Parameter("lag_ms", "time constant of exponential smoothing", 0.0, 200.0, neutral=0.0, scale=2.0, default=0.0),
        Parameter(
            "mean_ms", "time over which a jerk filter takes the mean", 0.0, 400.0, neutral=0.0, scale=4.0, default=0.0
        ),
    )
    definition = "lag · dr'/dt + r' = r, and r'' the mean of r' over the last mean; the position loop gets r''"
    source = "controls: set-point filters, such as dynamic stiffness, jerk and exponential position filters"
    signature = (
        "The axis lags behind the command as if it were late, and more so it cuts corners: fast changes are "
        "smoothed. A delay shifts them as they are."
    )
    remedy = Remedy("adjust", "servo mismatch", "Set the same command filters on all axes in the control.")
    search = SearchHints(quasi_static=False, stated=True, seeds=({"lag_ms": 5.0}, {"mean_ms": 10.0}))

    def apply(self, plant):
        axis = plant.axes[self.subject]
        lag, mean = axis.smoothing
        axis.smoothing = (lag + self.si("lag_ms"), mean + self.si("mean_ms"))
