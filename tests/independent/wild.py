"""Wild machines: what a real machine does and no catalogue has, drawn by chance; and tests by plans of all sorts.

Sizes are assumed, in the range of used machining centres: angles of slides of some µrad, modes of 10 to 30 Hz, friction
that changes by a third along an axis, single worm teeth that stand out by some 0.001°, drifts of some tenths of a µm in
minutes. ``level`` scales all of them.
"""

from __future__ import annotations

import numpy as np

from . import real_machines
from .machines import FRICTION_TOLERANCE, TOLERANCE
from .measurement import Bar

#: Numbers of data sheets and tolerances are wrong by a factor between these.
WRONG_BY = (0.5, 3.0)
#: Faults are so many times their limit, or a typical size of kinds without one.
TIMES = (0.8, 2.0)
#: How closely a number is defined on a machine whose play, friction and angles differ from place to place.
DEFINED_TO = 0.1
#: Spacing of the drift's knots and how long it goes on, s.
_DRIFT_STEP, _DRIFT_END = 240.0, 9600.0
_SERVO = ("servo_gain", "servo_delay", "velocity_feedforward", "velocity_gain", "drive_compliance", "vibration")


def draw_factors(keys, rng: np.random.Generator) -> dict[str, float]:
    """For each key how wrong it is: a factor within WRONG_BY, even in its logarithm."""
    low, high = np.log(WRONG_BY)
    return {key: float(np.exp(rng.uniform(low, high))) for key in keys}


def draw_data_sheet(rng: np.random.Generator) -> dict[str, float]:
    """How many times the usual tolerance each number of the data sheet may be off."""
    return draw_factors((*TOLERANCE, *FRICTION_TOLERANCE), rng)


def draw_direction(rng: np.random.Generator) -> list[float]:
    """A unit vector, every direction as likely."""
    v = rng.standard_normal(3)
    return (v / np.linalg.norm(v)).tolist()


def draw_nature(model: dict, level: float, rng: np.random.Generator) -> list[dict]:
    """What a machine does beside the catalogue, as ``[[effect]]`` tables; ``model`` is the machine as its user knows
    it. All sizes are in proportion to ``level``.
    """
    out: list[dict] = []
    for axis, drive in model["drive"].items():
        phase = float(rng.uniform(-180.0, 180.0))
        rotary = axis in "ABC"
        out.append(
            {
                "id": f"varying_friction.{axis}",
                "place_share": level * float(rng.uniform(0.1, 0.4)),
                "order": float(rng.choice([0.13, 0.4, 1.0, 2.0])),
                "phase_deg": phase,
                "way_share": level * 0.12 * float(rng.uniform(-1.0, 1.0)),
            }
        )
        wave = float(rng.choice([1.0, 2.0])) if rotary else 2.0 * np.pi / float(rng.uniform(0.08, 0.3))
        share = level * float(rng.uniform(0.3, 1.0))
        out.append({"id": f"varying_play.{axis}", "share": share, "wave_number": wave, "phase_deg": phase})
        if rotary:
            out.append({"id": f"tooth_errors.{axis}", "error_deg": draw_teeth(drive["worm_teeth"], level, rng)})
            continue
        point = [float(rng.normal(0.0, 150.0)), float(rng.normal(0.0, 150.0)), float(rng.uniform(-400.0, 0.0))]
        angles = {k: (level * np.array([3.0, 2.0, 1.5]) * rng.standard_normal(3)).tolist() for k in "ABC"}
        out.append({"id": f"slide_angles.{axis}", **angles, "point_mm": point})
        clock = np.arange(0.0, _DRIFT_END + 1.0, _DRIFT_STEP)
        walk = np.cumsum(level * 0.8 * rng.standard_normal(len(clock)))
        out.append({"id": f"drift.{axis}", "clock_s": clock.tolist(), "um": (walk - walk[0]).tolist()})
    for where in ("tool", "table"):
        out.append(
            {
                "id": f"structural_mode.{where}",
                "frequency_Hz": float(rng.uniform(10.0, 30.0)),
                "damping_ratio": float(rng.uniform(0.02, 0.08)),
                "along": draw_direction(rng),
                "share": level * float(rng.uniform(0.3, 1.0)),
            }
        )
    for ball in ("spindle", "table"):
        out.append(
            {"id": f"egg.{ball}", "amplitude_um": level * 0.3 * float(rng.normal()), "axis": draw_direction(rng)}
        )
    return out


def draw_teeth(count: int, level: float, rng: np.random.Generator) -> list[float]:
    """Errors of a worm wheel's teeth in degrees: all a little, one group, and one tooth that stands out."""
    error = level * 0.0003 * rng.standard_normal(count)
    first, long = int(rng.integers(count)), int(rng.integers(3, 8))
    error[(first + np.arange(long)) % count] += level * 0.0012 * float(rng.choice([-1.0, 1.0]))
    error[int(rng.integers(count))] += level * 0.002 * float(rng.choice([-1.0, 1.0]))
    return error.tolist()


def find_undefined(effects: list[dict]) -> set[str]:
    """Ids of the catalogue whose numbers a machine does not have: the angles of its slides add to them."""
    out: set[str] = set()
    for kind, axis in (e["id"].split(".") for e in effects):
        if kind == "slide_angles":
            out |= {f"straightness.E{k}{axis}" for k in "XYZ" if k != axis} | {f"scale_error.{axis}"}
            out |= {f"squareness.{s}" for s in ("XY", "YZ", "ZX") if axis in s}
    return out


def find_names_in_part(effects: list[dict]) -> set[str]:
    """Ids of the catalogue that the nature of a machine really is in part: naming one of them is not wrong."""
    out = find_undefined(effects)
    for kind, axis in (e["id"].split(".") for e in effects):
        if kind == "structural_mode":
            out |= {f"{servo}.{k}" for servo in _SERVO for k in "XYZ"}
        elif kind == "varying_friction":
            # the data sheet is off as well
            out |= {f"{k}.{axis}" for k in ("friction", "viscous_friction", "velocity_gain", "servo_gain")}
            out |= {f"{k}.{axis}" for k in ("torque_ripple", "backlash")}
        elif kind == "varying_play":
            out |= {f"backlash.{axis}", f"pitch_error.{axis}"}
        elif kind == "tooth_errors":
            out |= {f"pitch_error.{axis}", f"worm_wear.{axis}"}
        elif kind == "drift":
            out.add(f"thermal_drift.{axis}")
    return out


def draw_bar(rng: np.random.Generator) -> Bar:
    """A ball bar with faults, in a workshop."""
    odd = rng.uniform() < 0.4
    return Bar(
        gain=float(rng.normal(0.0, 0.01)),
        clock=float(rng.uniform(-100e-6, 100e-6)),
        hum_um=float(rng.uniform(0.02, 0.1)),
        hum_Hz=float(rng.normal(50.0, 0.05)),
        tail_share=float(rng.uniform(0.01, 0.03)),
        tail_times=float(rng.uniform(4.0, 8.0)),
        outliers=int(rng.integers(1, 7)) if odd else 0,
        gaps=int(rng.integers(0, 3)) if odd else 0,
    )


def draw_fault(kind: str, subject: str, model: dict, rng: np.random.Generator) -> dict:
    """A fault that is hardly one: so many TIMES its limit, or a typical size where its kind has none."""
    if kind in real_machines.TOLERANCE:
        return real_machines.beyond(kind, subject, model, rng, TIMES)
    times, sign = float(rng.uniform(*TIMES)), float(rng.choice([-1.0, 1.0]))
    return {
        "id": f"{kind}.{subject}",
        **{
            "servo_gain": lambda: {"ratio": 1.0 + 0.02 * sign * times},
            "servo_delay": lambda: {"delay_ms": 0.5 * sign * times},
            "torque_ripple": lambda: {"amplitude_Nm": 0.05 * times, "order": float(rng.integers(1, 4))},
            "thermal_drift": lambda: {
                "amplitude_um": 6.0 * sign * times,
                "time_constant_s": float(rng.uniform(200.0, 900.0)),
            },
            "worm_wear": lambda: {
                "depth_deg": 0.0014 * times,
                "centre_deg": float(rng.uniform(14.0, 22.0) if subject != "C" else rng.uniform(30.0, 330.0)),
                "width_deg": float(rng.uniform(3.0, 6.0) if subject != "C" else rng.uniform(6.0, 25.0)),
            },
        }[kind](),
    }


def list_faults(model: dict, locations: list[str]) -> list[tuple[str, str]]:
    """(kind, subject) of every fault to draw from on a machine."""
    axes = list(model["drive"])
    linear, rotary = [a for a in axes if a in "XYZ"], [a for a in axes if a in "ABC"]
    out = [(k, a) for k in ("backlash", "pitch_error", "servo_gain", "servo_delay", "friction") for a in axes]
    out += [(k, a) for k in ("scale_error", "thermal_drift") for a in linear]
    out += [(k, a) for k in ("worm_wear", "torque_ripple") for a in rotary]
    out += [("straightness", n) for n in ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")]
    out += [("squareness", n) for n in ("XY", "YZ", "ZX")] + [("axis_location", n) for n in locations]
    return [*out, ("radial_error_motion", "C"), ("tilt_error_motion", "C")]


def draw_plan(axes: str, on_head: str, rng: np.random.Generator) -> list[dict]:
    """Tests of another plan than the usual ones: other cones, places, feeds and bars (100 or 150 mm), tests in any
    number. Axes ``on_head`` carry no table ball.
    """
    bar_mm = float(rng.choice([100.0, 150.0]))
    feed = float(rng.choice([600.0, 900.0, 1300.0, 1800.0, 2600.0]))

    def place() -> dict:
        x, y = (float(10 * rng.integers(-9, 10)) for _ in range(2))
        return {"table_ball_mm": [x, y, float(rng.choice([130.0, 155.0, 190.0]))], "setup": f"x{x:g}y{y:g}"}

    def common(where: dict) -> dict:
        pace = float(10 * round(feed * rng.uniform(0.8, 1.25) / 10))
        return {**where, "bar_length_mm": bar_mm, "feed_mm_min": pace}

    def way() -> dict:
        return {"direction": str(rng.choice(["CW", "CCW"])), "revolutions": 2}

    rows: list[dict] = []
    for where in (place() for _ in range(int(rng.integers(2, 4)))):
        for _ in range(int(rng.integers(1, 4))):
            apex, lean = rng.choice([[10, 4], [12, 20], [20, 8], [25, 12], [25, 35], [35, 15], [40, 25]])
            across = "perpendicular" if rng.uniform() < 0.8 else "parallel"
            cone = {"half_apex_deg": float(apex), "inclination_deg": float(lean), "sensitive_direction": across}
            rows.append({"kind": "cone_frustum", **cone, **way(), **common(where)})
        for plane in rng.choice(["XY", "YZ", "ZX"], int(rng.integers(1, 3)), replace=False):
            rows.append({"kind": "circular", "plane": str(plane), **way(), **common(where)})
    far = float(rng.choice([80.0, 110.0, 140.0]))
    where = {"table_ball_mm": [far, 0.0, 155.0], "setup": f"far{far:g}"}
    for axis in (a for a in axes if a in "ABC" and not (a == "C" and a in on_head)):
        ends = [0.0, 360.0] if axis == "C" else [-50.0, 50.0]
        for across in rng.choice(["tangential", "radial", "axial"], int(rng.integers(1, 4)), replace=False):
            first, last = ends if rng.uniform() < 0.5 else ends[::-1]
            turn = {"axis": axis, "from_deg": first, "to_deg": last, "sensitive_direction": str(across)}
            rows.append({"kind": "rotary", **turn, **common(where)})
    return rows
