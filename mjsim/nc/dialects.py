"""How controls differ in what this project writes and reads. Sources: docs/nc.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.chain import Chain

#: What the F word of a block means.
FEEDS = {
    "a11": "G94, eq. A.11: path of all five axes, mm and degrees counted alike, per minute",
    "inverse": "G93: one divided by the minutes of the block",
    "tcp": "G94 with tool centre point control: path of the tool tip on the workpiece, mm/min",
}


@dataclass(frozen=True)
class Dialect:
    """One kind of control.

    Attributes:
        name: as the user says it. title: the controls meant.
        feeds: F conventions that it can be written in, the usual one first.
        decimals: of positions. feed_decimals: of F.
        largest_inverse: largest F of G93, 1/min.
        comment: what encloses a comment. upper: whether comments are in capitals.
        units: G codes for mm, and for inches where F's meaning with them is clear.
        path: words of the preamble for continuous-path mode.
        tip_on, tip_off: blocks that switch tool centre point control.
        weight: mm of path that a degree of a rotary axis counts in G94
            (1 where F is that of eq. A.11, 0 where F is the linear axes' alone).
        strict_point: whether an axis word without a decimal point is ambiguous.
        cycle: the control shortens blocks of rotary axes to whole cycles of so many s; 0: it does not.
        ending: of its programs' files.
    """

    name: str
    title: str
    feeds: tuple[str, ...]
    decimals: int
    feed_decimals: int
    largest_inverse: float
    comment: tuple[str, str]
    upper: bool
    units: tuple[int, ...]
    path: tuple[str, ...]
    tip_on: str = ""
    tip_off: str = ""
    weight: float = 1.0
    strict_point: bool = False
    cycle: float = 0.0
    ending: str = ".nc"

    def weights(self, chain: Chain) -> np.ndarray:
        """Weights (axes,) of the axes in the length of a G94 block."""
        return np.array([self.weight if a.rotary else 1.0 for a in chain.axes])


_LIST = (
    Dialect(
        name="fanuc",
        title="Fanuc and alike, increment system IS-C",
        feeds=("a11", "inverse", "tcp"),
        decimals=4,
        feed_decimals=3,
        largest_inverse=9999.999,
        comment=("(", ")"),
        upper=True,
        units=(21, 20),
        path=("G64",),
        tip_on="G43.4 H1",
        tip_off="G49",
        strict_point=True,
    ),
    Dialect(
        name="siemens",
        title="Sinumerik 840D and later",
        feeds=("a11", "inverse", "tcp"),
        decimals=5,
        feed_decimals=4,
        largest_inverse=1e9,
        comment=("; ", ""),
        upper=False,
        units=(710, 71),
        path=("G64",),
        tip_on="TRAORI",
        tip_off="TRAFOOF",
        ending=".mpf",
    ),
    Dialect(
        name="linuxcnc",
        title="LinuxCNC (RS274/NGC)",
        feeds=("inverse", "tcp"),
        decimals=6,
        feed_decimals=4,
        largest_inverse=1e9,
        comment=("(", ")"),
        upper=False,
        units=(21, 20),
        path=("G64 P0.001 Q0",),  # Q0: or it joins straight blocks that lie within P of a line
        tip_on="M428",  # as the configurations of LinuxCNC with switchable kinematics have it
        tip_off="M429",
        weight=0.0,
        cycle=1e-3,
        ending=".ngc",
    ),
)
#: Dialects that are written, and read.
DIALECTS = {d.name: d for d in _LIST}
#: Dialects that are read. F of HEIDENHAIN in a block of linear and rotary axes counts mm and degrees alike (assumed).
READABLE = {
    **DIALECTS,
    "heidenhain": Dialect(
        name="heidenhain",
        title="HEIDENHAIN TNC, Klartext and DIN/ISO",
        feeds=(),
        decimals=4,
        feed_decimals=3,
        largest_inverse=0.0,
        comment=("; ", ""),
        upper=False,
        units=(71, 70),
        path=(),
    ),
}


def dialect(name: str, reading: bool = False) -> Dialect:
    """The dialect of that name.

    Args:
        name: Of the dialect.
        reading: Whether a program is to be read.

    Raises:
        InputError: there is none.
    """
    known = READABLE if reading else DIALECTS
    if name not in known:
        raise InputError(f"unknown NC dialect {name!r}; allowed: {', '.join(known)}")
    return known[name]
