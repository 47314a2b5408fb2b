"""Pitch error of a worm gear or ball screw: a sum of sines of the axis position."""

import math

from mjsim.effects.registry import register
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis
from mjsim.machine.plant import SINE
from mjsim.units import DEG, UM

_ROTARY = (
    Parameter("components", "[order per table turn, amplitude °, phase °]", upper=1.0, kind="components", scale=0.001),
    Parameter("direction", "acts only while the axis turns this way", kind="choice", choices=("CW", "CCW")),
)
_LINEAR = (
    Parameter(
        "components", "[order per screw turn, amplitude µm, phase °]", upper=1000.0, kind="components", scale=1.0
    ),
)


@register
class PitchError(Effect):
    kind = "pitch_error"
    subjects = every_axis
    search = SearchHints(scanned=True, free=("components",))
    title = "Pitch error of a worm gear or ball screw"
    parameters = _ROTARY
    definition = "x + Σ W sin(N x + φ), N peaks per table turn (linear axes: per screw turn, 2π N x / lead)"
    source = "paper eq. 1; direction-dependent sets as in section 2.3, blended over 0.05° of travel (assumed)"
    signature = "Waves tied to the axis position: short where the axis moves fast, mirrored where it turns back."
    remedy = Remedy(
        "compensate",
        "cyclic error",
        "Enter a pitch-error compensation table. Check how the screw or the encoder is seated.",
        "Enter a pitch-error compensation table. Check how the worm or the encoder is seated.",
    )

    @classmethod
    def parameters_of(cls, subject):
        return _ROTARY if is_rotary(subject) else _LINEAR

    def apply(self, plant):
        rotary = is_rotary(self.subject)
        for order, amplitude, phase in self.values["components"]:
            if amplitude:
                wave = order if rotary else order * plant.axes[self.subject].gear
                size = amplitude * (DEG if rotary else UM)
                plant.add_op(
                    "pitch_error", SINE, self.subject, size, wave, math.radians(phase), self.direction_sign(plant.chain)
                )
