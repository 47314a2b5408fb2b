"""One reading of an R-test, what was recorded, and the nest.

A nest of three sensors in the spindle reads where the centre of a sphere on the table is, while the rotary axes turn
and the tool centre follows the sphere. Each coordinate is a reading of its own: a ball-bar test with a sensor that does
not turn with the bar. The three share their clock, the place of the sphere, and the nest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mjsim.instruments.ball_bar.measurement import BallBarTest, Trace

#: RMS of one sample of an ordinary nest, m (assumed: incremental or inductive sensors, axes under servo control).
USUAL_NOISE = 0.2e-6


@dataclass(frozen=True)
class SphereReading(BallBarTest):
    """One coordinate of an R-test: how far the sphere's centre is from the tool centre point, machine frame.

    ``table_ball`` is the nominal centre of the sphere in the work frame, and ``length`` is 0: the tool centre follows
    it. The name is that of the recording with ``.dx``, ``.dy`` or ``.dz`` behind.
    """

    instrument: ClassVar[str] = "r_test"

    @property
    def recording(self) -> str:
        """Name of the R-test."""
        return self.name.rpartition(".")[0]


@dataclass(frozen=True)
class NestTrace(Trace):
    """What was recorded, for one of its coordinates.

    Attributes:
        vector: All three coordinates, (n, 3) m.
    """

    vector: np.ndarray = ()  # type: ignore[assignment]


@dataclass(frozen=True)
class Nest:
    """Numbers of the instrument. Its gains and angles are fitted, so that none of them is an error beside the fit.

    Attributes:
        resolution: Of a reading, m.
        range: Largest reading, m.
        rate: Samples per second, Hz.
        repeatability: Standard deviation of one sample, each coordinate, m; ``None`` where nobody states it.
    """

    resolution: float = 0.1e-6
    range: float = 1.0e-3
    rate: float = 200.0
    repeatability: float | None = None
    certificate: ClassVar[str] = ""
    gain_uncertainty: ClassVar[float] = 0.0
    form: ClassVar[float] = 0.0
    hysteresis: ClassVar[float] = 0.0

    @property
    def noise_stated(self) -> bool:
        """Whether the user states the noise of a sample."""
        return self.repeatability is not None

    @property
    def usual_noise(self) -> float:
        """RMS of one sample where no test repeats its revolution, m."""
        return USUAL_NOISE if self.repeatability is None else self.repeatability

    @property
    def source(self) -> str:
        """From what its errors are known."""
        return "fitted: gains and angles of the nest are unknowns of the fit"
