"""From a fitted state to what is said about one direction: components with intervals, curves, spectrum."""

from __future__ import annotations

import numpy as np

from mjsim.inference.nuisance import TRIGGER, TRIGGERS
from mjsim.inference.pitch import joint
from mjsim.inference.pitch.alternating import alternate
from mjsim.inference.pitch.curve import components_of, curve, terms_of
from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.pitch.model import PitchModel, State
from mjsim.inference.pitch.parts import Component, LocalFault
from mjsim.inference.pitch.result import DirectionIdentification
from mjsim.inference.pitch.spectrum import spectrum
from mjsim.inference.pitch.terms import UNIT, Fault, Wave
from mjsim.units import DEG, MM


def identified_direction(model: PitchModel, state: State, direction: TurnDirection) -> DirectionIdentification:
    """Everything about one axis turning in one direction."""
    p = model.problem
    line = curve(model, state, direction, direction.tests[0])
    found = _components(model, state, direction)
    lines = spectrum(model, state, direction, line)
    variance = np.diag(state.covariance)
    faults = tuple(
        LocalFault(t.centre / DEG, t.width / DEG, t.height * UNIT / DEG, joint.at_turn(model, direction, t))
        for t in terms_of(state, direction)
        if isinstance(t, Fault)
    )
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
        _trigger_half_widths(state, variance, [p.tests[k].name for k in direction.tests]),
        p.tests[direction.tests[0]].feed * 60 / MM,
        float(np.ptp(p.samples[direction.tests[0]].centre)),
        direction.axis not in p.chain.round_axes,
    )


def _trigger_half_widths(state: State, variance: np.ndarray, tests: list[str]) -> dict[str, float]:
    """Half of the 95 % interval of some tests' triggers, ms."""
    return {t: float(1.96e3 * TRIGGER * np.sqrt(variance[state.parameters.place(TRIGGERS, t)])) for t in tests}


def _components(model: PitchModel, state: State, direction: TurnDirection) -> tuple[Component, ...]:
    """The waves with their intervals; waves closer than the resolution are one component that cannot be taken apart."""
    waves = components_of(state, direction)
    groups: list[list[Wave]] = []
    for t in waves:
        if groups and t.order - groups[-1][-1].order < 1.2 * direction.resolution:
            groups[-1].append(t)
        else:
            groups.append([t])
    places = dict(zip(map(id, state.terms), state.blocks, strict=True))
    triggers = state.parameters.places(TRIGGERS)
    out = []
    for group in groups:
        main = max(group, key=lambda t: t.amplitude_deg)
        b = places[id(main)]
        full = state.covariance[b, b]
        across = state.covariance[b, triggers]
        fixed = full - across @ np.linalg.solve(state.covariance[np.ix_(triggers, triggers)], across.T)
        size, phase = 1.96 * _spread(main, full)
        _, known = 1.96 * _spread(main, fixed)
        ci = {
            "amplitude_deg": (max(0.0, main.amplitude_deg - size), main.amplitude_deg + size),
            "phase_deg": (main.phase_deg - phase, main.phase_deg + phase),
        }
        if main.free_order:
            half = 1.96 * float(np.sqrt(full[2, 2]))
            ci["order"] = (main.order - half, main.order + half)
        multiple = abs(
            main.order / direction.teeth - round(main.order / direction.teeth)
        ) * direction.teeth < 0.5 * min(1.0, direction.resolution)
        rest = tuple(t.order for t in group if t is not main)
        out.append(
            Component(
                main.order,
                main.amplitude_deg,
                main.phase_deg,
                ci,
                not main.free_order,
                float(known),
                bool(multiple),
                rest,
            )
        )
    return tuple(out)


def _spread(t: Wave, covariance: np.ndarray) -> np.ndarray:
    """Standard deviations of amplitude and phase, both in degrees."""
    v = np.array([t.c, t.s])
    a = float(np.hypot(*v))
    along, across = v / a, np.array([-v[1], v[0]]) / a
    c = covariance[:2, :2]
    return np.array(
        [np.sqrt(max(along @ c @ along, 0.0)) * UNIT / DEG, np.degrees(np.sqrt(max(across @ c @ across, 0.0)) / a)]
    )
