"""The numbers of the machine in ``models/`` and the list of its bodies. All dimensions are assumed."""

from __future__ import annotations

from mjsim.machine.modelling import balance, table_side, tool_side
from mjsim.machine.modelling.dimensions import Dimensions
from mjsim.machine.modelling.solids import Body, Machine, Part

DIMENSIONS = Dimensions(
    table_radius=0.310,
    table_bottom=0.030,
    table_top=0.080,  # the tilting axis passes 80 mm below the table's surface
    slot_width=0.014,  # ISO 299
    slot_depth=0.025,
    slots=8,
    ball_height=0.155,  # OT = (., ., 155) mm in the paper
    ball_radius=0.0127,
    cheek_inner=0.365,
    cheek_outer=0.415,
    cheek_top=0.100,
    plate_depth=0.440,
    deck_top=-0.380,
    guide=0.420,
    bed_rear=0.950,  # behind the motor of the cradle at the end of travel
    bed_guide_end=0.940,
    x_screw_front=0.920,
    column_face=0.980,
    floor=-1.150,
    cradle_density=1800.0,
    plate_density=7850.0,
    table_density=7200.0,
)


def machine(dimensions: Dimensions = DIMENSIONS) -> Machine:
    """The machine as solids, with balance plates that put the centre of mass on the tilting axis.

    Args:
        dimensions: of the machine.

    Returns:
        Its bodies: the tool's side first, then the table's.

    Raises:
        ValueError: cradle and table are top-heavy, so that no balance plate on top helps.
    """
    d = dimensions
    made = {
        "column": tool_side.column(d),
        "x_slide": tool_side.x_slide(),
        "z_slide": tool_side.z_slide(),
        "spindle": tool_side.spindle(d),
        "bed": table_side.bed(d),
        "y_slide": table_side.y_slide(d),
        "cradle": table_side.cradle(d, balance.plate_height(d)),
        "table": table_side.table(d),
        "table_fixture": table_side.table_fixture(d),
    }
    return Machine(
        tuple(Body(name, tuple(Part(mesh, pieces) for mesh, pieces in parts.items())) for name, parts in made.items())
    )
