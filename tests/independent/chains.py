"""Machines with other chains than the paper's: kinematics as products of exponentials from the configuration text,
programs by Newton's method.

Nothing here uses code of mjsim. Linear axes stand on the bed in all of these machines.
"""

from __future__ import annotations

import numpy as np

from .kinematics import DEG
from .programs import PLANES, Program

#: Name -> configuration, directions of tilted axes, tool length in m, independent location errors, axis whose angle the
#: program never lets become negative.
FAMILIES = {
    "bc_trunnion": ("w-C'B'X'bYZ-t", {}, None, "EX0C EY0C EA0C EB0C EX0B EZ0B EA0B EC0B", "B"),
    "head_table": ("w-C'bXYZB-t", {}, 0.25, "EX0C EY0C EA0C EB0C EZ0B EA0B EC0B", ""),
    "fork_head": ("w-bXYZCA-t", {}, 0.25, "EX0C EY0C EA0C EB0C EY0A EZ0A EB0A EC0A", ""),
    "nutating_table": ("w-C'B'Y'bXZ-t", {"B": (0.0, 1.0, 1.0)}, None, "EX0C EY0C EA0C EB0C EX0B EZ0B EA0B EC0B", ""),
}
#: The families and the paper's machine; its programs are in closed form, in :mod:`.programs`.
CHAINS = {"paper": ("w-C'A'Y'bXZ-t", {}, None, "EX0C EY0C EA0C EB0C EY0A EZ0A EB0A EC0A", "A"), **FAMILIES}
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
            table = [b for b in self.sides[0] if b in "ABC"]
            point = self.centre(table[0]) if table else np.zeros(3)  # about which a slide turns what it carries
            turn = move(point)
            for k in "ABC":  # the first one outermost
                turn = turn @ exp(UNIT[k], motion.get(f"E{k}{a}", 0.0))
            out = out @ turn @ move(-point)
            for k in "XYZ":
                out = exp(sign * UNIT[k], motion.get(f"E{k}{a}", 0.0), linear=True) @ out
            return out
        wobble, where, c = np.eye(4), np.eye(4), self.centre(a)
        for k in "ABC":  # the first one outermost
            wobble = wobble @ exp(UNIT[k], motion.get(f"E{k}{a}", 0.0))
        for k, turns in zip("XYZ", "ABC", strict=True):  # axial motion is along the centreline, wherever that points
            along = self.direction(a) if turns == a else UNIT[k]
            wobble = wobble @ exp(along, motion.get(f"E{k}{a}", 0.0), linear=True)
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

    def _circle(self) -> float:
        return float(np.linalg.norm(self._away()))

    def _both(self, phi: np.ndarray) -> np.ndarray:
        """As there."""
        second = next(a for a, _ in self.machine.serial() if a != self.test["axis"])
        angles = {self.test["axis"]: phi, second: self._second(phi)}
        return self._columns(angles, np.tile(self._resting(), (len(phi), 1)))

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
        axis, radial = self.machine.direction(t["axis"]), self._away() / self._circle()
        on_head = t["axis"] in self.machine.sides[1]
        way = {"radial": -radial if on_head else radial, "axial": axis, "tangential": np.cross(axis, radial)}
        bar = self.length * way[t["sensitive_direction"]]
        turned = exp(axis, phi)[:, :3, :3] @ bar if on_head else np.tile(bar, (len(phi), 1))
        return self._columns({t["axis"]: phi}, self.ball + turned)
