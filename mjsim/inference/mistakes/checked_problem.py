"""The campaign as an estimation problem, after a look for mistakes: the way in for every command that believes the
traces.
"""

from __future__ import annotations

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.inference.disturbances import without_disturbances
from mjsim.inference.mistakes.mistakes import Mistake
from mjsim.inference.mistakes.recognise import find_mistakes
from mjsim.inference.problem import Problem
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine, build
from mjsim.threads import one_blas_thread


@one_blas_thread
def checked_problem(
    campaign: Campaign,
    machine: Machine,
    threads: int = 2,
    block: float | None = None,
    keep_motions: bool = True,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Problem:
    """A problem whose traces were looked at, without disturbances. A campaign that is to be taken ``as_is`` is not
    looked at.

    Args:
        campaign: With at least one measured test.
        machine: As given.
        threads: Tests that are worked on side by side.
        block: Length of an averaging block, s; otherwise by the tests' feeds.
        keep_motions: Without it, a test's motions are kept for one model only: a fifth of the memory.
        settings: What decides in a diagnosis.

    Raises:
        InputError: The data say that a sign, a unit, a direction, the order of traces or the sense of an axis is wrong.
    """
    plant = build(machine)
    problem = Problem.of(campaign, plant, threads, block, keep_motions, settings)
    readings = problem.readings(plant)
    if not campaign.as_is:
        _refuse_own(problem.campaign)
        refuse(campaign, find_mistakes(problem, machine, readings).mistakes)
    return without_disturbances(problem, readings)


@one_blas_thread
def trusted_problem(
    campaign: Campaign, machine: Machine, threads: int = 2, settings: DiagnosisSettings = DIAGNOSIS
) -> Problem:
    """As :func:`checked_problem`, for a campaign that is not looked at again."""
    plant = build(machine)
    problem = Problem.of(campaign, plant, threads, settings=settings)
    return without_disturbances(problem, problem.readings(plant))


def _refuse_own(campaign: Campaign) -> None:
    """Raise an error where an instrument finds its recordings wrong by themselves.

    Raises:
        InputError: The first mistake.
    """
    for name, part in campaign.measured_parts.items():
        for m in INSTRUMENTS[name].mistakes(part.measured, part.traces, part.instrument):
            raise InputError(f"{campaign.folder / 'campaign.toml'}: {m.sentence}, or say --as-is")


def refuse(campaign: Campaign, mistakes: tuple[Mistake, ...]) -> None:
    """Raise an error that names the first mistakes and how to go on; nothing happens where there are none.

    Raises:
        InputError: there is one.
    """
    if not mistakes:
        return
    said = "; ".join(m.sentence for m in mistakes[:2])
    more = f"; and {len(mistakes) - 2} more" if len(mistakes) > 2 else ""
    remedy = (
        "which one, only you can tell"
        if any(not m.certain for m in mistakes)
        else f"`mjsim check {campaign.folder} --fix NEW-FOLDER` writes a corrected copy"
    )
    raise InputError(
        f"{campaign.folder / 'campaign.toml'}: {said}{more}; {remedy}, --as-is takes the files as they are"
    )
