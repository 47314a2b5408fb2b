"""The paper's measurements, made again: its tests on a machine that is as the paper describes it, with a worn worm.

From the paper: the tests, feed, bar and ball height, worm teeth, the orders of the pitch errors per direction (Fig. 3),
the amplitude of C's order 72 turning CW, and an inward deflection between 135° and 180° at half apex 15° that went with
the old rotary table (section 3.1). Assumed: everything else, above all the drives, the other amplitudes and all phases.
The table ball of the C tests stands 70 mm off the centreline: then X and Y turn back at 35°, 125°, 215° and 305°, as
the projections of Fig. 4c do.
"""

from __future__ import annotations

from .campaign import Case
from .layouts import arrange, cone, rotary

#: Components [order, amplitude in degrees, phase in degrees] by axis and direction of motion.
PITCH_ERRORS = {
    ("A", "CW"): [
        [60, 0.00120, 40.0],
        [120, 0.00060, -70.0],
        [180, 0.00035, 150.0],
        [240, 0.00025, 10.0],
        [328, 0.00040, -120.0],
        [360, 0.00030, 80.0],
        [388, 0.00020, 30.0],
        [720, 0.00015, -40.0],
    ],
    ("A", "CCW"): [
        [60, 0.00105, 55.0],
        [120, 0.00050, -50.0],
        [180, 0.00030, 170.0],
        [328, 0.00035, -100.0],
        [360, 0.00025, 60.0],
        [388, 0.00020, 0.0],
    ],
    ("C", "CW"): [[72, 0.00250, -30.0], [180, 0.00050, 100.0], [216, 0.00040, 20.0], [360, 0.00030, -80.0]],
    ("C", "CCW"): [[72, 0.00100, -10.0], [90, 0.00060, 130.0], [216, 0.00035, 45.0], [360, 0.00025, -60.0]],
}
#: One flank of A's wheel is worn where the cradle is nearly level, the one that carries while A comes down: there A
#: lags (x − depth).
WEAR = {"id": "worm_wear.A", "depth_deg": -0.0035, "centre_deg": 7.5, "width_deg": 1.5, "direction": "CW"}


def pitch_effects(axes: str = "AC") -> tuple[dict, ...]:
    """The pitch errors as effect tables."""
    known = ((axis, way, rows) for (axis, way), rows in PITCH_ERRORS.items() if axis in axes)
    return tuple({"id": f"pitch_error.{axis}", "components": rows, "direction": way} for axis, way, rows in known)


def tests() -> tuple[dict, ...]:
    """Sections 2.3 and 3: tangential turns of A and C both ways, then the cones at three places."""
    turns = [rotary("A", 0, 90), rotary("A", 90, 0)]
    centre = [cone(15, (0, 0)), cone(45, (0, 0))]
    turns_c = [rotary("C", 0, 360, (70, 0)), rotary("C", 360, 0, (70, 0))]
    rest = [cone(theta, ball) for ball in ((50, 0), (0, 50)) for theta in (15, 45)]
    return tuple(arrange(turns + centre + turns_c + rest))


def case(worn: bool = True, seed: int = 2013) -> Case:
    """The campaign; ``worn=False`` is the same machine after its rotary table was replaced."""
    hidden = (*pitch_effects(), WEAR) if worn else pitch_effects()
    return Case("kato2013", "K", tests(), hidden=hidden, seed=seed)
