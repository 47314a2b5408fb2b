"""Fig. 3 and 4: spectra and curves of the pitch errors, identified from the example's tangential tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mjsim.paper import caption
from mjsim.paper.machine import PaperMachine
from mjsim.plots import pitch, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SOURCE = "From an independent simulation of the tangential tests (example kato2013), not the paper's data."
#: Ends of the amplitude axes, °. The paper ends C's at 1.5e-3 as well and writes the height of order 72 beside the
#: line.
_TOP = {"A": 1.5e-3, "C": 3.0e-3}
#: The paper's scale of Fig. 4, ° per division.
_DIVISION = 4e-3
_CURVES = (("A", "CW"), ("A", "CCW"), ("C", "CW"))


def spectra_sheet(machine: PaperMachine) -> Figure:
    """Fig. 3: A on the left, C on the right, CCW above CW."""
    width, height = 11.0, 5.6
    sheet = style.new_figure(width, height)
    handles, labels = [], []
    for i, (letter, axis) in enumerate(zip("ab", "AC", strict=True)):
        found = machine.pitch[axis]
        for k, way in enumerate(("CCW", "CW")):
            d = found.directions[way]
            named = [(c.order, c.amplitude_deg) for c in d.components]
            axes = sheet.add_axes((0.055 + 0.5 * i, 0.595 - 0.385 * k, 0.435, 0.335))
            pitch.draw_spectrum(
                axes,
                pitch.PitchSpectrum(way, d.orders, d.amplitude_deg, d.floor_deg, d.limit_deg, named, d.tooth_order),
                _TOP[axis],
            )
            axes.set_ylabel("amplitude, 10⁻³ deg", fontsize=style.SMALL)
            if way == "CW":  # the lower one
                seen = f"arc of {d.arc_deg:.0f}°: resolution {d.resolution:.1f}"
                axes.set_xlabel(f"number of peaks per revolution ({seen})", fontsize=style.TEXT)
            handles, labels = axes.get_legend_handles_labels()
        sheet.text(0.055 + 0.5 * i, 0.96, f"({letter}) {axis} axis", fontsize=style.TEXT, fontweight="bold")
    labels = ["multiples of the teeth" if "multiples" in t else t for t in labels]
    sheet.legend(
        handles, labels, loc="center", bbox_to_anchor=(0.5, 0.093), ncols=5, frameon=False, fontsize=style.TEXT
    )
    caption.write(sheet, f"Fig. 3  Amplitude spectra of the pitch errors of the A and C axes. {_SOURCE}")
    return sheet


def curves_sheet(machine: PaperMachine) -> Figure:
    """Fig. 4: A turning CW and CCW, C turning CW."""
    width, height, side = 11.0, 4.6, 3.0
    sheet = style.new_figure(width, height)
    handles, labels = [], []
    for i, (axis, way) in enumerate(_CURVES):
        d = machine.pitch[axis].directions[way]
        x = 0.35 + 3.55 * i
        axes = style.polar_axes(sheet, (x / width, 1.15 / height, side / width, side / height))
        pitch.draw_curves(
            axes, pitch.PitchCurves(way, d.position_deg, d.raw_deg, d.modified_deg, d.identified_deg), _DIVISION
        )
        text = f"({'abc'[i]}) {axis} axis, {way}"
        sheet.text(x / width, 0.78 / height, text, fontsize=style.TEXT, fontweight="bold")
        sheet.text((x + side) / width, 0.78 / height, pitch.scale_text(_DIVISION), fontsize=style.TEXT, ha="right")
        handles, labels = axes.get_legend_handles_labels()
    sheet.legend(
        handles, labels, loc="center", bbox_to_anchor=(0.5, 0.52 / height), ncols=3, frameon=False, fontsize=style.TEXT
    )
    caption.write(
        sheet,
        f"Fig. 4  Raw, modified and identified data of the pitch errors of the A and C axes over the axis "
        f"position. {_SOURCE}",
    )
    return sheet
