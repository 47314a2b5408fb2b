"""R-tests on the paper's machine: a nest in the spindle reads where a sphere on the table is while the axes move.

Drives, transmission and kinematics are those of the other generators here; the nest is this module's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit

from . import campaign, drives, machines, measurement, real_machines, simulate
from .kinematics import DEG, MICRO, axis_command, spindle_ball, table_ball
from .programs import Program

#: One standard deviation: place of the sphere and of the nest in the spindle, m; angles of the nest, rad; gains.
SPHERE, PLACE, ANGLE, GAIN = 300e-6, 10e-6, 5e-3, 1e-3
#: RMS of one sample, µm.
NOISE = 0.2


class Motion(Program):
    """The program of one R-test: the tool centre stays in the sphere while C, A, or both turn.

    Args:
        test: A ``[[test]]`` table.
    """

    def __init__(self, test: dict) -> None:
        self.second = (test["second_from_deg"] * DEG, test["second_to_deg"] * DEG) if "second_to_deg" in test else None
        told = {"kind": "rotary", "table_ball_mm": test["sphere_mm"], "bar_length_mm": 0.0}
        super().__init__({**test, **told, "sensitive_direction": "radial"})

    def turning_radius(self) -> float:
        if self.second is None:
            return super().turning_radius()
        # the way of the linear axes for a radian of the first axis, where it is longest
        phi = np.linspace(self.test["from_deg"] * DEG, self.test["to_deg"] * DEG, 361)
        way = self._both(phi + 1e-5)[:, :3] - self._both(phi - 1e-5)[:, :3]
        return float(np.linalg.norm(way, axis=1).max() / 2e-5)

    def _both(self, phi: np.ndarray) -> np.ndarray:
        first, last = self.test["from_deg"] * DEG, self.test["to_deg"] * DEG
        assert self.second is not None
        other = self.second[0] + (phi - first) / (last - first) * (self.second[1] - self.second[0])
        a, c = (phi, other) if self.test["axis"] == "A" else (other, phi)
        return axis_command(a, c, np.broadcast_to(self.ball, (len(phi), 3)))

    def commands(self, time: np.ndarray) -> np.ndarray:
        if self.second is None:
            return super().commands(time)
        return self._both(self.phi(np.asarray(time, float)))


@dataclass(frozen=True)
class Nest:
    """What is wrong with a nest: place (m), angles (rad), gains."""

    place: np.ndarray
    angles: np.ndarray
    gains: np.ndarray

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Nest:
        return cls(*(size * rng.standard_normal(3) for size in (PLACE, ANGLE, GAIN)))

    def shows(self, away: np.ndarray) -> np.ndarray:
        """What the sensors read of a sphere that is ``away`` (n, 3) m from the tool centre point."""
        x, y, z = -self.angles
        cx, sx, cy, sy, cz, sz = np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(z), np.sin(z)
        turn = (
            np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
            @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
            @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        )
        return (1.0 + self.gains) * ((away - self.place) @ turn.T)


def deviation(
    test: dict, drive: dict, effects: dict, instants: np.ndarray, sphere_shift=0.0, unlisted=()
) -> np.ndarray:
    """Sphere less tool centre point, machine frame, (n, 3) m, at the instants (n,) s from the program's start."""
    program = Motion(test)
    load, extra = simulate.motion(program, test.get("started_s", 0.0), drive, effects, unlisted)
    at = simulate.cubic(instants / drives.GRID, load)
    more = None if extra is None else simulate.cubic(instants / drives.GRID, extra)
    return table_ball(at, program.ball + sphere_shift, effects, more) - spindle_ball(at, effects)


def usual_tests(feed: float = 1000.0) -> list[dict]:
    """C round and back, A down and back, and both together, with the sphere left in its place."""
    place = {"kind": "r_test", "sphere_mm": [110.0, 20.0, 90.0], "setup": "sphere", "feed_mm_min": feed}
    moves = [
        ("c-ccw", "C", 0.0, 720.0, None),
        ("c-cw", "C", 720.0, 0.0, None),
        ("a-up", "A", -90.0, 30.0, None),
        ("a-down", "A", 30.0, -90.0, None),
        ("ca", "C", 0.0, 360.0, (-60.0, 30.0)),
        ("ca-back", "C", 360.0, 0.0, (30.0, -60.0)),
    ]
    out = []
    for k, (name, axis, first, last, second) in enumerate(moves):
        more = {} if second is None else {"second_from_deg": second[0], "second_to_deg": second[1]}
        ends = {"axis": axis, "from_deg": first, "to_deg": last, **more, "started_s": 200.0 * k}
        out.append({"name": name, "trace": f"traces/{name}.csv", **place, **ends})
    return out


def write(
    folder: Path | str,
    seed: int,
    hidden: list[dict] | None = None,
    tests: list[dict] | None = None,
    within: list[dict] | None = None,
    noise_um: float = NOISE,
    tolerance: bool = True,
    unlisted=(),
) -> None:
    """Writes a campaign of R-tests on the paper's machine.

    Args:
        folder: Made where it is not there.
        seed: Of everything that is drawn.
        hidden: Effects that the user's model lacks, tables as in machine.toml.
        tests: ``[[test]]`` tables; otherwise the usual ones.
        within: Small errors of a real machine, tables as in machine.toml.
        noise_um: RMS of one sample.
        tolerance: Whether the machine file states the typical class.
        unlisted: Causes outside the catalogue.
    """
    rng, tests = np.random.default_rng([seed, 77]), tests or usual_tests()
    small, causes = within or [], hidden or []
    planted = real_machines.merged([*real_machines.with_causes(list(small), causes), *causes])
    drive, effects = machines.true_machine(machines.nominal("M1"), planted, np.random.default_rng([seed, 0]))
    nest, folder = Nest.drawn(rng), Path(folder)
    spheres = {s: SPHERE * rng.standard_normal(3) for s in dict.fromkeys(t["setup"] for t in tests)}
    (folder / "traces").mkdir(parents=True, exist_ok=True)
    for t in tests:
        trigger = measurement.TRIGGER * rng.standard_normal()
        clock = measurement.recorded_clock(Motion(t).window, trigger)
        d = nest.shows(deviation(t, drive, effects, clock - trigger, spheres[t["setup"]], unlisted)) / MICRO
        d += np.column_stack([measurement.noise(len(clock), noise_um, rng) for _ in range(3)])
        d = np.round(d, 1)
        rows = [f"{s:.3f},{x:.1f},{y:.1f},{z:.1f}" for s, (x, y, z) in zip(clock, d, strict=True)]
        (folder / t["trace"]).write_text("\n".join(["time_s,dx_um,dy_um,dz_um", *rows, ""]))
    model = machines.nominal("M1")
    if tolerance:
        model["tolerance"] = real_machines.TOLERANCE
    (folder / "machine.toml").write_text(tomlkit.dumps(model))
    head = {"name": "R-tests", "instrument": {"kind": "r_test"}, "test": tests}
    (folder / "campaign.toml").write_text(tomlkit.dumps(head))


def write_with_bar(folder: Path | str, seed: int, bars: list[dict], hidden: list[dict], tests: list[dict]) -> None:
    """A campaign of one machine with R-tests as :func:`write` makes them, and ball-bar tests.

    Args:
        folder: Made where it is not there.
        seed: Of everything that is drawn.
        bars: ``[[test]]`` tables of the ball bar.
        hidden: Effects that the user's model lacks, tables as in machine.toml.
        tests: ``[[test]]`` tables of the R-tests.
    """
    folder = Path(folder)
    write(folder, seed, hidden, tests)
    nest = tomlkit.parse((folder / "campaign.toml").read_text()).unwrap()
    case = campaign.Case("both", "M1", tuple(bars), tuple(hidden), seed=seed, tolerance_stated=True)
    campaign.write_files(case, folder)
    both = tomlkit.parse((folder / "campaign.toml").read_text()).unwrap()
    both["instrument"] = {"bar": both["instrument"], "nest": nest["instrument"]}
    both["test"] = [*both["test"], *nest["test"]]
    (folder / "campaign.toml").write_text(tomlkit.dumps(both))
