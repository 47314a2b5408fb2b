"""Velocity feedforward of a drive."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class VelocityFeedforward(Effect):
    kind = "velocity_feedforward"
    subjects = every_axis
    title = "Velocity feedforward"
    parameters = (Parameter("ratio", "share of dr/dt added to ω_ref", -1.0, 2.0, neutral=0.0, scale=0.05),)
    definition = "ω_ref + ratio·dr/dt"
    source = "usual servo practice; not in the paper"
    signature = "The axis' following error shrinks by ratio: it runs ahead of axes without feedforward."
    remedy = Remedy("adjust", "servo mismatch", "Set the same feedforward on all axes in the control.")
    search = SearchHints(quasi_static=False, stated=True, least=0.1, looks_like=("servo_delay",))

    def apply(self, plant):
        plant.axes[self.subject].feedforward += self.values["ratio"]
