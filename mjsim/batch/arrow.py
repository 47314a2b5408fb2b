"""Arrow and Parquet, which the extra "batch" brings."""

from mjsim.io.extras import need

need("batch", "batch", "pyarrow", "pandas")

import pyarrow as pa  # noqa: E402
import pyarrow.parquet as pq  # noqa: E402

__all__ = ["pa", "pq"]
