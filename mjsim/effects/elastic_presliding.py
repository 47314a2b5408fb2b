"""Presliding that is elastic up to a share of the friction level."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class ElasticPresliding(Effect):
    kind = "elastic_presliding"
    subjects = every_axis
    for_logs = True
    title = "Presliding that does not creep at rest"
    parameters = (
        Parameter(
            "share_ratio",
            "share of the friction level up to which the bristles do not slip",
            0.0,
            0.98,
            neutral=0.0,
            scale=0.1,
        ),
    )
    definition = "dz/dt = ω − α |ω| σ0 z / g(ω); α = 0 up to share_ratio of the level, 1 at the level, a cosine between"
    source = "Dupont, Hayward, Armstrong, Altpeter 2002 (elasto-plastic friction)"
    signature = "An axis at rest keeps its place while the load swings below the break-away torque."
    remedy = Remedy("share", "reversal spikes", "Rolling guides and seals have it. Friction compensation reduces it.")
    search = SearchHints(quasi_static=False, seeds=({"share_ratio": 0.5},))

    def apply(self, plant):
        plant.axes[self.subject].hold = self.values["share_ratio"]
