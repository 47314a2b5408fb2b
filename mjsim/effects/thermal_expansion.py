"""Thermal expansion between spindle and table that follows a temperature sensor."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, linear_axes


@register
class ThermalExpansion(Effect):
    kind = "thermal_expansion"
    subjects = linear_axes
    title = "Thermal expansion between spindle and table, by a temperature sensor"
    parameters = (
        Parameter("expansion_um_per_K", "displacement per kelvin", -1000.0, 1000.0, neutral=0.0, scale=1.0),
        Parameter("sensor", "column of temperature.csv", kind="sensor"),
    )
    definition = "a (T − T(0)), T of one sensor on the campaign clock; several sensors add up"
    source = "ISO 230-3 (thermal distortion); linear in temperatures, as compensations of controls are"
    signature = "The circle's centre wanders as the temperature of a sensor does."
    remedy = Remedy(
        "compensate",
        "thermal compensation",
        "Enter the displacement per kelvin into the temperature compensation of the control, with the other sign. "
        "Check cooling.",
    )
    # steel grows by 11 µm/m K: what lies between sensor and tool is at most 0.9 m of it in 19 of 20 machines
    search = SearchHints(width=5.0)

    def apply(self, plant):
        if plant.temperatures is not None:  # without a record nothing has warmed up
            time, rise = plant.temperatures.rise(self.values["sensor"])
            plant.follow("thermal_expansion", self.subject, self.si("expansion_um_per_K"), time, rise)
