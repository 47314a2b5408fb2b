"""Whether the drives' control loops are stable: an unstable one gives numbers for a while, but none of a machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.errors import SimulationError
from mjsim.machine.control import Control
from mjsim.machine.plant import AxisPlant, Plant
from mjsim.simulation.drive import MOST_SUBSTEPS, PHASE, STEP, bristle_rate, equations
from mjsim.simulation.servo import sampling
from mjsim.simulation.servo_filters import filters

#: A pole may lie outside the unit circle by so much: rounding of a double integrator's two poles at 1, which lie apart
#: by the square root of the precision of a double.
_ON_CIRCLE = 1e-6


def check_stable(plant: Plant, moving: bool = True) -> None:
    """Refuse drives whose linear part grows by itself. Friction cannot save them: it is bounded, the growth is not.

    Args:
        plant: With the drives.
        moving: Whether it is measured in motion. At rest, what only axis logs show of a drive does not matter.

    Raises:
        SimulationError: names the drive and what to change.
    """
    for name, axis in plant.axes.items():
        if what := only_in_logs(axis):
            if not moving:
                continue
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
        "cogging": bool(axis.waves),
        "rest_friction": axis.resting[0] != 0.0,
        "torque_loss": axis.torque_loss != 0.0,
        "encoder_error": axis.encoder_error[0] != 0.0,
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


def check_loop(axis: AxisPlant, place: str, record_step: float) -> None:
    """Refuse the loop of a digital control that grows by itself, as its linear part says.

    Args:
        axis: The drive with the control that ran.
        place: Of its table in the machine file, for the message.
        record_step: Between two samples of the recording, s; for a control that states no sampling time.

    Raises:
        SimulationError: Says which loop it is, how fast it grows, and up to which velocity gain it does not.
    """
    step = sampling(axis, record_step)
    pole = outermost_pole(axis, step)
    if abs(pole) <= 1.0 + _ON_CIRCLE:
        return
    inner = replace(axis, position_gain=0.0)
    law = axis.control.law is not None
    alone = not law and abs(outermost_pole(inner, step)) > 1.0 + _ON_CIRCLE
    what = "law R, S, T" if law else "velocity loop" if alone else "position loop"
    growth, turns = np.log(abs(pole)) / step, abs(float(np.angle(pole))) / (2.0 * np.pi * step)
    sampled = f"sample_time_s = {step:g}" if axis.control.sample_time > 0.0 else f"steps of {step:g} s"
    delay = f", loop_delay_s = {axis.control.loop_delay:g}" if axis.control.loop_delay > 0.0 else ""
    gains = (
        f"torque_per_V = {axis.velocity_gain:.4g}"
        if law
        else f"velocity_gain_Nms_per_rad = {axis.velocity_gain:.4g}, position_gain_per_s = {axis.position_gain:.4g}, "
        f"integral_time_s = {axis.integral_time:.4g}"
    )
    raise SimulationError(
        f"{place}: the {what} swings itself up at {turns:.3g} Hz, e-fold every {1.0 / growth:.2g} s ({gains}, "
        f"{sampled}{delay}, inertia_kgm2 = {axis.inertia:.4g}, effects included); {_remedy(axis, step, law)}"
    )


def outermost_pole(axis: AxisPlant, step: float) -> complex:
    """The pole of the sampled loop that is farthest from 0, with friction left out.

    With q = 1/z, the torque held for one step h moves the motor by

        θ/τ = q [f1² q + f2 (1 − e q)] / (J (1 − q)(1 − e q)),   e = exp(−C h/J),  f1, f2 as in the servo loop,

    and the control answers with τ = −Kvp (1 + h/(2 Ti) (1 + q)/(1 − q)) S(q)/R(q) D(q) θ, D its delay. The poles are
    the roots of the product of the denominators plus that of the numerators.
    """
    R, S, _ = filters(axis, step)
    J, rate = axis.inertia, axis.viscous / axis.inertia
    e = np.exp(-rate * step)
    f1 = (1.0 - e) / rate if rate * step > 1e-9 else step
    f2 = (step - f1) / rate if rate * step > 1e-4 else 0.5 * step**2
    mechanics = np.convolve([1.0, -1.0], [1.0, -e])
    moved = np.convolve([0.0, 1.0], [f2, f1**2 - e * f2]) / J
    gain, below = np.array([axis.velocity_gain]), np.array([1.0])
    if axis.control.law is None and np.isfinite(axis.integral_time):
        half = 0.5 * step / axis.integral_time
        gain, below = axis.velocity_gain * np.array([1.0 + half, half - 1.0]), np.array([1.0, -1.0])
    late = axis.control.loop_delay / step
    whole = int(late)
    delay = np.zeros(whole + 2)
    delay[whole], delay[whole + 1] = 1.0 - (late - whole), late - whole
    left = np.convolve(np.convolve(R, below), mechanics)
    right = np.convolve(np.convolve(np.convolve(S, gain), moved), delay)
    size = max(len(left), len(right))
    # in powers of z, the coefficients in q stand in falling order
    poles = np.roots(np.pad(left, (0, size - len(left))) + np.pad(right, (0, size - len(right))))
    return complex(poles[np.argmax(np.abs(poles))]) if len(poles) else 0.0j


def _remedy(axis: AxisPlant, step: float, law: bool) -> str:
    """What would be stable: another velocity gain, or nothing of that kind."""
    key = "torque_per_V" if law else "velocity_gain_Nms_per_rad"
    factors = np.concatenate([np.geomspace(1.0, 1e-4, 200), np.geomspace(1.0, 1e4, 200)])
    for f in factors:
        if abs(outermost_pole(replace(axis, velocity_gain=f * axis.velocity_gain), step)) <= 1.0 + _ON_CIRCLE:
            return f"stable with these: {key} {'below' if f < 1.0 else 'above'} about {f * axis.velocity_gain:.2g}"
    return "no velocity gain makes it stable: check the other numbers, above all their units"
