"""What a kind of ball-bar test is: its keys in a campaign, its path, its words, and the tests of it that could be
measured next.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import Field

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import COORDINATES, Chain
from mjsim.units import DEG, MM


@dataclass(frozen=True)
class Key:
    """A key of a ``[[test]]`` table that belongs to some kinds of tests only.

    Attributes:
        name: as in campaign.toml; it ends in its unit.
        attribute: attribute of :class:`BallBarTest` that holds the value. A name that is none of them becomes an entry
            of ``BallBarTest.more``.
        unit: SI per unit of the file; ``None`` for texts and counts.
        type: what the value may be: ``float``, ``int`` or ``str``, with pydantic's bounds.
        words: what a text may be; a function of the machine's chain where it depends on the axes.
        needed: whether every test of the kind has to have the key.
        option: of ``mjsim import``.
        help: of that option.
    """

    name: str
    attribute: str
    unit: float | None = None
    type: Any = str
    words: tuple[str, ...] | Callable[[Chain], tuple[str, ...]] = ()
    needed: bool = True
    option: str = ""
    help: str = ""

    @property
    def flag(self) -> str:
        """The option of ``mjsim import`` that gives the key."""
        return self.option or "--" + self.name.replace("_", "-")

    def words_of(self, chain: Chain) -> tuple[str, ...]:
        """What a text may be on a machine with these axes; empty for numbers."""
        return self.words(chain) if callable(self.words) else self.words

    def given(self, test: BallBarTest) -> bool:
        """Whether the test has the key: one of a kind's own that is not needed may be left out."""
        return self.attribute in test.more or hasattr(test, self.attribute)

    def of(self, test: BallBarTest) -> Any:
        """The test's value, SI."""
        return test.more[self.attribute] if self.attribute in test.more else getattr(test, self.attribute)


#: An angle in degrees: far more than any axis turns (assumed).
Angle = Annotated[float, Field(ge=-36_000, le=36_000, allow_inf_nan=False)]

DIRECTION = Key("direction", "direction", words=("CW", "CCW"), help="Which way round.")
REVOLUTIONS = Key(
    "revolutions",
    "revolutions",
    type=Annotated[int, Field(ge=1, le=100)],
    needed=False,
    help="Whole revolutions (default 2).",
)
FROM = Key("from_deg", "start", DEG, Angle, option="--from", help="Command at the start, °.")
TO = Key("to_deg", "stop", DEG, Angle, option="--to", help="Command at the end, °.")


#: Places of a path at which it is tried whether the axes can follow.
_LOOKED_AT = 361


class Kind(ABC):
    """One kind of test. Its angle φ goes round in whole revolutions from φ = 0; for a kind that does not, see
    :class:`Arc`.

    Class attributes:
        name: as in campaign.toml.
        keys: of its ``[[test]]`` table, beside the ones that all kinds have, in their order there.
        goes_round: the path is a closed circle that is repeated in revolutions. Such a test has ISO 230-4 figures.
        margin: of φ at both ends of the program that is not measured, rad: run-in and run-out.
        moves_on_table: the spindle ball moves relative to the table. Where it rests there, a feed of the tool centre
        point has no meaning.
    """

    name: ClassVar[str]
    keys: ClassVar[tuple[Key, ...]]
    goes_round: ClassVar[bool] = True
    margin: ClassVar[float] = 10.0 * DEG
    moves_on_table: ClassVar[bool] = True

    @abstractmethod
    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        """Axis commands (n, axes) m and rad, in the order of the test's chain, at φ (n,) rad."""

    @abstractmethod
    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        """φ (n,) rad, within a turn, at axis positions ``q`` (n, axes) on the path or near it: inverse of
        :meth:`path`.
        """

    @abstractmethod
    def words(self, test: BallBarTest) -> str:
        """How the test goes, without what all kinds have: ball, bar and feed."""

    def radius(self, test: BallBarTest) -> float:
        """Radius (m) of the circle on which the feed is programmed."""
        return test.length

    def plane(self, test: BallBarTest) -> str:
        """The plane of two linear axes in which the test runs (XY, YZ, ZX); empty where it runs in none."""
        return ""

    def turns(self, test: BallBarTest) -> str:
        """The rotary axis that the test turns alone; empty where there is none."""
        return ""

    @property
    def needed(self) -> tuple[str, ...]:
        """Names of the keys that a test of the kind has to have."""
        return tuple(k.name for k in self.keys if k.needed)

    def repeats(self, test: BallBarTest) -> bool:
        """Whether the trace goes over the same path at least twice, so that its noise can be told from the machine."""
        return self.goes_round and test.revolutions >= 2

    def ends(self, test: BallBarTest) -> tuple[float, float]:
        """φ (rad) at which the program begins and ends, at rest."""
        sign = 1.0 if test.direction == "CCW" else -1.0
        return -sign * self.margin, sign * (2 * np.pi * test.revolutions + self.margin)

    def turned(self, test: BallBarTest) -> BallBarTest:
        """The same path in the other direction."""
        return replace(test, direction="CW" if test.direction == "CCW" else "CCW")

    def way(self, test: BallBarTest) -> str:
        """``CCW`` or ``CW``: in which direction the test runs."""
        return test.direction

    def completed(self, test: BallBarTest) -> BallBarTest:
        """A test with the attributes that follow from those in its file."""
        return test

    def wrong(self, test: BallBarTest) -> str:
        """What is wrong with a test whose keys are right one by one; empty where nothing is."""
        return ""

    def short_name(self, test: BallBarTest) -> str:
        """Name of a proposed test, without its feed: letters, digits, ``_ . + -``. Numbers of keys that only this
        kind has stand behind its name, as in ``latitude30-centre-ccw``.
        """
        own = [k.of(test) / k.unit for k in self.keys if k.attribute in test.more and k.unit]
        numbers = "-".join(map(number_name, own))
        return f"{self.name}{numbers}-{place_name(test)}-{test.direction.lower()}".replace("_", "-")

    def out_of_reach(self, test: BallBarTest) -> str:
        """Why the axes cannot follow the test's path; empty where they can."""
        try:
            self.path(test, np.linspace(*self.ends(test), _LOOKED_AT))
        except InputError as error:
            return str(error)
        return ""

    def cannot(self, chain: Chain) -> str:
        """Why a machine with these axes runs no test of this kind; empty where it does."""
        missing = [a for a in COORDINATES if a not in chain.linear]
        return (
            f"it needs {', '.join(COORDINATES)}, and the machine has no {' and no '.join(missing)}" if missing else ""
        )

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        """Tests of this kind that a plan looks at first; feed and name are put in later.

        Args:
            chain: the machine's axes.
            length: of the bar, m.
            height: Z of the table ball, m.
        """
        yield from ()

    def variations(self, test: BallBarTest) -> Iterator[BallBarTest]:
        """Tests that differ from ``test`` in one condition of this kind's own: not in feed or direction, which all
        kinds have.
        """
        yield from ()


class Arc(Kind):
    """A kind that goes from ``start`` to ``stop`` once: φ is the command that turns. It needs :data:`FROM` and
    :data:`TO` in its keys.
    """

    goes_round = False
    margin = 2.0 * DEG

    def ends(self, test: BallBarTest) -> tuple[float, float]:
        return test.start, test.stop

    def turned(self, test: BallBarTest) -> BallBarTest:
        back = replace(test, start=test.stop, stop=test.start)
        return replace(back, direction=self.way(back))

    def completed(self, test: BallBarTest) -> BallBarTest:
        return replace(test, direction=self.way(test), revolutions=1)

    def way(self, test: BallBarTest) -> str:
        """``CCW`` where φ grows, ``CW`` where it falls."""
        return "CCW" if test.stop > test.start else "CW"

    def ending(self, test: BallBarTest, stop: float) -> BallBarTest:
        """The same path as far as the command ``stop``, rad."""
        return replace(test, stop=stop)

    def nearest(self, test: BallBarTest) -> str:
        """How far the axes can follow a path that they cannot follow to its end; empty where not at all."""
        if self.out_of_reach(self.ending(test, test.start + np.sign(test.stop - test.start) * 3 * self.margin)):
            return ""
        able, unable = test.start, test.stop
        while abs(unable - able) > 0.05 * DEG:
            middle = (able + unable) / 2
            able, unable = (able, middle) if self.out_of_reach(self.ending(test, middle)) else (middle, unable)
        end = self.ending(test, np.sign(able) * np.floor(abs(able) / DEG * 10.0) / 10.0 * DEG)
        keys = (k for k in self.keys if k.unit and k.of(end) != k.of(test))
        return "; nearest possible: " + ", ".join(f"{k.name} = {k.of(end) / (k.unit or 1.0):.1f}" for k in keys)

    def wrong(self, test: BallBarTest) -> str:
        if test.start == test.stop:
            return f"from_deg and to_deg are both {test.start / DEG:g}; nothing would move"
        if abs(test.stop - test.start) <= 2 * self.margin:
            return (
                f"from_deg and to_deg are {abs(test.stop - test.start) / DEG:g}° apart; allowed: more than "
                f"{2 * self.margin / DEG:g}°, "
                "as both ends of the turn are left out"
            )
        return ""


class Turn(Arc):
    """An arc of which φ is the command of the rotary axis ``axis``."""

    def way(self, test: BallBarTest) -> str:
        """``CCW`` where the axis turns what it carries counter-clockwise, ``CW`` where clockwise."""
        return "CCW" if (test.stop - test.start) * test.chain.axis(test.axis).ccw > 0.0 else "CW"


def number_name(value: float) -> str:
    """A number as a part of a name: ``50``, ``50neg``."""
    return f"{abs(round(value))}{'neg' if value < 0 else ''}"


def place_name(test: BallBarTest) -> str:
    """Where the table ball is, as a part of a name: ``centre``, ``x50``, ``x100-y50neg``."""

    def part(letter: str, value: float) -> str:
        mm = round(value / MM)
        return f"{letter}{number_name(mm)}" if mm else ""

    return "-".join(p for p in map(part, "xy", test.table_ball[:2]) if p) or "centre"


def spindle_name(test: BallBarTest) -> str:
    """At which angle the spindle is held, as the end of a name: ``-spindle180``; nothing at 0."""
    return f"-spindle{number_name(test.spindle / DEG)}" if test.spindle else ""


def able_kinds(chain: Chain) -> list[str]:
    """Names of the kinds of tests that a machine with these axes can run."""
    return [name for name, kind in KINDS.items() if not kind.cannot(chain)]


#: Name in campaign.toml -> kind.
KINDS: dict[str, Kind] = {}
_K = TypeVar("_K", bound=Kind)


def register(cls: type[_K]) -> type[_K]:
    """Class decorator: makes a kind of test known under its ``name``."""
    KINDS[cls.name] = cls()
    return cls


def kind_of(test: BallBarTest) -> Kind:
    """The kind of a test."""
    return KINDS[test.kind]


def all_keys() -> dict[str, list[Key]]:
    """Name -> the keys of that name, one for each kind that has it."""
    out: dict[str, list[Key]] = {}
    for kind in KINDS.values():
        for key in kind.keys:
            out.setdefault(key.name, []).append(key)
    return out
