"""Friction that is larger after a rest."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class RestFriction(Effect):
    kind = "rest_friction"
    subjects = every_axis
    for_logs = True
    title = "Friction that is larger after a rest"
    parameters = (
        Parameter("excess_ratio", "excess after a long rest, over the level", 0.0, 20.0, neutral=0.0, scale=0.1),
        Parameter("way_rad", "motor angle over which 63 % of it go", 1e-5, 100.0, default=0.05, scale=0.05),
        Parameter("rest_s", "time at rest in which 63 % of it form again", 1e-3, 1e5, default=10.0, scale=5.0),
    )
    definition = (
        "the friction level g(ω) is multiplied by 1 + excess_ratio·s, ds/dt = (1 − s)/rest − s·|ω|/way; s is 1 where "
        "an axis rests at the start of a recording"
    )
    source = (
        "Dieterich, J. Geophys. Res. 84 (1979) 2161: friction grows with the time of contact, and a way of sliding "
        "renews it; exponential form assumed"
    )
    signature = "An axis that rested starts late and with a jerk. A reversal without a rest does not show it."
    remedy = Remedy(
        "maintain",
        "",
        "Check the lubrication of guideways and nut, and the preload.",
        "Check the lubrication of bearing and worm, and the preload.",
    )
    search = SearchHints(
        quasi_static=False,
        free=("excess_ratio", "way_rad"),
        seeds=({"excess_ratio": 0.3, "way_rad": 0.01}, {"excess_ratio": 0.3, "way_rad": 0.1}),
    )

    def apply(self, plant):
        plant.axes[self.subject].resting = (self.values["excess_ratio"], self.si("way_rad"), self.si("rest_s"))
