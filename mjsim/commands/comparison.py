"""What a comparison is: measured and simulated channels of every test, whatever recorded them.

An instrument's own part may say more (figures of a standard, what was fitted of its set-up); what is here is there for
all of them, so that text, JSON, tables, plots, report and workbench read every instrument alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.instruments.base import INSTRUMENTS, Channel
from mjsim.io.extras import need
from mjsim.machine.model import Machine

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ComparedChannel:
    """One channel of one test.

    Attributes:
        channel: Its name and unit.
        time: As recorded, (n,) s.
        measured: (n,) SI.
        simulated: With what was fitted of the set-up, (n,) SI.
        valid: Which samples count, (n,) bool.
        noise: RMS of one sample's noise, SI.
    """

    channel: Channel
    time: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    valid: np.ndarray
    noise: float

    @property
    def residual(self) -> np.ndarray:
        """Measured less simulated, (n,) SI."""
        return self.measured - self.simulated

    @property
    def rms(self) -> float:
        """RMS of the residual where the samples count, SI."""
        return float(np.sqrt(np.mean(self.residual[self.valid] ** 2)))

    @property
    def maximum(self) -> float:
        """Largest residual where the samples count, SI."""
        return float(np.abs(self.residual[self.valid]).max())


class ComparedTest(ABC):
    """One test of any instrument; ``test`` is the test itself."""

    __test__ = False
    test: Any

    @property
    @abstractmethod
    def channels(self) -> Sequence[ComparedChannel]:
        """Measured and simulated, channel by channel."""

    @abstractmethod
    def to_json(self) -> dict:
        """Plain numbers; a key ends in its unit."""


class ComparedPart(ABC):
    """The tests of one instrument against a machine.

    Attributes:
        campaign: What this instrument measured.
        machine: As compared.
        tests: One per measured test.
        rms: Of all residuals; of an instrument with several units, of its first one.
        noise: RMS of one sample's noise in the same unit.
    """

    campaign: Campaign
    machine: Machine
    tests: tuple[Any, ...]

    @property
    def instrument(self) -> str:
        """Name of the instrument."""
        return self.tests[0].test.instrument

    @property
    def warnings(self) -> list[str]:
        """What the user should know of tests and readings."""
        return []

    @abstractmethod
    def to_json(self) -> dict:
        """As ``mjsim compare --json`` prints it."""


@dataclass(frozen=True)
class Comparison:
    """A campaign against a machine.

    Attributes:
        campaign: What was measured.
        machine: As compared.
        parts: What each instrument shows, in the order of their answers.
    """

    campaign: Campaign
    machine: Machine
    parts: tuple[Any, ...]

    @property
    def tests(self) -> tuple[Any, ...]:
        """All tests of all instruments."""
        return tuple(t for part in self.parts for t in part.tests)

    @property
    def rms(self) -> float:
        """RMS of the residuals of the first instrument, SI."""
        return self.parts[0].rms

    @property
    def noise(self) -> float:
        """RMS of one sample's noise of the first instrument, SI."""
        return self.parts[0].noise

    @property
    def warnings(self) -> list[str]:
        """What the user should know of tests and readings."""
        return [w for part in self.parts for w in part.warnings]

    def of(self, instrument: str) -> Any:
        """What one instrument shows; ``None`` where it has measured nothing."""
        return next((p for p in self.parts if p.instrument == instrument), None)

    def to_json(self) -> dict:
        """As ``mjsim compare --json`` prints it: the first instrument's keys, and the others' below keys of their
        own.
        """
        return joined(self.campaign, {p.instrument: p.to_json() for p in self.parts})

    def to_dataframe(self) -> pd.DataFrame:
        """One row per test: the entries of :meth:`to_json`; ISO 230-4 figures are columns ``measured_…`` and
        ``simulated_…`` (µm).
        """
        need("to_dataframe", "dataframe", "pandas")
        import pandas as pd

        rows = []
        for row in (row for part in self.parts for row in part.to_json()["tests"]):
            figures = row.pop("iso230_4", {})
            flat = {f"{who}_{k}": v for who, f in figures.items() if f for k, v in f.items()}
            first = {"test": row.pop("name"), "kind": row.pop("kind"), "setup": row.pop("setup")}
            rows.append({**first, **row, **flat})
        return pd.DataFrame(rows)


def joined(campaign: Campaign, parts: dict[str, dict]) -> dict:
    """The answers of all instruments as one object.

    Args:
        campaign: Whose tests these are.
        parts: JSON by name of the instrument, in the order of their answers.

    Returns:
        The first one's keys, with the tests that nobody has measured in ``not_measured``; those of each other one below
        a key of its own.
    """
    first, *others = parts
    rest = {INSTRUMENTS[name].beside: parts[name] for name in others}
    planned = [t.name for t in campaign.planned if t.instrument not in others]
    return {k: planned if k == "not_measured" else v for k, v in parts[first].items()} | rest


def apart(parts: Sequence[Any], data: dict) -> list[tuple[Any, dict]]:
    """Each instrument's part with its own keys of what :func:`joined` has made of all of them.

    Args:
        parts: In the order of their answers.
        data: Of :func:`joined`.
    """
    return [(p, data if i == 0 else data[INSTRUMENTS[p.instrument].beside]) for i, p in enumerate(parts)]


def significant(x: float) -> float:
    """A number with six digits."""
    return float(f"{float(x):.6g}")


# -- what a check of one instrument's recordings says ------------------------------------------------------------------


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
