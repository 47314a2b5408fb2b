"""Friction that is larger in one direction."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class FrictionDirection(Effect):
    kind = "friction_direction"
    subjects = every_axis
    for_logs = True
    title = "Friction that depends on the direction"
    noun = "friction by direction"
    parameters = (
        Parameter(
            "share_ratio",
            "share by which the level is larger in the positive direction and smaller in the other",
            -0.9,
            0.9,
            neutral=0.0,
            scale=0.05,
        ),
    )
    definition = "the friction level g(ω) is multiplied by 1 + share_ratio·sign(ω)"
    source = "preload and lubrication of nuts and guideways; asymmetric Coulomb friction"
    signature = (
        "Errors after reversals differ between the two directions; while the axis moves it acts as a constant force."
    )
    remedy = Remedy(
        "maintain", "reversal spikes", "Check seals, covers and wipers, and the counterbalance of the axis."
    )
    search = SearchHints(quasi_static=False)

    def apply(self, plant):
        plant.axes[self.subject].asymmetry += self.values["share_ratio"]
