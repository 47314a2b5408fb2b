"""Compliance of a drive's transmission."""

import math

from mjsim.effects.registry import register
from mjsim.machine.chain import AXES, ROTARY
from mjsim.machine.effect import Effect, Parameter

_DAMPING = Parameter("damping_ratio", "of the load on the spring with the motor held", 1e-3, 2.0, default=0.05, scale=0.05)
_ROTARY = (
    Parameter("stiffness_Nm_per_urad", "stiffness at the table", 1e-3, math.inf, neutral=math.inf, scale=1.0, inverse=True),
    _DAMPING,
)
_LINEAR = (
    Parameter("stiffness_N_per_um", "stiffness along the slide", 0.1, math.inf, neutral=math.inf, scale=100.0, inverse=True),
    _DAMPING,
)


@register
class DriveCompliance(Effect):
    kind = "drive_compliance"
    subjects = AXES
    title = "Elastic transmission between motor and load"
    parameters = _ROTARY
    definition = (
        "Jm dω/dt = τ − C ω − τ_friction − T, Jl dω_l/dt = T, T = k (θ − θ_l) + 2 ζ √(k Jl) (ω − ω_l); Jl: the moving bodies, Jm = J − Jl"
    )
    source = "two-mass model of a feed drive (usual servo practice; not in the paper)"
    signature = "The load lags in proportion to its acceleration, and rings after reversals, when the motor breaks free."
    quasi_static = False

    @classmethod
    def parameters_of(cls, subject):
        return _ROTARY if subject in ROTARY else _LINEAR

    @classmethod
    def free_of(cls, subject):
        return tuple(p.name for p in cls.parameters_of(subject))

    @classmethod
    def seeds(cls, subject):
        return [{cls.parameters_of(subject)[0].name: cls.parameters_of(subject)[0].scale, "damping_ratio": 0.05}]

    def apply(self, plant):
        plant.add_spring(self.subject, self.si(self.parameters_of(self.subject)[0].name), self.values["damping_ratio"])
