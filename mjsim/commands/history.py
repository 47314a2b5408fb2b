"""The ladder: every model that was tried on a campaign, its effects and its error per test."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from mjsim.campaign.machine_file import machine_text, read_machine
from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign
from mjsim.commands.ball_bar.compare import BarComparison
from mjsim.errors import InputError
from mjsim.io import files
from mjsim.io.inputs import file_bytes
from mjsim.machine.model import Machine
from mjsim.units import UM

_LARGEST = 20_000_000


@dataclass(frozen=True)
class Step:
    """One model: ``action`` (start, add, remove), the effect it was about, all effect keys, errors in µm (RMS, over all
    and per test).

    ``model`` is the machine file's text with exactly this model, so that the step can be simulated again whatever
    became of the file; empty in histories of versions that did not keep it.
    """

    action: str
    effect: str
    machine_file: str
    effects: tuple[str, ...]
    rms_um: float
    noise_um: float
    tests: dict[str, float]
    model: str = ""

    @property
    def label(self) -> str:
        """``+ backlash.A``, ``- backlash.A`` or ``machine as given``."""
        return {"add": f"+ {self.effect}", "remove": f"- {self.effect}"}.get(self.action, "machine as given")


def history_file(campaign: Campaign) -> Path:
    """Where the ladder is kept."""
    return campaign.state_folder / "history.json"


def read_history(campaign: Campaign) -> list[Step]:
    """Steps recorded for a campaign, oldest first; empty when there are none.

    Raises:
        InputError: the file is damaged.
    """
    path = history_file(campaign)
    if not os.path.lexists(path):
        return []
    data = file_bytes(path, _LARGEST, f"allowed: up to {_LARGEST / 1e6:.0f} MB; move it away to start a new one")
    try:
        return TypeAdapter(list[Step]).validate_python(json.loads(data)["steps"])
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{path}: not a history that mjsim has written; move it away to start a new one") from None


def step_of(action: str, effect: str, machine_file: Path, comparison: BarComparison, text: str | None = None) -> Step:
    """A step from the comparison of the model that it led to; ``text`` in place of the machine file's, where that
    cannot be read.
    """
    return Step(
        action,
        effect,
        machine_file.name,
        tuple(e.key for e in comparison.machine.effects),
        round(comparison.rms / UM, 4),
        round(comparison.noise / UM, 4),
        {t.test.name: round(t.rms / UM, 4) for t in comparison.tests},
        machine_text(comparison.machine, machine_file, comparison.campaign.folder, text),
    )


def machine_of_step(campaign: Campaign, step: Step) -> Machine:
    """The machine that a step led to.

    Raises:
        InputError: the history does not hold it, or an effect file that it names is gone.
    """
    if not step.model:
        raise InputError(
            f"{history_file(campaign)}: the step '{step.label}' was recorded without its machine; "
            f"move the file away and run `mjsim add {campaign.folder} EFFECT` to record the steps anew"
        )
    return in_campaign(read_machine(campaign.folder / step.machine_file, step.model), campaign)


def record(campaign: Campaign, steps: list[Step]) -> None:
    """Append steps; the first of them is dropped where the ladder already ends in the same model."""
    files.write_whole(history_file(campaign), with_steps(campaign, steps), force=True)


def with_steps(campaign: Campaign, steps: list[Step]) -> str:
    """Text of the history with some more steps, as :func:`record` writes it."""
    have = read_history(campaign)
    if have and steps and steps[0].action == "start":
        if (have[-1].effects, have[-1].machine_file) == (steps[0].effects, steps[0].machine_file):
            steps = steps[1:]
    rows = [{**vars(s), "effects": list(s.effects)} for s in [*have, *steps]]
    return json.dumps({"steps": rows}, indent=1)


def changed_machine(text: str, path: Path, campaign: Campaign) -> dict[Path, str | bytes]:
    """The files of a changed machine: ``text`` in place of ``path``, and the former text beside the history."""
    folder = campaign.state_folder
    number = 1 + sum(1 for _ in folder.glob(f"{path.stem}.*.toml")) if folder.is_dir() else 1
    while os.path.lexists(folder / f"{path.stem}.{number:03d}.toml"):  # the user has taken an older one away
        number += 1
    return {folder / f"{path.stem}.{number:03d}.toml": path.read_bytes(), path: text}
