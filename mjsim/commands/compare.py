"""Measured against simulated, whatever the instrument."""

from __future__ import annotations

from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign
from mjsim.commands.any_instrument import compare_plainly
from mjsim.commands.axis_log.compare import compare_logs
from mjsim.commands.ball_bar.compare import compare_bars
from mjsim.commands.comparison import Comparison
from mjsim.inference.problem import Problem
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent

#: Comparisons that fit more of a set-up than numbers on which the reading depends linearly.
_COMPARE = {LogTest.instrument: compare_logs}


def compare(
    campaign: Campaign, machine: Machine, threads: int = 2, progress: Progress = silent, problem: Problem | None = None
) -> Comparison:
    """Simulate every measured test and lay it over the measurement.

    What the set-ups and the instruments do to the readings is fitted with its priors; the machine is taken as it is.

    Args:
        campaign: With at least one measured test of any instrument.
        machine: As it is.
        threads: Simulations side by side.
        progress: Called as work gets on.
        problem: The ball-bar tests where they were prepared already.

    Raises:
        InputError: No test has a trace, or the traces show a mistake (:mod:`mjsim.inference.mistakes`).
    """
    campaign.need_traces("comparing needs at least one measured test")
    machine, parts = in_campaign(machine, campaign), []
    for name, part in campaign.measured_parts.items():
        if INSTRUMENTS[name].in_motion:
            own = problem if problem is not None and set(problem.noises) == {name} else None
            parts.append(compare_bars(part, machine, threads, progress, own))
        else:
            parts.append(_COMPARE.get(name, compare_plainly)(part, machine, threads, progress))
    return Comparison(campaign, machine, tuple(parts))
