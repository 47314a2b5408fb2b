"""What a campaign.toml and a machine.toml may contain; the checks behind their error messages."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable
from functools import cache
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model
from pydantic_core import PydanticCustomError

from mjsim.ballbar.acceptance import FIGURES
from mjsim.ballbar.kinds import KINDS, all_keys
from mjsim.ballbar.kinds.base import Key
from mjsim.machine.chain import FIVE_AXIS, SINGULAR, Chain
from mjsim.machine.control import MOST_COEFFICIENTS

Number = Annotated[float, Field(allow_inf_nan=False)]


def printable(text: str) -> str:
    """Refuse a text with control characters."""
    if not text.isprintable():
        raise PydanticCustomError("printable", "allowed: text without line breaks, tabs and control characters")
    return text


def _one_of(words: Callable[[], Iterable[str]]) -> Callable[[str], str]:
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
Clock = Annotated[float, Field(ge=-1e10, le=1e10, allow_inf_nan=False)]


#: From the pivot of a head to the ball, mm (assumed bounds).
ToolLength = Annotated[float, Field(gt=0, le=5000)]


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class InstrumentTable(Table):
    kind: Literal["ball_bar", "axis_log"] = "ball_bar"
    resolution_um: Annotated[float, Field(ge=1e-4, le=1000)] = 0.1
    resolution_deg: Annotated[float, Field(ge=1e-9, le=1)] = 1e-4
    range_mm: Annotated[float, Field(ge=0.001, le=100)] = 1.0
    sample_rate_Hz: Annotated[float, Field(ge=0.1, le=1e6)] = 200.0


class BallBarTable(Table):
    """The keys that every ``[[test]]`` may have. :func:`ball_bar_table` has those of single kinds as well."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Annotated[str, AfterValidator(_one_of(lambda: KINDS))]
    table_ball_mm: Annotated[list[Length], Field(min_length=3, max_length=3)]
    bar_length_mm: Annotated[float, Field(ge=20, le=1000)]
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


def ball_bar_table(chain: Chain = FIVE_AXIS) -> type[BallBarTable]:
    """What a ``[[test]]`` table may contain on a machine with these axes, whatever its kind."""
    fields: dict[str, Any] = {name: (_type(keys, chain) | None, None) for name, keys in all_keys().items()}
    rotary = Annotated[str, AfterValidator(_one_of(lambda: chain.rotary))]
    fields["program_reversed"] = (list[rotary] | None, None)
    return create_model("BallBarTable", __base__=BallBarTable, **fields)


def _type(keys: list[Key], chain: Chain) -> Any:
    """The type of a key that several kinds may have: texts may be any of their words."""
    words = dict.fromkeys(w for k in keys for w in k.words_of(chain))
    return Annotated[str, AfterValidator(_one_of(lambda: words))] if words else keys[0].type


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


class CampaignTable(Table):
    name: Text
    machine: str = "machine.toml"
    measured_on: datetime.date | None = None
    instrument: InstrumentTable = InstrumentTable()
    acceptance: AcceptanceTable | None = None
    test: Annotated[list[BallBarTable], Field(min_length=1, max_length=1000)]


_T = TypeVar("_T", bound=Table)


def with_tests(schema: type[_T], chain: Chain) -> type[_T]:
    """A schema with ``[[test]]`` tables, whose keys are those of the kinds known by now, on a machine with these
    axes.
    """
    tests: Any = list[ball_bar_table(chain)]  # pyright: ignore[reportInvalidTypeForm]
    return create_model(schema.__name__, __base__=schema, test=(tests, schema.model_fields["test"]))


def without_tests(schema: type[_T]) -> type[_T]:
    """A schema whose ``[[test]]`` tables are all read elsewhere."""
    tests: Any = Annotated[list[Any], Field(max_length=0)]
    return create_model(schema.__name__, __base__=schema, test=(tests, ...))


PositionGain = Annotated[float, Field(gt=0, le=1000)]
VelocityGain = Annotated[float, Field(gt=0, le=10000)]
Coefficients = Annotated[list[Number], Field(min_length=1, max_length=MOST_COEFFICIENTS)]


class ControllerTable(Table):
    """One ``[controller.NAME.AXIS]`` table: a cascade, or a discrete law R, S, T."""

    position_gain_per_s: PositionGain | None = None
    velocity_gain_Nms_per_rad: VelocityGain | None = None
    integral_time_s: Annotated[float, Field(gt=0)] = float("inf")
    velocity_feedforward: Annotated[float, Field(ge=0, le=2)] = 0.0
    torque_lag_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    loop_delay_s: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    sample_time_s: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    clip_Nm: Annotated[float, Field(gt=0, le=1e4)] | None = None
    clip_V: Annotated[float, Field(gt=0, le=1e4)] | None = None
    torque_per_V: Annotated[float, Field(gt=0, le=1e4)] | None = None
    anti_windup: bool = False
    velocity_samples: Annotated[int, Field(ge=1, le=MOST_COEFFICIENTS - 1)] = 1
    R: Coefficients | None = None
    S: Coefficients | None = None
    T: Coefficients | None = None


class IdentifyTable(Table):
    """How far the numbers of the data sheet are believed."""

    factor: Annotated[float, Field(gt=1, le=1000)] = 5.0


class DriveTable(Table):
    lead_mm: Annotated[float, Field(gt=0, le=1000)] | None = None
    worm_teeth: Annotated[float, Field(gt=0, le=10000)] | None = None
    position_gain_per_s: PositionGain | None = None
    velocity_gain_Nms_per_rad: VelocityGain | None = None
    integral_time_s: Annotated[float, Field(gt=0, le=10)] | None = None
    inertia_kgm2: Annotated[float, Field(gt=0, le=100)]
    viscous_Nms_per_rad: Annotated[float, Field(ge=0, le=100)]
    gravity_Nm: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0


class AxisTable(Table):
    """Where a rotary axis is, if not where its letter says."""

    direction: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None
    offset_mm: Annotated[list[Length], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]


class PlacementTable(Table):
    """The keys of a machine file that say where its rotary axes are."""

    configuration: str = FIVE_AXIS.configuration
    tool_length_mm: ToolLength | None = None
    singular_pass: Annotated[str, AfterValidator(_one_of(lambda: SINGULAR))] = SINGULAR[0]
    axis: dict[str, AxisTable] = {}


@cache
def machine_table(chain: Chain) -> type[Table]:
    """What a machine file with the axes of ``chain`` may contain; the keys of its ``drive`` table are these axes."""
    axes: dict[str, Any] = {a: (DriveTable, ...) for a in chain.letters}
    controlled: dict[str, Any] = {a: (ControllerTable | None, None) for a in chain.letters}
    controllers = create_model("ControllersTable", __base__=Table, **controlled)
    return create_model(
        "MachineTable",
        __base__=Table,
        name=(Text, ...),
        configuration=(str, FIVE_AXIS.configuration),
        tool_length_mm=(ToolLength | None, None),
        singular_pass=(str, SINGULAR[0]),
        axis=(dict[str, AxisTable], {}),
        drive=(create_model("DrivesTable", __base__=Table, **axes), ...),
        identify=(IdentifyTable | None, None),
        controller=(dict[str, controllers], {}),  # pyright: ignore[reportInvalidTypeForm]
        tolerance=(dict[str, dict[str, Annotated[float, Field(gt=0, le=1e6)]]], {}),
        effect=(Annotated[list[dict[str, Any]], Field(max_length=1000)], []),
    )
