"""Friction that grows with the torque of the motor."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class TorqueLoss(Effect):
    kind = "torque_loss"
    subjects = every_axis
    for_logs = True
    title = "Friction that grows with the torque"
    parameters = (Parameter("share_ratio", "share of the torque that is lost", 0.0, 0.9, neutral=0.0, scale=0.1),)
    definition = "the friction level g(ω) grows by share_ratio·|u|, u: torque of the motor"
    source = (
        "Hamon, Gautier, Garrec and Janot, joint drives with load-dependent friction (AIM 2010); efficiency of a screw "
        "or a gear"
    )
    signature = "More friction while the axis accelerates, brakes or carries, and none of it at a steady speed."
    remedy = Remedy(
        "maintain",
        "",
        "Check nut, gears and their lubrication: the efficiency of the transmission is low.",
        "Check the worm mesh and its lubrication: the efficiency of the transmission is low.",
    )
    search = SearchHints(quasi_static=False, seeds=({"share_ratio": 0.1}, {"share_ratio": 0.3}))

    def apply(self, plant):
        plant.axes[self.subject].torque_loss = self.values["share_ratio"]
