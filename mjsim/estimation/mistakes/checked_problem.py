"""The campaign as an estimation problem, after a look for mistakes: the way in for every command that believes the traces."""

from __future__ import annotations

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.estimation.mistakes.mistakes import Mistake
from mjsim.estimation.mistakes.recognise import find_mistakes
from mjsim.estimation.problem import Problem
from mjsim.machine.model import Machine, build
from mjsim.threads import one_blas_thread


@one_blas_thread
def checked_problem(
    campaign: Campaign, machine: Machine, threads: int = 2, block: float | None = None, keep_motions: bool = True
) -> Problem:
    """A :class:`~mjsim.estimation.problem.Problem` whose traces were looked at; a campaign that is to be taken ``as_is`` is not.

    Raises:
        InputError: the data say that a sign, a unit, a direction or the order of traces is wrong.
    """
    problem = Problem(campaign, machine, threads, block, outliers=False, keep_motions=keep_motions)
    if not campaign.as_is:
        refuse(campaign, find_mistakes(problem, machine).mistakes)
    problem.leave_out_outliers(build(machine))
    return problem


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
        if any(m.either for m in mistakes)
        else f"`mjsim check {campaign.folder} --fix NEW-FOLDER` writes a corrected copy"
    )
    raise InputError(f"{campaign.folder / 'campaign.toml'}: {said}{more}; {remedy}, --as-is takes the files as they are")
