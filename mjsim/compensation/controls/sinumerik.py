"""SINUMERIK 840D: encoder error compensation ($AA_ENC_COMP), sag compensation ($AN_CEC), machine data.

Source: SINUMERIK 840D sl, Function Manual Extended Functions, K3 Compensations, and F2 Multi-axis transformations.
"""

from __future__ import annotations

from mjsim.compensation.controls.base import Control, table_and_tilt
from mjsim.compensation.tables import Corrections, Grid, Table, scale
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM

#: Points that one table gets at most (MD38000 and MD18342 must allow as many).
_MOST = 2000


class Sinumerik(Control):
    """Corrections as SINUMERIK 840D takes them. Machine axes are called X1, Y1 and so on."""

    name = "sinumerik"
    title = "SINUMERIK"
    pulses = True

    def grid(self, chain: Chain, out: str, source: str) -> Grid:
        return Grid(most=_MOST, decimals=6, place_decimals=4)

    def files(self, corrections: Corrections) -> dict[str, str]:
        chain = corrections.chain
        out: dict[str, str] = {}
        own = [t for t in corrections.tables if t.out == t.source and not t.two_sided]
        crossed = [t for t in corrections.tables if t not in own]
        if own:
            lines = ["%_N_AX_EEC_INI", "CHANDATA(1)"]
            for t in own:
                lines += self._encoder(chain, t)
            out["ax_eec.ini"] = "\n".join([*lines, "M17", ""])
        if crossed:
            lines, number = ["%_N_NC_CEC_INI", "CHANDATA(1)"], 0
            for t in crossed:
                sides = ((1, t.forward), (-1, t.reverse)) if t.two_sided else ((0, t.forward),)
                for direction, values in sides:
                    lines += self._sag(chain, t, number, direction, values)
                    number += 1
            out["nc_cec.ini"] = "\n".join([*lines, "M17", ""])
        data = self._machine_data(corrections)
        if data:
            out["machine_data.txt"] = "\n".join([*data, ""])
        return out

    def _encoder(self, chain: Chain, t: Table) -> list[str]:
        axis, unit, own = f"{t.source}1", scale(chain, t.source), scale(chain, t.out)
        x = t.positions / unit
        return [
            f"; {axis}: {', '.join(t.keys)}; MD38000 $MA_MM_ENC_COMP_MAX_POINTS[0,{axis}] has to be {len(x)} or more",
            *(f"$AA_ENC_COMP[0,{n},{axis}]={-v / own + 0.0:.6f}" for n, v in enumerate(t.forward)),
            f"$AA_ENC_COMP_STEP[0,{axis}]={(x[-1] - x[0]) / (len(x) - 1):.9f}",
            f"$AA_ENC_COMP_MIN[0,{axis}]={x[0]:.4f}",
            f"$AA_ENC_COMP_MAX[0,{axis}]={x[-1]:.4f}",
            f"$AA_ENC_COMP_IS_MODULO[0,{axis}]={int(t.modulo)}",
        ]

    def _sag(self, chain: Chain, t: Table, number: int, direction: int, values) -> list[str]:
        own, x = scale(chain, t.out), t.positions / scale(chain, t.source)
        return [
            f"; table {number}: {t.out}1 by {t.source}1: {', '.join(t.keys)}; "
            f"MD18342 $MN_MM_CEC_MAX_POINTS[{number}] has to be {len(x)} or more",
            *(f"$AN_CEC[{number},{n}]={-v / own + 0.0:.6f}" for n, v in enumerate(values)),
            f"$AN_CEC_INPUT_AXIS[{number}]=({t.source}1)",
            f"$AN_CEC_OUTPUT_AXIS[{number}]=({t.out}1)",
            f"$AN_CEC_STEP[{number}]={(x[-1] - x[0]) / (len(x) - 1):.9f}",
            f"$AN_CEC_MIN[{number}]={x[0]:.4f}",
            f"$AN_CEC_MAX[{number}]={x[-1]:.4f}",
            f"$AN_CEC_DIRECTION[{number}]={direction}",
            f"$AN_CEC_MULT_BY_TABLE[{number}]=0",
            f"$AN_CEC_IS_MODULO[{number}]={int(t.modulo)}",
        ]

    def _machine_data(self, corrections: Corrections) -> list[str]:
        chain, out = corrections.chain, []
        for axis, width in corrections.backlash.items():
            out.append(f"MD32450 $MA_BACKLASH[0,{axis}1]: add {width / scale(chain, axis):.6f}")
        for axis, gain in corrections.gains.items():
            out.append(f"MD32200 $MA_POSCTRL_GAIN[0,{axis}1]: set {gain * 60.0 / 1000.0:.6f}")
        for axis, p in corrections.pulses.items():
            turn, unit = (DEG * 360.0, "rev/min") if chain.is_rotary(axis) else (MM, "mm/min")
            out += [
                f"MD32490 $MA_FRICT_COMP_MODE[{axis}1]: set 1",
                f"MD32500 $MA_FRICT_COMP_ENABLE[{axis}1]: set 1",
                f"MD32510 $MA_FRICT_COMP_ADAPT_ENABLE[0,{axis}1]: set 0",
                f"MD32520 $MA_FRICT_COMP_CONST_MAX[0,{axis}1]: set {p.speed / turn * 60.0:.6f} {unit}",
                f"MD32540 $MA_FRICT_COMP_TIME[0,{axis}1]: set {p.time:.3f} s",
            ]
        if corrections.kinematics:
            out += self._transformation(corrections)
        return out

    def _transformation(self, corrections: Corrections) -> list[str]:
        """Places and directions of both rotary axes as data of a transformation of type 40 (rotary table)."""
        chain, k = corrections.chain, corrections.kinematics
        out = ["; transformation of type 40 (rotary axis 1: tilting axis, rotary axis 2: table)"]
        place, ahead = [0.0, 0.0, 0.0], {}
        table, tilt = table_and_tilt(chain)
        for number, axis in ((1, tilt), (2, table)):
            shift, turn = [0.0] * 3, [0.0] * 3
            for e in chain.location_errors:
                if e.axis == axis:
                    (turn if e.rotation else shift)[e.along] = k.get(e.name, 0.0)
            ahead[number] = shift, turn
            place = [a - b for a, b in zip(place, shift, strict=True)]
        names = (("MD24550 $MC_TRAFO5_BASE_TOOL_1", 1), ("MD24558 $MC_TRAFO5_JOINT_OFFSET_1", 2))
        for name, number in names:
            out += [f"{name}[{i}]: add {v / MM:.6f}" for i, v in enumerate(ahead[number][0]) if v]
        out += [f"MD24500 $MC_TRAFO5_PART_OFFSET_1[{i}]: add {v / MM:.6f}" for i, v in enumerate(place) if v]
        for name, number, axis in (
            ("MD24570 $MC_TRAFO5_AXIS1_1", 1, tilt),
            ("MD24572 $MC_TRAFO5_AXIS2_1", 2, table),
        ):
            turn = ahead[number][1]
            if any(turn):
                along = chain.axis(axis).direction
                vector = along + _cross(turn, along)
                out += [f"{name}[{i}]: set {v:.8f}" for i, v in enumerate(vector)]
        return out

    def thermal_advice(self, axis: str, size: float, constant: float) -> str:
        return (
            f"a drift with time: let the PLC write SD43900 $SA_TEMP_COMP_ABS_VALUE[{axis}1] = {size / MM:.6f}·"
            f"(1 − exp(−t/{constant:.0f} s)) mm, t since the warm-up began; set bit 0 of MD32750 $MA_TEMP_COMP_TYPE"
        )

    def where(self) -> list[str]:
        return [
            "ax_eec.ini and nc_cec.ini: load them as archives or run them as part programs while MD32700 "
            "$MA_ENC_COMP_ENABLE and MD32710 $MA_CEC_ENABLE are 0. Then set these to 1 and SD41300 "
            "$SN_CEC_TABLE_ENABLE[t] to 1, and reset the NCK.",
            "Values in both are errors in mm and degrees: a positive value moves the axis in the negative direction.",
            "machine_data.txt: type the values into the machine data; then reset the NCK. An axis vector has the sign "
            "that your transformation uses.",
            "Kinematic data act with TRAORI only.",
            "Friction compensation (MD32490 to MD32540): constant, for the accelerations of the tests. The tests have "
            "to be measured with it switched off. Run a circular test after every change.",
        ]


def _cross(turn, along) -> list[float]:
    """turn × along, (3,): by how much a small rotation moves a direction."""
    a, b = turn, along
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
