"""Position-loop gain of a drive, as a ratio to the setting."""

from typing import ClassVar

from mjsim.effects.registry import register
from mjsim.machine.chain import AXES
from mjsim.machine.effect import Effect, Parameter


@register
class ServoGain(Effect):
    kind = "servo_gain"
    subjects = AXES
    title = "Position gain Kpp off its setting"
    parameters = (Parameter("ratio", "factor on Kpp", 0.5, 2.0, neutral=1.0, scale=0.01),)
    definition = "Kpp is multiplied by ratio"
    source = "paper Fig. 2 (Kpp)"
    signature = (
        "The axis lags differently from the others, by v/Kpp·(1 − 1/ratio): ellipses on circles, "
        "inward or outward bulges where it moves fast."
    )
    quasi_static = False
    tolerances: ClassVar = {"ratio": 0.0003}

    def apply(self, plant):
        plant.axes[self.subject].position_gain *= self.values["ratio"]
