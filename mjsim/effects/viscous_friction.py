"""Viscous friction of a drive, as a ratio to the data sheet."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class ViscousFriction(Effect):
    kind = "viscous_friction"
    subjects = every_axis
    title = "Viscous friction off its data-sheet value"
    parameters = (Parameter("ratio", "factor on C", 0.0, 20.0, neutral=1.0, scale=0.5),)
    definition = "C is multiplied by ratio"
    source = "paper Fig. 2 (C); ratio assumed"
    signature = (
        "A following error that grows with the axis' speed and fades within Ti; barely visible while the "
        "integrator has time."
    )
    remedy = Remedy("maintain", "", "Check lubrication, seals and temperature of the axis.")
    search = SearchHints(quasi_static=False, stated=True)

    def apply(self, plant):
        plant.axes[self.subject].viscous *= self.values["ratio"]
