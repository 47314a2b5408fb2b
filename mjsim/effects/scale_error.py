"""Scale error of a linear axis (ISO 230-1, linear positioning error growing with travel)."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, linear_axes
from mjsim.machine.plant import SCALE


@register
class ScaleError(Effect):
    kind = "scale_error"
    subjects = linear_axes
    title = "Scale error of a linear axis"
    parameters = (Parameter("ppm", "relative error of the scale or screw", -2000.0, 2000.0, neutral=0.0, scale=20.0),)
    definition = "x·(1 + ppm·1e-6)"
    source = "ISO 230-1 (linear positioning error motion, first order)"
    signature = "An ellipse along the axes on circles; grows with the travel of the axis."
    remedy = Remedy(
        "compensate", "scale mismatch", "Correct the axis' scale by linear compensation. Check temperatures."
    )

    def apply(self, plant):
        plant.add_op("scale_error", SCALE, self.subject, self.si("ppm"))
