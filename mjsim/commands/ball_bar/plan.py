"""The next ball-bar test: it separates best what the data cannot tell apart, or makes a hidden effect show."""

from __future__ import annotations

from mjsim.campaign.model import Campaign
from mjsim.commands.calibrate import fit_within_tolerance
from mjsim.commands.edit import fit_effect
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.findings import explain
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.noise import usual_noise
from mjsim.inference.planning.next_test import NOTHING, Plan, best_of, plan_for, typical
from mjsim.inference.planning.separation import Explanation
from mjsim.inference.samples import BLOCKS
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.inference.vibration import separate
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread


@one_blas_thread
def plan_bars(
    campaign: Campaign,
    machine: Machine,
    between: tuple[str, str] | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Plan | None:
    """The next test to run.

    Without ``between`` the campaign is diagnosed first: the first effect that has alternatives is separated from its
    first one; where nothing is ambiguous, the first effect that is not testable is made to show. ``None`` where there
    is neither.

    Args:
        between: two effect ids, or one and ``"nothing"``.
        settings: what decides.

    Raises:
        InputError: unknown effect; no traces and no ``between``.
    """
    campaign = campaign.in_motion
    ids = tuple(i for i in between or () if i != NOTHING)
    for i in ids:
        registry.effect_class(i, machine.chain)
    if between is not None and (len(between) != 2 or not ids or len(set(between)) != 2):
        raise InputError(
            f"plan between {' and '.join(between)}: allowed are two different effects, or one effect and {NOTHING!r}"
        )
    if between is not None and NOTHING in between:
        between = (ids[0], NOTHING)
    if not campaign.measured:
        if between is None:
            raise InputError(
                f"{campaign.folder / 'campaign.toml'}: {campaign.nothing_measured}; say which effects to separate "
                f"(--between A B)"
            )
        pair = _by_default(between[0], machine), _by_default(between[1], machine)
        return best_of(between, pair, campaign, usual_noise(), BLOCKS[0], threads, progress, settings.plan)
    progress("preparing", 0, 1)
    problem = checked_problem(campaign, build(machine), threads, settings=settings, machine=machine)
    separated = separate(problem, machine)
    if between is None:
        explained = explain(separated, progress)
        return plan_for(explained.data, explained.selection, threads, progress)
    problem, fitter = separated.problem, Fitter(separated.problem, separated.machine)
    if NOTHING in between:
        here = Explanation.of_fit(NOTHING, fit_within_tolerance(fitter, without=ids[0]))
        pair = here.with_effect(ids[0], typical(ids[0], machine.chain)), here
    else:
        fits = (fit_effect(fitter, *registry.effect_class(i, machine.chain)).fit for i in between)
        first, second = (Explanation.of_fit(i, fit) for i, fit in zip(between, fits, strict=True))
        pair = first, second
    block = problem.samples[0].block
    return best_of(between, pair, campaign, problem.noise, block, threads, progress, problem.settings.plan)


def _by_default(effect_id: str, machine: Machine) -> Explanation:
    """An effect at its typical size on an unmeasured machine; nothing at all for :data:`NOTHING`."""
    if effect_id == NOTHING:
        return Explanation.of_priors(NOTHING, machine, [])
    return Explanation.of_priors(effect_id, machine, [typical(effect_id, machine.chain)])
