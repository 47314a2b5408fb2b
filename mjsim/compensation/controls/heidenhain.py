"""HEIDENHAIN TNC: compensation tables (*.COM with config.cma), machine parameters, rows for the kinematics table.

Source: HEIDENHAIN technical manuals iTNC 530 HSCI and MANUALplus 620 (nonlinear axis-error compensation, machine
kinematics). KinematicsComp, which takes component errors: iTNC 530 HSCI, pages 666 to 686.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.compensation.controls.base import Control
from mjsim.compensation.tables import Corrections, Grid, Table, Wanted, rounded, scale
from mjsim.machine.axis import COORDINATES, TURNING
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM

#: Points that one table gets at most (assumed; the manuals name 256 for the iTNC).
_MOST = 256
_WIDTH = 14
#: Columns of a COM file for the component errors of its axis: along three coordinates and about them.
_COLUMNS = "C1 C2 C3 C4 C5 C6".split()


class Heidenhain(Control):
    """Corrections as TNC controls take them: one table per axis on whose position errors depend."""

    name = "heidenhain"
    title = "HEIDENHAIN"
    components = True
    thermal_tool = "let the PLC take it out (compensation of thermal expansion), or "

    def grid(self, chain: Chain, out: str, source: str) -> Grid:
        return Grid(most=_MOST, decimals=6, place_decimals=4)

    def corrections(self, wanted: Wanted, ranges: dict[str, tuple[float, float]]) -> Corrections:
        """One file holds all corrections by the position of one axis, so these share their points: the most of any."""
        made = super().corrections(wanted, ranges)
        points = {t.source: t.positions for t in sorted(made.tables, key=lambda t: len(t.positions))}
        return replace(made, tables=tuple(self._at(t, points[t.source], wanted.chain) for t in made.tables))

    def _at(self, t: Table, x: np.ndarray, chain: Chain) -> Table:
        if np.array_equal(x, t.positions):
            return t
        own, grid = scale(chain, t.out), self.grid(chain, t.out, t.source)
        forward, reverse = (rounded(np.interp(x, t.positions, v) / own, grid) * own for v in (t.forward, t.reverse))
        return replace(t, positions=x, forward=forward, reverse=reverse)

    def files(self, corrections: Corrections) -> dict[str, str]:
        chain = corrections.chain
        plain = [t for t in corrections.tables if t.out in chain.letters]
        sources = [a for a in chain.letters if any(t.source == a for t in plain)]
        out = {f"{a}.COM": self._com(chain, a, [t for t in plain if t.source == a]) for a in sources}
        if sources:
            rows = [["NR", "ACTIVE", *sources], ["0", "*", *(f"{a}.COM" for a in sources)]]
            out["config.cma"] = _lines("config.cma", rows)
        data = [f"MP_backLash {a}: add {w / scale(chain, a):.6f}" for a, w in corrections.backlash.items()]
        # kv in (m/min)/mm
        data += [f"MP_kvFactor {a}: set {g * 0.06:.6f}" for a, g in corrections.gains.items()]
        if data:
            out["parameters.txt"] = "\n".join([*data, ""])
        if components := [t for t in corrections.tables if t.out not in chain.letters]:
            out["kinematicscomp.txt"] = self._components(chain, components)
        if corrections.kinematics:
            out["kinematics.tab"] = self._kinematics_table(corrections)
        return out

    def _com(self, chain: Chain, source: str, tables: list[Table]) -> str:
        rows = [["NR", "AXISPOS", "BACKLASH", *(t.out for t in tables)]]
        own = next((t for t in tables if t.out == source and t.two_sided), None)
        for n, x in enumerate(tables[0].positions / scale(chain, source)):
            back = f"{-own.reverse[n] / scale(chain, source) + 0.0:+.6f}" if own is not None else ""
            values = [f"{-t.forward[n] / scale(chain, t.out) + 0.0:+.6f}" for t in tables]
            rows.append([str(n), f"{x + 0.0:+.4f}", back, *values])
        return _lines(f"{source}.COM", rows)

    def _components(self, chain: Chain, tables: list[Table]) -> str:
        """Component errors by the position of their axis, in the columns that the manual recommends (page 680)."""
        lines = []
        for source in dict.fromkeys(t.source for t in tables):
            mine = [t for t in tables if t.source == source]
            columns = [f"{_COLUMNS[(*COORDINATES, *TURNING).index(t.out[1])]}_{t.out}" for t in mine]
            rows = [["NR", "AXISPOS", *columns]]
            for n, x in enumerate(mine[0].positions / scale(chain, source)):
                values = [f"{-t.forward[n] / scale(chain, t.out) + 0.0:+.6f}" for t in mine]
                rows.append([str(n), f"{x + 0.0:+.4f}", *values])
            lines.append(_lines(f"{source}.COM", rows))
        return "".join(lines)

    def _kinematics_table(self, corrections: Corrections) -> str:
        """Rows of the transformation chain, from the table to the bed: what goes before each rotary axis."""
        chain, k = corrections.chain, corrections.kinematics
        rows = [["NR", "KEY", "AXIS", "COORD"]]
        for axis in chain.turning:
            for e in chain.location_errors:
                if e.axis == axis.letter and k.get(e.name):
                    letter = e.name[1]
                    unit = DEG if e.rotation else MM
                    rows.append([str(len(rows) - 1), "Trans", letter, f"{k[e.name] / unit:+.8f}"])
            rows.append([str(len(rows) - 1), "MachAxis", axis.letter])
        return _lines("kinematics.tab", rows)

    def friction_advice(self, axis: str, torque: float) -> str:
        """Friction compensation is a motor current there."""
        return (
            f"the friction compensation of a TNC is a motor current: {torque:.3g} N·m divided by the torque constant "
            f"of the motor, which is not in the machine file"
        )

    def where(self) -> list[str]:
        return [
            "*.COM: copy them to the folder of the control's compensation tables and name them in config.cma as the "
            "file here does; an asterisk in ACTIVE switches the line on. One file has a column for every axis "
            "that is corrected by the position of its axis.",
            "Values are errors in mm and degrees at AXISPOS; BACKLASH has those of the negative direction.",
            "parameters.txt: type the values into the machine parameters.",
            "kinematicscomp.txt: component errors for KinematicsComp (a software option), mm and degrees at AXISPOS. "
            "The machine builder enters them in the columns C1 to C6 of the COM file of that axis, with a Trans row "
            "in COMPTAB for each of them before its MachAxis row.",
            "kinematics.tab: add the Trans rows before the MachAxis row of the same rotary axis, as KinematicsOpt "
            "(cycle 451) does. They act with M128 or FUNCTION TCPM only.",
        ]


def _lines(name: str, rows: list[list[str]]) -> str:
    """A table as the control's editor writes it: name, columns of one width, end."""
    body = ["".join(cell.ljust(_WIDTH) for cell in row).rstrip() for row in rows]
    return "\n".join([f"BEGIN {name} MM", *body, "[END]", ""])
