"""Types of MuJoCo's rollouts, as far as mjsim uses them: states and sensors of whole runs, arrays (runs, steps,
size).
"""

from collections.abc import Sequence

import numpy as np

from . import MjData, MjModel

def rollout(
    model: MjModel, data: MjData, initial_state: np.ndarray, control: np.ndarray
) -> tuple[np.ndarray, np.ndarray]: ...

class Rollout:
    def __init__(self, *, nthread: int) -> None: ...
    def rollout(
        self,
        model: Sequence[MjModel],
        data: Sequence[MjData],
        initial_state: np.ndarray,
        control: np.ndarray,
        *,
        control_spec: int = ...,
        skip_checks: bool = ...,
        nstep: int | None = ...,
        state: np.ndarray | None = ...,
        sensordata: np.ndarray | None = ...,
    ) -> tuple[np.ndarray, np.ndarray]: ...
