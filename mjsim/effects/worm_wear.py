"""A worn stretch of a worm wheel, on both flanks of its teeth or on one."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, rotary_axes
from mjsim.machine.plant import BUMP


def _seeds(subject, chain):
    """A grid over the places and widths that a cradle or a turning table can show."""
    centres, way = range(0, 360, 10) if subject in chain.round_axes else range(-20, 101, 4), chain.axis(subject).ccw
    return [{"depth_deg": 0.001, "centre_deg": way * c, "width_deg": w} for w in (2.0, 5.0, 12.0) for c in centres]


@register
class WormWear(Effect):
    kind = "worm_wear"
    subjects = rotary_axes
    title = "Local wear of a worm wheel"
    parameters = (
        Parameter("depth_deg", "depth of the worn stretch", -0.1, 0.1, neutral=0.0, scale=0.001),
        Parameter("centre_deg", "axis position of its middle", -360.0, 360.0, scale=1.0),
        Parameter("width_deg", "standard deviation of its shape", 0.2, 90.0, scale=1.0),
        Parameter(
            "direction",
            "one worn flank: it carries only while the axis turns this way",
            kind="choice",
            choices=("CW", "CCW"),
        ),
    )
    definition = (
        "x − depth·exp(−½((x − centre)/width)²), repeating every 360°; with a direction only while the axis turns "
        "that way "
        "(CCW: it turns what it carries counter-clockwise), blended over 0.05° of travel after a reversal"
    )
    source = "paper section 3.1 (deflection blamed on the worm gear); Gaussian shape and blending assumed"
    signature = (
        "A local dent wherever the axis passes the worn stretch: in both directions of motion where both flanks "
        "are worn, "
        "in one where one flank is."
    )
    remedy = Remedy("maintain", "", "Replace or re-cut the worn worm wheel. Until then, use a compensation table.")
    search = SearchHints(free=("depth_deg", "centre_deg", "width_deg"), seeds=_seeds)

    def apply(self, plant):
        shape = self.si("depth_deg"), self.si("centre_deg"), self.si("width_deg")
        plant.add_op("worm_wear", BUMP, self.subject, *shape, self.direction_sign(plant.chain))
