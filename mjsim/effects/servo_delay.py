"""A command that arrives later than the other axes'."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class ServoDelay(Effect):
    kind = "servo_delay"
    subjects = every_axis
    title = "Command delay of one axis"
    noun = "command delay"
    parameters = (
        Parameter("delay_ms", "delay of the axis command; negative: earlier", -50.0, 50.0, neutral=0.0, scale=0.1),
    )
    definition = "r(t) is replaced by r(t − delay)"
    source = "dead time of the interpolator or drive bus"
    signature = "Like a difference of Kpp: v·delay along the axis' motion."
    remedy = Remedy("adjust", "servo mismatch", "Match interpolation delays and filters of the axes in the control.")
    search = SearchHints(quasi_static=False, stated=True)

    def apply(self, plant):
        plant.axes[self.subject].delay += self.si("delay_ms")
