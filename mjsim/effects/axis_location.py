"""Location errors of the rotary axes (ISO 230-7)."""

from mjsim.effects.registry import register
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect, Parameter, Remedy, location_errors

_SHIFT = (Parameter("value_um", "displacement of the centreline", -5000.0, 5000.0, neutral=0.0, scale=10.0),)
_TILT = (Parameter("value_urad", "rotation of the centreline", -5000.0, 5000.0, neutral=0.0, scale=20.0),)


@register
class AxisLocation(Effect):
    kind = "axis_location"
    subjects = location_errors
    title = "Location error of a rotary axis"
    noun = "location error"
    parameters = _SHIFT
    definition = (
        "p ← R p + shift behind every rotary axis, in the frame that carries it: for C, R = Ry(EB0C) Rx(EA0C) and the "
        "shift (EX0C, EY0C, 0); for A, R = Rz(EC0A) Ry(EB0A) and the shift (0, EY0A, EZ0A)"
    )
    source = "ISO 230-7 and ISO 230-1 (axis location errors); order of rotations: theory page"
    signature = "Once- and twice-per-turn deviations; partly or wholly hidden by the set-up's ball offsets."
    remedy = Remedy(
        "compensate", "", "Measure the rotary axis' centre line again and enter it in the control's kinematics."
    )

    @classmethod
    def parameters_of(cls, subject):
        return _TILT if is_rotary(subject[1]) else _SHIFT

    def apply(self, plant):
        plant.geometry.location[self.subject] = self.si(self.parameters_of(self.subject)[0].name)
