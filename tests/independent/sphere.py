"""Points of a probed sphere on the paper's machine and others, with own kinematics (:mod:`.chains`).

A probe touches the sphere from opposite sides, so that the play of a linear axis cancels. What it finds in one point is
where the linear axes stand when the tip is in the sphere's centre.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomlkit

from . import machines, real_machines
from .chains import CHAINS, Kinematics
from .kinematics import DEG, MICRO

#: Two standard deviations of what a machine of the typical class has, as the documentation states them.
CLASS = {"shift": 12.0, "turn": 30.0, "square": 24.0, "straight": 1.6, "scale": 20.0, "pitch_um": 0.6}
CLASS |= {"pitch_deg": 0.0014, "play_deg": 0.0008, "radial": 1.0, "tilt": 8.0}


def draw(rng: np.random.Generator, family: str = "paper") -> dict:
    """Errors of one machine of the typical class: normal with half the limit; SI, by kind and subject."""
    text, _, _, names, _ = CHAINS[family]
    rotary = [a for a in text if a in "ABC"]

    def normal(limit):
        return float(rng.normal(0.0, 0.5 * limit))

    out = {
        "location": {n: MICRO * normal(CLASS["turn" if n[1] in "ABC" else "shift"]) for n in names.split()},
        "square": {n: MICRO * normal(CLASS["square"]) for n in ("XY", "YZ", "ZX")},
        "straight": {
            f"E{j}{i}": MICRO * np.array([normal(CLASS["straight"]), normal(CLASS["straight"])])
            for i in "XYZ"
            for j in "XYZ"
            if i != j
        },
        "scale": {i: MICRO * normal(CLASS["scale"]) for i in "XYZ"},
        "waves": {},
        "play": {a: abs(normal(CLASS["play_deg"])) * DEG for a in rotary},
        "motion": {},
    }
    for a in ("X", "Y", "Z", *rotary):
        size = CLASS["pitch_deg"] * DEG if a in rotary else CLASS["pitch_um"] * MICRO
        out["waves"][a] = [(n, normal(size), normal(size)) for n in (1, 2)]
    for a in "C":  # the tolerance speaks of the axis that goes round
        out["motion"][a] = (
            [normal(CLASS["radial"] * MICRO) for _ in range(2)],
            [normal(CLASS["tilt"] * MICRO) for _ in range(2)],
        )
    return out


class Probed:
    """A machine that is probed.

    Args:
        errors: As :func:`draw` makes them.
        family: Of :data:`.chains.CHAINS`.
        periods: Way of one wave of every axis, m and rad.
    """

    def __init__(self, errors: dict, family: str = "paper", periods: dict | None = None) -> None:
        text, directions, length, _, _ = CHAINS[family]
        self.errors, self.periods = errors, periods or {}
        more = {"location": errors["location"], "square": errors["square"]}
        self.real = Kinematics(text, directions, length=length or 0.25, **more)
        self.ideal = Kinematics(text, directions, length=length or 0.25)
        self.axes = self.ideal.axes

    def centred(self, machine, angles: np.ndarray, sides: np.ndarray, ball, tip=(0.0, 0.0, 0.0), with_errors=False):
        """Linear positions (n, 3) at which the tip is in the sphere's centre, found by Newton's method."""
        linear = np.zeros((len(angles), 3))
        for _ in range(4):
            rest = self._gap(machine, linear, angles, sides, ball, tip, with_errors)
            slope = np.stack(
                [
                    (self._gap(machine, linear + 1e-4 * e, angles, sides, ball, tip, with_errors) - rest) / 1e-4
                    for e in np.eye(3)
                ],
                axis=2,
            )
            linear = linear - np.linalg.solve(slope, rest[:, :, None])[:, :, 0]
        return linear

    def _gap(self, machine, linear, angles, sides, ball, tip, with_errors):
        q = {a: linear[:, i].copy() for i, a in enumerate("XYZ")}
        q |= {a: angles[:, i].copy() for i, a in enumerate(self.axes[3:])}
        motion: dict = {}
        if with_errors:
            e, told = self.errors, {a: x.copy() for a, x in q.items()}
            for a in self.axes:  # waves of the command, then play behind them
                for n, c, s in e["waves"].get(a, ()):
                    arg = 2 * np.pi * n * told[a] / self.periods[a]
                    q[a] = q[a] + c * np.sin(arg) + s * np.cos(arg)
            for i, a in enumerate(self.axes[3:]):
                q[a] = q[a] - 0.5 * e["play"].get(a, 0.0) * sides[:, i]
            for a, ppm in e["scale"].items():
                q[a] = q[a] + ppm * told[a]
            for name, (two, three) in e["straight"].items():
                u = told[name[2]] / 0.1
                q[name[1]] = q[name[1]] + two * u**2 + three * u**3
            for a, ((rc, rs), (tc, ts)) in e["motion"].items():
                across = [k for k in "XYZ" if "XYZ".index(k) != "ABC".index(a)]
                first = {"A": "Y", "B": "Z", "C": "X"}[a]
                across = [first, next(k for k in across if k != first)]
                k = 2.0 * told[a]
                motion[f"E{across[0]}{a}"] = rc * np.cos(k) - rs * np.sin(k)
                motion[f"E{across[1]}{a}"] = rc * np.sin(k) + rs * np.cos(k)
                turn = ["ABC"["XYZ".index(x)] for x in across]
                motion[f"E{turn[0]}{a}"] = tc * np.cos(k) - ts * np.sin(k)
                motion[f"E{turn[1]}{a}"] = tc * np.sin(k) + ts * np.cos(k)
        return machine.bar(q, motion, ball, tip)

    def rows(self, angles_deg, nominal, true_ball, rng, noise, tip=None, spindle_deg=None, approach=None) -> np.ndarray:
        """Rows of a file: positions, deviations in µm, sides.

        Args:
            angles_deg: Rotary positions, (n, rotary), in the order of measuring.
            nominal: Where the sphere is thought to be, m.
            true_ball: Where it is, m.
            rng: Of the noise.
            noise: Standard deviation of one centre, m.
            tip: Of the probe off the spindle's axis, m.
            spindle_deg: Angles of the spindle, (n,).
            approach: Direction of the last move of every rotary axis, (n, rotary); otherwise by the order, the first
                upwards.
        """
        angles = np.asarray(angles_deg, float) * DEG
        sides = np.zeros(angles.shape)
        sides[0] = 1.0
        for i in range(1, len(angles)):
            step = angles[i] - angles[i - 1]
            sides[i] = np.where(step == 0.0, sides[i - 1], np.sign(step))
        sides = sides if approach is None else np.asarray(approach, float)
        told = np.round(self.centred(self.ideal, angles, sides, nominal), 6)
        found = np.zeros((len(angles), 3))
        turned = np.zeros(len(angles)) if spindle_deg is None else np.asarray(spindle_deg) * DEG
        for i in range(len(angles)):
            x, y, z = np.zeros(3) if tip is None else tip
            c, s = np.cos(turned[i]), np.sin(turned[i])
            place = np.array([c * x - s * y, s * x + c * y, z])
            at = self.centred(self.real, angles[i : i + 1], sides[i : i + 1], true_ball, place, True)
            found[i] = at[0]
        d = found - told + rng.normal(0.0, noise, found.shape)
        return np.column_stack([told * 1e3, angles / DEG, d / MICRO, sides])


#: Fifteen tilts of A and turns of C in a loop of both directions, and a turn of C at A = 0: 38 points.
def standard_positions() -> list[tuple[float, float]]:
    """Angles of A and C, degrees: C goes round at A = 0 and comes back, then A tilts at two turns of C."""
    out = [(0.0, float(c)) for c in range(0, 360, 45)] + [(0.0, float(c)) for c in (330, 240, 150, 60)]
    out += [(float(a), 60.0) for a in (-30, -60, -90, -45, 0, 30)]
    out += [(30.0, float(c)) for c in (120, 180, 240, 300)]
    out += [(float(a), 300.0) for a in (0, -30, -60, -90, -75, -45, -15)]
    out += [(-60.0, float(c)) for c in (270, 210, 150, 90, 30)]
    return out


def write(
    folder: Path | str,
    seed: int,
    errors: dict | None = None,
    positions=None,
    noise: float = 0.5e-6,
    tolerance: bool = True,
    both_spindles: bool = True,
    stated: float | None = 0.5,
    extra=None,
    spindle=None,
    approach=None,
) -> dict:
    """Writes a campaign of one set-up on the paper's machine; returns the true errors, SI.

    Args:
        folder: Made where it is not there.
        seed: Of everything that is drawn.
        errors: Instead of drawn ones.
        positions: Angles, degrees; otherwise the standard ones.
        noise: Of one centre, each coordinate, m.
        tolerance: Whether the machine file states the typical class.
        both_spindles: Turn the spindle by 180° in every second point.
        stated: Repeatability in campaign.toml, µm.
        spindle: Angles of the spindle, degrees, in the place of both_spindles.
        approach: As for :meth:`Probed.rows`.
        extra: A cause outside the catalogue: function of the angles (n, rotary) rad that gives (n, 3) m.
    """
    rng = np.random.default_rng(seed)
    machine = machines.nominal("M1")
    errors = draw(rng) if errors is None else errors
    periods = {a: machine["drive"][a]["lead_mm"] * 1e-3 for a in "XYZ"}
    periods |= {a: 2 * np.pi / machine["drive"][a]["worm_teeth"] for a in "AC"}
    probed = Probed(errors, periods=periods)
    nominal = np.array([0.11, 0.02, 0.09])
    true = nominal + rng.normal(0.0, 300e-6, 3)
    tip = rng.normal(0.0, 10e-6, 3)
    at = positions or standard_positions()
    if spindle is None:
        spindle = np.where(np.arange(len(at)) % 2, 180.0, 0.0) * both_spindles
    table = probed.rows(at, nominal, true, rng, noise, tip, spindle, approach)
    if extra is not None:
        table[:, 5:8] += extra(np.asarray(at) * DEG) / MICRO
    folder = Path(folder)
    (folder / "traces").mkdir(parents=True, exist_ok=True)
    head = "X_mm,Y_mm,Z_mm,A_deg,C_deg,dx_um,dy_um,dz_um,from_A,from_C,spindle_deg"
    lines = [",".join([*(f"{v:.4f}" for v in row), f"{s:.0f}"]) for row, s in zip(table, spindle, strict=True)]
    (folder / "traces" / "points.csv").write_text("\n".join([head, *lines, ""]))
    if tolerance:
        machine["tolerance"] = real_machines.TOLERANCE
    (folder / "machine.toml").write_text(tomlkit.dumps(machine))
    probe = {"kind": "sphere"} | ({"repeatability_um": stated} if stated else {})
    test = {"name": "points", "kind": "sphere", "trace": "traces/points.csv", "sphere_mm": [110.0, 20.0, 90.0]}
    (folder / "campaign.toml").write_text(tomlkit.dumps({"name": "probed", "instrument": probe, "test": [test]}))
    return errors


def tables(errors: dict) -> list[dict]:
    """Errors of the paper's machine as ``[[effect]]`` tables, for its ball-bar tests."""
    teeth = {a: machines.nominal("M1")["drive"][a]["worm_teeth"] for a in "AC"}
    out = []
    for n, v in errors["location"].items():
        out.append({"id": f"axis_location.{n}", ("value_urad" if n[1] in "ABC" else "value_um"): v / MICRO})
    out += [{"id": f"squareness.{n}", "angle_urad": v / MICRO} for n, v in errors["square"].items()]
    for n, (two, three) in errors["straight"].items():
        out.append({"id": f"straightness.{n}", "quadratic_um": two / MICRO, "cubic_um": three / MICRO})
    out += [{"id": f"scale_error.{n}", "ppm": v / MICRO} for n, v in errors["scale"].items()]
    for n, v in errors["play"].items():
        out.append({"id": f"backlash.{n}"} | ({"width_deg": v / DEG} if n in "ABC" else {"width_um": v / MICRO}))
    for n, rows in errors["waves"].items():
        unit, times = (DEG, teeth[n]) if n in "AC" else (MICRO, 1)
        waves = [
            [float(k * times), float(np.hypot(c, s)) / unit, float(np.degrees(np.arctan2(s, c)))] for k, c, s in rows
        ]
        out.append({"id": f"pitch_error.{n}", "components": waves})
    for n, (radial, tilt) in errors["motion"].items():
        for kind, key, (c, s) in (("radial", "amplitude_um", radial), ("tilt", "amplitude_urad", tilt)):
            size, phase = float(np.hypot(c, s)) / MICRO, float(np.degrees(np.arctan2(s, c)))
            out.append({"id": f"{kind}_error_motion.{n}", "order": 2.0, key: size, "phase_deg": phase})
    return out
