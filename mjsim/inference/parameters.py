"""One named vector of everything that a fit may move: blocks of entries with priors, bounds and frozen flags."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Block:
    """Entries that belong together, each with a normal prior of its own.

    Attributes:
        name: Unique in one vector, such as ``data sheet``.
        labels: One per entry.
        mean: Prior means, (n,).
        deviation: Prior standard deviations, (n,).
        lower: Lowest values allowed, (n,).
        upper: Highest values allowed, (n,).
        frozen: Which entries keep their values, (n,) bool.
        informative: Whether the prior is knowledge. Otherwise it only keeps the equations regular: it follows the
            estimate and costs nothing.
    """

    name: str
    labels: tuple[str, ...]
    mean: np.ndarray
    deviation: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    frozen: np.ndarray
    informative: bool = True

    @classmethod
    def normal(
        cls,
        name: str,
        labels: Iterable[str],
        mean: float | np.ndarray = 0.0,
        deviation: float | np.ndarray = 1.0,
        limit: float = np.inf,
        frozen: bool | np.ndarray = False,
        informative: bool = True,
    ) -> Block:
        """Entries with normal priors.

        Args:
            name: Of the block.
            labels: One per entry.
            mean: Prior mean of all entries, or of each (n,).
            deviation: Prior standard deviation of all entries, or of each (n,).
            limit: Largest distance from the mean that is allowed.
            frozen: Whether the entries keep their values, for all or for each (n,).
            informative: See :class:`Block`.
        """
        labels = tuple(labels)
        n = len(labels)
        centre = np.broadcast_to(np.asarray(mean, float), n)
        width = np.broadcast_to(np.asarray(deviation, float), n)
        held = np.broadcast_to(np.asarray(frozen, bool), n)
        return cls(name, labels, centre, width, centre - limit, centre + limit, held, informative)

    @property
    def size(self) -> int:
        """Number of entries."""
        return len(self.labels)

    @property
    def unbounded(self) -> Block:
        """The same without bounds."""
        return replace(self, lower=np.full(self.size, -np.inf), upper=np.full(self.size, np.inf))


@dataclass(frozen=True)
class Parameters:
    """The vector's blocks, in their order. Vectors themselves are plain arrays (size,)."""

    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        names = [b.name for b in self.blocks]
        if len(set(names)) < len(names):
            raise ValueError(f"blocks of one vector need different names: {', '.join(names)}")

    @cached_property
    def size(self) -> int:
        """Number of entries."""
        return sum(b.size for b in self.blocks)

    @cached_property
    def _slices(self) -> dict[str, slice]:
        ends = np.cumsum([0, *(b.size for b in self.blocks)])
        return {
            b.name: slice(int(first), int(last))
            for b, first, last in zip(self.blocks, ends[:-1], ends[1:], strict=True)
        }

    @cached_property
    def _places(self) -> dict[tuple[str, str], int]:
        return {
            (b.name, label): self._slices[b.name].start + i for b in self.blocks for i, label in enumerate(b.labels)
        }

    def __getitem__(self, name: str) -> slice:
        """Where a block stands in the vector."""
        return self._slices[name]

    def place(self, name: str, label: str) -> int:
        """Where one entry stands in the vector."""
        return self._places[name, label]

    def places(self, *names: str) -> np.ndarray:
        """Where the entries of some blocks stand in the vector, (n,)."""
        return np.concatenate([np.arange(self.size)[self._slices[n]] for n in names]) if names else np.zeros(0, int)

    def with_blocks(self, *blocks: Block) -> Parameters:
        """The same vector with further blocks at its end."""
        return Parameters(self.blocks + blocks)

    def split(self, vector: np.ndarray) -> dict[str, np.ndarray]:
        """A vector's values by block."""
        return {name: vector[at] for name, at in self._slices.items()}

    def part(self, vector: np.ndarray, other: Parameters) -> np.ndarray:
        """A vector's values of those blocks that another vector has as well, (other.size,)."""
        return np.concatenate([vector[self._slices[b.name]] for b in other.blocks])

    def join(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """The vector with the given values; blocks that are not given stand at their prior means.

        Raises:
            ValueError: a block has another number of entries, or no block has that name.
        """
        out = self.mean.copy()
        for name, value in values.items():
            if name not in self._slices:
                raise ValueError(f"no block is named {name!r}; there are {', '.join(self._slices)}")
            if len(value) != out[self._slices[name]].size:
                raise ValueError(f"block {name!r} has {out[self._slices[name]].size} entries, not {len(value)}")
            out[self._slices[name]] = value
        return out

    def _joined(self, field: str) -> np.ndarray:
        return np.concatenate([getattr(b, field) for b in self.blocks]) if self.blocks else np.zeros(0)

    @cached_property
    def mean(self) -> np.ndarray:
        """Prior means, (size,)."""
        return self._joined("mean")

    @cached_property
    def lower(self) -> np.ndarray:
        """Lowest values allowed, (size,)."""
        return self._joined("lower")

    @cached_property
    def upper(self) -> np.ndarray:
        """Highest values allowed, (size,)."""
        return self._joined("upper")

    @cached_property
    def frozen(self) -> np.ndarray:
        """Which entries keep their values, (size,) bool."""
        return self._joined("frozen").astype(bool)

    @cached_property
    def informative(self) -> np.ndarray:
        """Which entries have a prior that is knowledge, (size,) bool."""
        return np.repeat([b.informative for b in self.blocks], [b.size for b in self.blocks]).astype(bool)

    def precision(self, weight: float = 1.0) -> np.ndarray:
        """Inverse prior variances, (size,). Informative priors count ``weight`` times."""
        return np.where(self.informative, weight, 1.0) / self._joined("deviation") ** 2

    def departure(self, vector: np.ndarray) -> np.ndarray:
        """How far a vector is from its prior means, (size,); 0 where the prior is not informative."""
        return np.where(self.informative, vector - self.mean, 0.0)

    def penalty(self, vector: np.ndarray) -> float:
        """Squared distance of a vector from its informative priors, in standard deviations."""
        return float(self.precision() @ self.departure(vector) ** 2)
