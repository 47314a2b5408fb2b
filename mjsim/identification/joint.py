"""Joint least squares: the components of both axes and both directions together with set-up, triggers and data sheet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from mjsim.identification.components import Way, chosen, threshold
from mjsim.identification.model import PitchModel, State
from mjsim.identification.noise import residual_noise
from mjsim.identification.terms import Fault, Wave
from mjsim.inference.calibration import SHEET

#: Rounds of choosing and fitting at most.
_ROUNDS = 6
#: A test that the model explains no better than this (mean square of its whitened residuals) counts less.
_EXPLAINED = 1.3
#: A whole order is taken for the order where it lies within so many standard deviations, and these are below the second number.
_SIGMAS, _SHARP = 3.5, 0.12
#: Chance of calling different what is the same in both directions.
_DIFFERENT = 0.01


def searched(model: PitchModel, state: State, ways: list[Way], rounds: int = _ROUNDS) -> State:
    """Terms are added while the residual asks for them, everything refitted after each round; then what has become needless goes."""
    for _ in range(rounds):
        new = [t for w in ways for t in chosen(model, state, w)]
        if not new:
            break
        new = [replace(t, free_order=True) if isinstance(t, Wave) and t.test is None else t for t in new]
        state = model.fit(replace(state, terms=state.terms + tuple(new)), 5)
    return pruned(model, state)


def pruned(model: PitchModel, state: State) -> State:
    """Without the terms whose own evidence does not pass the threshold that let them in."""
    limit = threshold(1000)
    while state.terms:
        worth = [_evidence(t, state.covariance[b, b]) for t, b in zip(state.terms, state.blocks, strict=True)]
        i = int(np.argmin(worth))
        if worth[i] > limit:
            return state
        rest = tuple(t for j, t in enumerate(state.terms) if j != i)
        state = model.fit(replace(state, terms=rest), 4)
    return state


def _evidence(t: Wave | Fault, covariance: np.ndarray) -> float:
    """Squared distance of a term's size from zero, in standard deviations."""
    v = np.array([t.c, t.s]) if isinstance(t, Wave) else np.array([t.height])
    return float(v @ np.linalg.solve(covariance[: len(v), : len(v)], v))


def refined_noise(model: PitchModel, state: State) -> None:
    """Where no test repeats, the noise is taken from the floor of what is left."""
    if any(s.test.repeats for s in model.problem.samples):
        return
    try:
        model.problem.noise = residual_noise(model, state)
    except ValueError:
        return


def joined(model: PitchModel, state: State, ways: list[Way]) -> State:
    """The chosen terms fitted to all tests of the campaign; tests that the model does not explain count less.

    Ordinary tests tie the triggers and the data sheet. A machine that lacks another effect fails in some of them: their residuals
    then weigh as much as such a failure deserves.
    """
    rotary = set(model.use)
    others = [k for k in range(len(model.problem.tests)) if k not in rotary]
    if others:
        model.use = sorted(rotary | set(others))
        state = model.fit(state, 6)
        for _ in range(3):
            if not _weigh(model, state):
                break
            state = model.fit(state, 5)
    model.recentred(state)
    state = model.fit(state, 4)
    state = searched(model, state, ways, 2)
    return snapped(model, state, ways)


def _weigh(model: PitchModel, state: State) -> bool:
    """Weights by how well each test is explained; whether any changed."""
    misfit = model.misfit(state)
    weight = np.where(misfit > _EXPLAINED, 1.0 / np.maximum(misfit, 1.0) ** 1.5, 1.0)
    changed = bool(np.any(np.abs(np.log(weight / model.weight)) > 0.3))
    model.weight = weight
    return changed


def snapped(model: PitchModel, state: State, ways: list[Way]) -> State:
    """Orders that can be told to be whole numbers are held there; the others stay free."""
    centre = {(w.axis, w.way): np.mean([model.position[k][w.axis].mean() for k in w.tests]) for w in ways}
    terms = []
    for t, b in zip(state.terms, state.blocks, strict=True):
        if isinstance(t, Wave) and t.free_order:
            sd, whole = float(np.sqrt(state.covariance[b, b][2, 2])), round(t.order)
            if sd < _SHARP and abs(t.order - whole) < max(_SIGMAS * sd, 0.02):
                phase = np.arctan2(t.s, t.c) + (t.order - whole) * centre[t.axis, t.way]
                size = np.hypot(t.c, t.s)
                t = replace(t, order=float(whole), c=float(size * np.cos(phase)), s=float(size * np.sin(phase)), free_order=False)
        terms.append(t)
    return model.fit(replace(state, terms=tuple(terms)), 5)


def shared(model: PitchModel, state: State, axis: str) -> State | None:
    """The state with one set of waves for both directions of an axis, or ``None`` where the directions differ."""
    mine = [t for t in state.terms if isinstance(t, Wave) and t.axis == axis and t.test is None]
    if not mine or any(t.free_order for t in mine):
        return None
    sets = {way: {t.order: t for t in mine if t.way == way} for way in ("CW", "CCW")}
    # the cheap test first: what only one direction has, or has much larger, is no common component
    for n in {t.order for t in mine}:
        sizes = [np.hypot(s[n].c, s[n].s) if n in s else 0.0 for s in sets.values()]
        if min(sizes) < 0.5 * max(sizes):
            return None
    rest = tuple(t for t in state.terms if t not in mine)
    both = [
        Wave(axis, "", n, *(0.5 * (sets["CW"][n].c + sets["CCW"][n].c), 0.5 * (sets["CW"][n].s + sets["CCW"][n].s)))
        for n in sorted(sets["CW"])
    ]
    # phases of the two directions may stand apart by the trigger: the fit finds the triggers that bring them together
    trial = model.fit(replace(state, terms=rest + tuple(both)), 12)
    separate = state.objective
    return trial if trial.objective - separate < chi2.ppf(1.0 - _DIFFERENT, 2 * len(both)) else None


def trigger_places(model: PitchModel) -> np.ndarray:
    """Places of the triggers in the parameter vector."""
    layout = model.problem.layout
    return np.arange(layout.length + 1, layout.size)


def start_tau() -> np.ndarray:
    """The data sheet as printed."""
    return np.zeros(len(SHEET))
