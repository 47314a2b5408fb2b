"""What effects act on, as functions of the machine's chain, for the attribute ``subjects`` of an effect."""

from __future__ import annotations

from mjsim.machine.chain import COORDINATES, Chain


def every_axis(chain: Chain) -> tuple[str, ...]:
    """All axes."""
    return chain.letters


def linear_axes(chain: Chain) -> tuple[str, ...]:
    """Linear axes."""
    return chain.linear


def rotary_axes(chain: Chain) -> tuple[str, ...]:
    """Rotary axes."""
    return chain.rotary


def wobbling_axes(chain: Chain) -> tuple[str, ...]:
    """Rotary axes with an error motion: those that go round, and those of a head; where no point in space is measured,
    none.
    """
    if not chain.spatial:
        return ()
    return tuple(a.letter for a in chain.axes if a.letter in chain.round_axes or a in chain.swivelling)


def tilting_axes(chain: Chain) -> tuple[str, ...]:
    """Rotary axes that are not vertical: gravity acts on what they carry."""
    return tuple(a.letter for a in chain.axes if a.rotary and not a.vertical)


def axis_pairs(chain: Chain) -> tuple[str, ...]:
    """Pairs of linear axes, as XY."""
    return chain.planes


def straightness_errors(chain: Chain) -> tuple[str, ...]:
    """Straightness errors of the linear axes, as EYX: along Y, of the X axis."""
    return chain.straightness


def angular_errors(chain: Chain) -> tuple[str, ...]:
    """Angular errors of the linear axes, as EAX: about the X coordinate, of the X axis."""
    return chain.angular


def location_errors(chain: Chain) -> tuple[str, ...]:
    """Location errors of the rotary axes, as EC0A: about Z, of the A axis."""
    return tuple(e.name for e in chain.location_errors)


def axis_of_subject(subject: str, chain: Chain) -> str:
    """Letter of the axis that an effect on ``subject`` belongs to; empty where there is none."""
    if subject in chain.letters:
        return subject
    for error in (*chain.location_errors, *chain.squareness):
        if error.name == subject:
            return error.axis
    return subject[-1] if subject[-1:] in chain.letters else ""  # as ISO 230-1 names errors: the axis last


def in_words(subject: str, chain: Chain) -> str:
    """What a geometric error moves, and where, such as ``C centreline turned about Y, on A``; empty for other subjects.

    Args:
        subject: name of a location error, or of two axes that are not square.
        chain: axes of the machine.
    """
    for error in chain.location_errors:
        if error.name == subject:
            way = "turned about" if error.rotation else "displaced along"
            carrier = chain.carrier(error.axis)
            on = f"on {carrier}" if carrier else "on the bed"
            return f"{error.axis} centreline {way} {COORDINATES[error.along]}, {on}"
    if subject in chain.planes:
        return f"{subject[0]} and {subject[1]} not square"
    return ""
