"""The tests of a campaign as they are believed to be, and how well they fit: their reversals and their set-ups."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.inference.mistakes.evidence import Spikes, Variant, disagreement, spikes
from mjsim.inference.mistakes.mistakes import unit_of
from mjsim.inference.mistakes.settings import MistakeSettings
from mjsim.inference.samples import Samples

#: A test as it may have been run: its variant, its trace, and what the trace is multiplied with.
Part = tuple[Variant, Samples, float]


@dataclass
class State:
    """The tests as they are believed to be."""

    variants: list[Variant]
    traces: list[Samples]
    factors: list[float]
    settings: MistakeSettings
    _known: dict = field(default_factory=dict)

    def part(self, k: int) -> Part:
        return self.variants[k], self.traces[k], self.factors[k]

    def spikes_of(self, variant: Variant, s: Samples, factor: float = 1.0) -> Spikes:
        key = (id(variant), id(s))
        if key not in self._known:
            self._known[key] = spikes(variant, s, self.settings.visible_spike)
        found = self._known[key]
        return replace(found, factor=factor * found.factor, agreement=float(np.sign(factor)) * found.agreement)

    def fit(self, part: Part) -> float | None:
        """Agreement of a test's spikes, zero where their size is no machine's; ``None`` where there are none to see."""
        found = self.spikes_of(*part)
        if not found.visible:
            return None
        known = unit_of(found.factor)
        return found.agreement if known is not None and not known[1] else 0.0

    def disagrees(self, k: int) -> bool:
        """Whether the set-up of test ``k`` leaves much more than its tests do on their own: else no correction
        makes it agree.
        """
        members = self.members(k)
        disagreement_of = self.disagreement_of(k, {})
        if disagreement_of <= self.settings.setup_disagrees:
            return False
        apart = float(np.sqrt(sum(disagreement([self.part(j)]) ** 2 for j in members if j != k)))
        return apart < self.settings.setup_share * disagreement_of

    def disagreement_of(self, k: int, parts: dict[int, Part]) -> float:
        """Disagreement (m) of the set-up of test ``k`` with some tests changed; zero where the test is alone in it."""
        members = self.members(k)
        return disagreement([parts.get(j, self.part(j)) for j in members]) if len(members) > 1 else 0.0

    def members(self, k: int) -> list[int]:
        """Tests of the set-up of test ``k``."""
        setup = self.variants[k].test.setup
        return [j for j, v in enumerate(self.variants) if v.test.setup == setup]
