"""The whitened design of a model: derivatives of the readings with respect to everything that is fitted.

A nuisance reaches the tests of its set-up alone. As a full matrix, the nuisances' part would grow with the square of
the number of tests, and would be zero nearly everywhere.

Errors that the tests share, as what slides that turn leave, connect all rows. They have few directions. So the columns
stay as they are, and every product with them is less by what lies along these.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
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
        shared: Orthonormal directions (count, k) along which the errors of all tests together are larger, and by how
            much each of them shrinks (k,); empty without. Columns of ``blocks`` and ``rest`` are whitened but for that.
    """

    def __init__(
        self,
        blocks: Sequence[tuple[np.ndarray, np.ndarray]],
        nuisances: int,
        rest: np.ndarray | None = None,
        shared: tuple[np.ndarray, np.ndarray] | tuple[()] = (),
    ) -> None:
        ends = np.cumsum([0, *(len(columns) for _, columns in blocks)])
        self.blocks, self.nuisances, self.shared = tuple(blocks), nuisances, shared
        self.rest = np.zeros((ends[-1], 0)) if rest is None else rest
        self._rows = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.shape = len(self.rest), nuisances + self.rest.shape[1]
        self._basis, self._shrink = shared or (np.zeros((len(self.rest), 0)), np.zeros(0))

    @property
    def of_nuisances(self) -> Design:
        """The nuisances' part."""
        return Design(self.blocks, self.nuisances, shared=self.shared)

    @property
    def of_each_test(self) -> Design:
        """The design without what the errors of all tests share."""
        return Design(self.blocks, self.nuisances, self.rest)

    @property
    def T(self) -> Transposed:
        """To be multiplied with columns, or with the design."""
        return Transposed(self)

    @cached_property
    def _along(self) -> np.ndarray:
        """Products of the shared directions with all columns, (k, p)."""
        out = np.zeros((len(self._shrink), self.shape[1]))
        out[:, self.nuisances :] = self._basis.T @ self.rest
        for rows, (places, columns) in zip(self._rows, self.blocks, strict=True):
            out[:, places] += self._basis[rows].T @ columns
        return out

    def _shrunk(self, columns: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Columns (count, m), or one, that shrink along the shared directions, with their products ``along`` these."""
        return columns - self._basis @ (self._shrink * along.T).T if len(self._shrink) else columns

    def __matmul__(self, vector: np.ndarray) -> np.ndarray:
        """``J vector`` of a vector (p,) or of columns (p, k)."""
        out = self.rest @ vector[self.nuisances :]
        for rows, (places, columns) in zip(self._rows, self.blocks, strict=True):
            out[rows] += columns @ vector[places]
        return self._shrunk(out, self._along @ vector)

    def dense(self, *behind: np.ndarray) -> np.ndarray:
        """All columns as a matrix, (count, p + k), with k others ``behind``, (count,) each."""
        p = self.shape[1]
        out = np.zeros((self.shape[0], p + len(behind)))
        out[:, self.nuisances : p] = self.rest
        for i, column in enumerate(behind):
            out[:, p + i] = column
        for rows, (places, columns) in zip(self._rows, self.blocks, strict=True):
            out[rows, places] += columns
        if self.shared:
            out[:, :p] = self._shrunk(out[:, :p], self._along)
        return out

    def without(self, places: np.ndarray) -> Design:
        """The design without the columns at ``places``, none of which is a nuisance's."""
        rest = np.delete(self.rest, places - self.nuisances, axis=1)
        return Design(self.blocks, self.nuisances, rest, self.shared)

    def columns(self, places: np.ndarray | slice) -> np.ndarray:
        """The columns at ``places`` of the vector, none of which is a nuisance's, (count, k)."""
        out = self.rest[:, np.arange(self.shape[1])[places] - self.nuisances]
        return self._shrunk(out, self._along[:, places])

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """``Jᵀ columns`` of a vector (count,) or of columns (count, k)."""
        columns = self._shrunk(columns, self._basis.T @ columns)
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
        return out - self._taken(self)

    def _taken(self, other: Design) -> np.ndarray:
        """By how much the products with another design are less for what the errors of all tests share."""
        return (self._along.T * (self._shrink * (2.0 - self._shrink))) @ other._along

    def crossed(self, other: Design) -> np.ndarray:
        """``JᵀK`` with another design of the same tests and errors."""
        n, m = self.nuisances, other.nuisances
        out = np.zeros((self.shape[1], other.shape[1]))
        out[n:, m:] = self.rest.T @ other.rest
        for rows, (places, own), (others, columns) in zip(self._rows, self.blocks, other.blocks, strict=True):
            out[np.ix_(places, others)] += own.T @ columns
            out[places, m:] += own.T @ other.rest[rows]
            out[n:, others] += self.rest[rows].T @ columns
        return out - self._taken(other)


class Transposed:
    """``Jᵀ`` of a design."""

    def __init__(self, design: Design) -> None:
        self.design = design

    def __matmul__(self, other: np.ndarray | Design) -> np.ndarray:
        if other is self.design:
            return self.design.normal()
        return self.design.crossed(other) if isinstance(other, Design) else self.design.projected(other)
