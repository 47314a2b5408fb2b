"""What tables of a campaign have in common; the checks behind their error messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

Number = Annotated[float, Field(allow_inf_nan=False)]


def printable(text: str) -> str:
    """Refuse a text with control characters."""
    if not text.isprintable():
        raise PydanticCustomError("printable", "allowed: text without line breaks, tabs and control characters")
    return text


def one_of(words: Callable[[], Iterable[str]]) -> Callable[[str], str]:
    """As ``Literal``, for words that are not known before the program runs."""

    def check(text: str) -> str:
        allowed = list(words())
        if text not in allowed:
            *most, last = map(repr, allowed) if allowed else ("no text, as the machine has none",)
            named = f"{', '.join(most)} or {last}" if most else last
            raise PydanticCustomError("literal_error", "allowed: {words}", {"words": named})
        return text

    return check


#: What is shown on terminals and in plots.
Text = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(printable)]
#: A length of the set-up, a time on the campaign's clock: far more than any machine has (assumed).
Length = Annotated[float, Field(ge=-10_000, le=10_000, allow_inf_nan=False)]
#: A stated number of an instrument, µm or µrad (assumed bounds).
OwnLength = Annotated[float | None, Field(ge=0.01, le=1000)]
#: Expanded uncertainty (k = 2) of an instrument's unit of length, ppm.
GainUncertainty = Annotated[float | None, Field(ge=0, le=1e5)]
Clock = Annotated[float, Field(ge=-1e10, le=1e10, allow_inf_nan=False)]


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
