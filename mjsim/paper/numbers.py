"""The numbers that the paper prints, each beside the one that the simulator gives."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from scipy.signal import find_peaks

from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import machine_to_work
from mjsim.paper.machine import PaperMachine
from mjsim.paper.runs import ANGLE, HEIGHT, LENGTH, Run, Traces
from mjsim.units import DEG, MM, UM

#: Runs that the numbers need beside those of the figures.
RUNS = (
    *(Run("none", theta) for theta in (15, 45)),
    *(Run("wheel.A", theta) for theta in (15, 45)),
    *(Run("friction", 15, x, y) for x, y in ((0, 0), (200, 0), (-50, 0), (0, 200), (0, 50))),
)


@dataclass(frozen=True)
class Number:
    """One printed number.

    Attributes:
        group, name: where it stands in ``numbers.toml``. printed: the paper's. simulated: mjsim's. tolerance: what
            rounding or
        graph reading deserves, in the same unit; 0 for counts and lists.
        note: a slip of the paper, or how the number was taken.
    """

    group: str
    name: str
    printed: float | list[float]
    simulated: float | list[float]
    tolerance: float = 0.0
    note: str = ""

    @property
    def agrees(self) -> bool:
        """Whether every simulated value lies within the tolerance of the printed one."""
        a, b = np.atleast_1d(self.printed), np.atleast_1d(self.simulated)
        return a.shape == b.shape and bool(np.all(np.abs(a - b) <= self.tolerance + 1e-9))


def printed() -> dict:
    """``numbers.toml``: the paper's numbers with tolerances and notes, plot angles in °."""
    return tomllib.loads(files("mjsim.paper").joinpath("numbers.toml").read_text(encoding="utf-8"))


def numbers(machine: PaperMachine, traces: Traces) -> list[Number]:
    """Every number of ``numbers.toml`` beside the simulated one."""
    simulated = {
        "axis_travel": _travel(traces),
        "reversals_15_10_centre": _reversals(traces),
        "feed_15_10": _feed(traces),
        "worm": _worm(machine, traces),
        "bar": _bar(machine, traces),
    }
    out = []
    for group, entries in printed().items():
        for name, entry in entries.items():
            said = entry if isinstance(entry, dict) else {"value": entry}
            found = simulated[group][name]
            value, note = found if isinstance(found, tuple) else (found, "")
            tolerance = said.get("tolerance", 2e-4 if "amplitude" in name else 1e-6 if group == "bar" else 0.0)
            out.append(
                Number(
                    group,
                    name,
                    said["value"],
                    value,
                    tolerance,
                    "; ".join(n for n in (said.get("note", ""), note) if n),
                )
            )
    return out


def _travel(traces: Traces) -> dict:
    phi = np.radians(ANGLE)

    def span(theta: int, axis: str) -> tuple[float, str]:
        run, i = Run("none", theta), FIVE_AXIS.index(axis)
        s = traces.simulation(run)
        turn = (s.phi >= 0) & (s.phi <= 2 * np.pi)
        said = Program(run.test()).path(np.append(phi, 2 * np.pi))[:, i]
        return round(
            float(np.ptp(said)) / DEG, 9
        ), f"of the command; the simulated axis covers {np.ptp(s.position[turn, i]) / DEG:.3f}°"

    return {
        "A_range_deg_15_10": span(15, "A"),
        "A_range_deg_45_30": span(45, "A"),
        "C_range_deg_per_revolution": span(15, "C"),
        "measurement_circle_radius_mm_45": round(_circle_radius(traces, Run("none", 45)), 3),
    }


def _circle_radius(traces: Traces, run: Run) -> float:
    """Radius of the circle that the spindle ball describes on the table, mm, from the simulated positions."""
    s = traces.simulation(run)
    turn = (s.phi >= 0) & (s.phi <= 2 * np.pi)
    q = s.position[turn]
    points = machine_to_work(s.test.chain, q, q[:, :3])
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).mean()) / MM


def _reversals(traces: Traces) -> dict:
    s = traces.simulation(Run("none", 15))

    def angles(axis: str) -> list[float]:
        x = s.position[:, FIVE_AXIS.index(axis)]
        moving = np.flatnonzero(np.abs(np.diff(x)) > 1e-10)
        v = np.sign(np.diff(x)[moving])
        at = moving[np.flatnonzero(np.diff(v)) + 1]
        plot = (np.degrees(s.phi[at]) + 180.0) % 360.0
        inside = (s.phi[at] > -2 * DEG) & (s.phi[at] < 2 * np.pi - 2 * DEG)
        return sorted(round(float(a), 1) for a in plot[inside])

    near = lambda found, said: [min(found, key=lambda a: abs((a - b + 180) % 360 - 180)) for b in said]  # noqa: E731
    y = angles("Y")
    return {
        "X_deg": angles("X"),
        "Y_deg": (near(y, (151.0, 209.0)), "Y also turns back at 0° and 180°"),
        "A_deg": [a if a < 359.0 else round(a - 360.0, 1) for a in angles("A")],
    }


def _feed(traces: Traces) -> dict:
    def largest(axis: str, x: float = 0.0, y: float = 0.0) -> float:
        angle, speed = traces.velocity(Run("friction", 15, x, y), axis)
        return round(float(np.abs(speed[(angle > 175) & (angle < 185)]).max()), 0)

    return {
        "C_max_deg_per_min": largest("C"),
        "X_max_mm_per_min_XT_200": largest("X", x=200),
        "Y_max_mm_per_min_YT_200": largest("Y", y=200),
        "X_max_mm_per_min_XT_minus_50": largest("X", x=-50),
        "X_max_mm_per_min_YT_50": largest("X", y=50),
        "Y_max_mm_per_min_YT_50": largest("Y", y=50),
    }


def _worm(machine: PaperMachine, traces: Traces) -> dict:
    def orders(axis: str, *ways: str) -> list[float]:
        return sorted({c.order for w in ways for c in machine.pitch[axis].directions[w].components})

    both = orders("A", "CW", "CCW")
    size = next(
        (c.amplitude_deg for c in machine.pitch["C"].directions["CW"].components if c.order == 72), float("nan")
    )
    identified = "identified from the example's traces; what was planted there are the paper's orders"
    return {
        "A_teeth": int(machine.known.drives["A"].gear),
        "C_teeth": int(machine.known.drives["C"].gear),
        "A_orders": (both, identified),
        "A_orders_not_identified_ccw": (sorted(set(both) - set(orders("A", "CCW"))), "identified CW only"),
        "C_orders": (orders("C", "CW", "CCW"), identified),
        "C_order_72_amplitude_deg_cw": (round(size, 6), "identified; planted as printed"),
        "A_peaks_between_0_and_180_15_10": _peaks(traces, 15),
        "A_peaks_between_0_and_180_45_30": _peaks(traces, 45),
    }


def _peaks(traces: Traces, theta: int) -> int:
    """Peaks of the tooth order's wave between 0° and 180°; one that the reversal cuts at an end counts as well."""
    half = traces.raw(Run("wheel.A", theta))[: len(ANGLE) // 2]
    return len(find_peaks(half, prominence=0.02 * np.ptp(half))[0])


def _bar(machine: PaperMachine, traces: Traces) -> dict:
    s = traces.simulation(Run("none", 15))
    steady = (s.phi > 0.1) & (s.phi < 6.0)
    feed = np.polyfit(s.time[steady], s.phi[steady], 1)[0] * _circle_radius(traces, Run("none", 15)) * 60.0
    instrument = machine.campaign.instrument
    return {
        "resolution_um": (round(instrument.resolution / UM, 6), "of the example's instrument"),
        "range_mm": (round(instrument.range / MM, 6), "of the example's instrument"),
        "length_mm": round(LENGTH / MM, 6),
        "ZT_mm": round(HEIGHT / MM, 6),
        "feed_mm_per_min": round(float(feed), 0),
    }
