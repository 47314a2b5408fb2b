"""The whitened design of a model: derivatives of the readings with respect to everything that is fitted.

A nuisance reaches the tests of its set-up alone. As a full matrix, the nuisances' part would grow with the square of
the number of tests, and would be zero nearly everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np


class Design:
    """A whitened design ``J`` (count, p): of the nuisances, block by block, then of everything else.

    It is used like a matrix, as far as least squares need one: ``J @ vector``, ``J.T @ columns``, ``J.T @ J`` and
    ``J.T @ K`` of another design.

    Attributes:
        blocks: Per test, the places (b,) of its nuisances in the vector and their columns (rows of the test, b).
        nuisances: Number of all nuisances. They come first in the vector.
        rest: Columns of everything else, (count, p - nuisances).
    """

    def __init__(
        self, blocks: Sequence[tuple[np.ndarray, np.ndarray]], nuisances: int, rest: np.ndarray | None = None
    ) -> None:
        ends = np.cumsum([0, *(len(columns) for _, columns in blocks)])
        self.blocks, self.nuisances = tuple(blocks), nuisances
        self.rest = np.zeros((ends[-1], 0)) if rest is None else rest
        self._rows = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.shape = len(self.rest), nuisances + self.rest.shape[1]

    @property
    def of_nuisances(self) -> Design:
        """The nuisances' part."""
        return Design(self.blocks, self.nuisances)

    @property
    def T(self) -> Transposed:
        """To be multiplied with columns, or with the design."""
        return Transposed(self)

    def __matmul__(self, vector: np.ndarray) -> np.ndarray:
        """``J vector`` of a vector (p,) or of columns (p, k)."""
        out = self.rest @ vector[self.nuisances :]
        for rows, (places, columns) in zip(self._rows, self.blocks, strict=True):
            out[rows] += columns @ vector[places]
        return out

    def dense(self, *behind: np.ndarray) -> np.ndarray:
        """All columns as a matrix, (count, p + k), with k others ``behind``, (count,) each."""
        p = self.shape[1]
        out = np.zeros((self.shape[0], p + len(behind)))
        out[:, self.nuisances : p] = self.rest
        for i, column in enumerate(behind):
            out[:, p + i] = column
        for rows, (places, columns) in zip(self._rows, self.blocks, strict=True):
            out[rows, places] += columns
        return out

    def without(self, places: np.ndarray) -> Design:
        """The design without the columns at ``places``, none of which is a nuisance's."""
        return Design(self.blocks, self.nuisances, np.delete(self.rest, places - self.nuisances, axis=1))

    def columns(self, places: np.ndarray | slice) -> np.ndarray:
        """The columns at ``places`` of the vector, none of which is a nuisance's, (count, k)."""
        return self.rest[:, np.arange(self.shape[1])[places] - self.nuisances]

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """``Jᵀ columns`` of a vector (count,) or of columns (count, k)."""
        out = np.zeros((self.shape[1], *columns.shape[1:]))
        out[self.nuisances :] = self.rest.T @ columns
        for rows, (places, own) in zip(self._rows, self.blocks, strict=True):
            out[places] += own.T @ columns[rows]
        return out

    def normal(self) -> np.ndarray:
        """``JᵀJ``, (p, p)."""
        n = self.nuisances
        out = np.zeros((self.shape[1], self.shape[1]))
        out[n:, n:] = self.rest.T @ self.rest
        for rows, (places, own) in zip(self._rows, self.blocks, strict=True):
            out[np.ix_(places, places)] += own.T @ own
            out[places, n:] += own.T @ self.rest[rows]
        out[n:, :n] = out[:n, n:].T
        return out

    def crossed(self, other: Design) -> np.ndarray:
        """``JᵀK`` with another design of the same tests."""
        n, m = self.nuisances, other.nuisances
        out = np.zeros((self.shape[1], other.shape[1]))
        out[n:, m:] = self.rest.T @ other.rest
        for rows, (places, own), (others, columns) in zip(self._rows, self.blocks, other.blocks, strict=True):
            out[np.ix_(places, others)] += own.T @ columns
            out[places, m:] += own.T @ other.rest[rows]
            out[n:, others] += self.rest[rows].T @ columns
        return out


class Transposed:
    """``Jᵀ`` of a design."""

    def __init__(self, design: Design) -> None:
        self.design = design

    def __matmul__(self, other: np.ndarray | Design) -> np.ndarray:
        if other is self.design:
            return self.design.normal()
        return self.design.crossed(other) if isinstance(other, Design) else self.design.projected(other)
