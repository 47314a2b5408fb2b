"""Viscous friction that is larger in one direction."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class ViscousDirection(Effect):
    kind = "viscous_direction"
    subjects = every_axis
    for_logs = True
    title = "Viscous friction that depends on the direction"
    noun = "viscous friction by direction"
    parameters = (
        Parameter(
            "share_ratio",
            "share by which it is larger in the positive direction and smaller in the other",
            -0.95,
            0.95,
            neutral=0.0,
            scale=0.05,
        ),
    )
    definition = "C is multiplied by 1 + share_ratio·sign(ω)"
    source = "asymmetric viscous friction, as for asymmetric Coulomb friction (Armstrong-Hélouvry 1991, section 2)"
    signature = "The following error differs between the two directions by an amount that grows with the speed."
    remedy = Remedy(
        "maintain",
        "",
        "Check wipers, nut and guideway lubrication: one direction drags more than the other.",
        "Check seals, worm and bearing lubrication: one direction drags more than the other.",
    )
    search = SearchHints(quasi_static=False)

    def apply(self, plant):
        plant.axes[self.subject].viscous_share += self.values["share_ratio"]
