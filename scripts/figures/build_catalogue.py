"""The effect catalogue of the documentation, made from the effect classes: docs/effects.md and
docs/images/effects/*.svg.

Run it with the project's Python; ``--text`` leaves the pictures as
they are. A picture shows what an effect of typical size adds to the reading of two tests.
"""

from __future__ import annotations

import sys
import tempfile
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.new import new_campaign
from mjsim.effects.registry import kinds
from mjsim.instruments.ball_bar.iso230 import least_squares_circle
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.model import Machine
from mjsim.machine.temperatures import Temperatures
from mjsim.plots import style
from mjsim.plots.polar import FILL, PolarTrace, draw_polar, scale_text
from mjsim.plots.save import save
from mjsim.simulation.multibody import Simulation, simulate
from mjsim.units import DEG, UM

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, IMAGES = DOCS / "effects.md", DOCS / "images" / "effects"

#: Kind -> two panels, each a subject and a test (a key of :func:`tests`). A kind that is not listed has its first
#: subject on both tests.
PANELS = {
    "angular_error": [("EAY", "circle"), ("EBX", "cone")],
    "axial_error_motion": [("A", "cone"), ("C", "wide cone")],
    "axis_location": [("EB0A", "cone"), ("EA0C", "cone")],
    "backlash": [("X", "circle"), ("A", "cone")],
    "drive_compliance": [("X", "circle"), ("C", "cone")],
    "friction": [("X", "circle"), ("A", "cone")],
    "gravity_windup": [("A", "cone"), ("A", "wide cone")],
    "pitch_error": [("X", "circle"), ("C", "cone")],
    "radial_error_motion": [("C", "cone"), ("C", "wide cone")],
    "scale_error": [("X", "circle"), ("X", "cone")],
    "servo_delay": [("X", "circle"), ("C", "cone")],
    "servo_gain": [("X", "circle"), ("C", "cone")],
    "squareness": [("XY", "circle"), ("ZX", "cone")],
    "straightness": [("EYX", "circle"), ("EXY", "cone")],
    "thermal_drift": [("X", "circle"), ("X", "cone")],
    "thermal_expansion": [("X", "circle"), ("X", "cone")],
    "tilt_error_motion": [("C", "cone"), ("C", "wide cone")],
    "torque_ripple": [("X", "circle"), ("A", "cone")],
    "velocity_feedforward": [("X", "circle"), ("C", "cone")],
    "velocity_gain": [("X", "circle"), ("A", "cone")],
    "vibration": [("X", "circle"), ("X", "cone")],
    "viscous_friction": [("X", "circle"), ("C", "cone")],
    "worm_wear": [("A", "cone"), ("A", "wide cone")],
}
#: Values of parameters that have neither a default nor a size that switches the effect off.
SHAPES = {
    "angular_error": {"quadratic_urad": 0.0},
    "axial_error_motion": {"order": 2.0},
    "pitch_error.X": {"components": [[1.0, 1.0, 0.0]]},
    "pitch_error.C": {"components": [[72.0, 0.001, 0.0]]},
    "radial_error_motion": {"order": 2.0},
    "straightness": {"cubic_um": 0.0},
    "tilt_error_motion": {"order": 2.0},
    "torque_ripple": {"order": 1.0, "phase_deg": 0.0},
    "thermal_drift": {"time_constant_s": 180.0},
    "thermal_expansion": {"sensor": "spindle"},
    "vibration": {"frequency_Hz": 3.0},
    "worm_wear": {"centre_deg": 20.0, "width_deg": 2.0},
}
#: A sensor that gets warmer by 1 K in a minute.
WARMING = Temperatures(np.array([0.0, 600.0]), ("spindle",), np.array([[20.0], [30.0]]))
INTRODUCTION = textwrap.dedent("""\
    # Effect catalogue

    Written by `scripts/figures/build_catalogue.py` from the effect classes. Do not edit this page.

    An effect is one physical cause of motion error. Its id is `kind.SUBJECT`, for example `backlash.A`.
    `mjsim effects` prints this list, and `mjsim effects backlash.A` prints one entry. An effect that is
    missing here can be [written by you](how-to-effect.md).

    **The pictures.** Each picture shows what the effect adds to the reading of the ball bar: a
    simulation with the effect minus a simulation without it, in the multibody model. The size of the
    effect is the *typical size* of the table. Both machines have the friction of the template of `mjsim
    new campaign`. The eccentricity is taken out, as ISO 230-4 does. The angle is φ, with 0° on X. The
    scale below a plot says how many micrometres one division is. A temperature sensor gets warmer by
    1 K in a minute. The tests are:

    | test | what it is |
    |---|---|
    | circle | XY plane, radius 100 mm, 1000 mm/min, two revolutions counter-clockwise |
    | cone | cone frustum 15°/10°, table ball 50 mm off C in Y, 1000 mm/min, two revolutions counter-clockwise |
    | wide cone | cone frustum 45°/30°, table ball on the C axis, 1000 mm/min, two revolutions counter-clockwise |

    **The columns.** *Off at* is the value that switches the effect off. A parameter without such a
    value describes the shape of the effect. *Typical size* is the first step of a fit. *Allowed* are
    the bounds. Terms are explained in the [glossary](glossary.md), symbols in the [theory](theory.md).
    "Paper" means Kato, Tsutsumi and Sato (2013).
    """)


def shipped() -> dict[str, type[Effect]]:
    """The classes of the package itself, by kind: neither installed packages nor files of the user."""
    return {kind: cls for kind, cls in kinds().items() if cls.__module__.startswith("mjsim.effects.")}


def page() -> str:
    """The page as Markdown."""
    lines = [INTRODUCTION, "| kind | of | what it is |", "|---|---|---|"]
    lines += [
        f"| [`{k}`](#{k}) | {', '.join(cls.subjects_of(FIVE_AXIS))} | {cls.title} |" for k, cls in shipped().items()
    ]
    for cls in shipped().values():
        lines += ["", *entry(cls)]
    return "\n".join(lines) + "\n"


def entry(cls: type[Effect]) -> list[str]:
    """Lines of one kind's section."""
    out = [
        f"## {cls.kind}",
        "",
        f"**{cls.title}**, of {', '.join(cls.subjects_of(FIVE_AXIS))}.",
        "",
        *wrapped(f"**Definition.** {cls.definition}"),
        "",
        *wrapped(f"**Signature.** {cls.signature}"),
        "",
        *wrapped(f"**Remedy.** {cls.remedy.text}"),
        *(["", *wrapped(f"**Remedy of a rotary axis.** {cls.remedy.rotary}")] if cls.remedy.rotary else []),
        "",
        *wrapped(f"**Source.** {cls.source}"),
        "",
        "| parameter | unit | off at | typical size | allowed | meaning |",
        "|---|---|---|---|---|---|",
        *parameter_rows(cls),
        "",
    ]
    if cls.for_logs:
        return [*out, "*Looked for in [axis logs](axis-logs.md) only.*"]
    first, second = panels(cls)
    seen = " and ".join(dict.fromkeys([f"`{first[0].id}` on a {first[1]}", f"`{second[0].id}` on a {second[1]}"]))
    return [*out, f"![Signature of {cls.kind}: polar plots](images/effects/{cls.kind}.svg)", "", f"*{seen}.*"]


def parameter_rows(cls: type[Effect]) -> list[str]:
    """A row of the table for every parameter; parameters of axes that differ from the first subject's follow with
    their axes.
    """
    sets: dict[tuple[Parameter, ...], list[str]] = {}
    for subject in cls.subjects_of(FIVE_AXIS):
        sets.setdefault(cls.parameters_of(subject), []).append(subject)
    rows: dict[Parameter, list[str]] = {}
    for parameters, subjects in sets.items():
        for p in parameters:
            rows.setdefault(p, []).extend(subjects)
    out = []
    for p, subjects in rows.items():
        name = f"`{p.name}`" + ("" if len(subjects) == len(cls.subjects_of(FIVE_AXIS)) else f" ({', '.join(subjects)})")
        neutral = "empty list" if p.kind == "components" else "–" if p.neutral is None else number(p.neutral)
        size = "–" if p.kind in ("choice", "sensor") else number(p.scale)
        out.append(f"| {name} | {p.unit or '–'} | {neutral} | {size} | {allowed(p)} | {p.meaning} |")
    return out


def allowed(p: Parameter) -> str:
    """The values that a parameter may have."""
    if p.kind == "choice":
        return " or ".join(p.choices)
    if p.kind == "sensor":
        return "a sensor"
    return "list" if p.kind == "components" else f"{number(p.lower)} to {number(p.upper)}"


def number(value: float) -> str:
    """A number with a true minus sign and the sign of infinity."""
    return "∞" if value == float("inf") else f"{value:g}".replace("-", "−")


def wrapped(text: str) -> list[str]:
    """Prose in lines of at most 100 columns."""
    return textwrap.wrap(text, 100, break_long_words=False, break_on_hyphens=False)


def panels(cls: type[Effect]) -> list[tuple[Effect, str]]:
    """Two effects of a kind at their typical size, each with the name of its test."""
    first = cls.subjects_of(FIVE_AXIS)[0]
    usual = ("cone", "wide cone") if first in FIVE_AXIS.rotary else ("circle", "cone")  # no circle turns a rotary axis
    return [(typical(cls, subject), test) for subject, test in PANELS.get(cls.kind, [(first, t) for t in usual])]


def typical(cls: type[Effect], subject: str) -> Effect:
    """The effect at its typical size: every parameter that can switch it off is one ``scale`` away from there."""
    values = SHAPES.get(cls.kind, {}) | SHAPES.get(f"{cls.kind}.{subject}", {})
    for p in cls.parameters_of(subject):
        if p.neutral is not None and p.name not in values:
            values[p.name] = p.scale if p.inverse else p.neutral + p.scale
        elif p.kind == "number" and p.default is None and p.name not in values:
            values[p.name] = min(p.upper, max(p.lower, p.scale))
    return cls(subject, **values)


def tests(campaign) -> dict[str, BallBarTest]:
    """The tests of the pictures, from those of a new campaign."""
    known = {t.name: t for t in campaign.tests}
    cone = known["cone15-centre-ccw"]
    return {
        "circle": known["circle-xy-ccw"],
        "cone": replace(cone, table_ball=(0.0, 0.050, 0.155)),
        "wide cone": replace(cone, half_apex=np.radians(45.0), inclination=np.radians(30.0)),
    }


def picture(cls: type[Effect], machine: Machine, known: dict[str, BallBarTest]) -> None:
    """Write the picture of a kind."""
    figure = style.new_figure(5.6, 3.1)
    for i, (effect, name) in enumerate(panels(cls)):
        before = machine.effect(effect.id)
        if before is not None:  # friction: more of it
            lead = next(p.name for p in effect.parameters if p.neutral is not None)
            effect = before.replaced(**{lead: before.values[lead] + effect.values[lead]})
        (without,), (with_effect,) = (simulate(m, [known[name]]) for m in (machine, machine.with_effect(effect)))
        axes = style.polar_axes(figure, (0.06 + 0.49 * i, 0.12, 0.40, 0.72))
        trace = difference_trace(with_effect, without)
        step = style.nice_step(max(np.abs(trace.deviation_um).max(), 0.01) / FILL)
        draw_polar(axes, [trace], step, small=True)
        figure.text(
            0.26 + 0.49 * i,
            0.95,
            f"{effect.id}, {name}",
            ha="center",
            va="center",
            fontsize=style.TEXT,
            color=style.INK,
        )
        figure.text(
            0.26 + 0.49 * i, 0.04, scale_text(step), ha="center", va="center", fontsize=style.TEXT, color=style.INK
        )
    save(figure, IMAGES / f"{cls.kind}.svg")


def difference_trace(one: Simulation, other: Simulation) -> PolarTrace:
    """What ``one`` reads more than ``other`` over the measured part, about its least-squares centre."""
    low, high = Program(one.test).measured_span
    keep = (one.time >= low) & (one.time <= high)
    phi, rest = one.phi[keep][::5], (one.deviation - other.deviation)[keep][::5]
    rest = rest - least_squares_circle(phi, rest).eccentricity_m(phi)
    return PolarTrace("difference", phi / DEG, rest / UM, "simulated")


def main() -> None:
    """Write the page, and its pictures unless told not to."""
    PAGE.write_text(page(), encoding="utf-8")
    if "--text" in sys.argv:
        return
    IMAGES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "campaign"
        new_campaign(folder)
        file = folder / "machine.toml"  # the numbers of the effects below are those of the examples' sense
        file.write_text(
            file.read_text(encoding="utf-8").replace('sense = "iso"', 'sense = "opposite"'), encoding="utf-8"
        )
        campaign = read_campaign(folder)
        machine, known = replace(read_machine(campaign.machine_file), temperatures=WARMING), tests(campaign)
        for cls in (c for c in shipped().values() if not c.for_logs):
            picture(cls, machine, known)
            print(f"{cls.kind}.svg: {(IMAGES / f'{cls.kind}.svg').stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
