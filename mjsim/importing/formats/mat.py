"""MATLAB files (``.mat``, up to version 7.2) through scipy: every numeric vector is a column."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.io.inputs import read_bytes

#: Depth of structures that are looked into.
_DEEP = 4


@register
class Mat(Format):
    """Vectors of the longest common length; those of structures are named by their path, as ``X.Data``."""

    suffixes = (".mat",)

    def read(self, path: Path, options: Options) -> Table:
        from scipy.io import loadmat  # slow to load

        try:
            content = loadmat(io.BytesIO(read_bytes(path)), squeeze_me=True, struct_as_record=False)
        except NotImplementedError:
            raise InputError(f"{path}: a MATLAB file of version 7.3; save it with -v7 in MATLAB") from None
        except (ValueError, TypeError, OSError, KeyError, EOFError) as error:
            raise InputError(f"{path}: no readable MATLAB file: {str(error)[:80]}") from None
        found: dict[str, np.ndarray] = {}
        for name, value in content.items():
            if not name.startswith("__"):
                _collect(name, value, found, _DEEP)
        lengths = [len(v) for v in found.values()]
        if not lengths or max(lengths) < 2:
            raise InputError(f"{path}: no vector of numbers; allowed: a time and one vector for each signal")
        kept = {n: v for n, v in found.items() if len(v) == max(lengths)}
        values = np.column_stack(list(kept.values()))
        notes = (f"MATLAB file with {len(found)} vectors, {len(kept)} of {max(lengths)} samples",)
        return Table(path, tuple(kept), ("",) * len(kept), values, np.arange(1, len(values) + 1), (), notes)


def _collect(name: str, value, found: dict[str, np.ndarray], depth: int) -> None:
    """Put the vectors of a value into ``found``, rows or columns of a matrix as vectors of their own."""
    if depth == 0:
        return
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            _collect(f"{name}.{field}", getattr(value, field), found, depth - 1)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for i, part in enumerate(value.ravel()[:100], start=1):
            _collect(f"{name}{i}", part, found, depth - 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.ndim in (1, 2):
        matrix = value if value.ndim == 2 else value[:, None]
        matrix = matrix.T if matrix.shape[0] < matrix.shape[1] else matrix
        for i, column in enumerate(matrix.T[:100], start=1):
            found[name if matrix.shape[1] == 1 else f"{name}{i}"] = np.asarray(column, float)
