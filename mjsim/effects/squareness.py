"""Squareness between linear axes (ISO 230-1)."""

from mjsim.effects.base import Effect, Parameter
from mjsim.effects.registry import register


@register
class Squareness(Effect):
    kind = "squareness"
    subjects = ("XY", "YZ", "ZX")
    title = "Squareness error between two linear axes"
    parameters = (Parameter("angle_urad", "angle α off 90°", -5000.0, 5000.0, neutral=0.0, scale=20.0),)
    definition = "spindle ball relative to the table displaced: XY: ΔX = −α·Y; YZ: ΔY = −α·Z; ZX: ΔX = +α·Z"
    source = "ISO 230-1 (perpendicularity of axes of linear motion)"
    signature = "A two-lobed ellipse at 45° on circles of that plane."

    def act(self, plant):
        plant.geometry.squareness[self.subject] = self.si("angle_urad")

    def edit_model(self, model):
        """Turns the joint axis. The compiler would normalise it and so scale the travel by 1 + α²/2."""
        joint, row, sign = {"XY": ("Y", 0, 1.0), "YZ": ("Z", 1, -1.0), "ZX": ("Z", 0, 1.0)}[self.subject]
        # the Y slide carries the table: moving it by +α is moving the spindle ball by −α relative to it
        model.joint(joint).axis[row] += sign * self.si("angle_urad")
