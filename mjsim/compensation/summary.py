"""The text beside a control's files: what they correct, from which data, with which uncertainty, what they leave."""

from __future__ import annotations

from textwrap import wrap

from mjsim.compensation.result import Compensation
from mjsim.compensation.tables import Corrections
from mjsim.compensation.worth import Worth, unit_text
from mjsim.digits import estimate, expanded
from mjsim.instruments.base import INSTRUMENTS
from mjsim.units import DEG, MM, UM

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
        f"verdict of the diagnosis: {result.saved.verdict}",
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
