"""What a curve of pitch errors is made of: its components, the same by the paper's scheme, and faults of single
places.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Component:
    """One component ``amplitude sin(order x + phase)``, x the actual axis position; amplitudes and phases in degrees.

    Attributes:
        order: peaks per turn; a whole number where the data allow only one (``order_known``).
        ci95: name -> (low, high) of ``amplitude_deg`` and ``phase_deg``, and of ``order`` where it is not known; they
            contain
        trigger, set-up and data sheet. phase_fixed_trigger_deg: half width of the phase's interval were the trigger
        known. multiple_of_teeth: whether the order is a multiple of the tooth number. merged: orders of further waves
        that this one cannot be separated from on the arc measured; then its numbers are those of the fit with all of
        them and no statement about one cause.
    """

    order: float
    amplitude_deg: float
    phase_deg: float
    ci95: dict[str, tuple[float, float]]
    order_known: bool
    phase_fixed_trigger_deg: float
    multiple_of_teeth: bool
    merged: tuple[float, ...] = ()

    @property
    def separable(self) -> bool:
        return not self.merged

    @property
    def phase_half_width_deg(self) -> float:
        low, high = self.ci95["phase_deg"]
        return 0.5 * (high - low)

    @property
    def limited_by_trigger(self) -> bool:
        """Whether the phase is known to no better than 3°, and would be to half its uncertainty were the trigger
        known.
        """
        return self.phase_half_width_deg > 3.0 and self.phase_fixed_trigger_deg < 0.5 * self.phase_half_width_deg

    def to_json(self) -> dict:
        out = {
            "order": round(self.order, 4),
            "amplitude_deg": float(f"{self.amplitude_deg:.5g}"),
            "phase_deg": round(self.phase_deg, 2),
            "ci95": {k: [float(f"{x:.5g}") for x in v] for k, v in self.ci95.items()},
            "order_known": self.order_known,
            "phase_half_width_with_known_trigger_deg": round(self.phase_fixed_trigger_deg, 2),
            "multiple_of_teeth": self.multiple_of_teeth,
            "separable": self.separable,
        }
        if self.merged:
            out["not_separable_from"] = [round(n, 2) for n in self.merged]
        return out


@dataclass(frozen=True)
class Alternation:
    """One component by the paper's alternating scheme: see :mod:`mjsim.inference.pitch.alternating`."""

    order: float
    amplitude_deg: float
    phase_deg: float
    rounds: int

    def to_json(self) -> dict:
        return {
            "order": round(self.order, 4),
            "amplitude_deg": float(f"{self.amplitude_deg:.5g}"),
            "phase_deg": round(self.phase_deg, 2),
            "rounds": self.rounds,
        }


@dataclass(frozen=True)
class LocalFault:
    """A worn stretch of the wheel that was taken out: ``height exp(-((x - centre)/width)²/2)``, degrees."""

    centre_deg: float
    width_deg: float
    height_deg: float
