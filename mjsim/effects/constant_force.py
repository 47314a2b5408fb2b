"""A constant torque against a motor."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class ConstantForce(Effect):
    kind = "constant_force"
    subjects = every_axis
    for_logs = True
    title = "Constant force on an axis"
    noun = "constant torque"
    parameters = (
        Parameter("torque_Nm", "torque against the motor's positive direction", -200.0, 200.0, neutral=0.0, scale=0.02),
    )
    definition = "τ_gravity grows by torque, also where the integrator does not hold it from the start"
    source = "Janot, Gautier, Brunot 2019 (offset of EMPS); weight, cable drag, amplifier offset"
    signature = (
        "The following error is shifted by the same amount in both directions where no integrator takes it away."
    )
    remedy = Remedy("adjust", "", "Check the counterbalance, and what pulls at the axis: hoses, covers, cables.")
    search = SearchHints(quasi_static=False)

    def apply(self, plant):
        plant.axes[self.subject].gravity += self.si("torque_Nm")
