"""Pitch error of a gear from two encoders of one axis: one on the motor, one on the load.

What the load shows beyond the motor is the paper's equation (1) and little else:

    load − motor = Σ W_i sin(N_i θ + φ_i) + drift(t) + play · sign(ω) + latency · ω

with the axis position θ, N_i waves per turn of the axis (the number of teeth of the wheel is the order of its worm).
The drift of each recording is a cubic of the time. Play and latency are fitted where the axis moves both ways. Samples
may be slow and uneven: sines are fitted by least squares (Lomb 1976; Zechmeister and Kürster 2009 with the other terms
fitted along). One wave is added after the other, the one that explains most, and all orders are fitted again.

A wave is named where it explains more than noise does at one place of those looked at in a thousand searches. The noise
at an order is what other orders from a third of it to three times of it explain, without the resolution around it: a
peak is not its own noise. The same noise gives the standard deviation of an order (Rife and Boorstyn 1974); what
drifts of other degrees do to it is added.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.instruments.axis_log.measurement import recorded_axes
from mjsim.machine.model import Machine
from mjsim.units import DEG

#: Chance that noise alone names a wave in one search.
_FALSE_ALARM = 1e-3
#: Turns of a wave in one recording from which it is told from drift.
TURNS = 4.0
#: Most waves, orders on the search grid in one resolution, and highest harmonic of a worm.
_MOST, _FINE, _HARMONICS = 12, 6, 10
#: Noise at an order is that of the orders from this part of it to so many times of it, by this lower share of them.
_BAND, _LOW = 3.0, 0.75
#: Degree of the drift, and others that would do as well: what they change is doubt as well.
_DRIFT, _OTHERS = 3, (2, 4, 5)
#: Most samples that are fitted; more are averaged.
_SAMPLES = 3000
#: Highest order that is looked for.
_HIGHEST = 2000.0


@dataclass(frozen=True)
class EncoderWave:
    """One wave over the position of an axis.

    Attributes:
        order: Waves per turn.
        order_sd: Its standard deviation.
        amplitude: rad.
        amplitude_sd: rad.
        phase: At position 0, rad.
        turns: How many of its waves the longest recording covers.
        strength: What it explains over what noise explains at its order.
    """

    order: float
    order_sd: float
    amplitude: float
    amplitude_sd: float
    phase: float
    turns: float
    strength: float


@dataclass(frozen=True)
class EncoderPitch:
    """The pitch error of one axis from its two encoders.

    Attributes:
        axis: Letter.
        tests: Names of the logs.
        waves: From the lowest order up, those that turn often enough to be told from drift.
        slow: Waves of fewer turns: part of the drift.
        worm: Order of the worm, and its standard deviation; nothing where no wave was found.
        family: Harmonics of the worm that were found, by their number, 1 for itself.
        arc: Range of the position in the longest recording, rad.
        rate: Usual speed, rad/s.
        raw: RMS of the difference less its drift, rad.
        left: RMS of what is left, rad.
        position: (n,) rad.
        difference: Load less motor without drift, slow waves, play and latency, (n,) rad.
        orders: Orders looked at, (m,).
        explained: What a wave of each order would explain beside the drift alone, over the noise there, (m,).
        limit: That a wave has to exceed, (m,).
    """

    axis: str
    tests: tuple[str, ...]
    waves: tuple[EncoderWave, ...]
    slow: tuple[EncoderWave, ...]
    worm: tuple[float, float] | None
    family: tuple[int, ...]
    arc: float
    rate: float
    raw: float
    left: float
    position: np.ndarray
    difference: np.ndarray
    orders: np.ndarray
    explained: np.ndarray
    limit: np.ndarray

    def to_json(self) -> dict:
        """As ``mjsim identify pitch-error --json`` prints it; angles in degrees."""
        worm = None
        if self.worm is not None:
            order, sd = self.worm
            worm = {"order": round(order, 3), "sd": round(sd, 3), "harmonics": list(self.family)}
            worm["period_s"] = round(2.0 * np.pi / order / self.rate, 3) if self.rate else None
        return {
            "axis": self.axis,
            "tests": list(self.tests),
            "arc_deg": round(self.arc / DEG, 4),
            "rate_deg_per_s": round(self.rate / DEG, 8),
            "worm": worm,
            "components": [_plain(w) for w in self.waves],
            "slow": [_plain(w) for w in self.slow],
            "rms_deg": {"raw": self.raw / DEG, "residual": self.left / DEG},
        }


def _plain(w: EncoderWave) -> dict:
    return {
        "order": round(w.order, 3),
        "order_sd": round(w.order_sd, 3),
        "amplitude_deg": w.amplitude / DEG,
        "amplitude_sd_deg": w.amplitude_sd / DEG,
        "phase_deg": round(w.phase / DEG, 2),
        "turns": round(w.turns, 2),
        "strength": round(w.strength, 1),
    }


def axes_with_two_encoders(logs: Campaign) -> tuple[str, ...]:
    """Rotary axes whose load side was recorded."""
    there = {a for t in logs.measured for a in t.axes if logs.traces[t.name].axes[a].load is not None}
    return tuple(a for a in recorded_axes(logs.measured) if a in there and logs.tests[0].chain.is_rotary(a))


def identify_from_encoders(logs: Campaign, axis: str) -> EncoderPitch:
    """Pitch error of one rotary axis from the logs that recorded its load side.

    Args:
        logs: The axis logs of a campaign.
        axis: Letter of a rotary axis.

    Raises:
        InputError: No log has the load side of the axis, or it hardly moves.
    """
    tests = [t for t in logs.measured if axis in t.axes and logs.traces[t.name].axes[axis].load is not None]
    if not tests or not logs.tests[0].chain.is_rotary(axis):
        raise InputError(
            f"axis {axis}: no log has the load side of this rotary axis; needed: the column {axis}_load_deg, such as a "
            f"second encoder, or a guide log"
        )
    total = sum(len(logs.traces[t.name].time) for t in tests)
    block = -(-total // _SAMPLES)
    recorded = [t.name for t in tests]
    x, y, base, arc, apart, rates = _stacked(logs, recorded, axis, block, _DRIFT)
    if arc <= 0.0:
        raise InputError(f"axis {axis} does not move in {', '.join(t.name for t in tests)}; allowed: a moving axis")
    resolution = 2.0 * np.pi / arc
    highest = min(_HIGHEST, 0.5 * np.pi / apart)
    whole = len(base.T) > (_DRIFT + 1) * len(tests) and arc >= 0.98 * 2.0 * np.pi
    # forth and back over a whole turn, drift is told from position, and only whole orders repeat
    grid = np.arange(1.0, highest) if whole else np.arange(resolution, highest, resolution / _FINE)
    if len(grid) < 4 * _FINE:
        raise InputError(f"axis {axis} moves by {arc / DEG:.3g}° with samples {apart / DEG:.3g}° apart; allowed: more")
    waves = np.sin(np.outer(x, grid)), np.cos(np.outer(x, grid))
    found: list[float] = []
    first = None
    while len(found) < _MOST:
        strength = _strength(waves, _design(base, x, found), y, grid, resolution)
        first = strength if first is None else first
        best = int(np.argmax(np.where(strength[1] > strength[2], strength[0], 0.0)))
        if strength[1][best] <= strength[2][best]:
            break
        found.append(float(grid[best]))
        found = found if whole else _refined(found, base, x, y, resolution)
    assert first is not None
    fit, rest = _fit(base, x, y, found)
    found_by_order = sorted(range(len(found)), key=lambda k: found[k])
    gain = _strength(waves, _design(base, x, found), y, grid, resolution)[0]
    floors = [_floor(gain, grid, n, resolution)[0] for n in found]
    pairs = fit[base.shape[1] :].reshape(-1, 2)
    doubt = np.zeros(len(found))
    if found and not whole:
        other = [_stacked(logs, recorded, axis, block, degree)[2] for degree in _OTHERS]
        doubt = np.std([found, *(_refined(found, b, x, y, resolution) for b in other)], axis=0)
    made = [
        _wave(found[k], float(pairs[k, 0]), float(pairs[k, 1]), floors[k], len(x), arc, float(doubt[k]))
        for k in found_by_order
    ]
    turns = 0.98 * (1.0 if whole else TURNS)
    told = tuple(w for w in made if w.turns >= turns)
    worm, family = _worm(told, turns * resolution)
    sines = sum((w.amplitude * np.sin(w.order * x + w.phase) for w in told), np.zeros(len(x)))
    drift_only = y - base @ np.linalg.lstsq(base, y, rcond=None)[0]
    slow = tuple(w for w in made if w not in told)
    return EncoderPitch(
        axis, tuple(recorded), told, slow, worm, family, arc, float(np.median(rates)), float(drift_only.std()),
        float(rest.std()), x, rest + sines, grid, first[1], first[2],
    )  # fmt: skip


def _stacked(logs: Campaign, names: list[str], axis: str, block: int, degree: int):
    """Positions, differences, columns of drift, play and latency of all logs; arc, distance of samples, speeds."""
    positions, differences, own, more, arcs, steps, rates = [], [], [], [], [], [], []
    for name in names:
        recording = logs.traces[name]
        record = recording.axes[axis]
        assert record.load is not None
        rows = len(recording.time) // block * block
        time, motor, load = (
            v[:rows].reshape(-1, block).mean(axis=1) for v in (recording.time, record.actual, record.load)
        )
        u = 2.0 * (time - time[0]) / (time[-1] - time[0]) - 1.0
        own.append(np.polynomial.legendre.legvander(u, degree))
        rate = np.gradient(motor, time)
        more.append(np.column_stack([np.sign(rate), rate]))
        positions.append(motor)
        differences.append(load - motor)
        arcs.append(float(np.ptp(motor)))
        steps.append(float(np.median(np.abs(np.diff(motor)))))
        rates.append(float(np.median(np.abs(rate))))
    count = [len(p) for p in positions]
    drift = np.zeros((sum(count), (degree + 1) * len(names)))
    for k, part in enumerate(own):
        at = sum(count[:k])
        drift[at : at + count[k], k * (degree + 1) : (k + 1) * (degree + 1)] = part
    both = np.vstack(more)
    two_ways = np.mean(both[:, 0] > 0.0) > 0.05 and np.mean(both[:, 0] < 0.0) > 0.05
    base = np.column_stack([drift, both]) if two_ways else drift
    apart = max(float(np.median([s for s in steps if s > 0.0] or [0.0])), max(arcs) / 1e5)
    return np.concatenate(positions), np.concatenate(differences), base, max(arcs), apart, rates


def _design(base: np.ndarray, x: np.ndarray, orders: list[float]) -> np.ndarray:
    """Columns of the drift, then sine and cosine of each order."""
    return np.column_stack([base, *(f(n * x) for n in orders for f in (np.sin, np.cos))])


def _fit(base: np.ndarray, x: np.ndarray, y: np.ndarray, orders: list[float]):
    """Coefficients of the columns, and what is left."""
    A = _design(base, x, orders)
    fit = np.linalg.lstsq(A, y, rcond=None)[0]
    return fit, y - A @ fit


def _strength(waves: tuple[np.ndarray, np.ndarray], A: np.ndarray, y: np.ndarray, grid: np.ndarray, resolution: float):
    """What a further wave of each order would explain, the same over the noise there, and its limit, (m,) each.

    The limit is that of an exponential value over a mean that is itself known from some values only (F distribution).
    """
    Q, _ = np.linalg.qr(A)
    rest = y - Q @ (Q.T @ y)
    s, c = (w - Q @ (Q.T @ w) for w in waves)
    ss, cc, sc = (s * s).sum(axis=0), (c * c).sum(axis=0), (s * c).sum(axis=0)
    p, q = rest @ s, rest @ c
    det = ss * cc - sc**2
    usable = det > 1e-6 * len(y) ** 2 / 4.0
    gain = np.where(usable, (cc * p**2 - 2.0 * sc * p * q + ss * q**2) / np.where(usable, det, 1.0), 0.0)
    floors, known = np.array([_floor(gain, grid, n, resolution) for n in grid]).T
    places = len(grid) * (grid[1] - grid[0]) / resolution
    limit = known * ((places / _FALSE_ALARM) ** (1.0 / known) - 1.0)
    return gain, gain / floors, limit


def _floor(gain: np.ndarray, grid: np.ndarray, order: float, resolution: float) -> tuple[float, float]:
    """What noise explains at an order in the mean, and from how many independent values this is known.

    Noise explains amounts with an exponential distribution (χ² with two degrees). Its mean follows from the lower three
    quarters of what the orders around explain, which other peaks do not reach.
    """
    apart = np.abs(grid - order) > 1.5 * resolution
    near = apart & (grid > order / _BAND) & (grid < order * _BAND)
    if near.sum() < 4 * _FINE:
        near = apart & (np.abs(grid - order) < 24.0 * resolution)
    values = np.sort(gain[near])
    low = values[: max(1, round(_LOW * len(values)))]
    mean = float(low.mean()) / (1.0 + (1.0 - _LOW) * np.log(1.0 - _LOW) / _LOW)
    return max(mean, 1e-30), max(_LOW * len(values) * (grid[1] - grid[0]) / resolution, 1.0)


def _refined(orders: list[float], base: np.ndarray, x: np.ndarray, y: np.ndarray, resolution: float) -> list[float]:
    """All orders fitted, each within a resolution of where it was: Gauss-Newton with the other columns fitted along."""
    here = np.array(orders)
    for _ in range(8):
        fit, rest = _fit(base, x, y, list(here))
        a, b = fit[base.shape[1] :: 2], fit[base.shape[1] + 1 :: 2]
        slopes = np.column_stack(
            [x * (s * np.cos(n * x) - c * np.sin(n * x)) for n, s, c in zip(here, a, b, strict=True)]
        )
        Q, _ = np.linalg.qr(_design(base, x, list(here)))
        slopes -= Q @ (Q.T @ slopes)
        step = np.clip(np.linalg.lstsq(slopes, rest, rcond=None)[0], -0.2 * resolution, 0.2 * resolution)
        here = np.clip(here + step, np.array(orders) - resolution, np.array(orders) + resolution)
        if np.abs(step).max() < 1e-4 * resolution:
            break
    return [float(n) for n in here]


def _wave(order: float, sine: float, cosine: float, floor: float, count: int, arc: float, doubt: float):
    """One of the waves, with what the noise around its order makes uncertain, all waves fitted.

    Args:
        order: Waves per turn.
        sine: Coefficient, rad.
        cosine: Coefficient, rad.
        floor: What noise explains at this order, rad².
        count: Number of samples.
        arc: Range of the position in the longest recording, rad.
        doubt: How far other drifts move the order.
    """
    amplitude = float(np.hypot(sine, cosine))
    strength = max(0.5 * count * amplitude**2 / floor, 1e-12)
    order_sd = np.hypot(np.sqrt(1.5) / np.pi * (2.0 * np.pi / arc) / np.sqrt(strength), doubt)
    size_sd, phase = float(np.sqrt(floor / count)), float(np.arctan2(cosine, sine))
    return EncoderWave(order, float(order_sd), amplitude, size_sd, phase, order * arc / (2.0 * np.pi), strength)


def _worm(waves: tuple[EncoderWave, ...], lowest: float) -> tuple[tuple[float, float] | None, tuple[int, ...]]:
    """Order of the worm: what most waves are harmonics of, or else the lowest wave.

    Everything before the worm turns faster than it, so that it has the lowest order. A worm that is more than eccentric
    has harmonics. Waves that are whole multiples of one order by accident are rare: each does so with the chance of
    twice its uncertainty over that order. A family of waves is believed where this chance, over all families looked at,
    is below one in a thousand.
    """
    if not waves:
        return None, ()
    best, family = 0.0, ()
    order: tuple[float, float] = (waves[0].order, waves[0].order_sd)
    looked_at = len(waves) * _HARMONICS
    for head in waves:
        for h in range(1, _HARMONICS + 1):
            n = head.order / h
            if n < lowest:
                continue
            members, score = {h: head}, -np.log(looked_at)
            for w in waves:
                m = round(w.order / n)
                doubt = 3.0 * np.hypot(w.order_sd, m / h * head.order_sd)
                if w is head or not 1 <= m <= _HARMONICS or m in members or abs(w.order - m * n) > doubt:
                    continue
                members[m] = w
                score += np.log(max(n / (2.0 * doubt), 1.0))
            if score > best and score > -np.log(_FALSE_ALARM):
                best, family = score, tuple(sorted(members))
                weights = {m: (m / w.order_sd) ** 2 for m, w in members.items()}
                mean = sum(weights[m] * w.order / m for m, w in members.items()) / sum(weights.values())
                order = (float(mean), float(sum(weights.values()) ** -0.5))
    return order, family or (1,)


def machine_with_waves(machine: Machine, found: Mapping[str, EncoderPitch]) -> Machine:
    """The machine with the waves of some axes in place of the pitch errors that it had."""
    for axis, result in found.items():
        cls, subject = registry.effect_class(f"pitch_error.{axis}", machine.chain)
        machine = machine.without(f"pitch_error.{axis}")
        if result.waves:
            rows = [[w.order, w.amplitude / DEG, w.phase / DEG] for w in result.waves]
            machine = machine.with_effect(cls(subject, components=rows))
    return machine
