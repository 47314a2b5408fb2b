"""Friction that rises with the speed and saturates."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class RisingFriction(Effect):
    kind = "rising_friction"
    subjects = every_axis
    for_logs = True
    title = "Friction that rises with the speed and saturates"
    parameters = (
        Parameter("torque_Nm", "friction torque that is added at high speed", 0.0, 200.0, neutral=0.0, scale=0.05),
        Parameter(
            "velocity_rad_per_s", "motor speed at which 63 % of it are there", 1e-3, 1e4, default=20.0, scale=5.0
        ),
    )
    definition = "τ_friction grows by torque·(1 − exp(−|ω|/velocity))·sign(ω)"
    source = (
        "lubricated guideways and nuts: viscous friction that falls as the lubricant warms and shears; form assumed"
    )
    signature = (
        "The friction between slow and fast motion rises less and less: viscous friction alone fits one speed only."
    )
    remedy = Remedy("maintain", "", "Check lubrication and the preload of the bearings.")
    search = SearchHints(
        quasi_static=False,
        free=("torque_Nm", "velocity_rad_per_s"),
        seeds=({"torque_Nm": 0.02, "velocity_rad_per_s": 5.0}, {"torque_Nm": 0.02, "velocity_rad_per_s": 50.0}),
    )

    def apply(self, plant):
        plant.axes[self.subject].rising = (self.si("torque_Nm"), self.si("velocity_rad_per_s"))
