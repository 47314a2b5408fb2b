"""The ``[tolerance]`` table of a machine file: what a machine of its class may have without being at fault."""

from __future__ import annotations

from pathlib import Path

from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.machine.chain import Chain, is_rotary
from mjsim.machine.effect import Effect, Parameter

#: A limit that is relative to the stated or neutral value.
RATIO = "ratio"

#: What a typical machine has: the commented table of a new campaign. Sources: acceptance tolerances of ISO 10791-1 and
#: -3 (squareness, straightness), -2 and ISO 230-2 (positioning, reversal), -6 (rotary axes), and makers' data sheets.
TYPICAL_TOLERANCE: dict[str, dict[str, float]] = {
    "axis_location": {"um": 12.0, "urad": 30.0},
    "squareness": {"urad": 24.0},
    "straightness": {"um": 1.6},
    "scale_error": {"ppm": 20.0},
    "pitch_error": {"um": 0.6, "deg": 0.0014},
    "backlash": {"um": 0.8, "deg": 0.0008},
    "friction": {RATIO: 0.4},
    "radial_error_motion": {"um": 1.0},
    "tilt_error_motion": {"urad": 8.0},
}

#: What a typical machine has of errors that hardly show at one place of the ball. They are fitted only where a machine
#: file states them. Sources: acceptance level of ISO 10791-1, -2 and -3 for the angular deviations of a linear axis,
#: 60 µrad, here over 500 mm of travel; for the axial error motion that of the radial one is assumed.
VOLUMETRIC_TOLERANCE: dict[str, dict[str, float]] = {
    "angular_error": {"urad": 12.0},
    "axial_error_motion": {"um": 1.0},
}


def check_tolerance(path: Path, table: dict[str, dict[str, float]], effects: tuple[Effect, ...], chain: Chain) -> None:
    """Refuse kinds and units that no effect has.

    Args:
        path: The machine file, for the message.
        table: Limits (two standard deviations) by kind of effect and unit.
        effects: The effects of the machine, among them the user's own.
        chain: Its axes.

    Raises:
        InputError: Names the kind or the unit, and what is allowed.
    """
    classes = registry.kinds_of(effects)
    for kind, limits in table.items():
        if kind not in classes:
            raise InputError(f"{path}: [tolerance] {kind} is no kind of effect; allowed: {', '.join(sorted(classes))}")
        allowed = units_of(classes[kind], chain)
        if allowed and RATIO not in allowed and any(e.kind == kind for e in effects):
            allowed = (*allowed, RATIO)  # of the level that the file states
        if not allowed:
            raise InputError(
                f"{path}: [tolerance] {kind}: this kind has no single size, so it cannot have a tolerance; take it out"
            )
        for unit in limits:
            if unit not in allowed:
                raise InputError(f"{path}: [tolerance] {kind}: unit {unit!r}; allowed: {', '.join(allowed)}")
        if not limits:
            raise InputError(
                f"{path}: [tolerance] {kind} has no limit; allowed: a table such as {{ {allowed[0]} = 10.0 }}"
            )


def units_of(cls: type[Effect], chain: Chain) -> tuple[str, ...]:
    """Units in which a kind's tolerance may be stated; none where shapes have to be known before a size makes sense."""
    units: list[str] = []
    for subject in cls.subjects_of(chain):
        parameters = cls.parameters_of(subject)
        if any(p.inverse for p in parameters) or _needs_a_place(parameters):
            return ()
        for p in parameters:
            if p.leading and (unit := unit_of_size(p, subject)) not in units:
                units.append(unit)
    return tuple(units)


def _needs_a_place(parameters: tuple[Parameter, ...]) -> bool:
    """Whether a shape other than the order of a wave has no default, as the place of a worn stretch or a sensor."""
    required = (p for p in parameters if not p.leading and p.default is None and p.kind in ("number", "sensor"))
    return any(p.name != "order" for p in required)


def unit_of_size(p: Parameter, subject: str) -> str:
    """Last part of a leading parameter's name: its unit, or ``ratio``."""
    if p.kind == "components":
        return "deg" if is_rotary(subject) else "um"
    return p.name.rsplit("_", 1)[-1]
