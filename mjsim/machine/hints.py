"""What a search for causes wants to know about an effect. An effect needs none of it: every hint has a default."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from mjsim.machine.chain import Chain
from mjsim.machine.parameter import Parameter

#: Values of parameters by name, from which a fit starts.
Values = dict[str, Any]
#: Effects from which a fit starts, each with the names of what is free.
Starts = Sequence[tuple[Any, tuple[str, ...]]]


#: What stood in the class of an effect before there were hints.
MOVED = ("free", "seeds", "quasi_static", "scanned", "least", "variants")


def _none(*_: Any) -> Starts:
    return []


@dataclass(frozen=True)
class SearchHints:
    """How a diagnosis looks for an effect.

    Attributes:
        free: names of the parameters that are fitted; by default those that switch the effect off. Names that a subject
            does not have are left out.
        seeds: values from which fits start: a list, or a function of subject and chain. By default, the parameters that
            switch the effect off are one typical size away from their neutral values.
        quasi_static: whether the effect follows from the motion of the axes, without a new simulation of the drives.
        scanned: whether its orders or frequencies are read off a spectrum instead of being fitted from seeds.
        least: smallest departure of the leading parameter from neutral that makes sense as a cause of its own
            (assumed).
        looks_like: kinds of effects on the same axis in whose place it makes sense below ``least`` as well.
        within_tolerance: whether it is looked for only where the machine file states its tolerance, or has it already:
            what no single place of the ball can tell from other effects needs an expected size.
        width: prior standard deviation of the leading parameters, typical sizes, where physics says it; by default
            several are tried.
        variants: function of the effect that the user's machine has already: other ways in which it may be wrong.
    """

    free: tuple[str, ...] = ()
    seeds: Sequence[Values] | Callable[[str, Chain], Sequence[Values]] | None = None
    quasi_static: bool = True
    scanned: bool = False
    least: float = 0.0
    looks_like: tuple[str, ...] = ()
    within_tolerance: bool = False
    width: float | None = None
    variants: Callable[[Any], Starts] = _none

    def free_of(self, parameters: Sequence[Parameter]) -> tuple[str, ...]:
        """Names of the ``parameters`` (of one subject) that a diagnosis fits."""
        if not self.free:
            return tuple(p.name for p in parameters if p.leading)
        known = {p.name for p in parameters}
        return tuple(n for n in self.free if n in known)

    def seeds_of(
        self, parameters: Sequence[Parameter], subject: str, chain: Chain, sensors: Sequence[str] = ()
    ) -> list[Values]:
        """Values from which a diagnosis starts.

        Args:
            parameters: of the subject.
            subject: what the effect acts on.
            chain: axes of the machine.
            sensors: of temperature that were recorded; an effect that follows one has seeds for each of them.
        """
        if self.seeds is None:
            seeds: list[Values] = [{p.name: p.neutral + p.scale for p in parameters if p.neutral is not None}]
        else:
            seeds = list(self.seeds(subject, chain) if callable(self.seeds) else self.seeds)
        follows = next((p.name for p in parameters if p.kind == "sensor"), None)
        return seeds if follows is None else [{**s, follows: sensor} for s in seeds for sensor in sensors]
