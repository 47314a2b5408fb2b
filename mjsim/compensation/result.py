"""Corrections for one control, and how they are handed on."""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import wrap

from mjsim.campaign.model import Campaign
from mjsim.commands.comparison import significant
from mjsim.commands.saved import SavedDiagnosis
from mjsim.compensation.controls import Control
from mjsim.compensation.forecast import Forecast
from mjsim.compensation.tables import Corrections, Worth, scale, unit_text
from mjsim.digits import estimate, expanded, rounded_um
from mjsim.instruments.base import INSTRUMENTS
from mjsim.units import DEG, MM, UM

# -- the text beside a control's files ---------------------------------------------------------------------------------

_WIDTH = 100


def summary(result: Compensation) -> str:
    """Text of ``corrections.txt``."""
    c, who = result.corrections, result.control
    done, measured = result.corrected, result.campaign.measured_parts
    kinds = [
        f"{len(p.measured)} {INSTRUMENTS[n].noun} tests".replace("ball bar", "ball-bar") for n, p in measured.items()
    ]
    out = [
        f"Corrections for {who.title}, written by mjsim",
        f"campaign: {result.campaign.name}, machine: {result.saved.machine.name}",
        f"data: {', '.join(kinds)}, noise {result.saved.noise / UM:.3f} µm; "
        f"verdict of the diagnosis: {result.saved.verdict.replace('_', ' ')}",
        "",
        "These corrections come on top of those that were active while the tests were measured.",
        *([f"Positions of the rotary axes count in this sense: {c.chain.senses} (ISO 841)."] if c.chain.rotary else []),
        "Check the sign on your machine with one value before you load everything.",
        "",
        "Corrected:",
    ]
    rows = [w for w in result.worth if w.effect.key in done]
    out += [*(line for w in rows for line in size_lines(w)), *pulse_lines(c)] or ["  nothing"]
    out += ["", "Left:"]
    out += [line for x in c.left for line in _paragraph(f"{x.key}: {x.reason}")] or ["  nothing that is known"]
    if result.saved.unexplained:
        out += _paragraph(f"unexplained: {result.saved.unexplained}")
    before, after, perfect = result.forecast.rms()
    out += ["", "Forecast, RMS about the set-up:"]
    out.append(f"  {'test':32} {'as it is':>10} {'forecast':>10} {'perfect':>10}   µm")
    for t in result.forecast.tests:
        a, b, p = t.rms()
        out.append(f"  {t.test.name[:32]:32} {a / UM:10.3f} {b / UM:10.3f} {p / UM:10.3f}")
    out.append(f"  {'all tests':32} {before / UM:10.3f} {after / UM:10.3f} {perfect / UM:10.3f}")
    if c.kinematics:
        how = "run with" if who.settings.transforms else "run without"
        out += _paragraph(f"The forecast is for tests that are {how} tool centre point control.")
    out += ["", "Where to put them:"]
    if not c.empty:
        out += [line for text in who.where() for line in _paragraph(text)]
    else:
        out.append("  There is nothing to type.")
    return "\n".join([*out, ""])


def size_lines(w: Worth) -> list[str]:
    """One line per size of an effect: value, 95 % half width, where it comes from."""
    specs = {p.name: p for p in w.effect.parameters_of(w.effect.subject)}
    origin = {"found": "found", "calibrated": "calibrated", "stated": "as the machine file states, without an interval"}
    out = []
    for label, value in w.sizes.items():
        p = specs.get(label) or next(s for s in specs.values() if s.kind == "components")
        half = w.uncertainty.get(label)
        ends = None if half is None else (value - half, value + half)
        size = f"{estimate(value, ends)} {expanded(ends)}".rstrip()
        out.append(f"  {w.effect.key:24} {label:16} {size}{unit_text(p, w.effect)}  ({origin[w.known.origin]})")
    return out


def pulse_lines(c: Corrections) -> list[str]:
    """One line per axis whose friction is compensated."""
    out = []
    for axis, p in c.pulses.items():
        size, unit = (DEG, "°") if c.chain.is_rotary(axis) else (MM, "mm")
        out.append(
            f"  friction.{axis:15} pulse of {p.speed / size * 60.0:.4g} {unit}/min for {p.time * 1e3:g} ms  (takes "
            f"{100 * p.removes:.0f} % of the mean square of what friction does to {axis} in the tests)"
        )
    return out


def _paragraph(text: str) -> list[str]:
    return wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")


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
                    "sizes": {k: significant(v) for k, v in w.sizes.items()},
                    "uncertainty95": {k: significant(v) for k, v in w.uncertainty.items()},
                }
                for w in self.worth
                if w.effect.key in done
            ],
            "leaves": [{"id": x.key, "reason": x.reason} for x in c.left],
            "unexplained": self.saved.unexplained or None,
            "backlash": {
                a: {"deg": significant(v / DEG)} if chain.is_rotary(a) else {"mm": significant(v / MM)}
                for a, v in c.backlash.items()
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
                e.name: {"urad": significant(c.kinematics[e.name] / UM)}
                if e.rotation
                else {"mm": significant(c.kinematics[e.name] / MM)}
                for e in chain.location_errors
                if e.name in c.kinematics
            },
            "position_gains_per_s": {a: significant(g) for a, g in c.gains.items()},
            "friction_pulses": {
                a: {
                    "deg_min" if chain.is_rotary(a) else "mm_min": significant(p.speed / scale(chain, a) * 60.0),
                    "time_s": significant(p.time),
                    "removes": round(p.removes, 3),
                }
                for a, p in c.pulses.items()
            },
            "forecast": {
                "programs": "tool centre point control" if self.control.settings.transforms else "axis positions",
                "rms_before_um": rounded_um(before),
                "rms_after_um": rounded_um(after),
                "rms_perfect_um": rounded_um(perfect),
                "gone": None if self.forecast.gone is None else round(self.forecast.gone, 4),
                "tests": [
                    dict(
                        zip(
                            ("name", "before_um", "after_um", "perfect_um"),
                            (t.test.name, *map(rounded_um, t.rms())),
                            strict=True,
                        )
                    )
                    for t in self.forecast.tests
                ],
            },
            "files": list(self.files),
        }
