"""Compliance of a drive's transmission."""

import math

from mjsim.effects.registry import register
from mjsim.machine.bodies import has_model
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect, Parameter, Remedy, SearchHints, every_axis

_DAMPING = Parameter(
    "damping_ratio", "of the load on the spring with the motor held", 1e-3, 2.0, default=0.05, scale=0.05
)
_ROTARY = (
    Parameter(
        "stiffness_Nm_per_urad", "stiffness at the table", 1e-3, math.inf, neutral=math.inf, scale=1.0, inverse=True
    ),
    _DAMPING,
)
_LINEAR = (
    Parameter(
        "stiffness_N_per_um", "stiffness along the slide", 0.1, math.inf, neutral=math.inf, scale=100.0, inverse=True
    ),
    _DAMPING,
)


def _seeds(subject, chain):
    """One typical stiffness; none where the masses of the moving bodies are not known."""
    return [{p.name: p.scale for p in DriveCompliance.parameters_of(subject)}] if has_model(chain) else []


@register
class DriveCompliance(Effect):
    kind = "drive_compliance"
    subjects = every_axis
    title = "Elastic transmission between motor and load"
    noun = "elastic drive"
    parameters = _ROTARY
    definition = (
        "Jm dω/dt = τ − C ω − τ_friction − T, Jl dω_l/dt = T, T = k (θ − θ_l) + 2 ζ √(k Jl) (ω − ω_l); Jl: the "
        "moving bodies, Jm = J − Jl"
    )
    source = "two-mass model of a feed drive (usual servo practice; not in the paper)"
    signature = (
        "The load lags in proportion to its acceleration, and rings after reversals, when the motor breaks free."
    )
    remedy = Remedy(
        "maintain",
        "lateral play",
        "Check coupling, bearings and nut for stiffness.",
        "Check coupling, bearings and worm for stiffness.",
    )
    search = SearchHints(
        quasi_static=False,
        free=("stiffness_Nm_per_urad", "stiffness_N_per_um", "damping_ratio"),
        seeds=_seeds,
    )

    @classmethod
    def parameters_of(cls, subject):
        return _ROTARY if is_rotary(subject) else _LINEAR

    def apply(self, plant):
        plant.add_spring(self.subject, self.si(self.parameters_of(self.subject)[0].name), self.values["damping_ratio"])
