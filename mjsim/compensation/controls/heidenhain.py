"""HEIDENHAIN TNC: compensation tables (*.COM with config.cma), machine parameters, rows for the kinematics table.

Source: HEIDENHAIN technical manuals iTNC 530 HSCI and MANUALplus 620 (nonlinear axis-error compensation, machine
kinematics).
"""

from __future__ import annotations

from mjsim.compensation.controls.base import Control
from mjsim.compensation.tables import Corrections, Grid, Table, scale
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM

#: Points that one table gets at most (assumed; the manuals name 256 for the iTNC).
_MOST = 256
_WIDTH = 14


class Heidenhain(Control):
    """Corrections as TNC controls take them: one table per axis on whose position others depend."""

    name = "heidenhain"
    title = "HEIDENHAIN"

    def grid(self, chain: Chain, out: str, source: str) -> Grid:
        return Grid(most=_MOST, decimals=6, place_decimals=4)

    def files(self, corrections: Corrections) -> dict[str, str]:
        chain = corrections.chain
        out: dict[str, str] = {}
        named: dict[str, list[str]] = {}
        for t in corrections.tables:
            # tables of one source may have different points, so each stands in a file of its own
            name = f"{t.out}_{t.source}.COM" if t.out != t.source else f"{t.source}.COM"
            out[name] = self._com(chain, t, name)
            named.setdefault(t.source, []).append(name)
        if named:
            out["config.cma"] = self._cma(chain, named)
        data = [f"MP_backLash {a}: add {w / scale(chain, a):.6f}" for a, w in corrections.backlash.items()]
        # kv in (m/min)/mm
        data += [f"MP_kvFactor {a}: set {g * 0.06:.6f}" for a, g in corrections.gains.items()]
        if data:
            out["parameters.txt"] = "\n".join([*data, ""])
        if corrections.kinematics:
            out["kinematics.tab"] = self._kinematics_table(corrections)
        return out

    def _com(self, chain: Chain, t: Table, name: str) -> str:
        columns = ["NR", "AXISPOS", "BACKLASH", t.out]
        lines = [f"BEGIN {name} MM", "".join(c.ljust(_WIDTH) for c in columns).rstrip()]
        unit, own = scale(chain, t.source), scale(chain, t.out)
        for n, (x, f, r) in enumerate(zip(t.positions / unit, -t.forward / own, -t.reverse / own, strict=True)):
            back = f"{r + 0.0:+.6f}" if t.two_sided else ""
            cells = [str(n), f"{x + 0.0:+.4f}", back, f"{f + 0.0:+.6f}"]
            lines.append("".join(c.ljust(_WIDTH) for c in cells).rstrip())
        return "\n".join([*lines, "[END]", ""])

    def _cma(self, chain: Chain, named: dict[str, list[str]]) -> str:
        columns = ["NR", "ACTIVE", *named]
        rows = max(map(len, named.values()))
        lines = ["BEGIN config.cma MM", "".join(c.ljust(_WIDTH) for c in columns).rstrip()]
        for n in range(rows):
            cells = [str(n), "*" if n == 0 else ""]
            cells += [names[n] if n < len(names) else "" for names in named.values()]
            lines.append("".join(c.ljust(_WIDTH) for c in cells).rstrip())
        return "\n".join([*lines, "[END]", ""])

    def _kinematics_table(self, corrections: Corrections) -> str:
        """Rows of the transformation chain, from the table to the bed: what goes before each rotary axis."""
        chain, k = corrections.chain, corrections.kinematics
        lines = ["BEGIN kinematics.tab MM", "".join(c.ljust(_WIDTH) for c in ("NR", "KEY", "AXIS", "COORD")).rstrip()]
        number = 0
        for axis in chain.turning:
            for e in chain.location_errors:
                if e.axis == axis.letter and k.get(e.name):
                    letter = e.name[1]
                    unit = DEG if e.rotation else MM
                    cells = [str(number), "Trans", letter, f"{k[e.name] / unit:+.8f}"]
                    lines.append("".join(c.ljust(_WIDTH) for c in cells).rstrip())
                    number += 1
            lines.append("".join(c.ljust(_WIDTH) for c in (str(number), "MachAxis", axis.letter)).rstrip())
            number += 1
        return "\n".join([*lines, "[END]", ""])

    def where(self) -> list[str]:
        return [
            "*.COM: copy them to the folder of the control's compensation tables and name them in config.cma as the "
            "file here does; an asterisk in ACTIVE switches a line on. Only one line is active at a time: put columns "
            "of one axis together in one .COM file where your machine needs more than one.",
            "Values are errors in mm and degrees at AXISPOS; BACKLASH has those of the negative direction.",
            "parameters.txt: type the values into the machine parameters.",
            "kinematics.tab: add the Trans rows before the MachAxis row of the same rotary axis, as KinematicsOpt "
            "(cycle 451) does. They act with M128 or FUNCTION TCPM only.",
        ]
