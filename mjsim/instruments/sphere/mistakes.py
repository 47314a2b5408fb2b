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
from mjsim.instruments.sphere.measurement import Points, Probe, SphereTest, probe_columns, sphere_columns
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
#: A sphere farther from its nominal place, m, is somewhere else: four standard deviations.
_FAR = 4.0 * MM
#: A probe that is longer or shorter by more standard deviations of its offset was not measured.
_LONG = 10.0
#: Another reading of a file: what would have to be corrected, the test, and the positions, (n, axes) m and rad.
Reading = tuple[str, SphereTest, np.ndarray]


def sphere_mistakes(tests: Sequence[SphereTest], recordings: dict[str, Points], probe: Probe) -> list[Mistake]:
    """Mistakes of all tests, the positions' first."""
    out = []
    for t in tests:
        points = recordings[t.name]
        found = _position_mistake(t, points.position, _NEAR, "in these positions the tool of an ideal machine is")
        found = found or _size_mistake(t, points, probe) or _centre_mistake(t, points)
        found = found or _deviation_mistake(t, points, probe) or _length_mistake(t, points, probe)
        if found:
            out.append(found)
    return out


def _off(test: SphereTest, position: np.ndarray) -> float:
    """RMS distance of the tool centre point from the sphere's centre in the points of an ideal machine, m."""
    away = bar_vector(test.chain, position, np.array(test.sphere))
    return float(np.sqrt((away**2).sum(axis=1).mean()))


def _position_mistake(
    test: SphereTest, q: np.ndarray, near: float, what: str, more: Sequence[Reading] = ()
) -> Mistake | None:
    """Axes that are not where the sphere is.

    Args:
        test: The test.
        q: Where the axes are, (n, axes) m and rad.
        near: How far off they may be, RMS m.
        what: The beginning of a sentence that the distance goes on.
        more: Other readings of the file, beside those that the positions have.
    """
    off = _off(test, q)
    if off < near:
        return None
    said = f"{test.name}: {what} {off / MM:.3g} mm (RMS) from the sphere"
    # a mistake in the file comes before numbers that are fitted, which have to fit well
    groups = ((_other_positions(test, q), max(near, _SHARE * off)), (_other_numbers(test, q), near), (more, near))
    for readings, enough in groups:
        found = [(_off(changed, p), words) for words, changed, p in readings]
        left, sentence = min(found, default=(off, ""))
        if left < enough:
            return Mistake("positions", (test.name,), f"{said}; {left / MM:.2g} mm are left if {sentence}")
    length = " or tool_length_mm" if test.chain.swivelling else ""
    return Mistake("positions", (test.name,), f"{said}; correct sphere_mm{length}, or the columns of the axes")


def _centre_mistake(test: SphereTest, points: Points) -> Mistake | None:
    """Measured centres that are not where the sphere is: what is wrong with their columns, or with the angles."""
    if test.chain.carried:  # deviations are no differences of axis positions
        return None
    found, smaller = points.position.copy(), points.position.copy()
    found[:, test.chain.linear_columns] += points.deviation
    smaller[:, test.chain.linear_columns] += 1e-3 * points.deviation
    unit = "the deviations are in nm; write them in µm", test, smaller
    return _position_mistake(test, found, _FAR, "the measured centres are", [unit])


def _other_positions(test: SphereTest, q: np.ndarray) -> Iterator[Reading]:
    """Other readings of the columns of axes."""
    chain = test.chain
    letters = chain.letters
    rotary = range(chain.count)[chain.rotary_columns]
    for axes in (*((i,) for i in range(chain.count)), *itertools.combinations(rotary, 2)):
        turned = q.copy()
        turned[:, axes] = -turned[:, axes]
        mine = [letters[i] for i in axes]
        words = f"the sign of {' and '.join(mine)} is turned; turn it in the file"
        if all(map(chain.is_rotary, mine)):
            senses = (f'sense = "{SENSES[chain.sense(a) == SENSES[0]]}" for [axis.{a}]' for a in mine)
            words += f", or write {' and '.join(senses)} in the machine file"
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


def _other_numbers(test: SphereTest, q: np.ndarray) -> Iterator[Reading]:
    """The sphere somewhere else on the table, positions without the tool's length, and another length."""
    chain = test.chain
    away = bar_vector(chain, q, np.array(test.sphere))
    x = np.linalg.lstsq(sphere_columns(test, q).reshape(-1, 3), away.ravel(), rcond=None)[0]
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
    if chain.swivelling:
        longer = _with_tool(chain, chain.tool_length + 0.05)
        change = (bar_vector(longer, q, np.array(test.sphere)) - away) / 0.05
        length = chain.tool_length - float((away * change).sum() / max(float((change**2).sum()), 1e-12))
        if length > 0.0:
            other = replace(test, chain=_with_tool(chain, length))
            yield f"the tool is {length / MM:.1f} mm long; correct tool_length_mm", other, q


def _with_tool(chain: Chain, length: float) -> Chain:
    return chain_of(chain.configuration, chain.placements, length, chain.singular)


def _size_mistake(test: SphereTest, points: Points, probe: Probe) -> Mistake | None:
    """Deviations in another unit."""
    largest, spread = float(np.abs(points.deviation).max()), float(np.abs(np.diff(points.deviation, axis=0)).max())
    said = f"{test.name}: the deviations are up to {largest / UM:.3g} µm"
    if spread < probe.noise:
        sentence = f"{said}, and change by less than one probed centre repeats; write them in µm, not in mm"
        return Mistake("unit", (test.name,), sentence)
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


def _length_mistake(test: SphereTest, points: Points, probe: Probe) -> Mistake | None:
    """A probe of another length, or a tip or sphere of another radius: all centres are off along the tool."""
    columns = np.column_stack(
        [sphere_columns(test, points.position).reshape(-1, 3), probe_columns(test, points)[:, :, 2].ravel()]
    )
    x, _, rank, _ = np.linalg.lstsq(columns, points.deviation.ravel(), rcond=1e-6)
    if rank < columns.shape[1] or abs(x[-1]) < _LONG * probe.offset:
        return None
    way = "spindle" if x[-1] < 0.0 else "table"
    return Mistake(
        "length",
        (test.name,),
        f"{test.name}: all centres are {abs(x[-1]) / MM:.2g} mm too far towards the {way}, as with a wrong "
        "length of the probe or radius of tip or sphere (correct it in the control, or take it off the deviations), or "
        "with a table that lies so much higher or lower than the machine file says",
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
