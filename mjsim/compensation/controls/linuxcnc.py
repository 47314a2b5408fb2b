"""LinuxCNC: BACKLASH and COMP_FILE of each joint, kinematic pins of the five-axis kinematics."""

from __future__ import annotations

from mjsim.compensation.arithmetic import Arithmetic, Ramp, sticks
from mjsim.compensation.controls.base import Control, table_and_tilt
from mjsim.compensation.tables import Corrections, Grid, Table, scale
from mjsim.machine.chain import SENSES, Chain, usual_speed
from mjsim.units import MM

#: MAX_ACCELERATION of a joint where the user does not say, mm/s² or °/s² (assumed).
USUAL_ACCELERATION = 1000.0
_CYCLE = 1e-3


class LinuxCNC(Control):
    """Corrections as LinuxCNC 2.9 reads them (`ini-config`, sections JOINT_n)."""

    name = "linuxcnc"
    title = "LinuxCNC"
    thermal_tool = "let HAL take it out (external offset of the axis, pins axis.L.eoffset-counts and -scale), or "
    crossed = False
    directions_of_axes = False
    gains = False
    merges = True

    def grid(self, chain: Chain, out: str, source: str) -> Grid:
        return Grid(most=256, decimals=7, place_decimals=5, modulo=False)

    def takes_over(self, table: Table) -> bool:
        return True  # a COMP_FILE switches BACKLASH off

    def acceleration(self, chain: Chain, axis: str) -> float:
        """MAX_ACCELERATION of a joint, m/s² or rad/s²."""
        return self.settings.acceleration.get(axis, USUAL_ACCELERATION * scale(chain, axis))

    def arithmetic(self, chain: Chain) -> Arithmetic:
        speed = usual_speed(chain)
        return Arithmetic(
            ramp=Ramp(
                {a: self.acceleration(chain, a) for a in chain.letters},
                {a: float(speed[i]) for i, a in enumerate(chain.letters)},
            ),
            transforms=self.settings.transforms,
        )

    def files(self, corrections: Corrections) -> dict[str, str]:
        chain = corrections.chain
        out: dict[str, str] = {}
        ini = ["; lines for the INI file of the machine: one section per joint, numbered in the order of the axes"]
        for i, axis in enumerate(chain.letters):
            table = corrections.table(axis, axis)
            width = corrections.backlash.get(axis, 0.0)
            if table is None and not width:
                continue
            unit = scale(chain, axis)
            ini += ["", f"[JOINT_{i}]", f"; {axis}, {'degrees' if chain.is_rotary(axis) else 'mm'}"]
            jump = width if table is None else float(abs(table.forward - table.reverse).max())
            if sticks(jump, self.acceleration(chain, axis)):
                a = self.acceleration(chain, axis) / unit
                ini += [
                    f"; MAX_ACCELERATION = {a:g} does not suit this reversal: LinuxCNC leaves changes from",
                    f"; {0.25 * a * _CYCLE**2:.6g} to {0.5 * a * _CYCLE**2:.6g} undone. Set another MAX_ACCELERATION.",
                ]
            if table is not None:
                name = f"comp-{axis.lower()}.txt"
                ini += [f"COMP_FILE = {name}", "COMP_FILE_TYPE = 1"]
                rows = zip(table.positions / unit, table.forward / unit, table.reverse / unit, strict=True)
                # no comment and no blank line: LinuxCNC would read no table, or end it there, and say nothing
                out[name] = "".join(f"{x:.5f} {f:.7f} {r:.7f}\n" for x, f, r in rows)
            else:
                ini.append(f"BACKLASH = {width / unit:.7f}")
        if len(ini) > 1:
            out["joints.ini"] = "\n".join(ini) + "\n"
        if corrections.kinematics:
            out["kinematics.hal"] = self._pins(corrections)
        return out

    def _pins(self, corrections: Corrections) -> str:
        """Places of the rotary axes as pins of xyzac-trt-kins or xyzbc-trt-kins."""
        chain, k = corrections.chain, corrections.kinematics
        table, tilt = table_and_tilt(chain)
        letters = "".join(chain.linear + chain.rotary).lower()
        senses = [chain.sense(a) for a in (table, tilt)]
        at = chain.axis(tilt).along
        across = 1 - at  # horizontal, at a right angle to the tilting axis
        names = {(e.axis, e.along): e.name for e in chain.location_errors if not e.rotation}

        def of(axis: str, along: int) -> float:
            return k.get(names.get((axis, along), ""), 0.0)

        point = [of(table, i) + of(tilt, i) for i in (0, 1)]
        offset = -of(table, across)
        xyz = [letter.lower() for letter in chain.linear]
        lines = [
            "# add these to the values of the pins that are set already, mm",
            f"setp {letters}-trt-kins.{xyz[0]}-rot-point {point[0] / MM:.6f}",
            f"setp {letters}-trt-kins.{xyz[1]}-rot-point {point[1] / MM:.6f}",
            f"setp {letters}-trt-kins.{xyz[across]}-offset {offset / MM:.6f}",
            f"setp {letters}-trt-kins.{xyz[2]}-offset {of(tilt, 2) / MM:.6f}",
        ]
        if senses[0] != senses[1]:
            lines.append("# these kinematics count both axes in one sense, and this machine does not")
        elif senses[0] == SENSES[0]:
            lines.append(f"setp {letters}-trt-kins.conventional-directions 1")
        return "\n".join(lines) + "\n"

    def where(self) -> list[str]:
        return [
            "joints.ini: copy its lines into the sections of the same name of your INI file.",
            "comp-*.txt: put them beside the INI file. A COMP_FILE switches BACKLASH off; the table holds both.",
            "A table counts unwrapped positions. Outside its ends it keeps the last value.",
            "kinematics.hal: add the values to those of your HAL file. They act with the tool-centre kinematics only.",
            f"The forecast assumes MAX_ACCELERATION = {USUAL_ACCELERATION:g} mm/s² or °/s² where --acceleration does "
            f"not say otherwise.",
        ]
