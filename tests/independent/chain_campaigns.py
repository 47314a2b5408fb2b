"""Campaigns of machines with other chains than the paper's, with known answers: drives and transmissions as for the
paper's machine, kinematics and programs of :mod:`.chains`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from . import drives, measurement, real_machines, structure, wild
from .campaign import Cause, write_folder
from .chains import CHAINS, ChainProgram, Kinematics
from .heldout import write_truth
from .kinematics import DEG, MICRO, axial
from .machines import FRICTION_TOLERANCE, TOLERANCE, by_id, nominal, with_hidden
from .programs import Program
from .simulate import cubic, motion
from .unlisted import CoolerCycle, EccentricPlay, LooseGib, ReversalCreep, Unlisted

#: No number of a drive is less than this share of what the data sheet says.
LEAST = 0.2
#: Largest amplitude of an unlisted cause, µm or arcsec. One that still does not show stays small.
LARGEST = 20.0


@dataclass(frozen=True)
class ChainCase:
    """One campaign of a family.

    Attributes:
        name: folder name. family: of :data:`.chains.CHAINS`. seed: of everything drawn.
        hidden: catalogue effects (tables as in machine.toml) and unlisted causes that the user's model lacks.
        real: everything is a little wrong, and the machine file has limits for it.
        kinds: of the tests. drives: nominal machine whose data sheet the axes have.
        bar: what is wrong with the instrument. noise_um: RMS of a sample.
        plan: tests without name, start and trace; empty: those of :meth:`tests`. stated: whether the machine file of a
            real machine states its limits. target_um: RMS to scale the signatures of unlisted causes to.
        nature: what the true machine does beside the catalogue, tables as of :mod:`.wild`.
        points: functional points of slides, mm, which the machine file states.
        spread: how many times the usual tolerance a number of the data sheet is off by. level: how many times their
            limits the small errors of a kind are drawn from.
        category, half: for the bank.
    """

    name: str
    family: str
    seed: int
    hidden: tuple[Cause, ...] = ()
    real: bool = False
    kinds: tuple[str, ...] = ("circular", "cone_frustum", "rotary")
    drives: str = "M1"
    bar: measurement.Bar = measurement.GOOD_BAR
    noise_um: float = measurement.NOISE
    plan: tuple[dict, ...] = ()
    stated: bool = True
    target_um: float = 0.0
    nature: tuple[dict, ...] = ()
    points: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    spread: dict[str, float] = field(default_factory=dict)
    level: dict[str, float] = field(default_factory=dict)
    category: str = ""
    half: str = "tune"

    def catalogue(self) -> list[dict]:
        return [h for h in self.hidden if isinstance(h, dict)]

    def unlisted(self) -> tuple[Unlisted, ...]:
        return tuple(h for h in self.hidden if not isinstance(h, dict))

    @cached_property
    def resolved(self) -> ChainCase:
        """The same case with its unlisted causes scaled to their target, or as large as a machine can have them."""
        if not (self.target_um and self.unlisted()):
            return self
        both = zip(self.hidden, signature_sizes(self), strict=True)
        hidden = (
            h if isinstance(h, dict) else h.scaled(min(self.target_um / max(size, 1e-9), LARGEST)) for h, size in both
        )
        return replace(self, hidden=tuple(hidden), target_um=0.0)

    @property
    def machine(self) -> Kinematics:
        return self.kinematics({})

    def kinematics(self, location: dict) -> Kinematics:
        """The machine with location errors by name, m and rad."""
        text, directions, length, _, _ = CHAINS[self.family]
        return Kinematics(text, directions, None, 0.25 if length is None else length, location)

    @property
    def erring(self) -> bool:
        """Whether the machine errs beyond its data sheet."""
        return bool(self.hidden or self.real)

    def rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, 16, stream])

    def model(self) -> dict:
        """The machine as its user knows it."""
        text, directions, length, _, _ = CHAINS[self.family]
        known, axes = nominal(self.drives), self.machine.axes
        source = dict(zip(axes, "XYZAC", strict=True))
        out: dict = {"name": self.family, "configuration": text}
        if length is not None:
            out["tool_length_mm"] = length * 1e3
        if directions:
            out["axis"] = {a: {"direction": list(d)} for a, d in directions.items()}
        for a, point in self.points.items():
            out.setdefault("axis", {})[a] = {"functional_point_mm": list(point)}
        if self.real and self.stated:
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
                drive[axis][key] *= max(1.0 + self.spread.get(key, 1.0) * sd * rng.standard_normal(), LEAST)
        effects = by_id(model["effect"])
        for axis in drive:
            for key, sd in FRICTION_TOLERANCE.items():
                factor = max(1.0 + self.spread.get(key, 1.0) * sd * rng.standard_normal(), LEAST)
                effects[f"friction.{axis}"][key] *= factor
        planted = [*(self.small() if self.real else []), *self.catalogue()]
        points = {f"functional_point.{a}": {"mm": list(point)} for a, point in self.points.items()}
        return drive, with_hidden(effects, real_machines.merged(planted)) | by_id(self.nature) | points

    def small(self) -> list[dict]:
        """Errors inside the limits, as on any real machine."""
        names = CHAINS[self.family][3].split()
        errors = real_machines.small_errors(self.model(), names, self.rng(1), self.level)
        return real_machines.with_causes(errors, self.catalogue())

    def tests(self) -> list[dict]:
        """The tests as in campaign.toml."""
        return self._scheduled([dict(t) for t in self.plan or self.usual()], 60.0)

    def usual(self) -> tuple[dict, ...]:
        """The usual plan: circles, cones at two places, and each rotary axis that moves a ball."""
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
        return tuple(r for r in rows if r["kind"] in self.kinds)

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
        out: list[dict] = []
        for row in rows:
            if row["kind"] != "rotary":
                row["revolutions"] = 2
            name = f"t{len(out) + 1:02d}-{row['kind'].replace('_', '-')}"
            test = {"name": name, "trace": f"traces/{name}.csv", **common, **row, "started_s": round(clock, 1)}
            clock += self.program(test).duration + 40.0
            out.append(test)
        return out

    def program(self, test: dict) -> Program:
        return _program(self.family, tuple((k, tuple(v) if isinstance(v, list) else v) for k, v in test.items()))


@cache
def _program(family: str, test: tuple) -> Program:
    text, directions, length, _, never_negative = CHAINS[family]
    machine = Kinematics(text, directions, length=0.25 if length is None else length)
    kept = ("name", "trace", "setup", "started_s")  # two tests that differ in these have one program
    path = {k: v for k, v in test if k not in kept}
    return Program(path) if family == "paper" else ChainProgram(path, machine, never_negative)


def causes(family: str, drives: str = "M1") -> list[dict]:
    """Causes that show on a family's tests, each well above the noise and beyond the limits of a real machine."""
    friction = by_id(nominal(drives)["effect"])["friction.X"]
    axes = Kinematics(CHAINS[family][0]).axes
    tilt = next(a for a in axes if a in "AB")
    shift, turn = (next(n for n in CHAINS[family][3].split() if n[1] in k and n[3] == tilt) for k in ("XYZ", "ABC"))
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
    program, machine = case.program(test), case.machine
    load, _ = motion(program, test["started_s"], drive, effects, unlisted, machine.axes)
    on_grid = dict(zip(machine.axes, load.T, strict=True))
    at = dict(zip(machine.axes, cubic(instants / drives.GRID, load).T, strict=True))
    location = {}
    for name, e in effects.items():
        if name.startswith("axis_location."):
            location[name.split(".")[1]] = MICRO * (e.get("value_um", 0.0) + e.get("value_urad", 0.0))
    wobble = {}
    for name, e in effects.items():
        kind, axis = name.split(".")
        if kind in ("radial_error_motion", "tilt_error_motion"):
            letters, key = ("XYZ", "amplitude_um") if kind.startswith("radial") else ("ABC", "amplitude_urad")
            first, second = (k for i, k in enumerate(letters) if i != "ABC".index(axis))
            arg = e["order"] * at[axis] + e.get("phase_deg", 0.0) * DEG
            wobble[f"E{first}{axis}"] = MICRO * e[key] * np.cos(arg)
            wobble[f"E{second}{axis}"] = MICRO * e[key] * np.sin(arg)
    for axis in (a for a in machine.axes if a in "ABC"):
        wobble[f"E{'XYZ'['ABC'.index(axis)]}{axis}"] = axial(effects, axis, at[axis])
    bar = case.kinematics(location).bar(at, wobble, program.ball + ball, np.zeros(3) + tip)
    bar += structure.turn_by_slides(machine, effects, at, program.ball)
    bar += cubic(instants / drives.GRID, structure.ring_modes(machine, effects, on_grid, program.ball, drives.GRID))
    return np.linalg.norm(bar, axis=1) - program.length + structure.read_eggs(machine, effects, at, program.ball)


def ringing(*frequencies: float) -> ChainCase:
    """A machine with its small errors and two tests. Its spindle head and its table have modes of such frequencies, Hz;
    none without them.
    """
    mode = {"damping_ratio": 0.03, "along": [0.6, 0.5, 0.6], "share": 1.0}
    nature = tuple(
        {"id": f"structural_mode.{end}", "frequency_Hz": f, **mode}
        for end, f in zip(("tool", "table"), frequencies, strict=False)
    )
    case = ChainCase("rings", "bc_trunnion", 4, real=True, kinds=("cone_frustum",), nature=nature)
    return replace(case, plan=case.usual()[:2])


def signature_sizes(case: ChainCase) -> list[float]:
    """RMS over a campaign of what each hidden cause adds to the readings of the true machine, µm, without what the
    balls' places could add (the first harmonic of each test).
    """
    drive, effects = case.true()
    rest = [replace(case, hidden=(*case.hidden[:i], *case.hidden[i + 1 :])) for i in range(len(case.hidden))]
    without = [(c, *c.true()) for c in rest]
    square, count = np.zeros(len(rest)), 0
    for test in case.tests():
        program = case.program(test)
        instants = np.arange(program.window[0], program.window[1], 0.025)
        basis = np.column_stack([np.ones(len(instants)), *(f(program.phi(instants)) for f in (np.cos, np.sin))])
        whole = reading(case, test, drive, effects, instants, unlisted=case.unlisted())
        count += len(instants)
        for i, (c, its_drive, its_effects) in enumerate(without):
            added = 1e6 * (whole - reading(c, test, its_drive, its_effects, instants, unlisted=c.unlisted()))
            square[i] += np.sum((added - basis @ np.linalg.lstsq(basis, added, rcond=None)[0]) ** 2)
    return [float(f"{s:.4g}") for s in np.sqrt(square / count)]


def write(case: ChainCase, folder: Path | str) -> dict:
    """Writes campaign.toml, machine.toml and the traces into ``folder``; returns the answer."""
    case = case.resolved
    tests, (drive, effects) = case.tests(), case.true()
    setup = measurement.draw_setup(tests, case.seed)

    def read(k: int, instants: np.ndarray) -> np.ndarray:
        ball, tip = (errors[tests[k]["setup"]] for errors in (setup.table, setup.spindle))
        return reading(case, tests[k], drive, effects, instants, ball, tip, case.unlisted())

    windows = [case.program(t).window for t in tests]
    traces = measurement.record(read, windows, setup, case.bar, case.noise_um, case.rng)
    write_folder(folder, case.name, case.model(), tests, traces, case.bar)
    return answer(case)


def answer(case: ChainCase) -> dict:
    """What really hides, in the form of answers.toml."""
    case = case.resolved
    odd = case.unlisted()
    out: dict = {"verdict": "unknown" if odd else "effect" if case.hidden else "none", "effect": case.catalogue()}
    if case.real:
        out |= {"tolerance_stated": case.stated, "within": case.small(), "tolerance": real_machines.TOLERANCE}
        out["friction_Nm"] = {e["id"][-1]: e["coulomb_Nm"] for e in case.model()["effect"]}
    if case.nature:
        nature = list(case.nature)
        out |= {"defined_to": wild.DEFINED_TO, "in_part": sorted(wild.find_names_in_part(nature))}
        out["undefined"] = sorted(wild.find_undefined(nature))
    if case.plan and case.hidden:
        out["signature_rms_um"] = signature_sizes(case)
    if odd:
        out["hidden"] = ", ".join(u.name for u in odd)
        out["axes"] = list(dict.fromkeys(a for u in odd for a in u.axes))
        out["variable"] = list(dict.fromkeys(v for u in odd for v in u.variable))
    return out


def write_heldout(case: ChainCase, folder: Path | str) -> None:
    """Writes ``heldout/`` into the campaign folder of a case: other tests, with their noise-free truth."""
    case = case.resolved
    (drive, effects), model = case.true(), case.model()
    effects = {k: e for k, e in effects.items() if not k.startswith("egg.")}  # of the instrument, not of the machine

    def truth(test: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        program = case.program(test)
        time = np.arange(int(program.duration * measurement.SAMPLE_RATE) + 1) / measurement.SAMPLE_RATE
        true = reading(case, test, drive, effects, time, unlisted=case.unlisted())
        nominal_um = reading(case, test, model["drive"], by_id(model["effect"]), time) * 1e6
        return np.degrees(program.phi(time)), true * 1e6, nominal_um

    write_truth(folder, case.name, case.other_tests(), truth)
