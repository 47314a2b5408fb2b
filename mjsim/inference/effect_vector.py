"""Free parameters of an effect as a vector: amplitude and phase as Cartesian pairs, everything else as it is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mjsim.inference.parameters import Block
from mjsim.machine.effect import Effect

#: Prior width of an effect's entries, typical sizes.
_WIDE = 1e3


def _plane() -> np.ndarray:
    """Points (2, n) that stand for a normal distribution in the plane, each for as much of it as the others."""
    share = (np.arange(128) + 0.5) / 128
    radius, angle = np.meshgrid(np.sqrt(-2.0 * np.log(share)), 2.0 * np.pi * share)
    return np.vstack([(radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()])


_PLANE = _plane()


class EffectVector:
    """An effect whose ``names`` are fitted.

    The vector is scaled so that one unit is the parameter's typical size. An ``amplitude_*`` with a free ``phase_deg``
    becomes (a cos φ, a sin φ), and so does every component of a pitch error: the reading is linear in those.
    """

    def __init__(
        self, effect: Effect, names: tuple[str, ...], prior: tuple[np.ndarray, np.ndarray] | None = None
    ) -> None:
        self.effect, self.names, self.prior = effect, tuple(names), prior
        self.specs = {p.name: p for p in effect.parameters_of(effect.subject)}
        self.amplitude = next((n for n in names if n.startswith("amplitude_")), None)
        self.polar = self.amplitude is not None and "phase_deg" in names

    @property
    def block(self) -> Block:
        """The effect as a block of the parameter vector; without a prior of its own a wide one only keeps the
        equations regular.
        """
        labels = [f"{i}" for i in range(len(self.vector))]
        name, (lower, upper) = f"effect {self.effect.key}", self.bounds
        if self.prior is not None:
            mean, deviation = self.prior
            block = Block.normal(name, labels, mean=mean, deviation=deviation)
        else:
            block = Block.normal(name, labels, mean=self.vector, deviation=_WIDE, informative=False)
        return replace(block, lower=lower, upper=upper)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bound of every entry, (n,) each; the two of an amplitude with its phase have none."""
        ends: list[tuple[float, float]] = []
        for n in self.names:
            p = self.specs[n]
            if n == "components":
                ends += [(-math.inf, math.inf)] * 2 * len(self.effect.values[n])
            elif self.polar and n == self.amplitude:
                ends += [(-math.inf, math.inf)] * 2
            elif not (self.polar and n == "phase_deg"):
                first, last = p.encode(p.lower), p.encode(p.upper)
                ends.append((min(first, last), max(first, last)))
        lower, upper = np.array(ends).T
        return lower, upper

    def with_prior(self, mean: np.ndarray, deviation: np.ndarray) -> EffectVector:
        """The same with a normal prior of its entries.

        Args:
            mean: (n,) typical sizes.
            deviation: Standard deviations, (n,) typical sizes.
        """
        return EffectVector(self.effect, self.names, (mean, deviation))

    def with_effect(self, effect: Effect) -> EffectVector:
        """The same entries and prior at the values of ``effect``."""
        return EffectVector(effect, self.names, self.prior)

    def with_waves(self, other: EffectVector) -> EffectVector:
        """A pitch error and the waves of another of the same kind; each keeps its prior, if only a wide one."""
        rows = [row for f in (self, other) for row in f.effect.values["components"]]
        priors = [f.prior or (np.zeros(len(f.vector)), np.full(len(f.vector), _WIDE)) for f in (self, other)]
        mean, deviation = (np.concatenate(pair) for pair in zip(*priors, strict=True))
        return EffectVector(self.effect.replaced(components=rows), self.names, (mean, deviation))

    @property
    def off(self) -> np.ndarray:
        """The vector when the effect is off, or as its prior expects it, (n,)."""
        if self.prior is not None:
            return self.prior[0]
        out = self.vector
        if "components" in self.names:
            return np.zeros(len(out))
        out[self.linear] = self.neutral
        return out

    @property
    def neutral(self) -> np.ndarray:
        """The vector's linear entries when the effect is off: leading parameters, or the two of an amplitude with
        its phase.
        """
        if self.polar:
            return np.zeros(2)
        return np.array([p.encode(p.neutral) for p in (self.specs[n] for n in self.names) if p.neutral is not None])

    @property
    def linear(self) -> list[int]:
        """Which entries of the vector the reading is linear in, for a single-phase effect or leading parameters."""
        if self.polar:
            return [0, 1]
        return [i for i, n in enumerate(self.names) if self.specs[n].neutral is not None]

    @property
    def is_linear(self) -> bool:
        """Whether the reading is linear in all entries of the vector."""
        return self.names == ("components",) or len(self.linear) == len(self.vector)

    def only(self, j: int, size: float) -> Effect:
        """The effect with ``size`` in the ``j``-th entry of its vector and nothing in the others; all are linear."""
        if self.names == ("components",):
            order, scale = self.effect.values["components"][j // 2][0], self.specs["components"].scale
            return self.effect.replaced(components=[[order, size * scale, 90.0 * (j % 2)]])
        vector = self.neutral.copy()
        vector[j] += size
        return self.at(vector)

    @property
    def vector(self) -> np.ndarray:
        """Present values, scaled."""
        out: list[float] = []
        v = self.effect.values
        for n in self.names:
            scale = self.specs[n].scale
            if n == "components":
                for _, a, phase in v[n]:
                    out += [a * math.cos(math.radians(phase)) / scale, a * math.sin(math.radians(phase)) / scale]
            elif self.polar and n == self.amplitude:
                phase = math.radians(v["phase_deg"])
                out += [v[n] * math.cos(phase) / scale, v[n] * math.sin(phase) / scale]
            elif not (self.polar and n == "phase_deg"):
                out.append(self.specs[n].encode(v[n]))
        return np.array(out)

    def at(self, vector: np.ndarray) -> Effect:
        """The effect with the vector's values, clipped to the parameters' bounds."""
        values, i = {}, 0
        for n in self.names:
            p = self.specs[n]
            if n == "components":
                rows = []
                for order, _, _ in self.effect.values[n]:
                    c, s = vector[i] * p.scale, vector[i + 1] * p.scale
                    rows.append([order, min(math.hypot(c, s), p.upper), math.degrees(math.atan2(s, c))])
                    i += 2
                values[n] = rows
            elif self.polar and n == self.amplitude:
                c, s = vector[i] * p.scale, vector[i + 1] * p.scale
                values[n] = min(math.hypot(c, s), p.upper)
                values["phase_deg"] = math.degrees(math.atan2(s, c))
                i += 2
            elif not (self.polar and n == "phase_deg"):
                values[n] = float(p.decode(vector[i]))
                i += 1
        return self.effect.replaced(**values)

    def nudged(self, j: int, step: float) -> tuple[Effect, float]:
        """The effect with the ``j``-th entry of its vector moved by about ``step``, the other way at a bound; and
        by how much it moved. What a drive does from a bound on is asked of a whole typical size: the damping of the
        bristles goes with the root of the friction, and next to none it is all that shows.
        """
        v = self.vector
        if not self.effect.search.quasi_static and min(abs(end[j] - v[j]) for end in self.bounds) < step:
            step = 1.0
        for sign in (1.0, -1.0):
            moved = v.copy()
            moved[j] += sign * step
            effect = self.at(moved)
            change = float(EffectVector(effect, self.names).vector[j] - v[j])
            if abs(change) > 1e-9:
                break
        return effect, change

    def interval(self, vector: np.ndarray, covariance: np.ndarray, z: float = 1.96) -> dict:
        """95 % intervals in the file's units, per parameter, as far as its bounds; for components two tables, lower and
        upper.
        """
        out, i = {}, 0
        for n in self.names:
            p = self.specs[n]
            if n == "components":
                low, high = [], []
                for order, _, _ in self.effect.values[n]:
                    size, phase = _polar(vector[i : i + 2], covariance[i : i + 2, i : i + 2], z)
                    low.append([order, size[0] * p.scale, phase[0]])
                    high.append([order, size[1] * p.scale, phase[1]])
                    i += 2
                out[n] = [low, high]
            elif self.polar and n == self.amplitude:
                size, out["phase_deg"] = _polar(vector[i : i + 2], covariance[i : i + 2, i : i + 2], z)
                out[n] = [x * p.scale for x in size]
                i += 2
            elif not (self.polar and n == "phase_deg"):
                sd = math.sqrt(max(covariance[i, i], 0.0))
                out[n] = sorted(float(p.decode(x)) for x in (vector[i] - z * sd, vector[i] + z * sd))
                i += 1
        return out


def _polar(v: np.ndarray, c: np.ndarray, z: float) -> tuple[list[float], list[float]]:
    """Intervals of amplitude and phase (deg) of a wave whose Cartesian pair (2,) has the covariance (2, 2).

    Noise makes a small amplitude larger rather than smaller. The interval starts at the smallest wave that comes out as
    large as this one often enough, and ends where the estimate's distribution in the plane does.
    """
    a, outside = float(np.hypot(*v)), 0.5 * math.erfc(z / math.sqrt(2.0))
    along = v / a if a > 0.0 else np.array([1.0, 0.0])
    across = np.array([-along[1], along[0]])
    values, directions = np.linalg.eigh(c)
    noise = directions * np.sqrt(np.maximum(values, 0.0)) @ _PLANE
    # the wave along v that comes out as large as v with this noise
    with_it = along @ noise
    left = a * a - (noise * noise).sum(0) + with_it * with_it
    smallest = np.where(np.hypot(*noise) < a, np.sqrt(np.maximum(left, 0.0)) - with_it, 0.0)
    low = float(np.quantile(smallest, outside))
    high = float(np.quantile(np.hypot(*(v[:, None] + noise)), 1.0 - outside))
    phase, off = math.degrees(math.atan2(v[1], v[0])), z * math.sqrt(max(across @ c @ across, 0.0))
    width = min(math.degrees(off / a), 180.0) if a > 0.0 else 180.0
    return [low, high], [phase - width, phase + width]
