"""Campaigns of machines with other chains than the paper's: kinematics as products of exponentials from the
configuration text, programs by Newton's method, drives and transmissions as for the paper's machine.

Nothing here uses code of mjsim. Linear axes stand on the bed in all of these machines.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import tomlkit

from . import drives, measurement, transmission
from .kinematics import DEG, MICRO
from .machines import FRICTION_TOLERANCE, TOLERANCE, by_id, nominal, with_hidden
from .programs import PLANES, Program
from .real_machines import TOLERANCE as LIMITS
from .simulate import cubic, grid

#: Name -> configuration, directions of tilted axes, tool length in m, independent location errors, axis whose angle the
#: program never lets become negative.
FAMILIES = {
    "bc_trunnion": ("w-C'B'X'bYZ-t", {}, None, "EX0C EY0C EA0C EB0C EX0B EZ0B EA0B EC0B", "B"),
    "head_table": ("w-C'bXYZB-t", {}, 0.25, "EX0C EY0C EA0C EB0C EZ0B EA0B EC0B", ""),
    "fork_head": ("w-bXYZCA-t", {}, 0.25, "EX0C EY0C EA0C EB0C EY0A EZ0A EB0A EC0A", ""),
    "nutating_table": ("w-C'B'Y'bXZ-t", {"B": (0.0, 1.0, 1.0)}, None, "EX0C EY0C EA0C EB0C EX0B EZ0B EA0B EC0B", ""),
}
UNIT = dict(zip("XYZABC", [*np.eye(3), *np.eye(3)], strict=True))


def exp(axis, amount, linear: bool = False) -> np.ndarray:
    """exp of a twist through the origin times ``amount`` (n,): a rotation about ``axis`` or a shift, (n, 4, 4)."""
    amount = np.atleast_1d(np.asarray(amount, float))[:, None, None]
    out = np.tile(np.eye(4), (len(amount), 1, 1))
    axis = np.asarray(axis, float)
    if linear:
        out[:, :3, 3] += amount[:, :, 0] * axis
    else:
        k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        out[:, :3, :3] += np.sin(amount) * k + (1 - np.cos(amount)) * k @ k
    return out


def move(v) -> np.ndarray:
    return exp(v, 1.0, linear=True)


class Kinematics:
    """A machine from its configuration text.

    Args:
        text: configuration. directions: of rotary axes that are tilted. offsets: of their centrelines, m; on the
            tool's side from a point ``length`` m above the ball. location, square: errors by name, m and rad.
    """

    def __init__(self, text, directions=None, offsets=None, length=0.25, location=None, square=None) -> None:
        left, right = text[2:-2].split("b")
        self.sides = [list(left.replace("'", "")), list(reversed(right))]  # from the far end to the bed
        self.axes = "".join(sorted((*self.sides[0], *self.sides[1]), key=lambda a: (a in "ABC", a)))
        self.directions, self.offsets, self.length = directions or {}, offsets or {}, length
        self.location, self.square = location or {}, square or {}

    def direction(self, a: str) -> np.ndarray:
        """Unit vector of an axis; of a linear one with its squareness errors added."""
        if a in "ABC":
            d = np.array(self.directions.get(a, UNIT[a]), float)
            return d / np.linalg.norm(d)
        d = UNIT[a].copy()
        for name, axis, i, sign in (("XY", "Y", 0, -1), ("YZ", "Z", 1, -1), ("ZX", "Z", 0, 1)):
            d[i] += sign * self.square.get(name, 0.0) * (axis == a)
        return d

    def centre(self, a: str) -> np.ndarray:
        pivot = np.array([0.0, 0.0, self.length * (a in self.sides[1])])
        return pivot + self.offsets.get(a, (0.0, 0.0, 0.0))

    def joint(self, a: str, side: int, q: dict, motion: dict) -> np.ndarray:
        """(n, 4, 4) of one axis with its errors."""
        if a in "XYZ":
            sign = 1 if side else -1
            out = exp(sign * self.direction(a), q[a], linear=True)
            for name in motion:
                if name[2] == a:
                    out = exp(sign * UNIT[name[1]], motion[name], linear=True) @ out
            return out
        wobble, where, c = np.eye(4), np.eye(4), self.centre(a)
        for k in "ABC":  # the first one outermost
            wobble = wobble @ exp(UNIT[k], motion.get(f"E{k}{a}", 0.0))
        for k in "XYZ":
            wobble = wobble @ exp(UNIT[k], motion.get(f"E{k}{a}", 0.0), linear=True)
            where = where @ move(self.location.get(f"E{k}0{a}", 0.0) * UNIT[k])
        for k in "CBA":
            where = where @ exp(UNIT[k], self.location.get(f"E{k}0{a}", 0.0))
        return move(c) @ where @ wobble @ exp(self.direction(a), q[a]) @ move(-c)

    def ends(self, q: dict, motion: dict, ball, tip=(0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
        """Table ball ``ball`` and spindle ball, ``tip`` off its place in the spindle's frame, (n, 3) each."""
        out = []
        for which, side in enumerate(self.sides):
            through = np.eye(4)[None]
            for a in side:
                through = self.joint(a, which, q, motion) @ through
            point = np.asarray(tip if which else ball, float)
            out.append(np.einsum("nij,...j->ni" if point.ndim == 1 else "nij,nj->ni", through[:, :3, :3], point))
            out[-1] = out[-1] + through[:, :3, 3]
        return out[0], out[1]

    def bar(self, q: dict, motion: dict, ball, tip=(0.0, 0.0, 0.0)) -> np.ndarray:
        """From the table ball to the spindle ball, (n, 3)."""
        table, spindle = self.ends(q, motion, ball, tip)
        return spindle - table

    def serial(self) -> list[tuple[str, np.ndarray]]:
        """Rotary axes from the workpiece to the tool, each with the direction about which it turns the tool."""
        work = [(a, -self.direction(a)) for a in self.sides[0] if a in "ABC"]
        return work + [(a, self.direction(a)) for a in reversed(self.sides[1]) if a in "ABC"]

    def aim(self, angles: np.ndarray, wanted: np.ndarray, steps: int) -> np.ndarray:
        """Newton's method for the rotary angles (n, 2) that point the tool along ``wanted`` (n, 3)."""
        (_, d1), (_, d2) = self.serial()
        up = np.array([0.0, 0.0, 1.0])
        for _ in range(steps):
            inner = exp(d2, angles[:, 1])[:, :3, :3] @ up
            first = exp(d1, angles[:, 0])[:, :3, :3]
            tool = np.einsum("nij,nj->ni", first, inner)
            slope = np.stack([np.cross(d1, tool), np.einsum("nij,nj->ni", first, np.cross(d2, inner))], axis=2)
            rest = np.einsum("nij,ni->nj", slope, wanted - tool)
            normal = np.einsum("nij,nik->njk", slope, slope) + 1e-12 * np.eye(2)
            angles = angles + np.clip(np.linalg.solve(normal, rest[:, :, None])[:, :, 0], -0.5, 0.5)
        return angles


class ChainProgram(Program):
    """One test's program on a machine of a family."""

    def __init__(self, test: dict, machine: Kinematics, never_negative: str) -> None:
        self.machine, self.never_negative = machine, never_negative
        super().__init__(test)

    def _away(self) -> np.ndarray:
        """From the turning axis to the ball that it moves."""
        a = self.test["axis"]
        d = self.machine.direction(a)
        away = (self.ball if a in self.machine.sides[0] else np.zeros(3)) - self.machine.centre(a)
        return away - d * (away @ d)

    def turning_radius(self) -> float:
        if self.test["kind"] == "rotary":
            return float(np.linalg.norm(self._away()))
        phi, h = np.linspace(self.test["from_deg"] * DEG, self.test["to_deg"] * DEG, 361), 1e-5
        slope = (self._both(phi + h) - self._both(phi - h))[:, :3] / (2 * h)
        return float(np.linalg.norm(slope, axis=1).max())

    def _both(self, phi: np.ndarray) -> np.ndarray:
        """Both rotary axes in proportion, the spindle ball at rest in the frame of the workpiece, (n, axes)."""
        t = self.test
        first, last, other, end = (t[k] * DEG for k in ("from_deg", "to_deg", "second_from_deg", "second_to_deg"))
        second = next(a for a, _ in self.machine.serial() if a != t["axis"])
        angles = {t["axis"]: phi, second: other + (end - other) * (phi - first) / (last - first)}
        return self._columns(angles, np.tile(self.ball + self.length * UNIT[t["sensitive_direction"]], (len(phi), 1)))

    def prepare_cone(self) -> None:
        """Rotary angles along the cone, followed from its start."""
        self._grid = np.linspace(self.start, self.last, int(abs(self.last - self.start) / 0.02) + 2)
        tool = self._cone(self._grid)[1]
        start = np.stack(np.meshgrid(*[np.linspace(-3, 3, 13)] * 2), -1).reshape(-1, 2)
        found = self.machine.aim(start, np.tile(tool[0], (len(start), 1)), 40)
        found = (found + np.pi) % (2 * np.pi) - np.pi
        (_, d1), (_, d2) = self.machine.serial()
        up = np.array([0.0, 0.0, 1.0])
        reached = np.einsum("nij,nj->ni", exp(d1, found[:, 0])[:, :3, :3], exp(d2, found[:, 1])[:, :3, :3] @ up)
        found = found[np.linalg.norm(reached - tool[0], axis=1) < 1e-10]
        letters = [a for a, _ in self.machine.serial()]
        if self.never_negative:
            found = found[found[:, letters.index(self.never_negative)] >= 0.0]
        now = found[np.argmin(np.abs(found).sum(axis=1))][None]
        rows = []
        for wanted in tool:
            now = self.machine.aim(now, wanted[None], 4)
            rows.append(now[0])
        self._angles = np.array(rows)

    def _columns(self, angles: dict[str, np.ndarray], point: np.ndarray) -> np.ndarray:
        """Axis commands (n, axes) that bring the spindle ball to work-frame points (n, 3)."""
        q = {a: np.zeros(len(point)) for a in self.machine.axes} | angles
        table, spindle = self.machine.ends(q, {}, point)
        q |= dict(zip("XYZ", (table - spindle).T, strict=True))
        return np.column_stack([q[a] for a in self.machine.axes])

    def commands(self, time: np.ndarray) -> np.ndarray:
        t, phi = self.test, self.phi(np.asarray(time, float))
        if t["kind"] == "cone_frustum":
            point, tool = self._cone(phi)
            order = np.argsort(self._grid)
            near = np.column_stack([np.interp(phi, self._grid[order], c[order]) for c in self._angles.T])
            found = self.machine.aim(near, tool, 3)
            return self._columns({a: found[:, i] for i, (a, _) in enumerate(self.machine.serial())}, point)
        if t["kind"] == "circular":
            point = np.tile(self.ball, (len(phi), 1))
            first, second = (np.eye(3)[i] for i in PLANES[t["plane"]])
            circle = self.length * (np.outer(np.cos(phi), first) + np.outer(np.sin(phi), second))
            about = t.get("lean_about_deg", 0.0) * DEG
            lean = exp(np.cos(about) * first + np.sin(about) * second, t.get("lean_deg", 0.0) * DEG)[0, :3, :3]
            return self._columns({}, point + circle @ lean.T)
        if t["kind"] == "simultaneous":
            return self._both(phi)
        axis, radial = self.machine.direction(t["axis"]), self._away() / self.turning_radius()
        on_head = t["axis"] in self.machine.sides[1]
        way = {"radial": -radial if on_head else radial, "axial": axis, "tangential": np.cross(axis, radial)}
        bar = self.length * way[t["sensitive_direction"]]
        turned = exp(axis, phi)[:, :3, :3] @ bar if on_head else np.tile(bar, (len(phi), 1))
        return self._columns({t["axis"]: phi}, self.ball + turned)


@dataclass(frozen=True)
class ChainCase:
    """One campaign of a family.

    Attributes:
        name: folder name. family: of :data:`FAMILIES`. seed: of everything drawn. hidden: catalogue effects that the
            user's model lacks. real: everything is a little wrong, and the machine file has limits for it.
        axes_tested: which tests there are; empty is all.
    """

    name: str
    family: str
    seed: int
    hidden: tuple[dict, ...] = ()
    real: bool = False
    kinds: tuple[str, ...] = ("circular", "cone_frustum", "rotary")

    @property
    def machine(self) -> Kinematics:
        text, directions, length, _, _ = FAMILIES[self.family]
        return Kinematics(text, directions, length=0.25 if length is None else length)

    def rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, 16, stream])

    def model(self) -> dict:
        """The machine as its user knows it: M1's drives."""
        text, directions, length, _, _ = FAMILIES[self.family]
        known, axes = nominal("M1"), self.machine.axes
        source = dict(zip(axes, "XYZAC", strict=True))
        out: dict = {"name": self.family, "configuration": text}
        if length is not None:
            out["tool_length_mm"] = length * 1e3
        if directions:
            out["axis"] = {a: {"direction": list(d)} for a, d in directions.items()}
        if self.real:
            out["tolerance"] = {k: dict(v) for k, v in LIMITS.items()}
        frictions = by_id(known["effect"])
        out["drive"] = {a: dict(known["drive"][s]) for a, s in source.items()}
        out["effect"] = [{"id": f"friction.{a}", **frictions[f"friction.{s}"]} for a, s in source.items()]
        return out

    def true(self) -> tuple[dict, dict]:
        """Drives and effects as they are: data sheet and small errors drawn, hidden causes planted."""
        rng, model = self.rng(0), self.model()
        drive = {a: dict(v) for a, v in model["drive"].items()}
        for axis in drive:
            for key, sd in TOLERANCE.items():
                drive[axis][key] *= 1.0 + sd * rng.standard_normal()
        effects = by_id(model["effect"])
        for axis in drive:
            for key, sd in FRICTION_TOLERANCE.items():
                effects[f"friction.{axis}"][key] *= 1.0 + sd * rng.standard_normal()
        if self.real:
            effects = with_hidden(effects, self.small(self.rng(1)))
        return drive, with_hidden(effects, self.hidden)

    def small(self, rng: np.random.Generator) -> list[dict]:
        """Errors inside the limits, as on any real machine."""

        def draw(limit: float) -> float:
            return float(np.clip(0.5 * limit * rng.standard_normal(), -0.95 * limit, 0.95 * limit))

        out = []
        for name in FAMILIES[self.family][3].split():
            key, unit = ("value_um", "um") if name[1] in "XYZ" else ("value_urad", "urad")
            out.append({"id": f"axis_location.{name}", key: draw(LIMITS["axis_location"][unit])})
        out += [{"id": f"squareness.{n}", "angle_urad": draw(LIMITS["squareness"]["urad"])} for n in PLANES]
        for n in ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"):
            out.append({"id": f"straightness.{n}", "quadratic_um": draw(1.6), "cubic_um": draw(1.6)})
        out += [{"id": f"scale_error.{a}", "ppm": draw(LIMITS["scale_error"]["ppm"])} for a in "XYZ"]
        for a in self.machine.axes:
            key, unit = ("width_deg", "deg") if a in "ABC" else ("width_um", "um")
            out.append({"id": f"backlash.{a}", key: abs(draw(LIMITS["backlash"][unit]))})
        return [e for e in out if e["id"] not in {h["id"] for h in self.hidden}]

    def tests(self) -> list[dict]:
        """Circles, cones at two places, and each rotary axis that moves a ball."""
        common = {"bar_length_mm": 100.0, "feed_mm_min": 2000.0}
        rows: list[dict] = []
        for plane, way in (("XY", "CCW"), ("XY", "CW"), ("YZ", "CCW"), ("ZX", "CCW")):
            ball = [0.0, 0.0, 155.0]
            rows.append(
                {"kind": "circular", "plane": plane, "direction": way, "table_ball_mm": ball, "setup": "middle"}
            )
        for ball, setup, way in (
            ([50.0, 0.0, 155.0], "x50", "CCW"),
            ([50.0, 0.0, 155.0], "x50", "CW"),
            ([0.0, 80.0, 155.0], "y80", "CCW"),
        ):
            cone = {"half_apex_deg": 15.0, "inclination_deg": 10.0, "sensitive_direction": "perpendicular"}
            rows.append({"kind": "cone_frustum", **cone, "direction": way, "table_ball_mm": ball, "setup": setup})
        steep = {"half_apex_deg": 30.0, "inclination_deg": 20.0, "sensitive_direction": "parallel"}
        x50 = {"table_ball_mm": [50.0, 0.0, 155.0], "setup": "x50"}
        rows.append({"kind": "cone_frustum", **steep, "direction": "CCW", **x50})
        for a, _ in self.machine.serial():
            ends, on_head = (-50.0, 50.0) if a != "C" else (0.0, 360.0), a in self.machine.sides[1]
            if on_head and a == "C":
                continue  # its centreline goes through the ball
            for sensitive in ("tangential", "radial", "axial"):
                turn = {"axis": a, "from_deg": ends[0], "to_deg": ends[1], "sensitive_direction": sensitive}
                rows.append({"kind": "rotary", **turn, "table_ball_mm": [100.0, 0.0, 155.0], "setup": "x100"})
        out, clock = [], 60.0
        for row in (r for r in rows if r["kind"] in self.kinds):
            if row["kind"] != "rotary":
                row["revolutions"] = 2
            name = f"t{len(out) + 1:02d}-{row['kind'].replace('_', '-')}"
            test = {"name": name, "trace": f"traces/{name}.csv", **row, **common, "started_s": round(clock, 1)}
            clock += self.program(test).duration + 40.0
            out.append(test)
        return out

    def program(self, test: dict) -> ChainProgram:
        return _program(self.family, tuple((k, tuple(v) if isinstance(v, list) else v) for k, v in test.items()))


@cache
def _program(family: str, test: tuple) -> ChainProgram:
    text, directions, length, _, never_negative = FAMILIES[family]
    machine = Kinematics(text, directions, length=0.25 if length is None else length)
    kept = ("name", "trace", "setup", "started_s")  # two tests that differ in these have one program
    return ChainProgram({k: v for k, v in test if k not in kept}, machine, never_negative)


def causes(family: str) -> list[dict]:
    """Causes that show on a family's tests, each well above the noise and beyond the limits of a real machine."""
    axes = Kinematics(FAMILIES[family][0]).axes
    tilt = next(a for a in axes if a in "AB")
    shift, turn = (next(n for n in FAMILIES[family][3].split() if n[1] in k and n[3] == tilt) for k in ("XYZ", "ABC"))
    return [
        {"id": f"backlash.{tilt}", "width_deg": 0.0024},
        {"id": "pitch_error.C", "components": [[72.0, 0.004, 40.0]]},
        {"id": "backlash.Y", "width_um": 2.6},
        {"id": f"axis_location.{turn}", "value_urad": 75.0},
        {"id": "squareness.XY", "angle_urad": 70.0},
        {"id": f"servo_gain.{tilt}", "ratio": 0.97},
        {"id": "backlash.C", "width_deg": 0.003},
        {"id": "straightness.EYX", "quadratic_um": 6.0, "cubic_um": 0.0},
        {"id": f"axis_location.{shift}", "value_um": -34.0},
        {"id": "friction.X", "coulomb_Nm": 1.7, "presliding_rad": 0.003},
    ]


def reading(case: ChainCase, test: dict, drive: dict, effects: dict, instants: np.ndarray, ball=0.0, tip=0.0):
    """Noise-free bar reading at the given instants (s from the program's start), m.

    ``ball`` and ``tip`` are the set-up errors of table ball and spindle ball, m.
    """
    program, axes = case.program(test), case.machine.axes
    time = grid(program)
    commands = program.commands(time)
    motor = np.empty_like(commands)
    for i, a in enumerate(axes):
        late = drives.delay(a, effects)
        command = program.commands(time - late)[:, i] if late and np.ptp(commands[:, i]) else commands[:, i]
        motor[:, i], _ = drives.run_axis(a, drive[a], effects, command)
    load = transmission.load_side(motor, test["started_s"] + time, drive, effects, axes)
    at = dict(zip(axes, cubic(instants / drives.GRID, load).T, strict=True))
    location = {}
    for name, e in effects.items():
        if name.startswith("axis_location."):
            location[name.split(".")[1]] = MICRO * (e.get("value_um", 0.0) + e.get("value_urad", 0.0))
    text, directions, length, _, _ = FAMILIES[case.family]
    machine = Kinematics(text, directions, None, 0.25 if length is None else length, location)
    motion = {}
    for name, e in effects.items():
        kind, axis = name.split(".")
        if kind in ("radial_error_motion", "tilt_error_motion"):
            letters, key = ("XYZ", "amplitude_um") if kind.startswith("radial") else ("ABC", "amplitude_urad")
            first, second = (k for i, k in enumerate(letters) if i != "ABC".index(axis))
            arg = e["order"] * at[axis] + e.get("phase_deg", 0.0) * DEG
            motion[f"E{first}{axis}"] = MICRO * e[key] * np.cos(arg)
            motion[f"E{second}{axis}"] = MICRO * e[key] * np.sin(arg)
    bar = machine.bar(at, motion, program.ball + ball, np.zeros(3) + tip)
    return np.linalg.norm(bar, axis=1) - program.length


def write(case: ChainCase, folder: Path | str) -> dict:
    """Writes campaign.toml, machine.toml and the traces into ``folder``; returns the answer."""
    folder, tests = Path(folder), case.tests()
    (folder / "traces").mkdir(parents=True, exist_ok=True)
    instrument = {"kind": "ball_bar", "resolution_um": 0.1, "range_mm": 1.0, "sample_rate_Hz": measurement.SAMPLE_RATE}
    head = {"name": case.name, "machine": "machine.toml", "instrument": instrument, "test": tests}
    (folder / "campaign.toml").write_text(tomlkit.dumps(head))
    (folder / "machine.toml").write_text(tomlkit.dumps(case.model()))
    drive, effects = case.true()
    setup = measurement.draw_setup(tests, case.seed)
    for k, test in enumerate(tests):
        clock = measurement.recorded_clock(case.program(test).window, setup.trigger[k])
        ball, tip = setup.table[test["setup"]], setup.spindle[test["setup"]]
        exact = reading(case, test, drive, effects, clock - setup.trigger[k], ball, tip)
        noisy = (exact + setup.length) * 1e6 + measurement.noise(len(clock), measurement.NOISE, case.rng(10 + k))
        rows = "\n".join(f"{t:.3f},{d:.1f}" for t, d in zip(clock, measurement.digitise(noisy), strict=True))
        (folder / test["trace"]).write_text("time_s,deviation_um\n" + rows + "\n")
    return {"verdict": "effect" if case.hidden else "none", "effect": [dict(h) for h in case.hidden]}
