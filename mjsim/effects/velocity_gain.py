"""Velocity-loop gain of a drive, as a ratio to the setting."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class VelocityGain(Effect):
    kind = "velocity_gain"
    subjects = every_axis
    title = "Velocity gain Kvp off its setting"
    parameters = (Parameter("ratio", "factor on Kvp", 0.1, 5.0, neutral=1.0, scale=0.05),)
    definition = "Kvp is multiplied by ratio"
    source = "paper Fig. 2 (Kvp)"
    signature = "Quadrant glitches change by 1/ratio in height, much like a change of friction."
    remedy = Remedy("adjust", "reversal spikes", "Tune the velocity loop in the drive.")
    search = SearchHints(quasi_static=False, stated=True)

    def apply(self, plant):
        plant.axes[self.subject].velocity_gain *= self.values["ratio"]
