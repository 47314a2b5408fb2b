"""Axial error motion of a rotary axis (ISO 230-7): what it carries goes to and fro along its centreline."""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, rotary_axes
from mjsim.machine.plant import SINE
from mjsim.machine.redundant import MOST_ORDERS


@register
class AxialErrorMotion(Effect):
    kind = "axial_error_motion"
    subjects = rotary_axes
    title = "Axial error motion of a rotary axis"
    parameters = (
        Parameter("amplitude_um", "amplitude of the motion", 0.0, 500.0, neutral=0.0, scale=1.0),
        Parameter("order", "cycles per turn of the axis k", 0.5, 50.0, scale=1.0),
        Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
    )
    definition = "what C carries is displaced by a·cos(kC + φ) along the centreline of C; other axes alike"
    source = "ISO 230-7 (axial error motion)"
    signature = "Waves of k per turn where the bar lies along the axis; the same wherever the ball lies."
    remedy = Remedy("maintain", "", "Check the axial bearing of the axis, its preload and the face it runs on.")
    search = SearchHints(
        free=("amplitude_um", "phase_deg"),
        seeds=[{"amplitude_um": 1.0, "order": float(k)} for k in range(1, MOST_ORDERS + 1)],
        within_tolerance=True,
    )

    def apply(self, plant):
        order, phase = self.values["order"], math.radians(self.values["phase_deg"])
        along = next(m.name for m in plant.chain.motions if m.axis == self.subject and m.axial)
        amplitude = self.si("amplitude_um")
        plant.add_op("straightness", SINE, along, amplitude, order, phase + 0.5 * math.pi, 0.0, source=self.subject)
