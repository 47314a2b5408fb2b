"""Pitch errors of the rotary axes from tangential three-axis tests (paper, section 2.3)."""

from __future__ import annotations

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.pitch.curve import components_of
from mjsim.inference.pitch.directions import TurnDirection, tangential, turn_directions
from mjsim.inference.pitch.noise import residual_noise
from mjsim.inference.pitch.result import PitchIdentification
from mjsim.inference.pitch.search import GearSearch
from mjsim.inference.pitch.summary import identified_direction
from mjsim.inference.problem import Problem
from mjsim.inference.search import Model
from mjsim.inference.spectrum import HIGHEST_ROTARY
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, UM

#: Teeth that the arc must cover, so that the tooth order stands apart from what lies below it (assumed).
_TEETH = 4
#: Lengths of averaging blocks, s; waves of the highest order that pass in a block at most.
_BLOCKS, _BAND = (0.010, 0.020, 0.040), 0.45


def identify_pitch_error(
    campaign: Campaign, machine: Machine, axis: str, progress: Progress = silent, threads: int = 2
) -> PitchIdentification:
    """Pitch errors of one rotary axis; :func:`identify_pitch_errors` does both in one go.

    Raises:
        InputError: the campaign has no measured tangential test of the axis, or its arc is too short.
    """
    return identify_pitch_errors(campaign, machine, (axis,), threads=threads, progress=progress)[axis]


@one_blas_thread
def identify_pitch_errors(
    campaign: Campaign,
    machine: Machine,
    axes: tuple[str, ...] | None = None,
    per_direction: bool = False,
    threads: int = 2,
    progress: Progress = silent,
) -> dict[str, PitchIdentification]:
    """Pitch errors of rotary axes: components per direction, against the noise floor, with 95 % intervals.

    The components are found in the tangential tests. Where the model explains all tests of the campaign, these tie
    set-up, triggers and data sheet. The machine's own pitch errors of these axes are left out and found anew.

    Args:
        campaign: with measured tangential tests.
        machine: as given.
        axes: letters of rotary axes; otherwise all of the machine.
        per_direction: keep CW and CCW apart even where they agree.
        threads: tests that are worked on side by side.
        progress: called as work gets on.

    Raises:
        InputError: the campaign has no measured tangential test of an axis, or its arc is too short.
    """
    rotary = machine.chain.rotary
    axes = rotary if axes is None else axes
    for axis in axes:
        _check(campaign, machine, axis)
    tested = tuple(a for a in rotary if a in axes or _testable(campaign, machine, a))
    bare = machine
    for axis in tested:
        bare = bare.without(f"pitch_error.{axis}")
    progress("reading the tests", 0, 1)
    problem = checked_problem(campaign, bare, threads, block=_block(campaign, tested))
    search, model = _searched(problem, bare, tested, progress)
    directions = [w for a in tested for w in turn_directions(model.problem, a, bare.drives[a].gear)]
    common = dict.fromkeys(tested, False)
    for axis in () if per_direction else tested:
        mine = [w for w in directions if w.axis == axis]
        if len(mine) == 2 and all(components_of(model.fit, w) for w in mine):
            progress(f"comparing the directions of {axis}", 0, 1)
            one = search.with_common_waves(model, axis)
            if one.evidence > model.evidence:
                model, common[axis] = one, True
    progress("drawing up the result", 0, 1)
    return {a: _result(search, model, problem, [w for w in directions if w.axis == a], common[a]) for a in axes}


def _searched(
    problem: Problem, machine: Machine, axes: tuple[str, ...], progress: Progress
) -> tuple[GearSearch, Model[Problem]]:
    """The best model of the tangential tests; of all tests where it explains those as well. Then the other tests tie
    the triggers. Where they show what is in no model, that would bend the triggers, and the phases with them.
    """

    def search_on(data: Problem) -> GearSearch:
        directions = [w for a in axes for w in turn_directions(data, a, machine.drives[a].gear)]
        return GearSearch(Fitter(data, machine), directions, progress)

    own = [k for k, t in enumerate(problem.tests) if any(tangential(t, a) for a in axes)]
    search = search_on(problem.only(own))
    model = search.best_from()
    if not any(kind_of(t).repeats(t) for t in problem.tests):
        noise = residual_noise(search.plain, model.fit)
        if noise is not None:
            search = search_on(search.plain.with_noises(dict.fromkeys(problem.noises, noise)))
            model = search.best_from(model.fit.effects)
    if len(own) < len(problem.tests):
        of_all = search_on(problem)
        best = of_all.best_from(model.fit.effects)
        if best.leaves_nothing:
            return of_all, best
    return search, model


def identified_machine(machine: Machine, results: dict[str, PitchIdentification]) -> Machine:
    """``machine`` with the pitch errors that were found in place of those it had."""
    for axis, result in results.items():
        keys = {e.key for e in result.effects}
        for e in machine.effects:
            if e.id == f"pitch_error.{axis}" and e.key not in keys:
                machine = machine.without(e.key)
        for e in result.effects:
            machine = machine.with_effect(e)
    return machine


def testable_axes(campaign: Campaign) -> tuple[str, ...]:
    """The rotary axes that have a measured tangential test.

    Raises:
        InputError: none has.
    """
    campaign = campaign.of(BallBarTest.instrument)
    rotary = campaign.tests[0].chain.rotary
    axes = tuple(a for a in rotary if tangential_tests(campaign, a))
    if not axes:
        first, *others = reversed(rotary or ("a rotary axis",))
        or_other = "".join(f' (or "{a}")' for a in others)
        raise InputError(
            f"{campaign.folder / 'campaign.toml'}: no measured tangential test of {' or '.join([*others, first])}; "
            f'needed: a [[test]] with kind = "rotary", axis = "{first}"{or_other}, sensitive_direction = "tangential" '
            "and a trace, best in both directions"
        )
    return axes


def _block(campaign: Campaign, axes: tuple[str, ...]) -> float:
    """The longest block that still shows the highest order in the fastest tangential test, s."""
    fastest = max(t.feed / kind_of(t).radius(t) / (2 * np.pi) for a in axes for t in tangential_tests(campaign, a))
    return max((b for b in _BLOCKS if b * fastest * HIGHEST_ROTARY < _BAND), default=_BLOCKS[0])


def tangential_tests(campaign: Campaign, axis: str) -> list:
    """The measured tangential tests of one rotary axis."""
    return [t for t in campaign.of(BallBarTest.instrument).measured if tangential(t, axis)]


def _arc(test) -> float:
    return abs(test.stop - test.start) - 2 * kind_of(test).margin


def _needed(machine: Machine, axis: str) -> float:
    return _TEETH * 2 * np.pi / machine.drives[axis].gear


def _testable(campaign: Campaign, machine: Machine, axis: str) -> bool:
    tests = tangential_tests(campaign, axis)
    return bool(tests) and min(_arc(t) for t in tests) >= _needed(machine, axis)


def _check(campaign: Campaign, machine: Machine, axis: str) -> None:
    tests = tangential_tests(campaign, axis)
    file = campaign.folder / "campaign.toml"
    if not tests:
        raise InputError(
            f'{file}: no measured tangential test of axis {axis}; needed: a [[test]] with kind = "rotary", axis = '
            f'"{axis}", '
            f'sensitive_direction = "tangential" and a trace, best in both directions'
        )
    needed, teeth = _needed(machine, axis), machine.drives[axis].gear
    for t in tests:
        if _arc(t) < needed:
            raise InputError(
                f"{file}: test {t.name!r} measures {_arc(t) / DEG:.1f}° of {axis}; to tell the tooth order "
                f"{teeth:g} from what lies below "
                f"it, from_deg and to_deg must be {(needed + 2 * kind_of(t).margin) / DEG:.1f}° apart or more"
            )


def _result(
    search: GearSearch,
    model: Model[Problem],
    every: Problem,
    directions: list[TurnDirection],
    common: bool,
) -> PitchIdentification:
    axis, problem = directions[0].axis, model.problem
    found = {w.direction: identified_direction(search, model, w) for w in directions}
    notes = []
    if len(directions) == 1:
        notes.append(f"only {directions[0].direction} was measured; nothing is known about the other direction")
    for k in (k for w in directions for k in w.tests):
        s = problem.samples[k]
        if not s.valid.all():
            notes.append(
                f"{s.test.name}: {int((~s.valid).sum())} of {len(s.valid)} samples left out as missing or disturbed"
            )
    used = {t.name for t in problem.tests}
    left_out = [t.name for t in every.tests if t.name not in used]
    if left_out:
        notes.append(
            f"not used, since the machine file does not explain them (mjsim diagnose says what it lacks): "
            f"{', '.join(left_out)}; "
            f"the phases would be more certain with them"
        )
    if not model.leaves_nothing:
        notes.append(
            f"the machine file does not explain {model.left / UM:.2g} µm RMS of these tests (mjsim diagnose says what "
            "it lacks)"
        )
    noise = problem.noise
    effects = _effects(problem.chain, axis, model, directions, common)
    return PitchIdentification(axis, found, common, effects, noise.rms / UM, noise.source, tuple(notes))


def _effects(
    chain: Chain, axis: str, model: Model[Problem], directions: list[TurnDirection], common: bool
) -> tuple[Effect, ...]:
    cls, subject = registry.effect_class(f"pitch_error.{axis}", chain)
    out = []
    for w in directions[:1] if common else directions:
        rows = components_of(model.fit, w)
        if rows:
            out.append(cls(subject, components=rows, **({} if common else {"direction": w.direction})))
    return tuple(out)
