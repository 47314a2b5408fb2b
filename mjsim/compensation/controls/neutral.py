"""A neutral CSV: every correction as a number, for controls that mjsim does not know."""

from __future__ import annotations

from mjsim.compensation.controls.base import Control
from mjsim.compensation.tables import Corrections, Grid, scale
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM, UM


class Neutral(Control):
    """Corrections as two tables of comma-separated values."""

    name = "csv"
    title = "a CSV file"
    components = True
    pulses = True

    def grid(self, chain: Chain, out: str, source: str) -> Grid:
        return Grid(most=5000, decimals=9, place_decimals=5)

    def files(self, corrections: Corrections) -> dict[str, str]:
        chain = corrections.chain
        values = ["quantity,axis,value,unit"]
        for a, w in corrections.backlash.items():
            values.append(f"backlash,{a},{w / scale(chain, a):.9f},{_unit(chain, a)}")
        for a, g in corrections.gains.items():
            values.append(f"position gain,{a},{g:.6g},1/s")
        for a, p in corrections.pulses.items():
            values.append(f"friction pulse,{a},{p.speed / scale(chain, a) * 60.0:.6f},{_unit(chain, a)}/min")
            values.append(f"friction pulse time,{a},{p.time:.6g},s")
        for e in chain.location_errors:
            if e.name in corrections.kinematics:
                size, unit = (UM, "urad") if e.rotation else (MM, "mm")
                values.append(f"location {e.name},{e.axis},{corrections.kinematics[e.name] / size:.6f},{unit}")
        out = {"values.csv": "\n".join([*values, ""])} if len(values) > 1 else {}
        rows = ["corrected,by,modulo,position,unit,forward,reverse,corrected_unit"]
        for t in corrections.tables:
            unit, own = scale(chain, t.source), scale(chain, t.out)
            for x, f, r in zip(t.positions / unit, t.forward / own, t.reverse / own, strict=True):
                rows.append(
                    f"{t.out},{t.source},{int(t.modulo)},{x:.5f},{_unit(chain, t.source)},{f + 0.0:.9f},{r + 0.0:.9f},"
                    f"{_unit(chain, t.out)}"
                )
        if len(rows) > 1:
            out["tables.csv"] = "\n".join([*rows, ""])
        return out

    def where(self) -> list[str]:
        return [
            "values.csv and tables.csv: values of a table are added to the command of the corrected axis at the "
            "position of the other one, on a straight line between the points.",
            "A row that corrects a component error (ISO 230-1, such as a turn of a slide) holds the negative of that "
            "error: for controls with a volumetric compensation, which know the arm to the tool.",
            "A backlash is the full width: half of it is added in the direction of motion.",
            "A friction pulse is added to the speed set-point where the axis reverses, in the new direction, and "
            "decays as exp(-t / friction pulse time).",
        ]


def _unit(chain: Chain, axis: str) -> str:
    return "deg" if scale(chain, axis) == DEG else "mm"
