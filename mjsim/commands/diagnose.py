"""Which physical effects are missing from a machine's model, whatever instruments have measured it."""

from __future__ import annotations

from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign
from mjsim.commands.at_rest import diagnose_at_rest
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.commands.ball_bar.diagnose import diagnose_bars
from mjsim.commands.both_instruments import diagnose_jointly
from mjsim.commands.diagnosis import Diagnosis
from mjsim.errors import InputError
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent


def diagnosable() -> tuple[str, ...]:
    """Instruments whose recordings a diagnosis explains: along a motion, axis logs, and all that measure at rest."""
    at_rest = (name for name, i in INSTRUMENTS.items() if i.at_rest)
    in_motion = (name for name, i in INSTRUMENTS.items() if i.in_motion)
    return (*in_motion, LogTest.instrument, *at_rest)


def diagnose(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Find what is missing from the model of a machine, with all instruments that have measured it.

    Args:
        campaign: With at least one measured test.
        machine: As given.
        max_effects: At most so many different effects; without it as many as the data prove.
        threads: Simulations side by side.
        progress: Called as work gets on.
        settings: What decides.

    Raises:
        InputError: Nothing was measured, the recordings show a mistake, or there is no diagnosis for an instrument.
    """
    campaign.need_traces("a diagnosis needs measured tests")
    machine, have = in_campaign(machine, campaign), set(campaign.measured_parts)
    if unable := sorted(have - set(diagnosable())):
        raise InputError(
            f"{campaign.folder / 'campaign.toml'}: no diagnosis works with tests of the instrument {unable[0]!r}; "
            f"allowed: {', '.join(diagnosable())}"
        )
    if any(INSTRUMENTS[name].at_rest for name in have):
        others = [name for name in campaign.measured_parts if not INSTRUMENTS[name].at_rest]
        beside = None
        if others:
            beside = diagnose(campaign.of(*others), machine, max_effects, threads, progress, settings)
        return diagnose_at_rest(campaign, machine, max_effects, threads, progress, settings, beside)
    if LogTest.instrument in have and campaign.in_motion.measured:
        return diagnose_jointly(campaign, machine, max_effects, threads, progress, settings)
    if LogTest.instrument in have:
        logs = diagnose_logs(campaign, machine, max_effects, threads, progress)
        return Diagnosis(
            campaign,
            logs.verdict,
            logs.before.noise,
            logs.effects,
            None,
            logs.not_testable,
            logs.machine,
            logs.before,
            logs.after,
            logs=logs,
            settings=settings,
            budget=logs.budget,
        )
    return diagnose_bars(campaign, machine, max_effects, threads, progress, settings)
