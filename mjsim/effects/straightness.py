"""Straightness errors of the linear axes (ISO 230-1 component errors)."""

from mjsim.effects.registry import register
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, straightness_errors
from mjsim.machine.plant import POLYNOMIAL
from mjsim.units import UM

#: Travel over which the coefficients are given, m.
_REFERENCE = 0.1


@register
class Straightness(Effect):
    kind = "straightness"
    subjects = straightness_errors
    title = "Straightness error of a linear axis"
    noun = "straightness error"
    parameters = (
        Parameter("quadratic_um", "bow over 100 mm of travel", -200.0, 200.0, neutral=0.0, scale=2.0),
        Parameter("cubic_um", "S-shape over 100 mm of travel", -200.0, 200.0, neutral=0.0, default=0.0, scale=2.0),
    )
    definition = (
        "displacement quadratic·(x/0.1 m)² + cubic·(x/0.1 m)³ in the first letter's direction, x the second "
        "letter's axis"
    )
    source = "ISO 230-1 (straightness error motion), polynomial form assumed"
    signature = (
        "Three-lobed (quadratic) or two- and four-lobed (cubic) shapes on circles; tied to the position of one axis."
    )
    remedy = Remedy("compensate", "straightness", "Align the guideway, or enter a straightness compensation table.")
    search = SearchHints(free=("quadratic_um", "cubic_um"), seeds=[{"quadratic_um": 2.0, "cubic_um": 0.0}])

    def apply(self, plant):
        axis = self.subject[2]
        plant.add_op(
            "straightness",
            POLYNOMIAL,
            plant.chain.straightness_column(self.subject),
            self.values["quadratic_um"] * UM,
            self.values["cubic_um"] * UM,
            _REFERENCE,
            source=axis,
        )
