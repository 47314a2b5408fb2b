"""What the tables of ball-bar tests and of their limits may contain."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, create_model

from mjsim.instruments.ball_bar.acceptance import FIGURES
from mjsim.instruments.ball_bar.kinds import KINDS, all_keys
from mjsim.instruments.ball_bar.kinds.base import Key
from mjsim.instruments.schema import Clock, Length, Table, Text, one_of, printable
from mjsim.machine.chain import FIVE_AXIS, Chain


class MotionTable(Table):
    """The keys of every ``[[test]]`` that is a motion."""

    feed_mm_min: Annotated[float, Field(gt=0, le=100000)]
    trace: str | None = None
    program: str | None = None
    program_dialect: Literal["fanuc", "siemens", "linuxcnc", "heidenhain"] | None = None
    program_reversed: list[str] | None = None
    program_rollover: bool | None = None
    driven_by: str | None = None
    setup: Annotated[str, Field(max_length=200), AfterValidator(printable)] | None = None
    started_s: Clock = 0.0
    spindle_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class BallBarTable(MotionTable):
    """The keys that every ball-bar test may have. :func:`ball_bar_table` has those of single kinds as well."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Annotated[str, AfterValidator(one_of(lambda: KINDS))]
    table_ball_mm: Annotated[list[Length], Field(min_length=3, max_length=3)]
    bar_length_mm: Annotated[float, Field(ge=20, le=1000)]


def ball_bar_table(chain: Chain = FIVE_AXIS) -> type[BallBarTable]:
    """What a ``[[test]]`` table may contain on a machine with these axes, whatever its kind."""
    fields: dict[str, Any] = {name: (_type(keys, chain) | None, None) for name, keys in all_keys().items()}
    rotary = Annotated[str, AfterValidator(one_of(lambda: chain.rotary))]
    fields["program_reversed"] = (list[rotary] | None, None)
    return create_model("BallBarTable", __base__=BallBarTable, **fields)


def _type(keys: list[Key], chain: Chain) -> Any:
    """The type of a key that several kinds may have: texts may be any of their words."""
    words = dict.fromkeys(w for k in keys for w in k.words_of(chain))
    return Annotated[str, AfterValidator(one_of(lambda: words))] if words else keys[0].type


class LimitTable(Table):
    """One ``[[acceptance.limit]]``."""

    tests: Annotated[list[str], Field(min_length=1, max_length=1000)]
    figure: Literal[FIGURES]  # pyright: ignore[reportInvalidTypeForm]
    um: Annotated[float, Field(gt=0, le=1e5)]
    source: Text


class AcceptanceTable(Table):
    instrument_um: Annotated[float, Field(ge=0, le=1000)]
    probability: Annotated[float, Field(ge=0.5, le=0.9999)] = 0.95
    limit: Annotated[list[LimitTable], Field(min_length=1, max_length=1000)]
