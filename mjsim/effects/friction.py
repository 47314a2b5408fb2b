"""Friction torque on the motor (LuGre)."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis

#: Stribeck velocities from which a diagnosis starts, rad/s on the motor: sticking that fades at once, and up to
#: ordinary feeds.
_STRIBECK = (0.3, 2.0, 10.0)


def _variants(friction):
    """The same friction with a break-away torque that is wrong."""
    free = ("coulomb_Nm", "static_ratio", "stribeck_velocity_rad_per_s")
    return [(friction.replaced(stribeck_velocity_rad_per_s=w), free) for w in _STRIBECK]


@register
class Friction(Effect):
    kind = "friction"
    subjects = every_axis
    title = "Friction of a drive"
    parameters = (
        Parameter("coulomb_Nm", "Coulomb torque Tc on the motor", 0.0, 200.0, neutral=0.0, scale=0.1),
        Parameter(
            "presliding_rad",
            "motor angle over which the bristles stretch to Tc",
            1e-5,
            1.0,
            default=0.003,
            scale=0.0003,
        ),
        Parameter("static_ratio", "break-away torque over Coulomb torque", 1.0, 5.0, default=1.0, scale=0.1),
        Parameter(
            "stribeck_velocity_rad_per_s",
            "motor speed at which the static surplus fades",
            1e-4,
            1e3,
            default=1.0,
            scale=0.5,
            log=True,
        ),
    )
    definition = (
        "dz/dt = ω − |ω| σ0 z / g(ω), τ_friction = σ0 z + σ1 dz/dt, σ0 = Tc/presliding, σ1 = 0.3 √(σ0 J), "
        "g(ω) = Tc [1 + (static_ratio − 1) exp(−(ω/ω_s)²)]"
    )
    source = "Canudas de Wit et al. 1995 (LuGre); paper section 2.2 (f in Fig. 2); σ1 assumed"
    signature = (
        "A quadrant glitch at each reversal of the axis; its height grows with Tc, its length with the presliding "
        "angle."
    )
    remedy = Remedy(
        "share", "reversal spikes", "Every drive has friction. Lubrication and friction compensation reduce it."
    )
    search = SearchHints(
        quasi_static=False,
        free=("coulomb_Nm",),
        variants=_variants,
    )

    def apply(self, plant):
        axis = plant.axes[self.subject]
        axis.coulomb, axis.presliding = self.si("coulomb_Nm"), self.si("presliding_rad")
        if self.values["static_ratio"] > 1.0:
            axis.static_ratio, axis.stribeck_velocity = (
                self.values["static_ratio"],
                self.si("stribeck_velocity_rad_per_s"),
            )
