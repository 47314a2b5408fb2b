"""What a campaign.toml and a machine.toml may contain; the checks behind their error messages."""

from __future__ import annotations

import datetime
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Field, create_model, model_validator
from pydantic_core import PydanticCustomError

from mjsim.instruments.ball_bar.files import AcceptanceTable
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.schema import Length, Number, Table, Text, one_of
from mjsim.machine.chain import FIVE_AXIS, SENSES, SINGULAR, Chain
from mjsim.machine.control import MOST_COEFFICIENTS
from mjsim.machine.model import ENCODERS

#: From the pivot of a head to the ball, mm (assumed bounds).
ToolLength = Annotated[float, Field(gt=0, le=5000)]


class _InstrumentTable(Table):
    kind: Annotated[str, AfterValidator(one_of(lambda: INSTRUMENTS))] = "ball_bar"
    resolution_um: Annotated[float, Field(ge=1e-4, le=1000)] = 0.1
    resolution_deg: Annotated[float, Field(ge=1e-9, le=1)] = 1e-4
    range_mm: Annotated[float, Field(ge=0.001, le=100)] = 1.0
    sample_rate_Hz: Annotated[float, Field(ge=1e-3, le=1e6)] = 200.0

    @model_validator(mode="after")
    def _check_own_keys(self) -> _InstrumentTable:
        mine = INSTRUMENTS[self.kind].own_keys
        others = {key for i in INSTRUMENTS.values() for key in i.own_keys if key not in mine}
        for key in sorted(others & self.model_fields_set):
            owners = " or ".join(repr(name) for name, i in INSTRUMENTS.items() if key in i.own_keys)
            words = "allowed: {key} only with kind = {owners}"
            raise PydanticCustomError("own_key", words, {"key": key, "owners": owners})  # pyright: ignore
        return self


_OWN: dict[str, Any] = {key: value for i in INSTRUMENTS.values() for key, value in i.own_keys.items()}
#: An ``[instrument]`` table with what any instrument may have.
InstrumentTable: Any = create_model("InstrumentTable", __base__=_InstrumentTable, **_OWN)


#: How a campaign comes to its first test.
_TESTS = "one [[test]] table or more; `mjsim import` writes one with each file (with --log for an axis log)"


class CampaignTable(Table):
    name: Text
    machine: str = "machine.toml"
    measured_on: datetime.date | None = None
    serial_number: Text | None = None
    instrument: InstrumentTable = InstrumentTable()  # pyright: ignore[reportInvalidTypeForm]
    acceptance: AcceptanceTable | None = None
    test: Annotated[list[Any], Field(min_length=1, max_length=1000, description=_TESTS)]


_T = TypeVar("_T", bound=Table)


def with_tests(schema: type[_T], table: type[Table]) -> type[_T]:
    """A schema whose ``[[test]]`` tables are of one kind.

    Args:
        schema: Of the file.
        table: Of a test.
    """
    tests: Any = list[table]  # pyright: ignore[reportInvalidTypeForm]
    return create_model(schema.__name__, __base__=schema, test=(tests, schema.model_fields["test"]))


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
    position_sample_time_s: Annotated[float, Field(ge=0, le=0.1)] = 0.0
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
    torque_constant_Nm_per_A: Annotated[float, Field(gt=0, le=1000)] | None = None
    encoder: Annotated[str, AfterValidator(one_of(lambda: ENCODERS))] = ENCODERS[0]


class AxisTable(Table):
    """Where a rotary axis is, if not where its letter says, and in which sense it counts; points of slides."""

    sense: Annotated[str, AfterValidator(one_of(lambda: SENSES))] | None = None
    direction: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None
    offset_mm: Annotated[list[Length], Field(min_length=3, max_length=3)] = Field(default=[0.0, 0.0, 0.0])
    functional_point_mm: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = None


class PlacementTable(Table):
    """The keys of a machine file that say where its rotary axes are, and the functional points of its linear ones."""

    configuration: str = FIVE_AXIS.configuration
    tool_length_mm: ToolLength | None = None
    singular_pass: Annotated[str, AfterValidator(one_of(lambda: SINGULAR))] = SINGULAR[0]
    axis: dict[str, AxisTable] = Field(default={})


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
