"""Templates of machines: a layout of axes and a size, with the numbers that a machine of that size may have.

Nobody knows the inertias of his machine. A template says what is typical, and that each number is right within a factor
only: a diagnosis then fits it instead of believing it. All numbers are assumed. They follow from a few: the moving mass
and the lead give the inertia of a linear axis, the bandwidth of the velocity loop gives its gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from mjsim.errors import InputError
from mjsim.machine.chain import SENSES, Chain, Placement, chain_of

#: Within which a number of a template is believed, two standard deviations (assumed).
FACTOR = 2.0


@dataclass(frozen=True)
class TypicalDrive:
    """A drive of a machine of some size; every number is assumed.

    Attributes:
        gear: Lead of a linear axis, mm; teeth of the worm wheel of a rotary one.
        position_gain: Kpp, 1/s. velocity_gain: Kvp, N·m·s/rad. integral_time: Ti, s.
        inertia: Of the whole axis at the motor, kg·m². viscous: N·m·s/rad.
        lifted: Torque of an axis that lifts, N·m.
        coulomb: Friction at the motor, N·m. presliding: Motor angle over which it builds up, rad.
    """

    gear: float
    position_gain: float
    velocity_gain: float
    integral_time: float
    inertia: float
    viscous: float
    lifted: float
    coulomb: float
    presliding: float


@dataclass(frozen=True)
class Size:
    """How large a machine is.

    Attributes:
        name: As in the name of a template.
        words: What the user knows of it.
        linear, rotary: Drives of its axes.
    """

    name: str
    words: str
    linear: TypicalDrive
    rotary: TypicalDrive


SIZES = (
    Size(
        "small",
        "table of up to 350 mm, moving masses of 100 to 300 kg",
        TypicalDrive(10.0, 60.0, 2.8, 0.010, 0.0055, 0.006, 2.0, 0.7, 0.003),
        TypicalDrive(72, 60.0, 1.0, 0.010, 0.0020, 0.003, 0.0, 0.25, 0.008),
    ),
    Size(
        "medium",
        "table of 400 to 650 mm, moving masses of 300 to 1000 kg",
        TypicalDrive(10.0, 45.0, 4.5, 0.012, 0.0115, 0.010, 3.0, 1.0, 0.003),
        TypicalDrive(72, 45.0, 1.5, 0.012, 0.0040, 0.004, 0.0, 0.4, 0.006),
    ),
    Size(
        "large",
        "table of 800 mm and more, moving masses of 1 to 4 t",
        TypicalDrive(16.0, 30.0, 9.0, 0.018, 0.0320, 0.025, 6.0, 2.8, 0.004),
        TypicalDrive(120, 30.0, 2.3, 0.018, 0.0072, 0.006, 0.0, 0.5, 0.007),
    ),
)


@dataclass(frozen=True)
class Layout:
    """An order of axes with a name.

    Attributes:
        name: As in the name of a template.
        words: What it looks like.
        configuration: Axes from the workpiece to the tool.
        leaning: Whether the axis that tilts the tool leans by 45° between Y and Z.
    """

    name: str
    words: str
    configuration: str
    leaning: bool = False

    @property
    def placements(self) -> tuple[tuple[str, Placement], ...]:
        """Rotary axes, all of which count as ISO 841 says."""
        chain = chain_of(self.configuration)
        lean = {True: Placement((0.0, 1.0, 1.0)), False: Placement((0.0, -1.0, -1.0))}
        return tuple(
            (a.letter, lean[a in chain.tool] if self.leaning and not a.vertical else Placement(sense=SENSES[0]))
            for a in chain.axes
            if a.rotary
        )


LAYOUTS = (
    Layout("trunnion-a", "tilting table: C on a cradle A", "w-C'A'Y'bXZ-t"),
    Layout("trunnion-b", "tilting table: C on a cradle B", "w-C'B'X'bYZ-t"),
    Layout("trunnion-column", "tilting table C on B, moving column", "w-C'B'bXYZ-t"),
    Layout("head-table-b", "swivel head B, rotary table C", "w-C'X'bYZB-t"),
    Layout("head-table-a", "swivel head A, rotary table C", "w-C'bXYZA-t"),
    Layout("fork-head", "fork head: C carries A, table at rest", "w-bXYZCA-t"),
    Layout("nutating-table", "nutating table: C on B, which leans by 45°", "w-C'B'Y'bXZ-t", leaning=True),
    Layout("nutating-head", "nutating head B, which leans by 45°, rotary table C", "w-C'bXYZB-t", leaning=True),
    Layout("four-axes", "rotary table C, three linear axes", "w-C'bXYZ-t"),
    Layout("three-axes", "three linear axes, cross table", "w-X'Y'bZ-t"),
)


@dataclass(frozen=True)
class MachineTemplate:
    """A layout in a size."""

    layout: Layout
    size: Size

    @property
    def name(self) -> str:
        """As the user says it."""
        return f"{self.layout.name}-{self.size.name}"

    @property
    def words(self) -> str:
        """What it is."""
        return f"{self.layout.words}; {self.size.words}"

    @cached_property
    def chain(self) -> Chain:
        """Its axes."""
        return chain_of(self.layout.configuration, self.layout.placements)

    def drive(self, axis: str) -> TypicalDrive:
        """The drive of an axis."""
        return self.size.rotary if self.chain.is_rotary(axis) else self.size.linear

    def to_json(self) -> dict:
        """Plain data, as ``mjsim machine templates --json`` prints it."""
        drives = {a: vars(self.drive(a)) for a in self.chain.letters}
        return {
            "name": self.name,
            "layout": self.layout.words,
            "size": self.size.words,
            "configuration": self.layout.configuration,
            "factor": FACTOR,
            "drives": drives,
        }


TEMPLATES = {t.name: t for t in (MachineTemplate(layout, size) for layout in LAYOUTS for size in SIZES)}


def template_named(name: str) -> MachineTemplate:
    """The template of a name.

    Raises:
        InputError: there is none.
    """
    if name not in TEMPLATES:
        layouts, sizes = ", ".join(x.name for x in LAYOUTS), ", ".join(s.name for s in SIZES)
        raise InputError(
            f"machine template {name[:60]!r} is unknown; allowed: LAYOUT-SIZE with a layout of {layouts} and a size of "
            f"{sizes}"
        )
    return TEMPLATES[name]
