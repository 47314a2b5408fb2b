"""Radial error motion of the rotary table (ISO 230-7)."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.plant import SINE


@register
class RadialErrorMotion(Effect):
    kind = "radial_error_motion"
    subjects = ("C",)
    title = "Radial error motion of the rotary table"
    parameters = (
        Parameter("amplitude_um", "radius of the motion", 0.0, 500.0, neutral=0.0, scale=1.0),
        Parameter("order", "cycles per table turn k", -50.0, 50.0, scale=1.0),
        Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "table displaced by a (cos(kC + φ), sin(kC + φ), 0) in the cradle frame"
    source = "ISO 230-7 (radial error motion)"
    signature = "Waves of k ± 1 per turn on cones and circles about C; of order 1 it hides in the ball's offset."

    free = ("amplitude_um", "phase_deg")

    @classmethod
    def seeds(cls, subject):
        """Orders -6 to 6; the order itself is a whole number and stays."""
        return [{"amplitude_um": 1.0, "order": float(k)} for k in range(-6, 7) if k]

    def apply(self, plant):
        a, k, phase = self.si("amplitude_um"), self.values["order"], math.radians(self.values["phase_deg"])
        plant.add_op("straightness", SINE, "EXC", a, k, phase + 0.5 * math.pi, 0.0, source="C")
        plant.add_op("straightness", SINE, "EYC", a, k, phase, 0.0, source="C")
