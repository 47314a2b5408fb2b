"""What an instrument is: its tests in a campaign, their recordings, and what it shows of a simulated motion.

A new instrument is one class, registered under a name. A campaign then reads its tests, and ``check``, ``compare``,
``export``, ``report`` and ``open`` work on them. The instrument gives its reading of a motion; what its set-up does to
the reading is fitted (:mod:`mjsim.commands.compare`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from mjsim.instruments.schema import Table
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import Geometry
from mjsim.units import DEG, MM, UM


class Test(Protocol):
    """One test of a campaign, measured or planned; ``instrument`` is the name of its instrument."""

    instrument: ClassVar[str]

    @property
    def name(self) -> str:
        """Unique in the campaign."""
        ...

    @property
    def setup(self) -> str:
        """Tests of one set-up share what the set-up does to the reading."""
        ...

    @property
    def trace(self) -> str | None:
        """File of the recording, relative to the campaign."""
        ...

    @property
    def chain(self) -> Chain:
        """Axes of the machine."""
        ...


@dataclass(frozen=True)
class Channel:
    """One quantity of a recording.

    Attributes:
        name: In words, as a plot labels it.
        unit: As a plot labels it.
        size: SI per unit.
        suffix: Of the unit in names of keys and columns.
    """

    name: str = "deviation"
    unit: str = "µm"
    size: float = UM
    suffix: str = "um"


@dataclass(frozen=True)
class Observation:
    """A recording as arrays.

    Attributes:
        time: From the start of the program, growing, (n,) s.
        value: One column a channel, (n, channels) SI.
        valid: Which values count, (n, channels) bool.
    """

    time: np.ndarray
    value: np.ndarray
    valid: np.ndarray


#: Way from which the last move to a place comes, m and rad: more than any play (the largest that is allowed, doubled).
LEAD_LINEAR, LEAD_ROTARY = 2.0 * MM, 2.0 * DEG
#: Repeated values from which the noise of an instrument at rest is called theirs; and as how many of them a statement
#: of the user counts, and an assumption.
FEWEST_REPEATS, STATED, ASSUMED_AS = 10, 10, 3


@dataclass(frozen=True)
class Stops:
    """Where a machine comes from and stands, for an instrument that measures while it stands still.

    Attributes:
        route: Commanded positions one after another, from which play follows, (m, axes) m and rad.
        clock: Campaign clock at them, (m,) s.
        at: Rows of the route that are measured, (n, k): a reading is the mean of its k.
        away: How far from the position of a reading the machine stands in it, (n, axes) m and rad.
    """

    route: np.ndarray
    clock: np.ndarray
    at: np.ndarray
    away: np.ndarray


@dataclass(frozen=True)
class Nuisances:
    """What a set-up does to a reading, linearly.

    Attributes:
        names: Of the numbers, with their unit.
        columns: Derivatives of the reading, (n, channels, numbers) SI per unit.
        spread: Prior standard deviations, (numbers,) units.
        shared: Names of numbers that belong to the instrument: they are the same in all set-ups.
    """

    names: tuple[str, ...]
    columns: np.ndarray
    spread: np.ndarray
    shared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Over:
    """What a plot shows a recording over, in the place of time.

    Attributes:
        name: Of the quantity.
        unit: As a plot labels it.
        value: (n,) units.
        series: To which series each sample belongs, (n,): samples of one are joined.
    """

    name: str
    unit: str
    value: np.ndarray
    series: tuple[str, ...]


@dataclass(frozen=True)
class Mistake:
    """What is wrong with a recording.

    Attributes:
        kind: In one word.
        tests: Names of the tests.
        sentence: What is wrong, from what it follows, and what to do.
    """

    kind: str
    tests: tuple[str, ...]
    sentence: str

    def to_json(self) -> dict:
        """Plain data."""
        return {"kind": self.kind, "tests": list(self.tests), "sentence": self.sentence}


T = TypeVar("T", bound=Test)
R = TypeVar("R")


class Instrument(ABC, Generic[T, R]):
    """One kind of instrument.

    Class attributes:
        name: As ``kind`` of its ``[instrument]`` table.
        noun: In sentences.
        test_noun: What one of its tests is called in sentences.
        beside: JSON key of its answer in a campaign whose first answer is another instrument's.
        order: Place of its answer in a campaign of several instruments.
        own_keys: Keys of its ``[instrument]`` table that not every instrument has: type and default of each.
        in_motion: Whether each of its tests is one reading along a motion, as a ball bar's: its tests are
            :class:`~mjsim.instruments.ball_bar.measurement.BallBarTest`, and all such instruments are fitted together.
        at_rest: Whether it measures while the machine stands still; it then says :meth:`stops`.
        plan_option: Option of ``mjsim plan`` that proposes positions.
        usual: Its own numbers where a campaign does not have it.
        handling: Time for mounting it and starting a test, s.
        by_itself_noun: What a table calls the numbers of :meth:`by_itself`.
        by_itself_note: What they are, in a sentence.
    """

    name: ClassVar[str]
    noun: ClassVar[str]
    test_noun: ClassVar[str]
    beside: ClassVar[str]
    order: ClassVar[int] = 9
    own_keys: ClassVar[Mapping[str, tuple[Any, Any]]] = {}
    in_motion: ClassVar[bool] = False
    at_rest: ClassVar[bool] = False
    plan_option: ClassVar[str] = ""
    usual: ClassVar[Any] = None
    handling: ClassVar[float] = 600.0
    by_itself_noun: ClassVar[str] = "by itself"
    by_itself_note: ClassVar[str] = ""

    # -- in a campaign -------------------------------------------------------------------------------------------------

    @abstractmethod
    def kinds(self) -> Sequence[str]:
        """What ``kind`` of a ``[[test]]`` table may be."""

    @abstractmethod
    def table(self, chain: Chain) -> type[Table]:
        """What a ``[[test]]`` table may contain on a machine with these axes."""

    @abstractmethod
    def test_of(self, file: Path, table: Any, chain: Chain) -> T:
        """The test that a checked table describes.

        Args:
            file: The campaign's file, for messages.
            table: An instance of :meth:`table`.
            chain: Axes of the machine.

        Raises:
            InputError: A value is wrong, or does not go with another one.
        """

    def tests_of(self, file: Path, table: Any, chain: Chain) -> tuple[T, ...]:
        """All tests that a checked table describes: several where one recording holds several readings.

        Args:
            file: As for :meth:`test_of`.
            table: As for :meth:`test_of`.
            chain: As for :meth:`test_of`.
        """
        return (self.test_of(file, table, chain),)

    def data_of(self, table: Any) -> Any:
        """The instrument's own numbers from its ``[instrument]`` table, SI."""
        return table

    def remarks(self, tests: Sequence[T], recordings: dict[str, R], data: Any) -> Sequence[Any]:
        """What the recordings show of themselves that is no mistake."""
        return ()

    def known_from(self, data: Any, recordings: Mapping[str, R]) -> Any:
        """The instrument's numbers with what its recordings say of them, by name of the test."""
        return data

    @abstractmethod
    def read(self, path: Path, test: T, data: Any) -> R:
        """The recording of a test.

        Args:
            path: Its file.
            test: What it is of.
            data: As :meth:`data_of` gives it.

        Raises:
            InputError: Names the file, the line, what was found and what is allowed.
        """

    def look_at(self, path: Path, test: T, recording: R, tests: Sequence[T]) -> None:
        """Refuse a recording that is not of its test; ``tests`` are all of this instrument.

        Raises:
            InputError: It is of another test, or its clock is wrong.
        """

    # -- files of other systems ----------------------------------------------------------------------------------------

    def file_columns(self, test: T) -> dict[str, tuple[str, str]]:
        """What a column of another system's table may be: by name its quantity (``deviation``, ``angle``, ``time`` or
        empty), and the unit that it has where nothing says it. None where :meth:`from_columns` does not work.
        """
        return {}

    def column_named(self, test: T, header: str, word: str) -> str:
        """Which of :meth:`file_columns` a column is; empty: none.

        Args:
            test: What the table is of.
            header: Of the column.
            word: The same without its unit, lower case.
        """
        return ""

    def missing_columns(self, test: T, have: Collection[str]) -> list[str]:
        """Names of columns that a table lacks, each as a user may say it."""
        return []

    def from_columns(self, source: Path, test: T, columns: dict[str, np.ndarray]) -> tuple[R, list[str]]:
        """The recording that a table holds, and notes for the user.

        Args:
            source: Of the table, for messages.
            test: What it is of.
            columns: Of :meth:`file_columns` those that it has, (n,) SI each.

        Raises:
            InputError: The columns do not go together.
        """
        raise NotImplementedError

    def trace_text(self, test: T, recording: R) -> str:
        """The file that :meth:`read` reads."""
        raise NotImplementedError

    def found_columns(self, test: T) -> Sequence[str]:
        """Columns of its file that hold what is found."""
        return ()

    def planned_text(self, test: T) -> str:
        """What a planned test is to be measured at, as a table; empty where the test does not say it."""
        return ""

    def proposals(self, chain: Chain, periods: Mapping[str, float]) -> Sequence[T]:
        """Planned tests that a plan looks at, with their positions; none where it proposes none.

        Args:
            chain: Axes of the machine.
            periods: Of each axis' periodic error, such as the lead of its screw, m or rad.
        """
        return ()

    def planned_noise(self, test: T, data: Any) -> np.ndarray:
        """Standard deviation of one sample of a planned test, (channels,) SI."""
        raise NotImplementedError

    def test_table(self, test: T) -> dict[str, Any]:
        """The ``[[test]]`` table of a planned test."""
        raise NotImplementedError

    def facts(self, test: T, recording: R) -> dict[str, Any]:
        """What a check says of a recording besides its length; a name ends in its unit."""
        return {}

    # -- what it shows -------------------------------------------------------------------------------------------------

    def channels(self, test: T) -> tuple[Channel, ...]:
        """What it records."""
        return (Channel(),)

    def over(self, test: T, recording: R) -> Over | None:
        """What a plot shows it over; ``None``: over time."""
        return None

    def observe(self, test: T, recording: R) -> Observation:
        """The recording as arrays."""
        raise NotImplementedError

    def command(self, test: T, time: np.ndarray) -> np.ndarray:
        """What the axes were told, (n, axes) m and rad at ``time`` (n,) s."""
        raise NotImplementedError

    def stops(self, test: T, recording: R) -> Stops | None:
        """Where the machine stands while it is measured; ``None`` where it moves as :meth:`command` says."""
        return None

    def reading(self, test: T, position: np.ndarray, geometry: Geometry) -> np.ndarray:
        """What an ideal instrument shows.

        Args:
            test: What is run.
            position: Of the axes behind their drives, (n, axes), or with error motions behind, m and rad.
            geometry: Location errors and squareness of the machine.

        Returns:
            (n, channels) SI.
        """
        raise NotImplementedError

    def reading_at(self, test: T, position: np.ndarray, geometry: Geometry, stops: Stops) -> np.ndarray:
        """What an ideal instrument shows while the machine stands.

        Args:
            test: What is run.
            position: As of :meth:`reading`.
            geometry: Location errors and squareness of the machine.
            stops: Where the machine was told to stand.

        Returns:
            (n, channels) SI.
        """
        return self.reading(test, position, geometry)

    def nuisances(self, test: T, time: np.ndarray) -> Nuisances:
        """What the set-up does to the reading; an unknown zero of every channel where nothing else is said."""
        channels = self.channels(test)
        count = len(channels)
        columns = np.broadcast_to(np.eye(count), (len(time), count, count))
        names = tuple(f"zero_of_{c.name}_{c.suffix}".replace(" ", "_") for c in channels)
        sizes = np.array([c.size for c in channels])
        return Nuisances(names, columns * sizes, np.full(count, 1e6))

    def nuisances_of(self, test: T, recording: R, time: np.ndarray, data: Any) -> Nuisances:
        """:meth:`nuisances` where they depend on the recording or on the numbers of the instrument."""
        return self.nuisances(test, time)

    def noise(self, test: T, recording: R, data: Any) -> np.ndarray:
        """Standard deviation of one sample, (channels,) SI."""
        raise NotImplementedError

    def figures(self, test: T, time: np.ndarray, reading: np.ndarray) -> dict[str, float]:
        """Figures of a standard of a reading (n, channels); a name ends in its unit."""
        return {}

    def figures_of(self, test: T, recording: R, time: np.ndarray, reading: np.ndarray) -> dict[str, float]:
        """:meth:`figures` where they depend on the recording."""
        return self.figures(test, time, reading)

    def by_itself(self, tests: Sequence[T], recordings: Mapping[str, R]) -> dict[str, float]:
        """Numbers of effects that the recordings give by a usual method alone, by id, in the unit of the number."""
        return {}

    def mistakes(self, tests: Sequence[T], recordings: dict[str, R], data: Any) -> Sequence[Any]:
        """What the recordings show to be wrong with units, signs, order and clocks."""
        return ()


#: Name -> instrument, in the order of their answers.
INSTRUMENTS: dict[str, Instrument] = {}
_I = TypeVar("_I", bound=Instrument)


def register(cls: type[_I]) -> type[_I]:
    """Class decorator: makes an instrument known under its ``name``."""
    INSTRUMENTS[cls.name] = cls()
    for name in sorted(INSTRUMENTS, key=lambda n: INSTRUMENTS[n].order):
        INSTRUMENTS[name] = INSTRUMENTS.pop(name)
    return cls


def instrument_of(kind: object) -> Instrument | None:
    """The instrument whose tests are of a kind; ``None`` where no instrument has it."""
    return next((i for i in INSTRUMENTS.values() if kind in i.kinds()), None)


def table_of(test: Any) -> dict[str, Any]:
    """The ``[[test]]`` table of a planned test of any instrument."""
    return INSTRUMENTS[test.instrument].test_table(test)
