"""Whether the drives' control loops are stable: an unstable one gives numbers for a while, but none of a machine."""

from __future__ import annotations

import numpy as np

from mjsim.errors import SimulationError
from mjsim.machine.control import Control
from mjsim.machine.plant import AxisPlant, Plant
from mjsim.simulation.drive import MOST_SUBSTEPS, PHASE, STEP, bristle_rate, equations


def check_stable(plant: Plant) -> None:
    """Refuse drives whose linear part grows by itself. Friction cannot save them: it is bounded, the growth is not.

    Raises:
        SimulationError: names the drive and what to change.
    """
    for name, axis in plant.axes.items():
        if what := only_in_logs(axis):
            raise SimulationError(
                f"drive {name}: {what} is simulated for axis logs only; take it out of the machine file for ball-bar "
                f"tests"
            )
        if STEP * bristle_rate(axis) > PHASE * MOST_SUBSTEPS:
            least = axis.coulomb / (axis.inertia - axis.load_inertia) * (STEP / PHASE / MOST_SUBSTEPS) ** 2
            raise SimulationError(
                f"drive {name}: friction with {axis.coulomb:.4g} N·m over presliding_rad = {axis.presliding:.4g} "
                f"makes the motor's "
                f"{axis.inertia - axis.load_inertia:.4g} kg·m² swing faster than can be simulated; "
                f"allowed with these: presliding_rad above {least:.4g}"
            )
        if axis.load_inertia:
            growth = float(np.linalg.eigvals(equations(axis)[0]).real.max())
            if growth > 0.0:
                raise SimulationError(
                    f"drive {name}: the control loop swings itself up on the elastic transmission, e-fold every "
                    f"{1.0 / growth:.2g} s "
                    f"(position gain {axis.position_gain:.4g} 1/s, velocity gain {axis.velocity_gain:.4g} "
                    f"N·m·s/rad, effects included); "
                    f"lower the gains, or raise stiffness and damping of drive_compliance.{name}"
                )
        elif (least := least_velocity_gain(axis)) >= axis.velocity_gain:
            raise SimulationError(
                f"drive {name}: the control loop swings itself up: velocity gain {axis.velocity_gain:.4g} "
                f"N·m·s/rad is too small for "
                f"position gain {axis.position_gain:.4g} 1/s and integral time {axis.integral_time:.4g} s (effects "
                f"included); "
                f"allowed with these: above {least:.4g}"
            )


def only_in_logs(axis: AxisPlant) -> str:
    """What a drive has that the simulation of a ball-bar test cannot compute, for a message; empty where nothing."""
    control = Control(sample_time=axis.control.sample_time)
    found = {
        "a control with lag, delay, limit or a law of its own": axis.control != control,
        "friction_direction": axis.asymmetry != 0.0,
        "friction_ripple": axis.friction_ripple[0] != 0.0,
        "cogging": bool(axis.waves),
        "friction_position": any(axis.by_position),
        "rest_friction": axis.resting[0] != 0.0,
        "rising_friction": axis.rising[0] != 0.0,
        "viscous_direction": axis.viscous_share != 0.0,
        "elastic_presliding": axis.hold != 0.0,
        "a controller without an integrator": not np.isfinite(axis.integral_time),
    }
    return next((what for what, there in found.items() if there), "")


def least_velocity_gain(axis: AxisPlant) -> float:
    """The velocity gain at which the loop of a rigid drive begins to swing itself up, N·m·s/rad; stable above (Routh).

    The loop is J s³ + (C + Kvp) s² + Kvp (Kpp + 1/Ti) s + Kvp Kpp/Ti.
    """
    return axis.inertia * axis.position_gain / (1.0 + axis.position_gain * axis.integral_time) - axis.viscous
