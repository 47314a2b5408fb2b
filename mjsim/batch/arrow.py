"""Arrow and Parquet, which the extra "batch" brings, and columns of Arrow tables made of plain memory.

``pyarrow.array`` loads pandas when it is first called, which takes longer than many runs; these do not.
"""

from collections.abc import Sequence

import numpy as np

from mjsim.io.extras import need

need("batch", "batch", "pyarrow", "pandas")

import pyarrow as pa  # noqa: E402
import pyarrow.parquet as pq  # noqa: E402

__all__ = ["integers", "lists", "numbers", "pa", "pq", "texts"]


def integers(values: Sequence[int] | np.ndarray) -> pa.Array:
    """A column of whole numbers."""
    data = np.ascontiguousarray(values, np.int64)
    return pa.Array.from_buffers(pa.int64(), len(data), [None, pa.py_buffer(data)])


def numbers(values: Sequence[float] | np.ndarray) -> pa.Array:
    """A column of numbers; NaN becomes null."""
    data = np.ascontiguousarray(values, float)
    return pa.Array.from_buffers(pa.float64(), len(data), [_valid(~np.isnan(data)), pa.py_buffer(data)])


def texts(values: Sequence[str | None]) -> pa.Array:
    """A column of texts; ``None`` becomes null."""
    data = [(v or "").encode() for v in values]
    valid = _valid(np.array([v is not None for v in values], bool))
    return pa.Array.from_buffers(pa.string(), len(data), [valid, _offsets(data), pa.py_buffer(b"".join(data))])


def lists(values: Sequence[np.ndarray | None]) -> pa.Array:
    """A column of lists of numbers; ``None`` becomes null."""
    data = [np.zeros(0) if v is None else np.asarray(v, float) for v in values]
    flat = np.concatenate([np.zeros(0), *data])
    children = [pa.Array.from_buffers(pa.float64(), len(flat), [None, pa.py_buffer(flat)])]
    valid = _valid(np.array([v is not None for v in values], bool))
    return pa.Array.from_buffers(pa.list_(pa.float64()), len(data), [valid, _offsets(data)], children=children)


def _valid(good: np.ndarray) -> pa.Buffer | None:
    return None if good.all() else pa.py_buffer(np.packbits(good, bitorder="little").tobytes())


def _offsets(data: Sequence) -> pa.Buffer:
    return pa.py_buffer(np.cumsum([0, *(len(d) for d in data)]).astype(np.int32))
