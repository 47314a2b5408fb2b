"""Structural vibration between spindle and table."""

from __future__ import annotations

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, linear_axes
from mjsim.machine.plant import VIBRATE


@register
class Vibration(Effect):
    """``phases`` holds the phase (rad, at the program's start) of every test by name; it is a nuisance of the test, so
    it stands in no
    machine file and is 0 where nothing was measured."""

    kind = "vibration"
    subjects = linear_axes
    search = SearchHints(scanned=True, free=("amplitude_um", "frequency_Hz"))
    title = "Structural vibration at constant frequency"
    parameters = (
        Parameter("amplitude_um", "amplitude between spindle and table", 0.0, 1000.0, neutral=0.0, scale=1.0),
        Parameter("frequency_Hz", "frequency", 0.1, 1000.0, scale=0.01),
    )
    definition = "a sin(2π f t + φ), φ free in every test"
    source = "ISO 230-8 (vibrations); constant frequency and amplitude assumed"
    signature = (
        "A ripple of constant frequency that does not repeat from revolution to revolution, strongest along one axis."
    )
    remedy = Remedy(
        "maintain", "vibration", "Find what vibrates at this frequency: foundation, pump, spindle or another machine."
    )

    def __init__(self, subject, **values):
        super().__init__(subject, **values)
        self.phases: dict[str, float] = {}

    def with_phases(self, phases: dict[str, float]) -> Vibration:
        """The same vibration with the phases of some tests, rad."""
        out = type(self)(self.subject, **self.values)
        out.phases = dict(phases)
        return out

    def replaced(self, **values):
        return super().replaced(**values).with_phases(self.phases)

    def apply(self, plant):
        rate = 2.0 * math.pi * self.values["frequency_Hz"]
        plant.add_op("vibration", VIBRATE, self.subject, self.si("amplitude_um"), rate, phases=self.phases)
