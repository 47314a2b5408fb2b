"""What can be done about a cause, and what ball-bar software calls it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mjsim.machine.axis import is_rotary


@dataclass(frozen=True)
class Remedy:
    """What can be done about a cause.

    Attributes:
        kind: ``adjust`` (a setting or a mechanical adjustment), ``compensate`` (a table or parameter of the control),
            ``maintain`` (a part, or the machine's surroundings) or ``share`` (belongs to every machine: taking it out
            of a simulation only says how much it makes).
        term: in the vocabulary of ball-bar software; empty where it has none.
        text: in one or two sentences.
        rotary: the text for a rotary axis, where it differs: one has a screw and a nut, the other a worm and a bearing.
    """

    kind: str
    term: str
    text: str
    rotary: str = ""

    def on(self, subject: str) -> Remedy:
        """The remedy as it fits an axis.

        Args:
            subject: what the effect acts on, such as the letter of an axis.
        """
        return replace(self, text=self.rotary, rotary="") if self.rotary and is_rotary(subject) else self

    @property
    def repairable(self) -> bool:
        """Whether a repair is meant, not only a share."""
        return self.kind != "share"


#: What is said of an effect that names no remedy.
UNKNOWN = Remedy("maintain", "", "Your own effect. The catalogue has no remedy for it.")
