"""Readers of the files that controls take, and the controls' arithmetic: what a machine does with such files.

Written from the manuals of the controls. Nothing here uses code of mjsim. Positions and values are mm and degrees as in
the files; corrections come out in m and rad.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from .kinematics import AXES, DEG, location, turn_x, turn_y, turn_z

NUMBER = r"[-+]?\d+(?:\.\d+)?"
UNIT = {a: DEG if a in "AC" else 1e-3 for a in AXES}


@dataclass
class Table:
    """Correction of ``out`` by ``source``: what is added to the command, file units, per direction."""

    out: str
    source: str
    x: np.ndarray
    forward: np.ndarray
    reverse: np.ndarray
    modulo: bool = False


@dataclass
class Told:
    """What a control was told: full backlash by axis, tables, location errors (mm, µrad), gains (1/s), friction
    compensation (mm/min or rev/min, s).
    """

    backlash: dict[str, float] = field(default_factory=dict)
    tables: list[Table] = field(default_factory=list)
    location: dict[str, float] = field(default_factory=dict)
    gain: dict[str, float] = field(default_factory=dict)
    friction: dict[str, tuple[float, float]] = field(default_factory=dict)
    stepwise: bool = False
    ramp: dict[str, tuple[float, float]] | None = None


# -- readers -----------------------------------------------------------------------------------------------------------


def read_linuxcnc(folder: Path) -> Told:
    told, joint = Told(), None
    files: dict[str, str] = {}
    ini = folder / "joints.ini"
    for line in ini.read_text().splitlines() if ini.exists() else ():
        line = line.strip()
        if not line or line.startswith((";", "#")):
            continue
        if m := re.fullmatch(r"\[JOINT_(\d)\]", line):
            joint = AXES[int(m[1])]
            continue
        key, value = (x.strip() for x in line.split("="))
        assert joint is not None
        if key == "BACKLASH":
            told.backlash[joint] = float(value)
        elif key == "COMP_FILE":
            files[joint] = value
        elif key == "COMP_FILE_TYPE":
            assert value == "1"
    for axis, name in files.items():
        told.backlash.pop(axis, None)
        rows = []
        for line in (folder / name).read_text().split("\n"):
            parts = line.split()
            if len(parts) != 3:
                break  # LinuxCNC's reader stops at the first line that has not three numbers
            rows.append([float(p) for p in parts])
        rows = rows[:256]
        x, f, r = np.array(rows).T
        assert (np.diff(x) > 0).all()
        told.tables.append(Table(axis, axis, x, f, r))
    hal = folder / "kinematics.hal"
    if hal.exists():
        pins = dict(re.findall(rf"setp xyzac-trt-kins\.(\S+) ({NUMBER})", hal.read_text()))
        v = {k: float(x) for k, x in pins.items()}
        # xyzac-trt-kins: C stands at (x-rot-point, y-rot-point), A at y-rot-point + y-offset, z-offset
        told.location = {
            "EX0C": v["x-rot-point"],
            "EY0C": -v["y-offset"],
            "EY0A": v["y-rot-point"] + v["y-offset"],
            "EZ0A": v["z-offset"],
        }
    return told


def read_sinumerik(folder: Path) -> Told:
    told = Told()
    text = (folder / "ax_eec.ini").read_text() if (folder / "ax_eec.ini").exists() else ""
    for axis in AXES:
        rows = re.findall(rf"^\$AA_ENC_COMP\[0,(\d+),{axis}1\]=({NUMBER})$", text, re.M)
        if not rows:
            continue
        step, low, high, modulo = (
            float(re.search(rf"^\$AA_ENC_COMP_{n}\[0,{axis}1\]=({NUMBER})$", text, re.M)[1])
            for n in ("STEP", "MIN", "MAX", "IS_MODULO")
        )
        assert [int(n) for n, _ in rows] == list(range(len(rows)))
        x = low + step * np.arange(len(rows))
        assert abs(x[-1] - high) < 1e-4
        v = -np.array([float(e) for _, e in rows])
        told.tables.append(Table(axis, axis, x, v, v, bool(modulo)))
    text = (folder / "nc_cec.ini").read_text() if (folder / "nc_cec.ini").exists() else ""
    tables: dict[tuple[str, str], Table] = {}
    for number in sorted({int(n) for n in re.findall(r"^\$AN_CEC\[(\d+),", text, re.M)}):
        rows = re.findall(rf"^\$AN_CEC\[{number},(\d+)\]=({NUMBER})$", text, re.M)

        def of(name, pattern=NUMBER, number=number):
            return re.search(rf"^\$AN_CEC_{name}\[{number}\]=\(?({pattern})\)?$", text, re.M)[1]

        source, out = of("INPUT_AXIS", r"\w+")[0], of("OUTPUT_AXIS", r"\w+")[0]
        x = float(of("MIN")) + float(of("STEP")) * np.arange(len(rows))
        v, zero = -np.array([float(e) for _, e in rows]), np.zeros(len(rows))
        direction = int(of("DIRECTION"))
        new = Table(
            out, source, x, v if direction >= 0 else zero, v if direction <= 0 else zero, of("IS_MODULO") == "1"
        )
        old = tables.get((out, source))
        if old is not None:
            new.forward, new.reverse = new.forward + old.forward, new.reverse + old.reverse
        tables[out, source] = new
    told.tables += tables.values()
    data = (folder / "machine_data.txt").read_text() if (folder / "machine_data.txt").exists() else ""
    for axis, v in re.findall(rf"\$MA_BACKLASH\[0,(\w)1\]: add ({NUMBER})", data):
        told.backlash[axis] = float(v)
    for axis, v in re.findall(rf"\$MA_POSCTRL_GAIN\[0,(\w)1\]: set ({NUMBER})", data):
        told.gain[axis] = float(v) * 1000.0 / 60.0
    for axis, v in re.findall(rf"\$MA_FRICT_COMP_CONST_MAX\[0,(\w)1\]: set ({NUMBER})", data):
        for name, value in (("MODE", 1), ("ENABLE", 1)):
            assert f"$MA_FRICT_COMP_{name}[{axis}1]: set {value}\n" in data
        assert f"$MA_FRICT_COMP_ADAPT_ENABLE[0,{axis}1]: set 0\n" in data
        seconds = re.search(rf"\$MA_FRICT_COMP_TIME\[0,{axis}1\]: set ({NUMBER})", data)
        told.friction[axis] = float(v), float(seconds[1])
    for name, axis in (("BASE_TOOL", "A"), ("JOINT_OFFSET", "C")):
        for i, v in re.findall(rf"\$MC_TRAFO5_{name}_1\[(\d)\]: add ({NUMBER})", data):
            told.location[f"E{'XYZ'[int(i)]}0{axis}"] = float(v)
    vectors = {n: [float(v) for v in re.findall(rf"\$MC_TRAFO5_AXIS{n}_1\[\d\]: set ({NUMBER})", data)] for n in (1, 2)}
    if vectors[1]:  # A along x: turned by b about y and c about z it is (1, c, -b)
        told.location |= {"EC0A": vectors[1][1] * 1e6, "EB0A": -vectors[1][2] * 1e6}
    if vectors[2]:  # C along z: turned by a about x and b about y it is (b, -a, 1)
        told.location |= {"EB0C": vectors[2][0] * 1e6, "EA0C": -vectors[2][1] * 1e6}
    return told


def read_heidenhain(folder: Path) -> Told:
    told = Told()
    cma = (folder / "config.cma").read_text().splitlines() if (folder / "config.cma").exists() else []
    named = [w for line in cma[2:-1] for w in line.split() if w.endswith(".COM")]
    assert not cma or "*" in cma[2]
    for name in named:
        lines = (folder / name).read_text().splitlines()
        assert lines[0] == f"BEGIN {name} MM" and lines[-1] == "[END]"
        head = lines[1]
        places = [m.start() for m in re.finditer(r"\S+", head)] + [None]
        columns = head.split()
        cells = [[line[a:b].strip() for a, b in pairwise(places)] for line in lines[2:-1]]
        source = name.removesuffix(".COM")
        x = np.array([float(c[1]) for c in cells])
        for k, out in enumerate(columns[3:], start=3):
            f = -np.array([float(c[k]) for c in cells])
            r = -np.array([float(c[2]) for c in cells]) if out == source and cells[0][2] else f
            told.tables.append(Table(out, source, x, f, r, source in "AC" and abs(x[-1] - x[0] - 360.0) < 1e-9))
    text = (folder / "parameters.txt").read_text() if (folder / "parameters.txt").exists() else ""
    told.backlash = {a: float(v) for a, v in re.findall(rf"MP_backLash (\w): add ({NUMBER})", text)}
    told.gain = {a: float(v) / 0.06 for a, v in re.findall(rf"MP_kvFactor (\w): set ({NUMBER})", text)}
    tab = (folder / "kinematics.tab").read_text().splitlines() if (folder / "kinematics.tab").exists() else []
    waiting: list[tuple[str, float]] = []
    for line in tab[2:-1]:
        _, key, axis, *rest = line.split()
        if key == "Trans":
            waiting.append((axis, float(rest[0])))
        else:
            for letter, v in waiting:
                told.location[f"E{letter}0{axis}"] = v if letter in "XYZ" else v * DEG * 1e6
            waiting = []
    return told


def read_fanuc(folder: Path, unit: float = 1e-4) -> Told:
    told = Told(stepwise=True)
    file = folder / "parameters.txt"
    lines = file.read_text().splitlines() if file.exists() else []
    axis: dict[tuple[int, str], str] = {}
    plain: dict[int, float] = {}
    for line in lines:
        if m := re.fullmatch(rf"N(\d{{5}})A(\d)P({NUMBER})", line):
            axis[int(m[1]), AXES[int(m[2]) - 1]] = m[3]
        elif m := re.fullmatch(rf"N(\d+)P({NUMBER})(?: \(add\))?", line):
            plain[int(m[1])] = float(m[2])
    for a in AXES:
        if v := axis.get((1851, a)):
            told.backlash[a] = int(v) * unit
        if v := axis.get((1825, a)):
            told.gain[a] = int(v) / 100.0
        if (3621, a) not in axis:
            continue
        zero, first, last, times = (int(axis[n, a]) for n in (3620, 3621, 3622, 3623))
        step = float(axis[3624, a])
        x = step * (np.arange(first, last + 1) - zero)

        def summed(start, zero=zero, first=first, last=last, times=times):
            p = np.array([plain[10000 + start + i] for i in range(last - first + 1)])
            assert np.abs(p).max() <= 7 and 0 <= times <= 100
            c = np.cumsum(p)
            return (c - c[zero - first]) * times * unit

        forward = reverse = summed(first)
        if axis.get((3605, a), "").endswith("1"):
            reverse = summed(int(axis[3626, a])) + int(axis[3627, a]) * unit
        told.tables.append(Table(a, a, x, forward, reverse, (3625, a) in axis))
    for i in range(6):
        if 5711 + i in plain:
            source, out = (AXES[int(plain[n + i]) - 1] for n in (5711, 5721))
            x = np.array([plain[5731 + 10 * k + i] for k in range(4)])
            v = np.array([plain[5771 + 10 * k + i] for k in range(4)]) * unit
            keep = np.append(True, np.diff(x) > 0)
            told.tables.append(Table(out, source, x[keep], v[keep], v[keep]))
    for start, a in ((19700, "A"), (19703, "C")):
        for i in range(3):
            if start + i in plain:
                told.location[f"E{'XYZ'[i]}0{a}"] = plain[start + i]
    return told


def read_csv(folder: Path) -> Told:
    told = Told()
    if (folder / "values.csv").exists():
        for line in (folder / "values.csv").read_text().splitlines()[1:]:
            what, a, value, _ = line.split(",")
            if what == "backlash":
                told.backlash[a] = float(value)
            elif what == "position gain":
                told.gain[a] = float(value)
            else:
                told.location[what.split()[1]] = float(value)
    if (folder / "tables.csv").exists():
        rows: dict[tuple[str, str, str], list] = {}
        for line in (folder / "tables.csv").read_text().splitlines()[1:]:
            out, by, modulo, x, _, f, r, _ = line.split(",")
            rows.setdefault((out, by, modulo), []).append([float(x), float(f), float(r)])
        for (out, by, modulo), v in rows.items():
            told.tables.append(Table(out, by, *np.array(v).T, modulo == "1"))
    return told


READERS = {
    "linuxcnc": read_linuxcnc,
    "sinumerik": read_sinumerik,
    "heidenhain": read_heidenhain,
    "fanuc": read_fanuc,
    "csv": read_csv,
}


# -- the controls' arithmetic ------------------------------------------------------------------------------------------


def _sign(r: np.ndarray) -> np.ndarray:
    """Direction of the last motion, 0 before the first."""
    out, last = np.zeros(len(r)), 0.0
    for i in range(1, len(r)):
        if abs(r[i] - r[i - 1]) > 1e-13:
            last = 1.0 if r[i] > r[i - 1] else -1.0
        out[i] = last
    return out


def _value(t: Table, x: np.ndarray, stepwise: bool) -> tuple[np.ndarray, np.ndarray]:
    at = x / UNIT[t.source]
    if t.modulo:
        at = t.x[0] + np.mod(at - t.x[0], 360.0)
    if not stepwise or t.out != t.source:
        return np.interp(at, t.x, t.forward), np.interp(at, t.x, t.reverse)
    nearest = np.abs(at[:, None] - t.x[None, :]).argmin(axis=1) if len(t.x) < 8 else _nearest(at, t.x)
    return t.forward[nearest], t.reverse[nearest]


def _nearest(at: np.ndarray, x: np.ndarray) -> np.ndarray:
    step = (x[-1] - x[0]) / (len(x) - 1)
    return np.clip(np.floor((at - x[0]) / step + 0.5).astype(int), 0, len(x) - 1)


def commands(told: Told, given: np.ndarray, tip: bool = True) -> np.ndarray:
    """Axis commands (n, 5) m and rad after the control's corrections.

    Args:
        told: what the control was told. given: commands of the program. tip: whether it runs with tool centre point
            control, so that the places of the rotary axes count.
    """
    out = given.copy()
    if told.location and tip:
        a, c = given[:, 3], given[:, 4]
        work = turn_z(-c, turn_x(-a, given[:, :3]))
        effects = {
            f"axis_location.{k}": {"value_um": v * 1e3} if k[1] in "XYZ" else {"value_urad": v}
            for k, v in told.location.items()
        }
        out[:, :3] = _placed(given, work, effects)
    sign = {a: _sign(out[:, i]) for i, a in enumerate(AXES)}
    for i, a in enumerate(AXES):
        more = 0.5 * told.backlash.get(a, 0.0) * UNIT[a] * sign[a]
        for t in told.tables:
            if t.out == a:
                f, r = _value(t, given[:, AXES.index(t.source)], told.stepwise)
                s = sign[t.source]
                more = more + UNIT[a] * np.where(s > 0, f, np.where(s < 0, r, 0.5 * (f + r)))
        out[:, i] += more
    return out


def friction_pulses(told: Told, axis: str, command: np.ndarray, gain: float, step: float) -> np.ndarray:
    """What the speed pulses of one axis amount to as a change of its command (n,), m or rad: where the axis itself
    turns, the speed set-point gets the amplitude in the new direction, and that fades.
    """
    amplitude, seconds = told.friction[axis]
    amplitude *= (2.0 * np.pi if axis in "AC" else 1e-3) / 60.0
    place, way, pulse, out = command[0], 0.0, 0.0, np.zeros(len(command))
    for i in range(1, len(command)):
        before, place = place, place + (command[i] - place) * (1.0 - np.exp(-gain * step))
        pulse *= np.exp(-step / seconds)
        now = np.sign(place - before) if abs(place - before) > 1e-13 else 0.0
        if now and way and now != way:
            pulse += now * amplitude
        way = now or way
        out[i] = pulse / gain
    return out


def _placed(q: np.ndarray, work: np.ndarray, effects: dict) -> np.ndarray:
    """Where points (n, 3) fixed to the table come to with the rotary axes placed as ``effects`` say."""
    a, c = q[:, 3], q[:, 4]
    p = turn_z(c, work)
    p = turn_y(location(effects, "EB0C"), turn_x(location(effects, "EA0C"), p))
    p = p + np.array([location(effects, "EX0C"), location(effects, "EY0C"), 0.0])
    p = turn_x(a, p)
    p = turn_z(location(effects, "EC0A"), turn_y(location(effects, "EB0A"), p))
    return p + np.array([0.0, location(effects, "EY0A"), location(effects, "EZ0A")])


@dataclass
class Corrected:
    """A program whose commands a control corrects; in place of :class:`independent.programs.Program`."""

    program: object
    told: Told
    tip: bool = True

    @property
    def duration(self) -> float:
        return self.program.duration

    def commands(self, time: np.ndarray) -> np.ndarray:
        return commands(self.told, self.program.commands(time), self.tip)
