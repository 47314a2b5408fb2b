"""FANUC 16i to 31i: backlash (1851, 1852), stored pitch error compensation (3620 to 3627), straightness compensation,
places of the rotary axes (19700 to 19705).

Sources: FANUC parameter manuals B-63090EN and B-63980EN, technical report A-77810E (bidirectional pitch error
compensation), A-79348E (tool center point control).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.compensation.arithmetic import Arithmetic
from mjsim.compensation.controls.base import Control, table_and_tilt
from mjsim.compensation.tables import Corrections, Grid, Table, scale
from mjsim.machine.chain import Chain, is_rotary
from mjsim.units import DEG, MM

#: Points per axis, and the largest increment of one point in detection units (times the magnification).
_POINTS, _LARGEST = 256, 7
#: Pitch error data are numbered from here on in a parameter file.
_DATA = 10000


class Fanuc(Control):
    """Corrections as FANUC controls take them: whole numbers of detection units."""

    name = "fanuc"
    title = "FANUC"
    thermal_tool = "let the PMC take it out (option thermal growth compensation along tool vector), or "
    directions_of_axes = False
    most_cross = 6

    def grid(self, chain: Chain, out: str, source: str) -> Grid:
        # straightness compensation has four points per pair of axes
        return Grid(most=_POINTS if out == source else 4, place_decimals=3, held=self.settings.detection_unit)

    def arithmetic(self, chain: Chain) -> Arithmetic:
        return Arithmetic(stepwise=True, transforms=self.settings.transforms)

    def files(self, corrections: Corrections) -> dict[str, str]:
        chain = corrections.chain
        lines: list[str] = []
        for axis, width in corrections.backlash.items():
            value = round(width / scale(chain, axis) / self.settings.detection_unit)
            n = chain.index(axis) + 1
            lines += [f"N01851A{n}P{value}", f"N01852A{n}P{value}"]
        for axis, gain in corrections.gains.items():
            lines.append(f"N01825A{chain.index(axis) + 1}P{round(gain * 100.0)}")
        data: list[str] = []
        first = 0
        for t in corrections.tables:
            if t.out == t.source:
                parameters, values, first = self._pitch(chain, t, first)
                lines += parameters
                data += values
        lines += self._straightness(corrections)
        lines += self._places(corrections)
        if not lines:
            return {}
        return {"parameters.txt": "\n".join(["%", *lines, *data, "%", ""])}

    def held(self, table: Table) -> Table:
        """Pitch errors are kept as small whole increments between points; the reference point has none."""
        if table.out != table.source:
            return replace(table, forward=table.forward, reverse=table.forward)
        zero = int(np.argmin(np.abs(table.positions)))
        unit = self.settings.detection_unit * (DEG if is_rotary(table.out) else MM)
        sides = [np.round(v / unit).astype(int) for v in (table.forward, table.reverse)]
        back = int(sides[1][zero] - sides[0][zero])
        magnification = 1
        while True:
            cumulated = [np.round((v - v[zero]) / magnification).astype(int) for v in sides]
            if max(int(np.abs(np.diff(c)).max()) for c in cumulated) <= _LARGEST:
                break
            magnification += 1
        forward, reverse = (c * magnification * unit for c in cumulated)
        return replace(table, forward=forward, reverse=reverse + back * unit)

    def _units(self, chain: Chain, t: Table, values: np.ndarray) -> np.ndarray:
        return np.round(values / scale(chain, t.out) / self.settings.detection_unit).astype(int)

    def _pitch(self, chain: Chain, t: Table, first: int) -> tuple[list[str], list[str], int]:
        """Parameters, numbered data, and the next free number, of one axis' table."""
        n, unit = chain.index(t.source) + 1, scale(chain, t.source)
        x = t.positions / unit
        step = (x[-1] - x[0]) / (len(x) - 1)
        zero = int(np.argmin(np.abs(x)))
        forward, reverse = self._units(chain, t, t.forward), self._units(chain, t, t.reverse)
        sides = [forward, reverse] if t.two_sided else [forward]
        steps = np.concatenate([np.diff(v) for v in sides])
        magnification = max(1, int(np.gcd.reduce(np.abs(steps))))
        out = [
            f"N03620A{n}P{first + zero}",
            f"N03621A{n}P{first}",
            f"N03622A{n}P{first + len(x) - 1}",
            f"N03623A{n}P{magnification}",
            f"N03624A{n}P{step:.3f}",
        ]
        if chain.is_rotary(t.source) and t.modulo:
            out.append(f"N03625A{n}P360.000")
        if t.two_sided:
            out += [
                f"N03605A{n}P00000001",
                f"N03626A{n}P{first + len(x)}",
                f"N03627A{n}P{int(reverse[zero] - forward[zero])}",
            ]
        data = []
        for side, v in enumerate(sides):
            increments = np.diff(v, prepend=v[0]) // magnification
            start = first + side * len(x)
            data += [f"N{_DATA + start + i}P{p}" for i, p in enumerate(increments)]
        return out, data, first + len(sides) * len(x)

    def _straightness(self, corrections: Corrections) -> list[str]:
        chain, out = corrections.chain, []
        for i, t in enumerate(t for t in corrections.tables if t.out != t.source):
            x = t.positions / scale(chain, t.source)
            values = self._units(chain, t, t.forward)
            out += [f"N{5711 + i:05d}P{chain.index(t.source) + 1}", f"N{5721 + i:05d}P{chain.index(t.out) + 1}"]
            for k, place in enumerate(np.pad(x, (0, 4 - len(x)), mode="edge")):
                out.append(f"N{5731 + 10 * k + i:05d}P{place:.3f}")
            for k, value in enumerate(np.pad(values, (0, 4 - len(x)), mode="edge")):
                out.append(f"N{5771 + 10 * k + i:05d}P{value}")
        return out

    def _places(self, corrections: Corrections) -> list[str]:
        chain, k, out = corrections.chain, corrections.kinematics, []
        if not k:
            return out
        table, tilt = table_and_tilt(chain)
        for start, axis in ((19700, tilt), (19703, table)):
            for e in chain.location_errors:
                if e.axis == axis and not e.rotation and k.get(e.name):
                    out.append(f"N{start + e.along}P{k[e.name] / MM:.6f} (add)")
        return out

    def friction_advice(self, axis: str, torque: float) -> str:
        """The backlash acceleration counts in units of the servo software."""
        return (
            f"the backlash acceleration (2003 bit 5, 2048, 2071) counts in units of the servo software, which do not "
            f"follow from {torque:.3g} N·m; tune it with a circle test"
        )

    def where(self) -> list[str]:
        return [
            "parameters.txt: read it in as parameters and pitch error data (numbers from 10000 on), or type them. "
            "Then switch the power off and on and return to the reference position.",
            f"Values are whole detection units of {self.settings.detection_unit:g} mm or degrees (--detection-unit).",
            "Numbers of the points begin at 0 here; give them other numbers where your control uses these already.",
            "Points of the straightness compensation are positions in mm or degrees here: type the numbers of the "
            "pitch error points that lie there.",
            "Lines marked (add) are changes of the values that are set already. They act with G43.4 only.",
        ]
