"""What a control makes of the blocks: interpolation cycle, block time, and the feed that comes of it.

A simple model of a control that interpolates block by block, without look-ahead and without smoothing: the axes move
linearly within a block and change their speeds at once from block to block. Better controls round these corners; this
is what they have to round. :func:`linuxcnc` has the block times that LinuxCNC was measured to keep.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, replace

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.follow import check_path, own_path, unwrapped
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import reading
from mjsim.nc.limits import scale
from mjsim.units import DEG, MM, UM

#: Places within a piece of straight motion at which it is looked at.
_INSIDE = 4
#: Shortest interpolation cycle that is simulated, s.
SHORTEST = 0.1e-3
#: P of G64 in the programs for LinuxCNC, m.
_G64_P = 1e-6


@dataclass(frozen=True)
class Control:
    """Attributes:
    cycle: interpolation cycle, s; 0 interpolates continuously.
    block_time: what the control needs to prepare a block, s: no block is shorter.
    whole_cycles: whether every block lasts a whole number of cycles, rounded up (controls that end each block on a
        cycle); otherwise a cycle runs over into the next block.
    shortened: whether blocks that turn a rotary axis last whole cycles, rounded down, and others as long as F says.
    acceleration: highest of every axis, (axes,) m/s² and rad/s²: a block that turns a rotary axis is blended into the
        next one from half of its way on, so it takes at least √(2 way/acceleration), in half cycles; empty: no limit.
    speed: highest of every axis, (axes,) m/s and rad/s; empty: no limit.
    tolerance: how far the blend at a corner of the linear axes may leave it, m; infinite: no limit. A blend begins at
        the speed that keeps it.
    """

    cycle: float = 0.0
    block_time: float = 0.0
    whole_cycles: bool = False
    shortened: bool = False
    acceleration: tuple[float, ...] = ()
    speed: tuple[float, ...] = ()
    tolerance: float = np.inf


def linuxcnc(chain: Chain, acceleration: np.ndarray, speed: np.ndarray | None = None) -> Control:
    """The block times of LinuxCNC 2.9 with its servo period of 1 ms, as they were measured.

    Args:
        chain: axes of the machine.
        acceleration: MAX_ACCELERATION of its axes, (axes,) m/s² and rad/s².
        speed: MAX_VELOCITY of its axes, (axes,) m/s and rad/s; nothing: no limit.
    """
    if len(acceleration) != chain.count:
        raise InputError(f"{len(acceleration)} accelerations; allowed: one for each of {', '.join(chain.letters)}")
    fastest = () if speed is None else tuple(map(float, speed))
    return Control(
        cycle=1e-3, shortened=True, acceleration=tuple(map(float, acceleration)), speed=fastest, tolerance=_G64_P
    )


def block_times(motion: Commanded, control: Control) -> np.ndarray:
    """Duration of every block on that control, (n,) s."""
    seconds = np.maximum(motion.seconds, control.block_time)
    way = np.abs(np.diff(motion.points, axis=0))  # with tool centre point control, LinuxCNC plans in table coordinates
    if control.speed:
        seconds = np.maximum(seconds, (way / control.speed).max(axis=1))
    if control.whole_cycles:
        seconds = np.ceil(seconds / control.cycle - 1e-6) * control.cycle
    if control.shortened:
        turns = (way[:, motion.chain.rotary_columns] > 0.0).any(axis=1)
        seconds = np.where(turns, _shortened(motion, seconds, way, control), seconds)
    return seconds


def _shortened(motion: Commanded, seconds: np.ndarray, way: np.ndarray, control: Control) -> np.ndarray:
    """Block times (n,) s of a control that blends each block into the next one with half of the acceleration."""
    least = np.sqrt(2.0 * (way / (control.acceleration or np.inf)).max(axis=1))
    least = np.ceil(2.0 * least / control.cycle - 1e-6) * 0.5 * control.cycle
    if np.isfinite(control.tolerance) and control.acceleration:
        steps = np.diff(motion.points[:, motion.chain.linear_columns], axis=0)
        length = np.linalg.norm(steps, axis=1)
        half = length / np.maximum((way / control.acceleration).max(axis=1), 1e-30) / 2.0  # acceleration of a blend
        cosine = (steps[1:] * steps[:-1]).sum(axis=1) / np.maximum(length[1:] * length[:-1], 1e-30)
        bend = np.sqrt(np.maximum(0.5 * (1.0 - cosine), 1e-30))  # sine of half the angle of the corner
        speed = length / np.maximum(seconds, least)
        blend = 2.0 * np.sqrt(half[:-1] * control.tolerance / bend)
        wait = np.maximum(speed[:-1] - blend, 0.0) / np.maximum(half[:-1], 1e-30)
        seconds = np.maximum(seconds, least) + np.append(np.where(length[:-1] > 0.0, wait, 0.0), 0.0)
    whole = np.maximum(np.floor(seconds / control.cycle + 1e-6), 1.0) * control.cycle
    return np.maximum(whole, least)


def executed(motion: Commanded, control: Control) -> Commanded:
    """The set-points that a control gives to the drives for ``motion``: straight lines from cycle to cycle.

    Raises:
        InputError: a time is out of bounds, or whole cycles are asked for without a cycle.
    """
    if control.cycle and not SHORTEST <= control.cycle <= 1.0:
        raise InputError(
            f"interpolation cycle of {control.cycle * 1e3:g} ms; allowed: {SHORTEST * 1e3:g} to 1000, or 0 for none"
        )
    if not 0.0 <= control.block_time <= 10.0:
        raise InputError(f"block time of {control.block_time * 1e3:g} ms; allowed: 0 to 10000")
    if (control.whole_cycles or control.shortened) and not control.cycle:
        raise InputError("blocks of whole cycles need an interpolation cycle; allowed: a cycle above 0 ms")
    slowed = Commanded(block_times(motion, control), motion.points, motion.tip, motion.chain)
    if not control.cycle:
        return slowed
    count = int(np.ceil(slowed.duration / control.cycle - 1e-6))
    return Commanded(np.full(count, control.cycle), slowed.at(np.arange(count + 1) * control.cycle), chain=motion.chain)


@dataclass(frozen=True)
class FeedReport:
    """The peripheral feed that a control really gives, over the measured part of a test.

    Attributes:
        time: (n + 1,) s of block time. phi: (n + 1,) rad.
        reading: (n + 1,) m, of an ideal machine that follows the set-points: chord error and rounding of the positions.
        radius: of the circle, m. nominal: the test's feed, m/s.
        duration, ideal: s, of the whole program by its blocks, and by its path and feed. seconds: (shortest, mean)
            block, s.
        jump: (axes,) m/s and rad/s, largest change of each axis' speed from block to block (from cycle to cycle where
            there is one).
        position: (axes,) m and rad, largest deviation of each axis from the test's path at the same angle.
        chain: the machine's axes.
    """

    time: np.ndarray
    phi: np.ndarray
    reading: np.ndarray
    radius: float
    nominal: float
    duration: float
    ideal: float
    seconds: tuple[float, float]
    jump: np.ndarray
    position: np.ndarray
    chain: Chain

    @property
    def feed(self) -> np.ndarray:
        """Feed on the circle, by the angle, between the instants, (n,) m/s."""
        return self.radius * np.abs(np.diff(self.phi)) / np.diff(self.time)

    @property
    def mean(self) -> float:
        """Mean feed, m/s: path over time."""
        return self.radius * abs(float(self.phi[-1] - self.phi[0])) / float(self.time[-1] - self.time[0])

    @property
    def phi_deg(self) -> np.ndarray:
        """``phi`` in degrees."""
        return self.phi / DEG

    @property
    def feed_mm_min(self) -> np.ndarray:
        """``feed`` in mm/min."""
        return self.feed * 60.0 / MM

    @property
    def reading_um(self) -> np.ndarray:
        """``reading`` in µm."""
        return self.reading / UM

    def to_json(self) -> dict:
        """The figures, in mm/min, ms, µm and µrad."""
        per_min = 60.0 / MM
        feed = self.feed
        return {
            "nominal_mm_min": self.nominal * per_min,
            "mean_mm_min": self.mean * per_min,
            "min_mm_min": float(feed.min()) * per_min,
            "max_mm_min": float(feed.max()) * per_min,
            "ripple_percent": 100.0 * float(np.ptp(feed)) / self.mean,
            "duration_s": self.duration,
            "ideal_duration_s": self.ideal,
            "shortest_block_ms": self.seconds[0] * 1e3,
            "mean_block_ms": self.seconds[1] * 1e3,
            "reading_um": {
                k: float(f(self.reading) / UM) for k, f in (("min", np.min), ("mean", np.mean), ("max", np.max))
            },
            "position_um": {a: float(self.position[self.chain.index(a)] / UM) for a in self.chain.linear},
            "angle_urad": {a: float(self.position[self.chain.index(a)] / UM) for a in self.chain.rotary},
            "speed_jump_per_min": {
                a: float(x / scale(a)) * 60.0 for a, x in zip(self.chain.letters, self.jump, strict=True)
            },
        }

    def to_csv(self) -> str:
        """Columns ``time_s, phi_deg, feed_mm_min, reading_um``, one row per instant; the feed is that up to the
        next one.
        """
        feed = np.append(self.feed_mm_min, self.feed_mm_min[-1:])
        text = io.StringIO()
        data = np.column_stack([self.time, self.phi_deg, feed, self.reading_um])
        np.savetxt(text, data, "%.6f", ",", header="time_s,phi_deg,feed_mm_min,reading_um", comments="")
        return text.getvalue()


def feed_report(
    test: BallBarTest, motion: Commanded, control: Control | None = None, name: str = "NC program"
) -> FeedReport:
    """Simulate the interpolation of a test's NC program.

    Args:
        test: what the program is for. motion: the program. control: ``None`` interpolates continuously. name: of the
            program, for messages.

    Raises:
        InputError: the program is none of this test, or as :func:`executed`.
    """
    motion = own_path(test, motion, name)
    nominal = Program(replace(test, commanded=None))
    first, last = nominal.measured_ends
    check_path(test, motion, (first, last), name)
    control = control or Control()
    given = executed(motion, control)
    fine = np.append(
        np.linspace(given.knots[:-1], given.knots[1:], _INSIDE, endpoint=False, axis=1).ravel(), given.duration
    )
    q = given.at(fine)
    phi = unwrapped(test, q)
    sign = np.sign(last - first)
    inside = np.flatnonzero((sign * phi >= sign * first - 1e-9) & (sign * phi <= sign * last + 1e-9))
    part = slice(int(inside[0]), int(inside[-1]) + 1)
    off = q[part] - nominal.path(phi[part])
    for table in map(test.chain.index, test.chain.round_axes):
        off[:, table] = (off[:, table] + np.pi) % (2 * np.pi) - np.pi  # whole turns do not matter
    speeds = given.speeds()[part.start // _INSIDE : max(part.stop // _INSIDE, 1)]
    radius = kind_of(test).radius(test)
    blocks = block_times(motion, control)
    return FeedReport(
        fine[part],
        phi[part],
        reading(test.chain, q[part], np.asarray(test.table_ball), test.length, None, test.component),
        radius,
        test.feed,
        given.duration,
        abs(nominal.ends[1] - nominal.ends[0]) * radius / test.feed,
        (float(blocks.min()), float(blocks.mean())),
        np.abs(np.diff(speeds, axis=0)).max(axis=0, initial=0.0),
        np.abs(off).max(axis=0),
        test.chain,
    )
