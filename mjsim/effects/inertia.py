"""Inertia of an axis, as a ratio to the data sheet."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class Inertia(Effect):
    kind = "inertia"
    subjects = every_axis
    for_logs = True
    title = "Inertia off the data sheet"
    parameters = (Parameter("ratio", "factor on the inertia of the whole axis", 0.05, 20.0, neutral=1.0, scale=0.05),)
    definition = "J is multiplied by ratio"
    source = "paper Fig. 2 (J); a load that the data sheet does not have"
    signature = "The error while the axis accelerates has another size, and overshoot after it another frequency."
    remedy = Remedy("adjust", "", "Identify the drive with the present load, and tune the loops for it.")
    search = SearchHints(quasi_static=False, stated=True)

    def apply(self, plant):
        plant.axes[self.subject].inertia *= self.values["ratio"]
