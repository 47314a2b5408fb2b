"""Limit of a motor's voltage: the faster it turns, the less torque is left."""

from dataclasses import replace

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis


@register
class VoltageLimit(Effect):
    kind = "voltage_limit"
    subjects = every_axis
    for_logs = True
    title = "Voltage limit of a drive"
    noun = "voltage limit"
    parameters = (
        Parameter(
            "no_load_rad_per_s",
            "speed of the motor without load at the largest voltage",
            1e-6,
            1e6,
            neutral=1e6,
            scale=1.0,
            inverse=True,
        ),
        Parameter(
            "stall_Nm",
            "torque of the motor at rest at the largest voltage",
            1e-6,
            1e5,
            scale=0.1,
            default=10.0,
        ),
    )
    definition = "the motor's torque stays between −stall (1 + ω/no_load) and stall (1 − ω/no_load)"
    source = (
        "U = R i + k ω of a motor at the voltage limit of its amplifier, torque k i: Krishnan, Electric Motor Drives "
        "(2001), speed-torque line of a DC motor; a synchronous motor without field weakening is taken as one"
    )
    signature = (
        "The axis falls behind where it is fast, and more so where it has to accelerate there; it brakes as usual."
    )
    remedy = Remedy(
        "adjust",
        "",
        "Check supply and DC link of the amplifier under load. Lower the rapid traverse of the axis, or its "
        "acceleration at high speed.",
    )
    search = SearchHints(quasi_static=False, stated=True, seeds=({"no_load_rad_per_s": 10.0},))

    def apply(self, plant):
        axis = plant.axes[self.subject]
        limit = (self.si("stall_Nm"), 1.0 / self.si("no_load_rad_per_s"))
        axis.control = replace(axis.control, voltage=limit)
