"""A machine of any chain as links: the two stacks, the bed under them and the column between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.machine.chain import Chain, usual_travel
from mjsim.machine.modelling.links import GAP, Link, Solid, box, points
from mjsim.machine.modelling.tool_stack import ToolStack
from mjsim.machine.modelling.work_stack import WorkStack

#: Height of the floor below the lowest part that moves, m.
_BED = 0.25
#: Distance between the column and what moves before it, m.
_CLEAR = 0.08


@dataclass(frozen=True)
class Assembly:
    """A machine as links.

    Attributes:
        chain: its axes.
        bed: what stands, with the column.
        work: links from the bed to the workpiece, without the table.
        table: what stands on the innermost of them.
        tool: links from the bed to the tool, without the spindle.
        spindle: what stands on the innermost of them.
        floor: height of the floor, m.
    """

    chain: Chain
    bed: Link
    work: tuple[Link, ...]
    table: Link
    tool: tuple[Link, ...]
    spindle: Link
    floor: float


def assembled(chain: Chain) -> Assembly:
    """The machine that mjsim draws and weighs where nothing but the chain is known. All dimensions are assumed."""
    work, tool = WorkStack(chain), ToolStack(chain)
    bottom = work.below
    floor = min(bottom - _BED, -0.75)
    bed = Link("bed", "bed and column", solids=[*work.rest, *tool.rest])
    standing = points([*work.table.solids, *work.rest, *(s for k in work.links for s in k.solids)])
    low, high = standing.min(axis=0), standing.max(axis=0)
    travel = dict(zip(chain.letters, usual_travel(chain), strict=True))
    forth = [float(travel[a.letter][1]) for a in chain.work if not a.rotary and a.along == 1]
    behind = float(high[1]) + _CLEAR + max(forth, default=0.0)
    bed.solids += _column(tool, behind, floor)
    rear = float(points(bed.solids)[:, 1].max())
    half = max(-float(low[0]), float(high[0]), 0.35) - 0.02
    bed.solids += [
        box((-half, half), (float(low[1]) + 0.02, rear), (floor + 0.06, bottom), "white"),
        box((-half + 0.05, half - 0.05), (float(low[1]) + 0.06, rear - 0.04), (floor, floor + 0.06), "graphite"),
    ]
    on_bed, on_column = tuple(reversed(work.links)), tuple(reversed(tool.links))
    return Assembly(chain, bed, on_bed, work.table, on_column, tool.spindle, floor)


def _column(tool: ToolStack, behind: float, floor: float) -> list[Solid]:
    """Upper part that carries the slides, and a foot behind everything that moves on the table's side."""
    front, half = tool.back, tool.wide + 0.04
    foot = max(front, behind)
    rear = max(front + 0.35, foot + 0.3)
    low = tool.low - 0.01
    return [
        box((-half, half), (front + GAP / 2, rear), (low, tool.high + 0.05), "white"),
        box((-half, half), (foot, rear), (floor, low), "white"),
        box((-half - 0.012, half + 0.012), (foot + 0.05, rear - 0.05), (low + 0.08, tool.high - 0.08), "blue"),
    ]


def weights(assembly: Assembly) -> dict[str, tuple[float, np.ndarray, float]]:
    """Mass (kg), centre of mass (3,) m in world coordinates, and moment of inertia (kg·m², the same about all axes) of
    every link that moves.

    Rotary links are balanced: what one carries has its centre of mass on its centreline, as in the shipped model. All
    numbers are assumed.
    """
    out: dict[str, tuple[float, np.ndarray, float]] = {}
    for side in (assembly.work, assembly.tool):
        mass, centre = 0.0, np.zeros(3)
        for link in reversed(side):
            assert link.axis is not None
            if link.axis.rotary:
                own = link.axis.centre
                place = own + mass / _ROTARY_MASS * (own - centre) if mass else own
                out[link.name] = _ROTARY_MASS, place, _INERTIA
                mass, centre = mass + _ROTARY_MASS, own
            else:
                out[link.name] = _SLIDE_MASS, link.origin, _SLIDE_INERTIA
    return out


#: Mass of a slide and of a rotary link, kg; moments of inertia, kg·m² (assumed, of the size of the shipped model's).
_SLIDE_MASS, _ROTARY_MASS, _SLIDE_INERTIA, _INERTIA = 250.0, 80.0, 20.0, 2.5
