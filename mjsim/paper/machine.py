"""The paper's machine: what is known of it, what was identified, and one cause at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.inference.pitch.identify import identify_pitch_errors
from mjsim.inference.pitch.result import PitchIdentification
from mjsim.io.resources import examples
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent

#: The example campaign that stands for the paper's measurements.
EXAMPLE = "kato2013"
#: What the figures show one by one; "all" is every effect of the model, "none" the drives without any.
CAUSES = ("all", "friction", "backlash.A", "pitch_error.A", "pitch_error.C", "wheel.A", "none")


@dataclass(frozen=True)
class PaperMachine:
    """Campaign, machine file and identified pitch errors of the paper's machine.

    Attributes:
        campaign: the paper's tests, measured by an independent simulator (the paper's own data are not published).
        known: the machine file: assumed drive values, friction, backlash of A; no pitch errors.
        pitch: identified pitch errors by axis, A and C (paper, section 2.3).
    """

    campaign: Campaign
    known: Machine
    pitch: dict[str, PitchIdentification]

    def effects(self, cause: str) -> tuple[Effect, ...]:
        """The effects that a cause of :data:`CAUSES` stands for.

        ``friction`` is the paper's "friction torque and tracking delay"; ``wheel.A`` is the tooth order of A's pitch
        error alone.
        """
        found = {a: self.pitch[a].effects for a in self.pitch}
        friction = tuple(e for e in self.known.effects if e.kind == "friction")
        if cause == "wheel.A":
            teeth = self.known.drives["A"].gear
            return tuple(
                e.replaced(components=rows)
                for e in found["A"]
                if (rows := [c for c in e.values["components"] if c[0] == teeth])
            )
        return {
            "all": (*self.known.effects, *found["A"], *found["C"]),
            "friction": friction,
            "backlash.A": tuple(e for e in self.known.effects if e.id == "backlash.A"),
            "pitch_error.A": found["A"],
            "pitch_error.C": found["C"],
            "none": (),
        }[cause]

    @cached_property
    def _bare(self) -> Machine:
        machine = self.known
        for effect in machine.effects:
            machine = machine.without(effect.key)
        return machine

    def machine(self, cause: str) -> Machine:
        """The drives with nothing but that cause."""
        machine = self._bare
        for effect in self.effects(cause):
            machine = machine.with_effect(effect)
        return machine


def paper_machine(threads: int = 2, progress: Progress = silent) -> PaperMachine:
    """Read the example campaign and identify the pitch errors of A and C from its tangential tests."""
    campaign = read_campaign(examples() / EXAMPLE)
    known = read_machine(campaign.machine_file)
    return PaperMachine(campaign, known, identify_pitch_errors(campaign, known, threads=threads, progress=progress))
