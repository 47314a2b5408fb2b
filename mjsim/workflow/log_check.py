"""``mjsim check`` on axis logs, and what other commands refuse."""

from __future__ import annotations

from mjsim.axislog.mistakes import LogMistake, log_mistakes
from mjsim.axislog.signals import findings
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.machine.model import Machine, build
from mjsim.simulation.stability import check_loop


def check_logs(campaign: Campaign) -> dict:
    """Mistakes of a campaign's axis logs, as ``mjsim check --json`` prints them."""
    found = log_mistakes(campaign.logs)
    rows = []
    for test in campaign.logs.recorded:
        kinds = [m.kind for m in found if m.test == test.name]
        recording = campaign.logs.recordings[test.name]
        rows.append(
            {
                "name": test.name,
                "axes": list(test.axes),
                "samples": len(recording.time),
                "duration_s": round(float(recording.time[-1]), 4),
                "rate_Hz": round(1.0 / recording.step, 3),
                "finding": kinds or ["ok"],
            }
        )
    recorded = {t.name for t in campaign.logs.recorded}
    return {
        "campaign": campaign.name,
        "mistakes": [m.to_json() for m in found],
        "signals": [f.to_json() for f in findings(campaign.logs) if not f.refused],
        "tests": rows,
        "questions": [],
        "not_measured": [t.name for t in campaign.logs.tests if t.name not in recorded],
    }


def refuse_mistakes(campaign: Campaign) -> None:
    """Stop where a log shows a mistake of its files, unless the campaign is taken as it is.

    Raises:
        InputError: The first mistake.
    """
    found: list[LogMistake] = [] if campaign.as_is else log_mistakes(campaign.logs)
    if found:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: {found[0].sentence}, or say --as-is")


def refuse_unstable(campaign: Campaign, machine: Machine) -> None:
    """Stop where the loop of a recorded axis is unstable with the numbers of the machine file.

    Raises:
        SimulationError: Names the table, the loop and what to change.
    """
    for test in campaign.logs.recorded:
        plant = build(machine.under(test.controller))
        for axis in test.axes:
            own = f"controller.{test.controller}.{axis}" if test.controller is not None else f"drive.{axis}"
            check_loop(
                plant.axes[axis], f"{machine.file or machine.name}: [{own}]", campaign.logs.recordings[test.name].step
            )
