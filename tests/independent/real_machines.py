"""Machines on which everything is a little wrong: some sixty small numbers inside their tolerance, and what the
tolerance is.

The limits are two standard deviations of a good used machine (assumed, in the range of ISO 10791 acceptance
tolerances). Nothing here uses code of mjsim.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .machines import nominal

#: Limits per kind of effect, as a machine file states them.
TOLERANCE: dict[str, dict[str, float]] = {
    "axis_location": {"um": 12.0, "urad": 30.0},
    "squareness": {"urad": 24.0},
    "straightness": {"um": 1.6},
    "scale_error": {"ppm": 20.0},
    "pitch_error": {"um": 0.6, "deg": 0.0014},
    "backlash": {"um": 0.8, "deg": 0.0008},
    "friction": {"ratio": 0.4},
    "radial_error_motion": {"um": 1.0},
    "tilt_error_motion": {"urad": 8.0},
}
#: Limits of what shows away from the tested places. Not every machine file states them.
VOLUMETRIC: dict[str, dict[str, float]] = {"angular_error": {"urad": 12.0}, "axial_error_motion": {"um": 1.0}}
_SHIFTS = ("EX0C", "EY0C", "EY0A", "EZ0A")
_TILTS = ("EA0C", "EB0C", "EB0A", "EC0A")
#: No small error is larger than this share of its limit.
_INSIDE = 0.95


def within(machine: str, rng: np.random.Generator) -> list[dict]:
    """The small errors of one of the paper's machines, as ``[[effect]]`` tables."""
    return small_errors(nominal(machine), (*_SHIFTS, *_TILTS), rng)


def small_errors(
    model: dict, locations: Iterable[str], rng: np.random.Generator, times: dict[str, float] | None = None
) -> list[dict]:
    """The small errors of a machine with these drives and independent axis locations, as ``[[effect]]`` tables.

    ``times`` makes the errors of a kind so many times as large: what a machine file states may be wrong.
    """

    def draw(limit: float) -> float:
        return float(np.clip(0.5 * limit * rng.standard_normal(), -_INSIDE * limit, _INSIDE * limit))

    def waves(orders: tuple[float, float], limit: float) -> list[list[float]]:
        rows = []
        for order in orders:
            a, b = draw(limit / np.sqrt(2.0)), draw(limit / np.sqrt(2.0))
            rows.append([float(order), float(np.hypot(a, b)), float(np.degrees(np.arctan2(b, a)))])
        return rows

    t = {k: {u: (times or {}).get(k, 1.0) * limit for u, limit in v.items()} for k, v in TOLERANCE.items()}
    out = []
    for n in locations:
        key, unit = ("value_um", "um") if n[1] in "XYZ" else ("value_urad", "urad")
        out.append({"id": f"axis_location.{n}", key: draw(t["axis_location"][unit])})
    out += [{"id": f"squareness.{n}", "angle_urad": draw(t["squareness"]["urad"])} for n in ("XY", "YZ", "ZX")]
    for n in ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"):
        limit = t["straightness"]["um"]
        out.append({"id": f"straightness.{n}", "quadratic_um": draw(limit), "cubic_um": draw(limit)})
    out += [{"id": f"scale_error.{a}", "ppm": draw(t["scale_error"]["ppm"])} for a in "XYZ"]
    known = {e["id"]: e for e in model["effect"]}
    for a in model["drive"]:
        rotary = a in "ABC"
        taken = {round(c[0]) for c in known.get(f"pitch_error.{a}", {}).get("components", [])}
        teeth = model["drive"][a].get("worm_teeth", 1.0)
        orders = tuple(n for n in ((teeth, 2.0 * teeth) if rotary else (1.0, 2.0)) if round(n) not in taken)
        out.append({"id": f"pitch_error.{a}", "components": waves(orders, t["pitch_error"]["deg" if rotary else "um"])})
        key, unit = ("width_deg", "deg") if rotary else ("width_um", "um")
        if f"backlash.{a}" not in known:
            out.append({"id": f"backlash.{a}", key: abs(draw(t["backlash"][unit]))})
        coulomb = known[f"friction.{a}"]["coulomb_Nm"]
        out.append({"id": f"friction.{a}", "coulomb_Nm": coulomb * (1.0 + draw(t["friction"]["ratio"]))})
    for kind, key, unit in (
        ("radial_error_motion", "amplitude_um", "um"),
        ("tilt_error_motion", "amplitude_urad", "urad"),
    ):
        a, b = draw(t[kind][unit] / np.sqrt(2.0)), draw(t[kind][unit] / np.sqrt(2.0))
        phase = float(np.degrees(np.arctan2(b, a)))
        out.append({"id": f"{kind}.C", key: float(np.hypot(a, b)), "order": 2.0, "phase_deg": phase})
    return out


def volumetric_errors(axes: str, rng: np.random.Generator) -> list[dict]:
    """Angular errors of all slides and axial error motions of all rotary axes within their limits, as ``[[effect]]``
    tables.
    """
    urad, um = VOLUMETRIC["angular_error"]["urad"], VOLUMETRIC["axial_error_motion"]["um"]

    def draw(limit: float) -> float:
        return float(np.clip(0.5 * limit * rng.standard_normal(), -_INSIDE * limit, _INSIDE * limit))

    out = [
        {"id": f"angular_error.E{about}{a}", "linear_urad": draw(urad), "quadratic_urad": draw(urad)}
        for a in axes
        if a in "XYZ"
        for about in "ABC"
    ]
    for a in (a for a in axes if a in "ABC"):
        x, y = draw(um / np.sqrt(2.0)), draw(um / np.sqrt(2.0))
        wave = {"amplitude_um": float(np.hypot(x, y)), "order": 2.0, "phase_deg": float(np.degrees(np.arctan2(y, x)))}
        out.append({"id": f"axial_error_motion.{a}"} | wave)
    return out


def beyond(kind: str, subject: str, model: dict, rng: np.random.Generator, times: tuple[float, float]) -> dict:
    """A cause of one of the kinds with a tolerance, of so many ``times`` its limit."""
    times, sign = float(rng.uniform(*times)), float(rng.choice([-1.0, 1.0]))
    phase = float(rng.integers(-18, 18) * 10)
    limits, rotary = TOLERANCE[kind], subject in ("A", "B", "C")
    size = {unit: round(times * limit, 6) for unit, limit in limits.items()}
    name = {"id": f"{kind}.{subject}"}
    if kind == "axis_location":
        return name | ({"value_um": sign * size["um"]} if subject[1] in "XYZ" else {"value_urad": sign * size["urad"]})
    if kind == "pitch_error":
        teeth = model["drive"][subject].get("worm_teeth", 1.0)
        return name | {"components": [[float(teeth), size["deg" if rotary else "um"], phase]]}
    if kind == "friction":
        coulomb = next(e for e in model["effect"] if e["id"] == f"friction.{subject}")["coulomb_Nm"]
        return name | {"coulomb_Nm": coulomb * (1.0 + 0.4 * min(times, 3.5))}
    return (
        name
        | {
            "squareness": {"angle_urad": sign * size.get("urad", 0.0)},
            "straightness": {"quadratic_um": sign * size.get("um", 0.0)},
            "scale_error": {"ppm": sign * size.get("ppm", 0.0)},
            "backlash": {"width_deg": size.get("deg", 0.0)} if rotary else {"width_um": size.get("um", 0.0)},
            "radial_error_motion": {"amplitude_um": size.get("um", 0.0), "order": 2.0, "phase_deg": phase},
            "tilt_error_motion": {"amplitude_urad": size.get("urad", 0.0), "order": 2.0, "phase_deg": phase},
        }[kind]
    )


def with_causes(small: list[dict], causes: list[dict]) -> list[dict]:
    """The small errors less those that a cause that matters takes the place of (waves of other orders stay)."""
    taken = {e["id"]: e for e in causes}
    out = []
    for e in small:
        cause = taken.get(e["id"])
        if cause is None:
            out.append(e)
        elif "components" in e and "components" in cause:
            orders = {round(c[0]) for c in cause["components"]}
            rest = [c for c in e["components"] if round(c[0]) not in orders]
            if rest:
                out.append({**e, "components": rest})
    return out


def merged(effects: list[dict]) -> list[dict]:
    """The waves of one axis' pitch error in one table."""
    out: dict[str, dict] = {}
    for e in effects:
        key = e["id"] + e.get("direction", "")
        if key in out and "components" in e:
            out[key] = {**out[key], "components": [*out[key]["components"], *e["components"]]}
        else:
            out[key] = dict(e)
    return list(out.values())
