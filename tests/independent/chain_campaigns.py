"""Campaigns of machines with other chains than the paper's, with known answers: drives and transmissions as for the
paper's machine, kinematics and programs of :mod:`.chains`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import tomlkit

from . import drives, measurement, real_machines, transmission
from .campaign import Cause
from .chains import FAMILIES, ChainProgram, Kinematics
from .heldout import write_truth
from .kinematics import DEG, MICRO
from .machines import FRICTION_TOLERANCE, TOLERANCE, by_id, nominal, with_hidden
from .simulate import State, cubic, grid
from .unlisted import CoolerCycle, EccentricPlay, LooseGib, ReversalCreep, Unlisted


@dataclass(frozen=True)
class ChainCase:
    """One campaign of a family.

    Attributes:
        name: folder name. family: of :data:`.chains.FAMILIES`. seed: of everything drawn.
        hidden: catalogue effects (tables as in machine.toml) and unlisted causes that the user's model lacks.
        real: everything is a little wrong, and the machine file has limits for it.
        kinds: of the tests. drives: nominal machine whose data sheet the axes have.
    """

    name: str
    family: str
    seed: int
    hidden: tuple[Cause, ...] = ()
    real: bool = False
    kinds: tuple[str, ...] = ("circular", "cone_frustum", "rotary")
    drives: str = "M1"

    def catalogue(self) -> list[dict]:
        return [h for h in self.hidden if isinstance(h, dict)]

    def unlisted(self) -> tuple[Unlisted, ...]:
        return tuple(h for h in self.hidden if not isinstance(h, dict))

    @property
    def machine(self) -> Kinematics:
        text, directions, length, _, _ = FAMILIES[self.family]
        return Kinematics(text, directions, length=0.25 if length is None else length)

    def rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, 16, stream])

    def model(self) -> dict:
        """The machine as its user knows it."""
        text, directions, length, _, _ = FAMILIES[self.family]
        known, axes = nominal(self.drives), self.machine.axes
        source = dict(zip(axes, "XYZAC", strict=True))
        out: dict = {"name": self.family, "configuration": text}
        if length is not None:
            out["tool_length_mm"] = length * 1e3
        if directions:
            out["axis"] = {a: {"direction": list(d)} for a, d in directions.items()}
        if self.real:
            out["tolerance"] = {k: dict(v) for k, v in real_machines.TOLERANCE.items()}
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
        planted = [*(self.small() if self.real else []), *self.catalogue()]
        return drive, with_hidden(effects, real_machines.merged(planted))

    def small(self) -> list[dict]:
        """Errors inside the limits, as on any real machine."""
        errors = real_machines.small_errors(self.model(), FAMILIES[self.family][3].split(), self.rng(1))
        return real_machines.with_causes(errors, self.catalogue())

    def tests(self) -> list[dict]:
        """Circles, cones at two places, and each rotary axis that moves a ball."""
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
        return self._scheduled([r for r in rows if r["kind"] in self.kinds], 60.0)

    def other_tests(self) -> list[dict]:
        """Cones at places and angles that :meth:`tests` does not have, some minutes after the campaign."""
        rows = [
            {"kind": "cone_frustum", "half_apex_deg": apex, "inclination_deg": lean, "direction": way, "setup": ""}
            | {"sensitive_direction": "perpendicular", "table_ball_mm": ball}
            for apex, lean, way, ball in (
                (15.0, 10.0, "CW", [-50.0, 0.0, 155.0]),
                (30.0, 20.0, "CCW", [0.0, 70.0, 155.0]),
                (20.0, 12.0, "CCW", [40.0, 40.0, 155.0]),
            )
        ]
        return self._scheduled(rows, self.tests()[-1]["started_s"] + 300.0)

    def _scheduled(self, rows: list[dict], clock: float) -> list[dict]:
        """Tests with names and starts."""
        common = {"bar_length_mm": 100.0, "feed_mm_min": 2000.0}
        out = []
        for row in rows:
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


def causes(family: str, drives: str = "M1") -> list[dict]:
    """Causes that show on a family's tests, each well above the noise and beyond the limits of a real machine."""
    friction = by_id(nominal(drives)["effect"])["friction.X"]
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
        {"id": "friction.X", **friction, "coulomb_Nm": 1.7 * friction["coulomb_Nm"]},
    ]


#: Causes outside the catalogue, each well above the noise.
UNLISTED = (
    ReversalCreep("Y", 2.5, time_constant_s=0.8),
    EccentricPlay("C", 10.0),
    CoolerCycle("X", 3.0),
    LooseGib("Y", 3.0),
)


def reading(
    case: ChainCase, test: dict, drive: dict, effects: dict, instants: np.ndarray, ball=0.0, tip=0.0, unlisted=()
) -> np.ndarray:
    """Noise-free bar reading at the given instants (s from the program's start), m.

    ``ball`` and ``tip`` are the set-up errors of table ball and spindle ball, m; ``unlisted`` are causes outside the
    catalogue.
    """
    program, axes = case.program(test), case.machine.axes
    time = grid(program)
    commands = program.commands(time)
    motor, torque = np.empty_like(commands), np.empty_like(commands)
    for i, a in enumerate(axes):
        late = drives.delay(a, effects)
        command = program.commands(time - late)[:, i] if late and np.ptp(commands[:, i]) else commands[:, i]
        motor[:, i], torque[:, i] = drives.run_axis(a, drive[a], effects, command)
    clock = test["started_s"] + time
    load = transmission.load_side(motor, clock, drive, effects, axes)
    if unlisted:
        state = State(time, clock, load, torque, axes)
        load = load + sum(u.displacement(state) for u in unlisted)
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
        exact = reading(case, test, drive, effects, clock - setup.trigger[k], ball, tip, case.unlisted())
        noisy = (exact + setup.length) * 1e6 + measurement.noise(len(clock), measurement.NOISE, case.rng(10 + k))
        rows = "\n".join(f"{t:.3f},{d:.1f}" for t, d in zip(clock, measurement.digitise(noisy), strict=True))
        (folder / test["trace"]).write_text("time_s,deviation_um\n" + rows + "\n")
    return answer(case)


def answer(case: ChainCase) -> dict:
    """What really hides, in the form of answers.toml."""
    odd = case.unlisted()
    out: dict = {"verdict": "unknown" if odd else "effect" if case.hidden else "none", "effect": case.catalogue()}
    if case.real:
        out |= {"tolerance_stated": True, "within": case.small()}
    if odd:
        out["axes"] = list(dict.fromkeys(a for u in odd for a in u.axes))
        out["variable"] = list(dict.fromkeys(v for u in odd for v in u.variable))
    return out


def write_heldout(case: ChainCase, folder: Path | str) -> None:
    """Writes ``heldout/`` into the campaign folder of a case: other tests, with their noise-free truth."""
    (drive, effects), model = case.true(), case.model()

    def truth(test: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        program = case.program(test)
        time = np.arange(int(program.duration * measurement.SAMPLE_RATE) + 1) / measurement.SAMPLE_RATE
        true = reading(case, test, drive, effects, time, unlisted=case.unlisted())
        nominal_um = reading(case, test, model["drive"], by_id(model["effect"]), time) * 1e6
        return np.degrees(program.phi(time)), true * 1e6, nominal_um

    write_truth(folder, case.name, case.other_tests(), truth)
