"""What an identification of pitch errors says: per direction the curves, the spectrum, the components, and how sure
they are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mjsim.inference.nuisance import TRIGGER
from mjsim.inference.pitch.parts import Alternation, Component, LocalFault
from mjsim.io.extras import need
from mjsim.machine.effect import Effect

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class DirectionIdentification:
    """One axis turning in one direction.

    Attributes:
        tests: names; the curves are those of the first. arc_deg, resolution (peaks per turn), tooth_order.
        position_deg, raw_deg, modified_deg, identified_deg: (n,) actual axis position and the curves over it, degrees:
        reading over radius; without decentering, backlash offset, local faults and all below the tooth order; sum of
        the components. at_reversal: (n,) bool, where a linear axis turns back and its friction makes a glitch. orders,
        amplitude_deg, floor_deg, limit_deg: (m,) spectrum of the modified curve, the amplitude that noise alone gives
        (RMS), and the one that a component must exceed. trigger_ci95_ms: half width of each test's trigger shift.
        feed_mm_min, duration_s: of the first test. tilts: whether the axis tilts the table.
    """

    axis: str
    direction: str
    tests: tuple[str, ...]
    arc_deg: float
    resolution: float
    tooth_order: int
    position_deg: np.ndarray
    raw_deg: np.ndarray
    modified_deg: np.ndarray
    identified_deg: np.ndarray
    at_reversal: np.ndarray
    orders: np.ndarray
    amplitude_deg: np.ndarray
    floor_deg: np.ndarray
    limit_deg: np.ndarray
    components: tuple[Component, ...]
    alternating: tuple[Alternation, ...]
    faults: tuple[LocalFault, ...]
    trigger_ci95_ms: dict[str, float]
    feed_mm_min: float
    duration_s: float
    tilts: bool

    @property
    def noise_floor_deg(self) -> float:
        """Amplitude that noise alone gives (RMS), median over the orders from the tooth order on."""
        return float(np.median(self.floor_deg[self.orders >= self.tooth_order]))

    @property
    def detection_limit_deg(self) -> float:
        """Amplitude that a component must exceed, median over the orders from the tooth order on."""
        return float(np.median(self.limit_deg[self.orders >= self.tooth_order]))

    @property
    def phase_limited_by_trigger(self) -> bool:
        """Whether some phase is known to no better than 3°, and would be to half its uncertainty were the trigger
        known.
        """
        return any(c.limited_by_trigger for c in self.components)

    @property
    def advice(self) -> str | None:
        """What to measure where the trigger limits the phases: one sentence."""
        limited = [c for c in self.components if c.limited_by_trigger]
        if not limited:
            return None
        worst = max(c.phase_half_width_deg for c in limited)
        trigger = max(self.trigger_ci95_ms.values())
        return (
            f"the unknown start of the recording (±{trigger:.1f} ms) leaves the phase of order "
            f"{', '.join(f'{c.order:g}' for c in limited)} uncertain by up to ±{worst:.0f}°. {self._remedy} ties "
            f"it down; without one, "
            f"3° need this test at {self.safe_feed_mm_min:.0f} mm/min or less"
        )

    @property
    def _remedy(self) -> str:
        if self.tilts:
            return f"A cone-frustum test in the same campaign, in which {self.axis} turns both ways,"
        other = "CW" if self.direction == "CCW" else "CCW"  # the table turns against the cone's sense
        return (
            f"A cone-frustum test in the same campaign, off centre and run {other} so that {self.axis} turns "
            f"{self.direction},"
        )

    @property
    def safe_feed_mm_min(self) -> float:
        """Feed of the first test at which the usual trigger (±20 ms, one standard deviation) costs 3° of the
        highest order's phase.
        """
        highest = max((c.order for c in self.components), default=float(self.tooth_order))
        speed = np.ptp(self.position_deg) / (self.duration_s * self.feed_mm_min)  # deg/s per mm/min
        return float(3.0 / (1.96 * TRIGGER * highest * speed))

    @property
    def differences(self) -> list[tuple[float, float]]:
        """Joint least squares against the alternating scheme: relative amplitude and phase (deg) difference per
        component.
        """
        out = []
        for c, a in zip(self.components, self.alternating, strict=True):
            turn = (a.phase_deg - c.phase_deg + 180.0) % 360.0 - 180.0
            out.append((a.amplitude_deg / c.amplitude_deg - 1.0, turn))
        return out

    def rms_deg(self) -> dict[str, float]:
        """RMS of the raw curve about its mean, of the modified one, and of what the components leave of it."""
        rest = self.modified_deg - self.identified_deg
        return {
            "raw": float(np.std(self.raw_deg)),
            "modified": float(np.sqrt(np.mean(self.modified_deg**2))),
            "residual": float(np.sqrt(np.mean(rest**2))),
            "residual_away_from_reversals": float(np.sqrt(np.mean(rest[~self.at_reversal] ** 2))),
        }

    def to_json(self) -> dict:
        gaps = self.differences
        return {
            "tests": list(self.tests),
            "arc_deg": round(self.arc_deg, 2),
            "resolution_per_rev": round(self.resolution, 3),
            "tooth_order": self.tooth_order,
            "noise_floor_deg": float(f"{self.noise_floor_deg:.4g}"),
            "detection_limit_deg": float(f"{self.detection_limit_deg:.4g}"),
            "components": [c.to_json() for c in self.components],
            "alternating": [a.to_json() for a in self.alternating],
            "largest_difference": {
                "amplitude_percent": round(100 * max((abs(a) for a, _ in gaps), default=0.0), 2),
                "phase_deg": round(max((abs(p) for _, p in gaps), default=0.0), 2),
            },
            "rms_deg": {k: float(f"{v:.4g}") for k, v in self.rms_deg().items()},
            "local_faults": [
                {k: float(f"{getattr(f, k):.5g}") for k in ("centre_deg", "width_deg", "height_deg")}
                for f in self.faults
            ],
            "trigger_ci95_ms": {k: round(v, 2) for k, v in self.trigger_ci95_ms.items()},
            "phase_limited_by_trigger": self.phase_limited_by_trigger,
            "advice": self.advice,
        }


@dataclass(frozen=True)
class PitchIdentification:
    """Pitch errors of one axis.

    Attributes:
        directions: "CW", "CCW" -> what was found; a direction without a tangential test is absent.
        common: the components of both directions agree within their uncertainty, so that one effect describes both.
        effects: ``pitch_error`` effects for machine.toml.
        noise_um: RMS of one sample's noise, and where the estimate comes from.
    """

    axis: str
    directions: dict[str, DirectionIdentification]
    common: bool
    effects: tuple[Effect, ...]
    noise_um: float
    noise_source: str
    notes: tuple[str, ...] = field(default=())

    def to_dataframe(self) -> pd.DataFrame:
        """One row per component: axis, direction, order, amplitude and phase (degrees) with their 95 % intervals,
        multiple_of_teeth.
        """
        need("to_dataframe", "dataframe", "pandas")
        import pandas as pd

        rows = []
        for direction, d in self.directions.items():
            for c in d.components:
                bounds = {
                    f"{k}_{end}": c.ci95[k][i]
                    for k in ("amplitude_deg", "phase_deg")
                    for i, end in enumerate(("low", "high"))
                }
                row = {
                    "axis": self.axis,
                    "direction": direction,
                    "order": c.order,
                    "amplitude_deg": c.amplitude_deg,
                    "phase_deg": c.phase_deg,
                }
                rows.append(row | bounds | {"multiple_of_teeth": c.multiple_of_teeth})
        return pd.DataFrame(rows)

    def to_json(self) -> dict:
        """As ``mjsim identify pitch-error --json`` prints it."""
        return {
            "axis": self.axis,
            "noise_um": round(self.noise_um, 4),
            "noise_source": self.noise_source,
            "directions_agree": self.common,
            "notes": list(self.notes),
            "directions": {k: d.to_json() for k, d in self.directions.items()},
            "effects": [{"id": e.id, **e.values} for e in self.effects],
        }
