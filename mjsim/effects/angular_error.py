"""Angular errors of the linear axes: roll, pitch and yaw of a slide (ISO 230-1 component errors)."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, angular_errors
from mjsim.machine.plant import POLYNOMIAL, SCALE

#: Travel over which the coefficients are given, m.
_REFERENCE = 0.1


@register
class AngularError(Effect):
    kind = "angular_error"
    subjects = angular_errors
    title = "Angular error of a linear axis"
    noun = "angular error"
    parameters = (
        Parameter("linear_urad", "turn over 100 mm of travel", -2000.0, 2000.0, neutral=0.0, scale=10.0),
        Parameter(
            "quadratic_urad", "curved part over 100 mm of travel", -2000.0, 2000.0, neutral=0.0, default=0.0, scale=10.0
        ),
    )
    definition = (
        "roll, pitch, yaw: the slide of the last letter's axis turns by linear·(x/0.1 m) + quadratic·(x/0.1 m)² about "
        "the second letter's coordinate (A: X, B: Y, C: Z) and its functional point, with everything that it carries"
    )
    source = "ISO 230-1 (angular error motion, functional point), polynomial form assumed"
    signature = (
        "At one place of the ball as scale, squareness and straightness; it differs in size from place to place, with "
        "the arm from the functional point."
    )
    remedy = Remedy(
        "adjust",
        "volumetric",
        "Level the machine and align the guideway, or enter a volumetric compensation table.",
    )
    search = SearchHints(
        free=("linear_urad", "quadratic_urad"),
        seeds=[{"linear_urad": 10.0, "quadratic_urad": 0.0}],
        within_tolerance=True,
    )

    def apply(self, plant):
        axis = self.subject[2]
        plant.add_op("straightness", SCALE, self.subject, self.si("linear_urad") / _REFERENCE, source=axis)
        quadratic = self.si("quadratic_urad")
        plant.add_op("straightness", POLYNOMIAL, self.subject, quadratic, 0.0, _REFERENCE, source=axis)
