"""Friction that depends on where an axis stands."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis

#: Travel for which the shares are stated: 100 mm, or 1 rad of a rotary axis.
REFERENCE = {False: 0.1, True: 1.0}


@register
class FrictionPosition(Effect):
    kind = "friction_position"
    subjects = every_axis
    for_logs = True
    title = "Friction that depends on the position"
    noun = "friction by position"
    parameters = (
        Parameter("linear_ratio", "relative change of the friction level over 100 mm or 1 rad", -5.0, 5.0, neutral=0.0),
        Parameter("quadratic_ratio", "the same, by the square of the travel", -5.0, 5.0, neutral=0.0),
    )
    definition = (
        "the friction level g(ω) is multiplied by 1 + linear_ratio·u + quadratic_ratio·u², u = q/100 mm or q/1 rad, "
        "and stays above a tenth of itself"
    )
    source = "preload of nuts and guideways that varies along the travel; form assumed"
    signature = "Errors after reversals have another size at another place; between them the error changes slowly."
    remedy = Remedy(
        "maintain",
        "reversal spikes",
        "Check screw, guideway and lubrication where the friction is high.",
        "Check worm, bearing and lubrication where the friction is high.",
    )
    search = SearchHints(quasi_static=False)

    def apply(self, plant):
        axis = plant.axes[self.subject]
        way = axis.gear * REFERENCE[plant.chain.is_rotary(self.subject)]
        axis.by_position = (self.values["linear_ratio"] / way, self.values["quadratic_ratio"] / way**2)
