"""Tilt error motion of the rotary table (ISO 230-7)."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.plant import SINE


@register
class TiltErrorMotion(Effect):
    kind = "tilt_error_motion"
    subjects = ("C",)
    title = "Tilt error motion of the rotary table"
    parameters = (
        Parameter("amplitude_urad", "angle of the wobble", 0.0, 5000.0, neutral=0.0, scale=5.0),
        Parameter("order", "cycles per table turn k", -50.0, 50.0, scale=1.0),
        Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "table turned by a·cos(kC + φ) about cradle x and a·sin(kC + φ) about cradle y"
    source = "ISO 230-7 (tilt error motion)"
    signature = "As radial error motion, growing with the ball's height above the A centreline."

    free = ("amplitude_urad", "phase_deg")

    @classmethod
    def seeds(cls, subject):
        """Orders -6 to 6; the order itself is a whole number and stays."""
        return [{"amplitude_urad": 5.0, "order": float(k)} for k in range(-6, 7) if k]

    def apply(self, plant):
        a, k, phase = self.si("amplitude_urad"), self.values["order"], math.radians(self.values["phase_deg"])
        plant.add_op("straightness", SINE, "EAC", a, k, phase + 0.5 * math.pi, 0.0, source="C")
        plant.add_op("straightness", SINE, "EBC", a, k, phase, 0.0, source="C")
