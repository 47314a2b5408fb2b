"""What can be done about a cause, and what ball-bar software calls it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Remedy:
    """What can be done about a cause.

    Attributes:
        kind: ``adjust`` (a setting or a mechanical adjustment), ``compensate`` (a table or parameter of the control),
            ``maintain`` (a part, or the machine's surroundings) or ``share`` (belongs to every machine: taking it out
            of a simulation only says how much it makes).
        term: in the vocabulary of ball-bar software; empty where it has none.
        text: in one or two sentences.
    """

    kind: str
    term: str
    text: str

    @property
    def repairable(self) -> bool:
        """Whether a repair is meant, not only a share."""
        return self.kind != "share"


#: What is said of an effect that names no remedy.
UNKNOWN = Remedy("maintain", "", "Your own effect. The catalogue has no remedy for it.")
