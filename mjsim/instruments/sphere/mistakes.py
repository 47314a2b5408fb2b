"""What is wrong with a file of points: positions or deviations in another order, sign, unit or with another tool.

Positions have to be those at which the tool is in the sphere's centre, so kinematics alone checks them. Deviations have
to be what location errors and a displaced sphere can make of it, which is checked where there are enough points.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mjsim.instruments.base import Mistake
from mjsim.instruments.sphere.measurement import Points, Probe, SphereTest
from mjsim.machine.chain import COORDINATES, SENSES, Chain, chain_of
from mjsim.machine.kinematics import Geometry, bar_vector
from mjsim.units import DEG, MM, UM

#: Positions may be off by so much, m: a sphere whose nominal place is known to 1 mm (two standard deviations).
_NEAR = 2.0 * MM
#: Another reading of a file is named where it leaves at most this share of what the file as it is leaves.
_SHARE = 0.2
#: Deviations are looked at where the geometry leaves more than so many standard deviations of the noise.
_POOR = 6.0
#: Sizes of errors that deviations of a real machine may be made of: sphere (m), location (m and rad), squareness (rad).
_SPHERE, _SHIFT, _TILT, _SQUARE = 1e-3, 50e-6, 200e-6, 200e-6
#: Deviations that no unit but a wrong one makes, m: beyond any machine.
_HUGE = 5.0 * MM
#: A sphere farther from its nominal place than so many standard deviations, m, is somewhere else.
_FAR = 4.0 * MM


def sphere_mistakes(tests: Sequence[SphereTest], recordings: dict[str, Points], probe: Probe) -> list[Mistake]:
    """Mistakes of all tests, the positions' first."""
    out = []
    for t in tests:
        found = _position_mistake(t, recordings[t.name]) or _size_mistake(t, recordings[t.name], probe)
        found = found or _deviation_mistake(t, recordings[t.name], probe)
        if found:
            out.append(found)
    return out


def _off(test: SphereTest, position: np.ndarray) -> float:
    """RMS distance of the tool centre point from the sphere's centre in the points of an ideal machine, m."""
    away = bar_vector(test.chain, position, np.array(test.sphere))
    return float(np.sqrt((away**2).sum(axis=1).mean()))


def _position_mistake(test: SphereTest, points: Points) -> Mistake | None:
    """Axes that are not where the sphere is."""
    off = _off(test, points.position)
    if off < _NEAR:
        return None
    best, sentence = off, ""
    for words, changed, position in _other_positions(test, points.position):
        left = _off(changed, position)
        if left < best:
            best, sentence = left, words
    said = f"{test.name}: in these positions the tool of an ideal machine is {off / MM:.3g} mm (RMS) from the sphere"
    if sentence and best < max(_NEAR, _SHARE * off):
        return Mistake("positions", (test.name,), f"{said}; {best / MM:.2g} mm are left if {sentence}")
    more = " or tool_length_mm" if test.chain.swivelling else ""
    return Mistake("positions", (test.name,), f"{said}; correct sphere_mm{more}, or the columns of the axes")


def _other_positions(test: SphereTest, q: np.ndarray) -> Iterator[tuple[str, SphereTest, np.ndarray]]:
    """Other readings of the columns of axes: what would have to be corrected, the test, and the positions."""
    chain = test.chain
    letters = chain.letters
    for i in range(chain.count):
        turned = q.copy()
        turned[:, i] = -turned[:, i]
        words = f"the sign of {letters[i]} is turned; turn it in the file"
        if chain.is_rotary(letters[i]):
            other = SENSES[chain.sense(letters[i]) == SENSES[0]]
            words += f', or write sense = "{other}" for [axis.{letters[i]}] in the machine file'
        yield words, test, turned
    for i, j in itertools.combinations(range(chain.count), 2):
        if chain.is_rotary(letters[i]) == chain.is_rotary(letters[j]):
            swapped = q.copy()
            swapped[:, [i, j]] = swapped[:, [j, i]]
            yield f"{letters[i]} and {letters[j]} are exchanged; exchange the columns", test, swapped
    for unit, factor in (("m", 1e3), ("inch", 25.4), ("µm", 1e-3)):
        scaled = q.copy()
        scaled[:, chain.linear_columns] *= factor
        yield f"the linear axes are in {unit}; write them in mm", test, scaled
    scaled = q.copy()
    scaled[:, chain.rotary_columns] /= DEG
    yield "the rotary axes are in rad; write them in degrees", test, scaled
    away = bar_vector(chain, q, np.array(test.sphere))
    yield from _with_offset(test, q, away)
    if chain.swivelling:
        longer = _with_tool(chain, chain.tool_length + 0.05)
        change = (bar_vector(longer, q, np.array(test.sphere)) - away) / 0.05
        length = chain.tool_length - float((away * change).sum() / max(float((change**2).sum()), 1e-12))
        if length > 0.0:
            other = replace(test, chain=_with_tool(chain, length))
            yield f"the tool is {length / MM:.1f} mm long; correct tool_length_mm", other, q


def _with_offset(test: SphereTest, q: np.ndarray, away: np.ndarray) -> Iterator[tuple[str, SphereTest, np.ndarray]]:
    """The sphere somewhere else on the table, and positions without the tool's length."""
    chain = test.chain
    x = np.linalg.lstsq(_sphere_columns(test, q), away.ravel(), rcond=None)[0]
    moved = replace(test, sphere=tuple(float(v) for v in np.array(test.sphere) + x))
    place = ", ".join(f"{v / MM:.1f}" for v in moved.sphere)
    yield f"the sphere is at [{place}] mm; correct sphere_mm", moved, q
    last = q.copy()
    constant = float(away[:, 2].mean())
    last[:, chain.linear_columns.stop - 1] -= constant
    letter = chain.linear[-1]
    yield (
        f"{letter} is {abs(constant) / MM:.1f} mm too {'large' if constant > 0 else 'small'} everywhere, such as "
        f"by the length of the probe; write where the tip is",
        test,
        last,
    )


def _sphere_columns(test: SphereTest, q: np.ndarray) -> np.ndarray:
    """Derivatives of the deviations by the place of the sphere, (3n, 3)."""
    h, ball = 1e-3, np.array(test.sphere)
    at = bar_vector(test.chain, q, ball)
    return np.stack([(at - bar_vector(test.chain, q, ball + h * e)) / h for e in np.eye(3)], axis=2).reshape(-1, 3)


def _with_tool(chain: Chain, length: float) -> Chain:
    return chain_of(chain.configuration, chain.placements, length, chain.singular)


def _size_mistake(test: SphereTest, points: Points, probe: Probe) -> Mistake | None:
    """Deviations in another unit."""
    largest, spread = float(np.abs(points.deviation).max()), float(np.abs(np.diff(points.deviation, axis=0)).max())
    said = f"{test.name}: the deviations are up to {largest / UM:.3g} µm"
    if spread < probe.noise:
        sentence = f"{said}, and change by less than one probed centre repeats; write them in µm, not in mm"
        return Mistake("unit", (test.name,), sentence)
    columns = _sphere_columns(test, points.position)
    away = np.linalg.lstsq(columns, points.deviation.ravel(), rcond=None)[0]
    rest = points.deviation.ravel() - columns @ away
    if np.linalg.norm(away) > _FAR and np.sqrt(np.mean(rest**2)) < _SHARE * largest:
        place = ", ".join(f"{(v + x) / MM:.2f}" for v, x in zip(test.sphere, away, strict=True))
        sentence = f"{said}, as of a sphere at [{place}] mm; correct sphere_mm, or the unit of the deviations"
        return Mistake("sphere", (test.name,), sentence)
    if largest > _HUGE:
        return Mistake("unit", (test.name,), f"{said}, more than any machine has; write them in µm, not in nm")
    return None


def _deviation_mistake(test: SphereTest, points: Points, probe: Probe) -> Mistake | None:
    """Deviations with other axes or single signs."""
    q, n = points.position, len(points.position)
    design = _geometry_columns(test, q)
    if 3 * n < 2 * design.shape[1]:
        return None
    prior = np.diag(1.0 / np.ones(design.shape[1]))

    def left(d: np.ndarray) -> float:
        """What the geometry of a plausible machine leaves, with its priors, RMS m."""
        x = np.linalg.lstsq(
            np.vstack([design / probe.noise, prior]),
            np.append(d.ravel() / probe.noise, np.zeros(len(prior))),
            rcond=None,
        )[0]
        rest = d.ravel() - design @ x
        return float(np.sqrt((rest @ rest + probe.noise**2 * (x @ x)) / len(rest)))

    as_is = left(points.deviation)
    if as_is < _POOR * probe.noise:
        return None
    best, words = as_is, ""
    names = [f"d{c.lower()}" for c in COORDINATES]
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            if signs[0] < 0.0 or (order == (0, 1, 2) and min(signs) > 0.0):
                continue  # all three signs together are a sphere on the other side: nobody can tell
            rest = left(points.deviation[:, order] * signs)
            if rest < best:
                moved = [
                    f"{names[k]} is {'minus ' if s < 0 else ''}{names[o]}"
                    for k, (o, s) in enumerate(zip(order, signs, strict=True))
                    if o != k or s < 0
                ]
                best, words = rest, ", ".join(moved)
    if best > _SHARE * as_is:
        return None
    return Mistake(
        "deviations",
        (test.name,),
        f"{test.name}: no geometry of the machine makes these deviations ({as_is / UM:.3g} µm are left), but one does "
        f"({best / UM:.3g} µm) where {words} of the file; correct the columns",
    )


def _geometry_columns(test: SphereTest, q: np.ndarray) -> np.ndarray:
    """Deviations by the place of the sphere, an offset of the probe, location errors and squareness, one usual size
    each, (3n, k).
    """
    chain, ball = test.chain, np.array(test.sphere)
    zero = bar_vector(chain, q, ball)
    columns = [zero - bar_vector(chain, q, ball + _SPHERE * e) for e in np.eye(3)]
    columns += [np.broadcast_to(_SHIFT * e, zero.shape) for e in np.eye(3)]
    for e in chain.location_errors:
        columns.append(zero - bar_vector(chain, q, ball, Geometry({e.name: _TILT if e.rotation else _SHIFT}, {})))
    for s in chain.squareness:
        columns.append(zero - bar_vector(chain, q, ball, Geometry({}, {s.name: _SQUARE})))
    return np.stack(columns, axis=2).reshape(-1, len(columns))
