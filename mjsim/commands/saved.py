"""A diagnosis kept beside its campaign, so that what follows from it need not repeat it.

The file is ``.mjsim/diagnosis.json``. It is used only while campaign, traces and machine file are those of the
diagnosis.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjsim.campaign.machine_file import machine_text, read_machine
from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign
from mjsim.commands.diagnosis import Diagnosis
from mjsim.errors import InputError
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.posterior import Posterior
from mjsim.io.cache import fingerprint
from mjsim.io.files import write_whole
from mjsim.io.inputs import file_bytes
from mjsim.io.toml import read_text
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine

_LARGEST = 50_000_000
#: Changes whenever the file's content does.
_FORM = 2


@dataclass(frozen=True)
class Known:
    """One effect of the diagnosed machine, and how well it is known.

    Attributes:
        effect: With its values.
        ci95: [low, high] per fitted parameter, as in the JSON of a diagnosis; empty where the machine file states it.
        origin: ``found``, ``calibrated`` or ``stated``.
        alternatives: Ids that the data cannot tell from it.
        observable: Whether the tests say more about it than its tolerance does.
    """

    effect: Effect
    ci95: dict
    origin: str
    alternatives: tuple[str, ...] = ()
    observable: bool = True


@dataclass(frozen=True)
class SavedDiagnosis:
    """What later commands need of a diagnosis.

    Attributes:
        verdict: As in the JSON.
        machine: With the effects found and the calibrated data sheet.
        known: Its effects.
        posterior: What the fit leaves uncertain.
        unexplained: The sentence on what is left, or an empty text.
        noise: RMS of one sample's noise, m.
    """

    verdict: str
    machine: Machine
    known: tuple[Known, ...]
    posterior: Posterior
    unexplained: str
    noise: float


def saved_of(result: Diagnosis) -> SavedDiagnosis:
    """What later commands need of ``result``."""
    if result.posterior is None:
        raise ValueError("the diagnosis was made without its posterior")
    found = {e.effect.key: Known(e.effect, e.ci95, "found", e.alternatives) for e in result.effects}
    expected = {
        c.effect.effect.key: Known(c.effect.effect, c.ci95, "calibrated", (), c.observable) for c in result.calibration
    }
    known = tuple(found.get(e.key) or expected.get(e.key) or Known(e, {}, "stated") for e in result.machine.effects)
    known = tuple(replace(k, effect=e) for k, e in zip(known, result.machine.effects, strict=True))
    rest = result.unexplained.summary if result.unexplained else ""
    return SavedDiagnosis(result.verdict, result.machine, known, result.posterior, rest, result.noise)


def saved_file(campaign: Campaign) -> Path:
    """Where a campaign's diagnosis is kept."""
    return campaign.state_folder / "diagnosis.json"


def stamp(campaign: Campaign, machine: Machine) -> str:
    """Fingerprint of everything that a diagnosis starts from."""
    tests = [(test, campaign.traces[test.name]) for test in campaign.measured]
    return fingerprint(_FORM, campaign.instruments, read_text(machine.file), tests, campaign.temperatures)


def keep(result: Diagnosis, given: Machine) -> SavedDiagnosis:
    """Write a diagnosis of the machine ``given`` beside its campaign, and hand it on.

    Raises:
        InputError: the file cannot be written.
    """
    saved = saved_of(result)
    data = {
        "stamp": stamp(result.campaign, given),
        "machine_file": given.file.name,
        "machine": machine_text(saved.machine, given.file, result.campaign.folder),
        "verdict": saved.verdict,
        "unexplained": saved.unexplained,
        "noise_m": saved.noise,
        "known": [
            {
                "key": k.effect.key,
                "ci95": k.ci95,
                "origin": k.origin,
                "alternatives": list(k.alternatives),
                "observable": k.observable,
            }
            for k in saved.known
        ],
        "fitted": [{"key": f.effect.key, "names": list(f.names)} for f in saved.posterior.effects],
        "covariance": [[float(f"{x:.7g}") for x in row] for row in saved.posterior.covariance],
    }
    write_whole(saved_file(result.campaign), json.dumps(data), force=True)
    return saved


def read_saved(campaign: Campaign, given: Machine) -> SavedDiagnosis | None:
    """The diagnosis that was kept of this campaign and machine; ``None`` where there is none, or it is out of date."""
    path = saved_file(campaign)
    if not path.is_file():
        return None
    try:
        data = json.loads(file_bytes(path, _LARGEST, "allowed: a file that mjsim has written"))
        if data["stamp"] != stamp(campaign, given):
            return None
        machine = in_campaign(read_machine(campaign.folder / data["machine_file"], data["machine"]), campaign)
        effects = {e.key: e for e in machine.effects}
        known = tuple(
            Known(effects[k["key"]], k["ci95"], k["origin"], tuple(k["alternatives"]), k["observable"])
            for k in data["known"]
        )
        fitted = tuple(EffectVector(effects[f["key"]], tuple(f["names"])) for f in data["fitted"])
        covariance = np.array(data["covariance"], float)
        return SavedDiagnosis(
            data["verdict"], machine, known, Posterior(fitted, covariance), data["unexplained"], float(data["noise_m"])
        )
    except (ValueError, KeyError, TypeError, InputError):
        return None
