"""Pitch errors of the rotary axes from tangential three-axis tests (paper, section 2.3)."""

from __future__ import annotations

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.pitch import joint
from mjsim.inference.pitch.curve import components_of
from mjsim.inference.pitch.directions import BAND, HIGHEST, TurnDirection, tangential, turn_directions
from mjsim.inference.pitch.model import PitchModel, State
from mjsim.inference.pitch.result import PitchIdentification
from mjsim.inference.pitch.settings import PITCH, PitchSettings
from mjsim.inference.pitch.summary import identified_direction
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, UM

#: Lengths of averaging blocks, s: short where the highest order passes fast.
_BLOCKS = (0.010, 0.020, 0.040)


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
    settings: PitchSettings = PITCH,
) -> dict[str, PitchIdentification]:
    """Pitch errors of rotary axes: components per direction, against the noise floor, with 95 % intervals.

    All tests of the campaign help to tie set-up, triggers and data sheet; the components are chosen on the tangential
    tests. The machine's own pitch errors of these axes are left out and found anew.

    Args:
        campaign: with measured tangential tests.
        machine: as given.
        axes: letters of rotary axes; otherwise all of the machine.
        per_direction: keep CW and CCW apart even where they agree.
        threads: tests that are worked on side by side.
        progress: called as work gets on.
        settings: what decides.

    Raises:
        InputError: the campaign has no measured tangential test of an axis, or its arc is too short.
    """
    rotary = machine.chain.rotary
    axes = rotary if axes is None else axes
    for axis in axes:
        _check(campaign, machine, axis, settings)
    tested = tuple(a for a in rotary if a in axes or _testable(campaign, machine, a, settings))
    bare = machine
    for axis in tested:
        bare = bare.without(f"pitch_error.{axis}")
    progress("reading the tests", 0, 5)
    problem = checked_problem(campaign, bare, threads, block=_block(campaign, tested))
    model = PitchModel(problem, bare, settings)
    directions = [w for a in tested for w in turn_directions(problem, a, machine.drives[a].gear)]
    model.use = sorted(k for w in directions for k in w.tests)
    progress("choosing components", 1, 5)
    state = model.start(fit_nuisance(problem, model.readings))
    state = joint.searched(model, state, directions)
    if not any(kind_of(s.test).repeats(s.test) for s in problem.samples):
        joint.refined_noise(model, state)
        state = joint.searched(model, model.fit(state, 4), directions)
    progress("fitting all tests", 2, 5)
    state = joint.joined(model, state, directions)
    progress("comparing the directions", 3, 5)
    common = dict.fromkeys(tested, False)
    for axis in tested:
        if not per_direction and len([w for w in directions if w.axis == axis]) == 2:
            one = joint.shared(model, state, axis)
            if one is not None:
                state, common[axis] = one, True
    progress("drawing up the result", 4, 5)
    return {a: _result(model, state, [w for w in directions if w.axis == a], a, common[a]) for a in axes}


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
    return max((b for b in _BLOCKS if b * fastest * HIGHEST < BAND), default=_BLOCKS[0])


def tangential_tests(campaign: Campaign, axis: str) -> list:
    """The measured tangential tests of one rotary axis."""
    return [t for t in campaign.of(BallBarTest.instrument).measured if tangential(t, axis)]


def _arc(test) -> float:
    return abs(test.stop - test.start) - 2 * kind_of(test).margin


def _needed(machine: Machine, axis: str, settings: PitchSettings) -> float:
    return settings.teeth * 2 * np.pi / machine.drives[axis].gear


def _testable(campaign: Campaign, machine: Machine, axis: str, settings: PitchSettings) -> bool:
    tests = tangential_tests(campaign, axis)
    return bool(tests) and min(_arc(t) for t in tests) >= _needed(machine, axis, settings)


def _check(campaign: Campaign, machine: Machine, axis: str, settings: PitchSettings) -> None:
    tests = tangential_tests(campaign, axis)
    file = campaign.folder / "campaign.toml"
    if not tests:
        raise InputError(
            f'{file}: no measured tangential test of axis {axis}; needed: a [[test]] with kind = "rotary", axis = '
            f'"{axis}", '
            f'sensitive_direction = "tangential" and a trace, best in both directions'
        )
    needed, teeth = _needed(machine, axis, settings), machine.drives[axis].gear
    for t in tests:
        if _arc(t) < needed:
            raise InputError(
                f"{file}: test {t.name!r} measures {_arc(t) / DEG:.1f}° of {axis}; to tell the tooth order "
                f"{teeth:g} from what lies below "
                f"it, from_deg and to_deg must be {(needed + 2 * kind_of(t).margin) / DEG:.1f}° apart or more"
            )


def _result(
    model: PitchModel, state: State, directions: list[TurnDirection], axis: str, common: bool
) -> PitchIdentification:
    found = {w.direction: identified_direction(model, state, w) for w in directions}
    effects = _effects(model.problem.chain, axis, state, directions, common)
    notes = []
    if len(directions) == 1:
        notes.append(f"only {directions[0].direction} was measured; nothing is known about the other direction")
    for k in (k for w in directions for k in w.tests):
        s = model.problem.samples[k]
        if not s.valid.all():
            notes.append(
                f"{s.test.name}: {int((~s.valid).sum())} of {len(s.valid)} samples left out as missing or disturbed"
            )
    left_out = [t.name for k, t in enumerate(model.problem.tests) if k not in model.use]
    if left_out:
        notes.append(
            f"not used, since the machine file does not explain them (mjsim diagnose says what it lacks): "
            f"{', '.join(left_out)}; "
            f"the phases would be more certain with them"
        )
    if any(k in model.frozen for w in directions for k in w.tests):
        notes.append(
            "the machine file does not explain the friction glitches or the slow part of these tests; they were "
            "taken out, but do not "
            "help to tie the start of the recording"
        )
    noise = model.problem.noise
    return PitchIdentification(axis, found, common, effects, noise.rms / UM, noise.source, tuple(notes))


def _effects(
    chain: Chain, axis: str, state: State, directions: list[TurnDirection], common: bool
) -> tuple[Effect, ...]:
    cls, subject = registry.effect_class(f"pitch_error.{axis}", chain)
    out = []
    for w in directions[:1] if common else directions:
        rows = [[t.order, t.amplitude_deg, t.phase_deg] for t in components_of(state, w)]
        if rows:
            out.append(cls(subject, components=rows, **({} if common else {"direction": w.direction})))
    return tuple(out)
