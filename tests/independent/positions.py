"""Readings of one axis at its targets on the paper's machine and others, with own kinematics (:mod:`.chains`).

A laser follows a reflector on the tool's side from the table, along one coordinate. A level or an angle interferometer
reads by what the slide has turned. The axis overruns the last target on either side and comes back.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomlkit

from . import machines, real_machines
from .chains import CHAINS, Kinematics
from .kinematics import DEG, MICRO


class Axis:
    """A machine of which one axis moves.

    Args:
        errors: By kind and subject, SI: ``play`` and ``scale`` by axis, ``waves`` by axis (period in m or rad, sine,
            cosine), ``angle`` by name (linear, quadratic, rad per 0.1 m), ``straight`` by name (quadratic, cubic, m
            per 0.1 m), ``location`` and ``square`` as :class:`.chains.Kinematics` takes them.
        family: Of :data:`.chains.CHAINS`.
    """

    def __init__(self, errors: dict, family: str = "paper") -> None:
        text, directions, length, _, _ = CHAINS[family]
        self.errors = errors
        more = {"location": errors.get("location", {}), "square": errors.get("square", {})}
        self.real = Kinematics(text, directions, length=length or 0.25, **more)

    def read(self, axis: str, component: str, target: np.ndarray, side: np.ndarray, line, at=None) -> np.ndarray:
        """True deviations at the targets, (n,) m or rad; ``line`` is where the optics meet while the axis is at 0, and
        ``at`` where other axes stand.
        """
        e, real = self.errors, target - 0.5 * self.errors.get("play", {}).get(axis, 0.0) * side
        moved = real + e.get("scale", {}).get(axis, 0.0) * real
        for period, sine, cosine in e.get("waves", {}).get(axis, ()):
            turn = 2 * np.pi * target / period
            moved = moved + sine * np.sin(turn) + cosine * np.cos(turn)
        if component == f"E{axis}{axis}" and axis in "ABC":
            return moved - target
        motion = {}
        for name, (one, two) in e.get("angle", {}).items():
            motion[name] = (one * (real / 0.1) + two * (real / 0.1) ** 2) * (name[2] == axis)
        for name, (two, three) in e.get("straight", {}).items():
            motion[name] = (two * (real / 0.1) ** 2 + three * (real / 0.1) ** 3) * (name[2] == axis)
        if component[1] in "ABC":
            return motion.get(component, np.zeros(len(target)))
        stand = {a: np.full(len(target), (at or {}).get(a, 0.0)) for a in self.real.axes}
        tool, table = self._points(np.asarray(line, float), {a: v[:1] for a, v in stand.items()})
        seen = self.real.bar(stand | {axis: moved}, motion, table, tool)
        nominal = target if component[1] == axis else 0.0
        return seen[:, "XYZ".index(component[1])] - nominal

    def read_diagonal(self, ends: dict, target: np.ndarray, side: np.ndarray, line, at=None) -> np.ndarray:
        """True deviations along the line between two points, (n,) m.

        Args:
            ends: Position at both ends by axis, m. target: way from the first end, (n,) m. side: of the last move.
            line: Where the optics meet at the first end. at: Where other axes stand.
        """
        e, first = self.errors, {a: v[0] for a, v in ends.items()}
        way = {a: v[1] - v[0] for a, v in ends.items()}
        length = np.sqrt(sum(w * w for w in way.values()))
        told = {a: np.full(len(target), (at or {}).get(a, 0.0)) for a in self.real.axes}
        told |= {a: first[a] + target * way[a] / length for a in ends}
        stand, motion = dict(told), {}
        for a in ends:
            real = told[a] - 0.5 * e.get("play", {}).get(a, 0.0) * side * np.sign(way[a])
            stand[a] = real + e.get("scale", {}).get(a, 0.0) * real
            for name, (one, two) in e.get("angle", {}).items():
                if name[2] == a:
                    motion[name] = one * (real / 0.1) + two * (real / 0.1) ** 2
            for name, (two, three) in e.get("straight", {}).items():
                if name[2] == a:
                    motion[name] = two * (real / 0.1) ** 2 + three * (real / 0.1) ** 3
        start = {a: np.full(1, first.get(a, (at or {}).get(a, 0.0))) for a in self.real.axes}
        tool, table = self._points(np.asarray(line, float), start)
        unit = np.array([way.get(a, 0.0) for a in "XYZ"]) / length
        return self.real.bar(stand, motion, table, tool) @ unit - target

    def _points(self, line: np.ndarray, stand: dict) -> tuple[np.ndarray, np.ndarray]:
        """Where the optics are fixed in the spindle's and the table's frame so that both are at the line."""
        ideal = Kinematics.__new__(Kinematics)
        ideal.__dict__ |= self.real.__dict__ | {"location": {}, "square": {}}
        table, spindle = ideal.ends(stand, {}, np.zeros(3), np.zeros(3))
        return line - spindle[0], line - table[0]


def targets_of(low: float, high: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Targets by ISO 230-2: p_i = (i − 1) p + r with a random r in each, so that no period is met by all."""
    step = (high - low) / (count - 1)
    return low + step * np.arange(count) + rng.uniform(-0.3, 0.3, count) * step * np.r_[0, np.ones(count - 2), 0]


def rows_of(target: np.ndarray, runs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The standard's cycle: targets, sides and numbers of the runs in the order of measuring."""
    both, side = np.r_[target, target[::-1]], np.repeat([1.0, -1.0], len(target))
    return np.tile(both, runs), np.tile(side, runs), np.repeat(np.arange(1, runs + 1), 2 * len(target))


def write(
    folder: Path | str,
    seed: int,
    errors: dict,
    tests: list[dict],
    noise: float = 0.3e-6,
    instrument: dict | None = None,
    tolerance: dict | None = None,
    gain: float = 0.0,
) -> None:
    """Writes a campaign of position tests on the paper's machine.

    Args:
        folder: Made where it is not there.
        seed: Of everything that is drawn.
        errors: As :class:`Axis` takes them.
        tests: Each with ``name``, ``axis``, ``ends`` (mm or degrees), ``count`` of targets; and ``component``,
            ``line_mm``, ``at_mm``, ``runs`` where they are not the usual ones. ``extra`` is a cause outside the
            catalogue: deviations (n,) m or rad at targets (n,). ``pause_s``: from reading to reading, where the file
            has times; ``drift``: deviations (n,) at such times. ``from_mm``, ``to_mm`` make a diagonal of it: then
            ``axis`` has all letters.
        noise: Of one reading, m and rad.
        instrument: More keys of its table.
        tolerance: More limits of the machine file.
        gain: Of the laser, relative.
    """
    rng, machine = np.random.default_rng(seed), machines.nominal("M1")
    folder, out = Path(folder), []
    (folder / "traces").mkdir(parents=True, exist_ok=True)
    for t in tests:
        axis, rotary = t["axis"], t["axis"] in list("ABC")
        unit, component = DEG if rotary else 1e-3, t.get("component", f"E{t['axis']}{t['axis']}")
        target = np.round(targets_of(*t["ends"], t["count"], rng), 3) * unit
        ends = {a: (v * 1e-3, t["to_mm"][a] * 1e-3) for a, v in t.get("from_mm", {}).items()}
        told, side, run = rows_of(target, t.get("runs", 5))
        at = {a: v * 1e-3 for a, v in t.get("at_mm", {}).items()}
        line = np.array(t.get("line_mm", (0.0, 0.0, 0.0))) * 1e-3
        if ends:
            found = Axis(errors).read_diagonal(ends, told, side, line, at)
        else:
            found = Axis(errors).read(axis, component, told, side, line, at)
        found = found + (t["extra"](told) if "extra" in t else 0.0) + gain * told * (component[1] == axis or bool(ends))
        clock = t.get("pause_s", 0.0) * np.arange(len(told))
        found = found + (t["drift"](clock) if "drift" in t else 0.0)
        found = found + rng.normal(0.0, noise, len(told)) + rng.normal(0.0, 50e-6)
        angle = component[1] in "ABC" and not ends
        names = [
            "target_deg" if rotary else "target_mm",
            "run",
            "direction",
            "deviation_urad" if angle else "deviation_um",
        ]
        rows = zip(told / unit, run, side, found / MICRO, strict=True)
        text = [",".join(names), *(f"{a:.4f},{b:.0f},{c:.0f},{d:.4f}" for a, b, c, d in rows)]
        if "pause_s" in t:
            text = [f"{row},{s}" for row, s in zip(text, ["time_s", *(f"{s:.1f}" for s in clock)], strict=True)]
        text.append("")
        (folder / "traces" / f"{t['name']}.csv").write_text("\n".join(text))
        keys = {k: t[k] for k in ("component", "line_mm", "at_mm", "from_mm", "to_mm") if k in t}
        out.append({"name": t["name"], "kind": "positions", "axis": axis, "trace": f"traces/{t['name']}.csv", **keys})
    machine["tolerance"] = real_machines.TOLERANCE | (tolerance or {})
    (folder / "machine.toml").write_text(tomlkit.dumps(machine))
    laser = {"kind": "positions", "compensated": True} | (instrument or {})
    (folder / "campaign.toml").write_text(tomlkit.dumps({"name": "lines", "instrument": laser, "test": out}))
