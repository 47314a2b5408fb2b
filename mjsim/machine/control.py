"""What a control does beside the gains of its cascade: sampling, lag, delay, limit, or a law of its own."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

#: Most coefficients of one polynomial of a discrete law.
MOST_COEFFICIENTS = 8


@dataclass(frozen=True)
class Law:
    """A discrete law ``R u = T r − S y`` in place of the cascade; coefficients count back in samples.

    Attributes:
        R: Of the output; the first is not zero.
        S: Of the actual position, output per motor angle.
        T: Of the commanded position, output per motor angle.
    """

    R: tuple[float, ...]
    S: tuple[float, ...]
    T: tuple[float, ...]


@dataclass(frozen=True)
class Control:
    """A digital control; SI, motor side.

    Attributes:
        sample_time: Between two outputs, s; 0: so short that it does not matter.
        torque_lag: Time constant of the first-order lag in the velocity controller, s.
        loop_delay: From sampling to torque, s.
        clip: Largest torque, N·m; infinite: none.
        anti_windup: Whether the integrator stops while the output is at its limit.
        velocity_samples: Samples over which the velocity is taken where there is no lag.
        law: What stands in place of the cascade; then the velocity gain is its torque per unit of output.
        fastest: Largest velocity set-point, rad/s of the motor; infinite: none.
        voltage: Torque of the motor at rest with all the voltage, N·m, and one over its speed without load, s/rad.
        position_sample_time: Between two velocity set-points, s; 0: one at every sample.
    """

    sample_time: float = 0.0
    torque_lag: float = 0.0
    loop_delay: float = 0.0
    clip: float = np.inf
    anti_windup: bool = False
    velocity_samples: int = 1
    law: Law | None = None
    fastest: float = np.inf
    voltage: tuple[float, float] = (np.inf, 0.0)
    position_sample_time: float = 0.0


@dataclass(frozen=True)
class Controller:
    """What one ``[controller.NAME.AXIS]`` table says; names as in :class:`mjsim.machine.model.Drive`.

    Attributes:
        position_gain: Kpp, 1/s.
        velocity_gain: Kvp, N·m·s/rad, or N·m per unit of a law's output.
        integral_time: Ti, s; infinite: no integrator.
        feedforward: Ratio of the velocity feedforward.
        control: The rest.
    """

    position_gain: float
    velocity_gain: float
    integral_time: float = np.inf
    feedforward: float = 0.0
    control: Control = field(default_factory=Control)

    def with_control(self, **changes: float | bool) -> Controller:
        """The same with some numbers of :attr:`control` changed."""
        return replace(self, control=replace(self.control, **changes))
