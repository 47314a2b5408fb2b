"""Position-loop gain of a drive, as a ratio to the setting."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis

#: A typical size lags as one of a command delay does, 0.1 ms: ratio · 1/Kpp at a usual Kpp of 50/s. The two look alike.
_TYPICAL = 0.005


@register
class ServoGain(Effect):
    kind = "servo_gain"
    subjects = every_axis
    title = "Position gain Kpp off its setting"
    noun = "position gain"
    parameters = (Parameter("ratio", "factor on Kpp", 0.5, 2.0, neutral=1.0, scale=_TYPICAL),)
    definition = "Kpp is multiplied by ratio"
    source = "paper Fig. 2 (Kpp)"
    signature = (
        "The axis lags differently from the others, by v/Kpp·(1 − 1/ratio): ellipses on circles, "
        "inward or outward bulges where it moves fast."
    )
    remedy = Remedy("adjust", "servo mismatch", "Set the position gain to that of the other axes in the control.")
    search = SearchHints(quasi_static=False, stated=True)

    def apply(self, plant):
        plant.axes[self.subject].position_gain *= self.values["ratio"]
