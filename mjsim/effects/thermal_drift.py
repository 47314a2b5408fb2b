"""Thermal drift between spindle and table."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, linear_axes
from mjsim.machine.plant import SETTLE


@register
class ThermalDrift(Effect):
    kind = "thermal_drift"
    subjects = linear_axes
    title = "Thermal drift between spindle and table"
    parameters = (
        Parameter("amplitude_um", "final displacement", -1000.0, 1000.0, neutral=0.0, scale=5.0),
        Parameter("time_constant_s", "time constant of the warm-up", 5.0, 20000.0, default=600.0, scale=60.0, log=True),
    )
    definition = "a (1 − exp(−t/τ)), t on the campaign clock"
    source = "ISO 230-3 (thermal drift); first-order warm-up assumed"
    signature = "The circle's centre wanders from revolution to revolution and from test to test, against the clock."
    remedy = Remedy(
        "maintain", "", "Warm the machine up before measuring and cutting. Check cooling and thermal compensation."
    )
    search = SearchHints(
        free=("amplitude_um", "time_constant_s"),
        seeds=[{"amplitude_um": 5.0, "time_constant_s": t} for t in (60.0, 180.0, 500.0, 1500.0, 5000.0)],
    )

    def apply(self, plant):
        plant.add_op("thermal_drift", SETTLE, self.subject, self.si("amplitude_um"), self.si("time_constant_s"))
