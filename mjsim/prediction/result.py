"""The predicted error of a part, and how it is handed on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.machine.model import Machine
from mjsim.units import MM, UM

PASSES, FAILS, UNKNOWN = "passes", "fails", "cannot say with these measurements"
#: Blocks that a page names.
_CRITICAL = 6


@dataclass(frozen=True)
class Block:
    """One block of the program.

    Attributes:
        line: Line of the NC file, or the block's number.
        normal: Largest deviation normal to the path, m.
        low, high: 95 % interval of it, m.
        along: Deviation along the path where that is, m; negative: behind.
        cause: What adds most to the largest deviation: a key of :class:`Cause`.
        share: How much that is, m.
        verdict: As of the whole program; empty without a tolerance.
    """

    line: int
    normal: float
    low: float
    high: float
    along: float
    cause: str = ""
    share: float = 0.0
    verdict: str = ""


@dataclass(frozen=True)
class Cause:
    """What one error of the machine makes of the deviation normal to the path.

    Attributes:
        key: Of the effect, or ``servo lag``.
        axis: What it acts on.
        rms: Over the program, m.
        at_worst: Share of the deviation where that is largest, m, signed.
    """

    key: str
    axis: str
    rms: float
    at_worst: float


@dataclass(frozen=True)
class Cut:
    """One of the cutting paths of a program.

    Attributes:
        first, last: Lines of the NC file, or numbers of blocks.
        largest: Largest normal deviation, m, and its 95 % interval.
        verdict: As of the whole program; empty without a tolerance.
    """

    first: int
    last: int
    largest: tuple[float, float, float]
    verdict: str = ""


@dataclass(frozen=True)
class Prediction:
    """The error that a part will have on a machine.

    Attributes:
        program: Its name.
        machine: The machine.
        path: Programmed places of the tip, (n, 3) m in the workpiece.
        normal: Deviation normal to the path, (n, 3) m.
        along: Deviation along it, (n,) m.
        blocks: Every block with its interval.
        causes: What makes the deviation, the largest first.
        by_axis: The same, all causes of an axis together.
        largest: Largest normal deviation, m, and its 95 % interval.
        tolerance: Allowed normal deviation, m, or ``None``.
        verdict: ``passes``, ``fails`` or ``cannot say …``; empty without a tolerance.
        reason: One sentence on the verdict.
        uncertain: Effects that make most of the uncertainty of the largest deviation, with their share of its variance.
        basis: What the interval follows from.
        seconds: Duration of the program as the control runs it.
        time: Instants of the arrays, (n,) s; feed blocks alone count.
        cuts: The cutting paths, each with its own verdict.
        cut_of: Which of them an instant belongs to, (n,).
        notes: Sentences on how the program was read.
    """

    program: str
    machine: Machine
    path: np.ndarray
    normal: np.ndarray
    along: np.ndarray
    blocks: tuple[Block, ...]
    causes: tuple[Cause, ...]
    by_axis: tuple[Cause, ...]
    largest: tuple[float, float, float]
    tolerance: float | None
    verdict: str
    reason: str
    uncertain: tuple[tuple[str, float], ...]
    basis: str
    seconds: float
    time: np.ndarray
    cuts: tuple[Cut, ...]
    cut_of: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def worst(self) -> Block:
        """The block with the largest normal deviation."""
        return max(self.blocks, key=lambda b: b.normal)

    @property
    def sizes(self) -> np.ndarray:
        """Largest normal deviation of every block, (blocks,) m."""
        return np.array([b.normal for b in self.blocks])

    @property
    def critical(self) -> list[Block]:
        """The blocks that decide, the worst first: at most one of every twentieth of the program."""
        groups = np.array_split(np.arange(len(self.blocks)), min(20, len(self.blocks)))
        worst = [max((self.blocks[i] for i in g), key=lambda b: b.high) for g in groups]
        return sorted(worst, key=lambda b: -b.high)[:_CRITICAL]

    @property
    def counts(self) -> dict[str, int]:
        """Number of blocks by verdict; empty without a tolerance."""
        if self.tolerance is None:
            return {}
        return {v: sum(b.verdict == v for b in self.blocks) for v in (PASSES, FAILS, UNKNOWN)}

    def to_json(self, blocks: bool = True) -> dict:
        """Plain numbers in µm, as ``mjsim predict --json`` prints them.

        Args:
            blocks: With a row for every block.
        """
        size = np.linalg.norm(self.normal, axis=1)
        return {
            "program": self.program,
            "machine": self.machine.name,
            "basis": self.basis,
            "cutting_forces": "not included",
            "duration_s": round(self.seconds, 3),
            "largest_um": _um(self.largest[0]),
            "largest_ci95_um": [_um(x) for x in self.largest[1:]],
            "rms_um": _um(float(np.sqrt(np.mean(size**2)))),
            "lag_um": _um(float(np.abs(self.along).max())),
            "worst_line": self.worst.line,
            "tolerance_um": None if self.tolerance is None else _um(self.tolerance),
            "verdict": self.verdict or None,
            "reason": self.reason or None,
            "blocks_by_verdict": self.counts or None,
            "paths": [_cut(c) for c in self.cuts],
            "notes": list(self.notes),
            "causes": [
                {"id": c.key, "axis": c.axis, "rms_um": _um(c.rms), "at_worst_um": _um(c.at_worst)} for c in self.causes
            ],
            "by_axis": [{"id": c.key, "rms_um": _um(c.rms), "at_worst_um": _um(c.at_worst)} for c in self.by_axis],
            "uncertain": [{"id": k, "share": round(s, 3)} for k, s in self.uncertain],
            "blocks": [_row(b) for b in self.blocks] if blocks else [_row(b) for b in self.critical],
        }

    def to_csv(self) -> str:
        """One line per kept instant: place in mm, deviation normal and along in µm."""
        rows = ["x_mm,y_mm,z_mm,normal_x_um,normal_y_um,normal_z_um,along_um"]
        data = np.column_stack([self.path / MM, self.normal / UM, self.along / UM])
        return "\n".join([*rows, *(",".join(f"{v:.4f}" for v in row) for row in data), ""])


def judged(low: float, high: float, allowed: float, stated: bool) -> str:
    """The verdict on a deviation with an interval.

    Args:
        low, high: Ends of the interval, in any unit.
        allowed: In the same unit.
        stated: Whether errors that no test showed have a tolerance.
    """
    if low > allowed:
        return FAILS
    return PASSES if high <= allowed and stated else UNKNOWN


def _row(b: Block) -> dict:
    out = {
        "line": b.line,
        "normal_um": _um(b.normal),
        "ci95_um": [_um(b.low), _um(b.high)],
        "along_um": _um(b.along),
        "cause": b.cause,
        "cause_um": _um(b.share),
    }
    return out | ({"verdict": b.verdict} if b.verdict else {})


def _cut(c: Cut) -> dict:
    out = {"first_line": c.first, "last_line": c.last, "largest_um": _um(c.largest[0])}
    out["largest_ci95_um"] = [_um(x) for x in c.largest[1:]]
    return out | ({"verdict": c.verdict} if c.verdict else {})


def _um(x: float) -> float:
    return round(float(x / UM), 3)
