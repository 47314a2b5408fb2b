"""Joint least squares: the components of both axes and both directions together with set-up, triggers and data
sheet.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from mjsim.inference.nuisance import TRIGGERS
from mjsim.inference.pitch.components import chosen, threshold
from mjsim.inference.pitch.curve import at_reversals, terms_of
from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.pitch.model import PitchModel, State
from mjsim.inference.pitch.noise import residual_noise
from mjsim.inference.pitch.terms import Fault, Term, Wave
from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.instruments.ball_bar.kinds import kind_of


def searched(model: PitchModel, state: State, directions: list[TurnDirection], rounds: int | None = None) -> State:
    """Terms are added while the residual asks for them, everything refitted after each round; then what has become
    needless goes. Without ``rounds`` there are as many as the settings allow.
    """
    for _ in range(rounds or model.settings.rounds):
        new = [t for w in directions for t in chosen(model, state, w)]
        if not new:
            break
        new = [replace(t, free_order=True) if isinstance(t, Wave) and t.test is None else t for t in new]
        state = model.fit(replace(state, terms=state.terms + tuple(new)), 5)
    return pruned(model, state)


def pruned(model: PitchModel, state: State) -> State:
    """Without the terms that the data do not ask for: each must be worth the threshold that let it in, everything
    else refitted.
    """
    limit = threshold(1000, model.settings.false_alarm)
    needed: set[int] = set()  # counted from the end, which dropping an earlier one leaves as it is
    while True:
        count = len(state.terms)
        worth = {
            i: _evidence(t, state.covariance[b, b])
            for i, (t, b) in enumerate(zip(state.terms, state.blocks, strict=True))
            if count - i not in needed
        }
        i = min(worth, key=lambda j: worth[j], default=None)
        if i is None or worth[i] > limit:
            return state
        trial = model.fit(replace(state, terms=state.terms[:i] + state.terms[i + 1 :]), 4)
        if trial.objective - state.objective < limit:
            state, needed = trial, {n for n in needed if n <= count - i - 1} | {n - 1 for n in needed if n > count - i}
        else:
            needed.add(count - i)


def _evidence(t: Wave | Fault, covariance: np.ndarray) -> float:
    """Squared distance of a term's size from zero, in standard deviations."""
    v = np.array([t.c, t.s]) if isinstance(t, Wave) else np.array([t.height])
    return float(v @ np.linalg.solve(covariance[: len(v), : len(v)], v))


def refined_noise(model: PitchModel, state: State) -> None:
    """Where no test repeats, the noise is taken from the floor of what is left."""
    if any(kind_of(s.test).repeats(s.test) for s in model.problem.samples):
        return
    try:
        model.problem = replace(model.problem, noises=dict.fromkeys(model.problem.noises, residual_noise(model, state)))
    except ValueError:
        return


def joined(model: PitchModel, state: State, directions: list[TurnDirection]) -> State:
    """The chosen terms fitted to all tests of the campaign that the machine explains.

    Ordinary tests tie the triggers and the data sheet. A machine that lacks another effect fails in some of them; such
    a failure bends the triggers, so those tests are left out, the worst first.
    """
    rotary = set(model.use)
    state = _freeze(model, state, directions)
    model.use = list(range(len(model.problem.tests)))
    state = model.fit(state, 6)
    while True:
        misfit = model.misfit(state)
        others = [k for k in model.use if k not in rotary and misfit[k] > model.settings.explained]
        if not others:
            break
        worst = max(misfit[k] for k in others)
        model.use = [k for k in model.use if k not in others or misfit[k] < 0.3 * worst]
        state = model.fit(state, 6)
    model.recentred(state)
    state = model.fit(state, 4)
    state = searched(model, state, directions, 2)
    return snapped(model, state, directions)


def _freeze(model: PitchModel, state: State, directions: list[TurnDirection]) -> State:
    """Tests in which the machine does not explain its reversals, or much that is slow, bear no witness of their
    trigger.

    Their glitches and slow parts are described by terms, which would move with any trigger: only the prior and the
    other tests know it. It goes back to where the prior has it, and the phases with it.
    """
    nuisances = model.problem.nuisances
    for w in directions:
        turned = False
        for k in w.tests:
            name = model.problem.tests[k].name
            slow = sum(isinstance(t, Wave) and t.test == name for t in state.terms)
            if slow < model.settings.slow_waves and not any(
                isinstance(t, Fault) and at_turn(model, w, t) for t in terms_of(state, w)
            ):
                continue
            shift = model.problem.shift(k, state.nuisance)
            model.frozen[k] = shift
            nuisance = state.nuisance.copy()
            nuisance[nuisances.place(TRIGGERS, name)] = 0.0
            state = replace(state, nuisance=nuisance)
            if not turned:
                speed = np.median(np.gradient(model.position[k][w.axis], GRID))
                moved = tuple(
                    _moved_along(t, float(speed) * shift) if t in terms_of(state, w) else t for t in state.terms
                )
                state, turned = replace(state, terms=moved), True
    return state


def _moved_along(t: Term, distance: float) -> Term:
    """The term as it is where positions are larger by ``distance`` rad."""
    if isinstance(t, Fault):
        return replace(t, centre=t.centre + distance)
    phase, size = np.arctan2(t.s, t.c) - t.order * distance, np.hypot(t.c, t.s)
    return replace(t, c=float(size * np.cos(phase)), s=float(size * np.sin(phase)))


def at_turn(model: PitchModel, direction: TurnDirection, fault: Fault) -> bool:
    """Whether a local fault stands where a linear axis turns back in some test of its direction: a glitch that the
    machine lacks.
    """
    for k in direction.tests:
        time = model.problem.motions[k].time[::GRID_STEPS]
        near = (
            np.abs((model.position[k][direction.axis] - fault.centre + np.pi) % (2 * np.pi) - np.pi) < 0.5 * fault.width
        )
        if near.any() and at_reversals(model, k, time[near]).any():
            return True
    return False


def snapped(model: PitchModel, state: State, directions: list[TurnDirection]) -> State:
    """Orders that can be told to be whole numbers are held there; the others stay free."""
    centre = {(w.axis, w.direction): np.mean([model.position[k][w.axis].mean() for k in w.tests]) for w in directions}
    terms = []
    for t, b in zip(state.terms, state.blocks, strict=True):
        if isinstance(t, Wave) and t.free_order:
            sd, whole = float(np.sqrt(state.covariance[b, b][2, 2])), round(t.order)
            if sd < model.settings.whole_order_sharp and abs(t.order - whole) < max(
                model.settings.whole_order_sd * sd, 0.02
            ):
                phase = np.arctan2(t.s, t.c) + (t.order - whole) * centre[t.axis, t.direction]
                size = np.hypot(t.c, t.s)
                t = replace(
                    t,
                    order=float(whole),
                    c=float(size * np.cos(phase)),
                    s=float(size * np.sin(phase)),
                    free_order=False,
                )
        terms.append(t)
    return model.fit(replace(state, terms=tuple(terms)), 5)


def shared(model: PitchModel, state: State, axis: str) -> State | None:
    """The state with one set of waves for both directions of an axis, or ``None`` where the directions differ."""
    mine = [t for t in state.terms if isinstance(t, Wave) and t.axis == axis and t.test is None]
    if not mine or any(t.free_order for t in mine):
        return None
    sets = {direction: {t.order: t for t in mine if t.direction == direction} for direction in ("CW", "CCW")}
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
    return trial if trial.objective - separate < chdtri(2 * len(both), model.settings.directions_differ) else None
