"""What a sweep file may contain; the checks behind its error messages."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from mjsim.instruments.ball_bar.tables import BallBarTable
from mjsim.instruments.schema import Table, Text

#: A value that is varied: whatever its bounds are, differences and ratios of two such numbers are finite.
Value = Annotated[float, Field(ge=-1e15, le=1e15, allow_inf_nan=False)]


class VaryTable(Table):
    parameter: Text
    values: Annotated[list[Value], Field(min_length=1, max_length=1_000_000)] | None = None
    from_: Annotated[Value | None, Field(alias="from")] = None
    to: Value | None = None
    count: Annotated[int, Field(ge=2, le=1_000_000)] | None = None
    scale: Literal["linear", "log"] = "linear"

    @property
    def ends(self) -> tuple[float, float]:
        """``from`` and ``to`` of an entry that has them."""
        assert self.from_ is not None and self.to is not None
        return self.from_, self.to


class SweepTable(Table):
    name: Text
    design: Literal["grid", "latin_hypercube", "tolerances"] = "grid"
    samples: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    campaign: Text | None = None
    tests: Any = "all"  # or a list of names; checked where the names are known
    machine: Text | None = None
    test: list[BallBarTable] = Field(default_factory=list)
    vary: list[VaryTable] = Field(default_factory=list)
    traces: bool = False
    every_ms: Annotated[int, Field(ge=1, le=10_000)] | None = None
