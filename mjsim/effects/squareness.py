"""Squareness between linear axes (ISO 230-1)."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, axis_pairs


@register
class Squareness(Effect):
    kind = "squareness"
    subjects = axis_pairs
    title = "Squareness error between two linear axes"
    noun = "squareness error"
    parameters = (Parameter("angle_urad", "angle α off 90°", -5000.0, 5000.0, neutral=0.0, scale=20.0),)
    definition = "spindle ball relative to the table displaced: XY: ΔX = −α·Y; YZ: ΔY = −α·Z; ZX: ΔX = +α·Z"
    source = "ISO 230-1 (perpendicularity of axes of linear motion)"
    signature = "A two-lobed ellipse at 45° on circles of that plane."
    remedy = Remedy("adjust", "squareness", "Align the guideways, or enter a squareness compensation.")

    def apply(self, plant):
        plant.geometry.squareness[self.subject] = self.si("angle_urad")
