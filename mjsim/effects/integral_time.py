"""Integral time of a velocity controller, as a ratio to the setting."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class IntegralTime(Effect):
    kind = "integral_time"
    subjects = every_axis
    for_logs = True
    title = "Integral time Ti off its setting"
    parameters = (Parameter("ratio", "factor on Ti", 0.02, 50.0, neutral=1.0, scale=0.1),)
    definition = "Ti is multiplied by ratio"
    source = "paper Fig. 2 (Ti)"
    signature = (
        "Errors after a reversal and after a stop die away faster or slower than the sheet says, in every log of the "
        "axis."
    )
    remedy = Remedy("adjust", "reversal spikes", "Set the integral time of the velocity loop in the drive.")
    search = SearchHints(
        quasi_static=False,
        stated=True,
        seeds=({"ratio": 0.5}, {"ratio": 2.0}),
    )

    def apply(self, plant):
        plant.axes[self.subject].integral_time *= self.values["ratio"]
