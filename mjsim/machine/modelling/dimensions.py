"""The dimensions that several parts of a machine share."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Dimensions:
    """Lengths in m, densities in kg/m³. The origin is the intersection of the tilting axis and the table's axis.

    Attributes:
        table_radius: of the round table.
        table_bottom: height of its lower face.
        table_top: height of its surface.
        slot_width: of a T-slot.
        slot_depth: of a T-slot.
        slots: how many T-slots there are, evenly spread.
        ball_height: of the table ball's centre.
        ball_radius: of both balls of the bar.
        cheek_inner: distance of the cradle's cheeks from the middle, inside.
        cheek_outer: the same, outside.
        cheek_top: height of the cheeks' upper face.
        plate_depth: of a balance plate on a cheek, along y.
        deck_top: height of the upper face of the slide under the cradle.
        guide: distance of that slide's guides from the middle.
        bed_rear: y where the bed's front part ends and the block under the column begins.
        bed_guide_end: y of the rear ends of the bed's guides.
        x_screw_front: y of the front of the bearing blocks of the column's screw.
        column_face: y of the column's front.
        floor: height of the floor.
        cradle_density: of the cradle's casting, as in the class ``light_casting`` of the model.
        plate_density: of journals and balance plates, as in the class ``steel``.
        table_density: of the table, as in the class ``machined``.
    """

    table_radius: float
    table_bottom: float
    table_top: float
    slot_width: float
    slot_depth: float
    slots: int
    ball_height: float
    ball_radius: float
    cheek_inner: float
    cheek_outer: float
    cheek_top: float
    plate_depth: float
    deck_top: float
    guide: float
    bed_rear: float
    bed_guide_end: float
    x_screw_front: float
    column_face: float
    floor: float
    cradle_density: float
    plate_density: float
    table_density: float
