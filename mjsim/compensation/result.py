"""Corrections for one control, and how they are handed on."""

from __future__ import annotations

from dataclasses import dataclass

from mjsim.campaign.model import Campaign
from mjsim.commands.saved import SavedDiagnosis
from mjsim.compensation.controls import Control
from mjsim.compensation.forecast import Forecast
from mjsim.compensation.tables import Corrections, scale
from mjsim.compensation.worth import Worth
from mjsim.units import DEG, MM, UM


@dataclass(frozen=True)
class Compensation:
    """Corrections for one control.

    Attributes:
        campaign: What was measured.
        control: Who gets the corrections.
        saved: The diagnosis that they come from.
        worth: Effects that are corrected, as far as the control can.
        corrections: What the control is told.
        forecast: What that will bring.
        files: The files by name.
    """

    campaign: Campaign
    control: Control
    saved: SavedDiagnosis
    worth: tuple[Worth, ...]
    corrections: Corrections
    forecast: Forecast
    files: dict[str, str]

    @property
    def corrected(self) -> tuple[str, ...]:
        """Keys of the effects that the control is told something about."""
        c = self.corrections
        left = {x.key for x in c.left}
        tabled = {k for t in c.tables for k in t.keys}
        return tuple(w.effect.key for w in self.worth if w.effect.key in tabled or w.effect.key not in left)

    def to_json(self) -> dict:
        """Plain numbers in µm, mm and degrees, as ``mjsim compensate --json`` prints them."""
        c, chain = self.corrections, self.corrections.chain
        before, after, perfect = self.forecast.rms()
        done = self.corrected
        return {
            "campaign": self.campaign.name,
            "control": self.control.name,
            "verdict": self.saved.verdict,
            "corrects": [
                {
                    "id": w.effect.key,
                    "origin": w.known.origin,
                    "sizes": {k: _sig(v) for k, v in w.sizes.items()},
                    "uncertainty95": {k: _sig(v) for k, v in w.uncertainty.items()},
                }
                for w in self.worth
                if w.effect.key in done
            ],
            "leaves": [{"id": x.key, "reason": x.reason} for x in c.left],
            "unexplained": self.saved.unexplained or None,
            "backlash": {
                a: {"deg": _sig(v / DEG)} if chain.is_rotary(a) else {"mm": _sig(v / MM)} for a, v in c.backlash.items()
            },
            "tables": [
                {
                    "corrects": t.out,
                    "by": t.source,
                    "points": len(t.positions),
                    "modulo": t.modulo,
                    "both_directions": not t.two_sided,
                    "effects": list(t.keys),
                }
                for t in c.tables
            ],
            "kinematics": {
                e.name: {"urad": _sig(c.kinematics[e.name] / UM)}
                if e.rotation
                else {"mm": _sig(c.kinematics[e.name] / MM)}
                for e in chain.location_errors
                if e.name in c.kinematics
            },
            "position_gains_per_s": {a: _sig(g) for a, g in c.gains.items()},
            "friction_pulses": {
                a: {
                    "deg_min" if chain.is_rotary(a) else "mm_min": _sig(p.speed / scale(chain, a) * 60.0),
                    "time_s": _sig(p.time),
                    "removes": round(p.removes, 3),
                }
                for a, p in c.pulses.items()
            },
            "forecast": {
                "programs": "tool centre point control" if self.control.settings.transforms else "axis positions",
                "rms_before_um": _r(before),
                "rms_after_um": _r(after),
                "rms_perfect_um": _r(perfect),
                "gone": None if self.forecast.gone is None else round(self.forecast.gone, 4),
                "tests": [
                    dict(
                        zip(
                            ("name", "before_um", "after_um", "perfect_um"),
                            (t.test.name, *map(_r, t.rms())),
                            strict=True,
                        )
                    )
                    for t in self.forecast.tests
                ],
            },
            "files": list(self.files),
        }


def _r(x: float) -> float:
    return round(float(x / UM), 4)


def _sig(x: float) -> float:
    return float(f"{x:.6g}")
