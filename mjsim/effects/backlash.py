"""Backlash: play between motor side and load side."""

from mjsim.effects.registry import register
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect, Parameter, Remedy, every_axis
from mjsim.machine.plant import PLAY

_ROTARY = (Parameter("width_deg", "full width b of the play", 0.0, 1.0, neutral=0.0, scale=0.001),)
_LINEAR = (Parameter("width_um", "full width b of the play (lost motion)", 0.0, 1000.0, neutral=0.0, scale=2.0),)


@register
class Backlash(Effect):
    kind = "backlash"
    subjects = every_axis
    title = "Backlash of an axis"
    parameters = _ROTARY
    definition = "y ← clip(y, x − b/2, x + b/2), starting centred; x motor side, y load side"
    source = "paper section 2.2 and 4.2; ISO 230-2 reversal error"
    signature = "A step at every reversal of the axis; nothing while it turns one way (there it is a constant offset)."
    remedy = Remedy(
        "adjust",
        "backlash",
        "Adjust the preload of nut and bearings. Until then, use the control's backlash compensation.",
        "Adjust the worm mesh or its preload. Until then, use the control's backlash compensation.",
    )

    @classmethod
    def parameters_of(cls, subject):
        return _ROTARY if is_rotary(subject) else _LINEAR

    def apply(self, plant):
        name = self.parameters_of(self.subject)[0].name
        plant.add_op("backlash", PLAY, self.subject, 0.5 * self.si(name))
