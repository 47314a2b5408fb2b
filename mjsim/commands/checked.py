"""What a check of one instrument's recordings says."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mjsim.campaign.model import Campaign


@dataclass(frozen=True)
class CheckedPart:
    """The check of one instrument's tests.

    Attributes:
        campaign: As read, the tests of this instrument alone.
        mistakes: In the order in which they are put right.
        rows: One per measured test: its name, and what the check says of it.
        remarks: What the recordings show of themselves that is no mistake.
    """

    campaign: Campaign
    mistakes: tuple[Any, ...]
    rows: tuple[dict, ...]
    remarks: tuple[Any, ...] = field(default=(), kw_only=True)

    @property
    def instrument(self) -> str:
        """Name of the instrument."""
        return self.campaign.tests[0].instrument

    @property
    def questions(self) -> tuple[str, ...]:
        """What the user should look at, a sentence each."""
        return ()

    def to_json(self) -> dict:
        """As ``mjsim check --json`` prints it."""
        return {
            "campaign": self.campaign.name,
            "mistakes": [m.to_json() for m in self.mistakes],
            "signals": [r.to_json() for r in self.remarks],
            "tests": list(self.rows),
            "questions": list(self.questions),
            "not_measured": [t.name for t in self.campaign.planned],
        }
