"""Error motion of a rotary axis, radial and tilt (ISO 230-7): a vector that goes round ``order`` times per turn of the
axis.
"""

import math

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, wobbling_axes
from mjsim.machine.plant import SINE
from mjsim.machine.redundant import visible_orders

_SHAPE = (
    Parameter("order", "cycles per turn of the axis k", -50.0, 50.0, scale=1.0),
    Parameter("phase_deg", "phase", -360.0, 360.0, default=0.0, scale=10.0),
)


def _hints(amplitude: str, size: float) -> SearchHints:
    """Orders -6 to 6 are tried, but for those that are a location error in another form; the order itself is a whole
    number and stays.
    """

    def seeds(subject, chain):
        orders = visible_orders(chain, subject, amplitude.endswith("urad"))
        return [{amplitude: size, "order": float(k)} for k in orders]

    return SearchHints(free=(amplitude, "phase_deg"), seeds=seeds)


def _go_round(effect: Effect, plant, amplitude: float, first: str, second: str) -> None:
    """Enter a vector with the components ``first`` (cosine) and ``second`` (sine)."""
    order, phase = effect.values["order"], math.radians(effect.values["phase_deg"])
    plant.add_op("straightness", SINE, first, amplitude, order, phase + 0.5 * math.pi, 0.0, source=effect.subject)
    plant.add_op("straightness", SINE, second, amplitude, order, phase, 0.0, source=effect.subject)


@register
class RadialErrorMotion(Effect):
    kind = "radial_error_motion"
    subjects = wobbling_axes
    title = "Radial error motion of a rotary axis"
    parameters = (Parameter("amplitude_um", "radius of the motion", 0.0, 500.0, neutral=0.0, scale=1.0), *_SHAPE)
    definition = (
        "what C carries is displaced by a (cos(kC + φ), sin(kC + φ), 0) in the frame that carries C; A and B alike"
    )
    source = "ISO 230-7 (radial error motion)"
    signature = "Waves of k ± 1 per turn on cones and circles about C; of order 1 it hides in the ball's offset."
    remedy = Remedy("maintain", "", "Check the bearing of the axis and its seat.")
    search = _hints("amplitude_um", 1.0)

    def apply(self, plant):
        _go_round(self, plant, self.si("amplitude_um"), *plant.chain.error_motion(self.subject)[:2])


@register
class TiltErrorMotion(Effect):
    kind = "tilt_error_motion"
    subjects = wobbling_axes
    title = "Tilt error motion of a rotary axis"
    parameters = (Parameter("amplitude_urad", "angle of the wobble", 0.0, 5000.0, neutral=0.0, scale=5.0), *_SHAPE)
    definition = (
        "what C carries is turned by a·cos(kC + φ) about x and a·sin(kC + φ) about y of the frame that carries C; "
        "A and B alike"
    )
    source = "ISO 230-7 (tilt error motion)"
    signature = "As radial error motion, growing with the distance of the ball along the axis."
    remedy = Remedy("maintain", "", "Check the bearing of the axis, its preload and clamping.")
    search = _hints("amplitude_urad", 5.0)

    def apply(self, plant):
        _go_round(self, plant, self.si("amplitude_urad"), *plant.chain.error_motion(self.subject)[2:4])
