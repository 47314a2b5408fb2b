"""From a fitted model to what is said about one direction: components with intervals, curves, spectrum."""

from __future__ import annotations

import numpy as np

from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.nuisance import TRIGGER, TRIGGERS
from mjsim.inference.pitch.alternating import alternate
from mjsim.inference.pitch.curve import acting, curve
from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.pitch.parts import Component, LocalFault
from mjsim.inference.pitch.result import DirectionIdentification
from mjsim.inference.pitch.search import GearSearch
from mjsim.inference.pitch.spectrum import spectrum
from mjsim.inference.problem import Problem
from mjsim.inference.search import Model, number_to_tell
from mjsim.units import DEG, MM

#: A wave of a fitted pitch error: order, amplitude, which of the components, and the pitch error.
Wave = tuple[float, float, int, EffectVector]


def identified_direction(
    search: GearSearch, model: Model[Problem], direction: TurnDirection
) -> DirectionIdentification:
    """Everything about one axis turning in one direction."""
    p, fit = model.problem, model.fit
    first = direction.tests[0]
    line = curve(p, fit, direction, first)
    found = _components(search, model, direction)
    lines = spectrum(p, fit, direction, line)
    faults = tuple(
        LocalFault(v["centre_deg"], v["width_deg"], -v["depth_deg"])
        for v in (f.effect.values for f in acting(fit, "worm_wear", direction))
    )
    triggers = {p.tests[k].name: fit.parameters.place(TRIGGERS, p.tests[k].recording) for k in direction.tests}
    return DirectionIdentification(
        direction.axis,
        direction.direction,
        tuple(p.tests[k].name for k in direction.tests),
        direction.arc / DEG,
        direction.resolution,
        round(direction.teeth),
        line.position / DEG,
        line.raw / DEG,
        line.modified / DEG,
        line.identified / DEG,
        line.at_reversal,
        lines.orders,
        lines.amplitude,
        lines.floor,
        lines.limit,
        found,
        tuple(alternate(line, [c.order for c in found])),
        faults,
        {name: 1.96e3 * TRIGGER * float(np.sqrt(fit.covariance[at, at])) for name, at in triggers.items()},
        p.tests[first].feed * 60 / MM,
        float(np.ptp(p.samples[first].centre)),
        direction.axis not in p.chain.round_axes,
    )


def _components(search: GearSearch, model: Model[Problem], direction: TurnDirection) -> tuple[Component, ...]:
    """The waves with their intervals; waves closer than the resolution are one component that cannot be taken apart."""
    waves = sorted(
        (row[0], row[1], i, f)
        for f in acting(model.fit, "pitch_error", direction)
        for i, row in enumerate(f.effect.values["components"])
        if row[0] >= direction.teeth
    )
    groups: list[list[Wave]] = []
    for one in waves:
        if groups and one[0] - groups[-1][-1][0] < 1.2 * direction.resolution:
            groups[-1].append(one)
        else:
            groups.append([one])
    return tuple(_component(search, model, direction, group) for group in groups)


def _component(search: GearSearch, model: Model[Problem], direction: TurnDirection, group: list[Wave]) -> Component:
    """The largest wave of a group, with its intervals: a trigger turns its phase, so they are those along it and across
    it.
    """
    fit = model.fit
    order, _, i, f = max(group, key=lambda one: one[1])
    _, size, phase = f.effect.values["components"][i]
    at = fit.parameters.places(f.block.name)[2 * i : 2 * i + 2]
    triggers = fit.parameters.places(TRIGGERS)
    full, across = fit.covariance[np.ix_(at, at)], fit.covariance[np.ix_(at, triggers)]
    fixed = full - across @ np.linalg.solve(fit.covariance[np.ix_(triggers, triggers)], across.T)
    scale = f.specs["components"].scale
    along, turned = 1.96 * _spread(phase, full) * scale
    _, known = 1.96 * _spread(phase, fixed) * scale
    half = float(np.degrees(turned / size))
    orders = search.orders_in_place_of(model, f.effect, order)
    likely = sorted(orders, key=lambda n: -orders[n])
    likely = likely[: number_to_tell(np.array([orders[n] for n in likely]))]
    ci = {"amplitude_deg": (max(0.0, size - along), size + along), "phase_deg": (phase - half, phase + half)}
    if len(likely) > 1:
        ci["order"] = (min(likely), max(likely))
    return Component(
        order,
        size,
        phase,
        ci,
        len(likely) == 1,
        float(np.degrees(known / size)),
        order % round(direction.teeth) == 0.0,
        tuple(n for n, *_ in group if n != order),
    )


def _spread(phase: float, covariance: np.ndarray) -> np.ndarray:
    """Standard deviations along a wave of this phase (deg) and across it."""
    c, s = np.cos(phase * DEG), np.sin(phase * DEG)
    ways = np.array([[c, s], [-s, c]])
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", ways, covariance, ways), 0.0))
