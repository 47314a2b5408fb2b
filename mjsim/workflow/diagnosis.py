"""What a diagnosis found, and how it is handed on."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.estimation.combinations import Combination
from mjsim.estimation.competing import CompetingModel
from mjsim.estimation.posterior import Posterior
from mjsim.estimation.shares import Calibration
from mjsim.estimation.unexplained import Unexplained
from mjsim.io import files
from mjsim.io.extras import need
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.units import UM
from mjsim.workflow.compare import Comparison

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class DiagnosedEffect:
    """One missing effect.

    Attributes:
        effect: With fitted parameters.
        free: Names of the fitted ones.
        ci95: [low, high] per fitted parameter, in the units of the names.
        rms_before: RMS of all tests before it is in the model, m, along the ladder of the effects found.
        rms_after: The same with it.
        alternatives: Ids that the data cannot tell from this one.
        tests: Where it shows.
        gain: How far the objective (squared residuals in units of the noise) falls with it.
        rejected: How much less of that the others reach that were fitted in its place, by id.
        models: The model with it, and those with its alternatives.
        probability: That it is this cause, and larger than a machine of its class may have.
        others: Probabilities of its alternatives, by id.
    """

    effect: Effect
    free: tuple[str, ...]
    ci95: dict
    rms_before: float
    rms_after: float
    alternatives: tuple[str, ...]
    tests: tuple[str, ...]
    gain: float = 0.0
    rejected: dict[str, float] = field(default_factory=dict)
    models: tuple[CompetingModel, ...] = ()
    probability: float = 1.0
    others: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Diagnosis:
    """Result of a diagnosis.

    Attributes:
        campaign: What was measured.
        verdict: ``identified``, ``ambiguous``, ``unknown`` or ``nothing_found``.
        noise: RMS of one sample's noise, m.
        effects: What is missing, in the order of the contribution.
        unexplained: Something repeatable that no effect of the catalogue explains.
        not_testable: Ids that the tests could not show.
        machine: With the effects and the calibrated data sheet in it.
        before: Comparison of the machine as given.
        after: Comparison of the fitted machine.
        rungs: The ladder between them, one effect more each. The last has the calibrated data sheet as well. From the
            third effect on they share the last rung. Where effects were calibrated, the first has all of these.
        next_test: The test that separates what is ambiguous, as in the JSON.
        trail: The models that were tried.
        calibration: Effects inside the tolerance of the machine file.
        shares: Share of each effect in the explained squared error; calibrated effects together by kind.
        combinations: Sums of calibrated numbers that the tests determine although they leave the numbers open.
        posterior: What the fit leaves uncertain about the machine; ``None`` where it was not kept.
        probabilities: Of the four verdicts.
        discrepancy: RMS in a test of what repeats and is in no model, m.
    """

    campaign: Campaign
    verdict: str
    noise: float
    effects: tuple[DiagnosedEffect, ...]
    unexplained: Unexplained | None
    not_testable: tuple[str, ...]
    machine: Machine
    before: Comparison
    after: Comparison
    rungs: tuple[Comparison, ...] = ()
    next_test: dict | None = None
    trail: list = field(default_factory=list)
    calibration: tuple[Calibration, ...] = ()
    shares: dict[str, float] = field(default_factory=dict)
    combinations: tuple[Combination, ...] = ()
    posterior: Posterior | None = None
    probabilities: dict[str, float] = field(default_factory=dict)
    discrepancy: float = 0.0

    @property
    def own_rungs(self) -> int:
        """How many of the effects, from the first, have a rung of the ladder of their own; the others share one."""
        shared = sum(r is self.rungs[-1] for r in self.rungs) if self.rungs else 0
        return len(self.effects) - (shared if shared > 1 else 0)

    @property
    def explained_shares(self) -> dict[str, float]:
        """Share of each cause in the explained squared error, the largest first; from the ladder where the selection
        has not computed them. They sum to 1.
        """
        if self.shares or not self.effects:
            return self.shares
        gains = {e.effect.key: max(0.0, e.rms_before**2 - e.rms_after**2) for e in self.effects}
        whole = sum(gains.values()) or 1.0
        return {key: gain / whole for key, gain in sorted(gains.items(), key=lambda item: -item[1])}

    def to_json(self) -> dict:
        """The JSON of ``mjsim diagnose``: µm, degrees and the units of the parameters' names."""
        return {
            "verdict": self.verdict,
            "probabilities": self.probabilities,
            "noise_um": _r(self.noise / UM),
            "discrepancy_um": _r(self.discrepancy / UM),
            "rms_before_um": _r(self.before.rms / UM),
            "rms_after_um": _r(self.after.rms / UM),
            "effects": [
                {
                    "id": e.effect.id,
                    "parameters": {k: _sig(v) for k, v in e.effect.values.items()},
                    "ci95": {k: _sig(v) for k, v in e.ci95.items()},
                    "rms_before_um": _r(e.rms_before / UM),
                    "rms_after_um": _r(e.rms_after / UM),
                    "probability": _r(e.probability),
                    "alternatives": [{"id": i, "probability": _r(e.others.get(i, 0.0))} for i in e.alternatives],
                    "alternative_ids": list(e.alternatives),
                    "tests": list(e.tests),
                }
                for e in self.effects
            ],
            "unexplained": self.unexplained.to_json() if self.unexplained else None,
            "not_testable": list(self.not_testable),
            "samples": sum(row["samples"] for row in self.before.to_json()["tests"]),
            "left_out": [
                {
                    "test": row["name"],
                    "disturbances": row["outliers"],
                    "samples": row["samples_left_out"],
                    "of": row["samples"],
                    "saturated": row["samples_saturated"],
                }
                for row in self.before.to_json()["tests"]
                if row["samples_left_out"]
            ],
            "next_test": self.next_test,
            **calibration_json(self.calibration, self.explained_shares, self.combinations),
        }

    def to_dataframe(self) -> pd.DataFrame:
        """One row per fitted parameter of the effects found: effect, parameter, value, low, high (95 %), units of the
        names.

        Components of a pitch error are parameters ``order 72 amplitude`` and ``order 72 phase``.
        """
        need("to_dataframe", "dataframe", "pandas")
        import pandas as pd

        rows = []
        for e in self.effects:
            same = ", ".join(e.alternatives)
            for name in e.free:
                value, ci = e.effect.values[name], e.ci95.get(name)
                if name == "components":
                    for k, row in enumerate(value):
                        for j, what in ((1, "amplitude"), (2, "phase")):
                            low, high = (ci[0][k][j], ci[1][k][j]) if ci else (np.nan, np.nan)
                            rows.append((e.effect.id, f"order {row[0]:g} {what}", row[j], low, high, same))
                else:
                    rows.append((e.effect.id, name, value, *(ci or (np.nan, np.nan)), same))
        return pd.DataFrame(rows, columns=["effect", "parameter", "value", "low", "high", "alternatives"])


def write_effect_file(result: Diagnosis, folder: Path) -> Diagnosis:
    """Write the unexplained rest's effect file into ``folder``; the diagnosis that names it. Nothing happens where
    none is left.
    """
    u = result.unexplained
    if u is None:
        return result
    path = unused_file(folder, u.stem, result.machine)
    files.write_whole(path, u.source, force=True)
    return replace(result, unexplained=replace(u, effect_file=str(path)))


def unused_file(folder: Path, stem: str, machine: Machine) -> Path:
    """A file of which no effect of the machine is made: what an earlier diagnosis found there stays as it is."""
    here = machine.path.parent if machine.path else Path()
    used = {(here / name).resolve() for name in machine.effect_files.values()}
    names = itertools.chain([f"{stem}.py"], (f"{stem}_{n}.py" for n in itertools.count(2)))
    return next(folder / name for name in names if (folder / name).resolve() not in used)


def calibration_json(
    entries: tuple[Calibration, ...], shares: dict[str, float], sums: tuple[Combination, ...] = ()
) -> dict:
    """The keys ``calibration``, ``combinations`` and ``shares`` of the JSON."""
    return {
        "calibration": [_calibration_row(c) for c in entries],
        "combinations": combination_json(sums),
        "shares": [{"id": name, "share": round(share, 4)} for name, share in shares.items()],
    }


def combination_json(sums: tuple[Combination, ...]) -> list[dict]:
    """The key ``combinations`` of the JSON."""
    return [
        {
            "terms": [{"id": t.effect_id, "parameter": t.name, "factor": _sig(t.factor)} for t in c.terms],
            "value": _sig(c.value),
            "ci95": [_sig(x) for x in c.ci95],
        }
        for c in sums
    ]


def _calibration_row(c: Calibration) -> dict:
    effect = c.effect.effect
    return {
        "id": effect.id,
        "parameters": {name: _sig(effect.values[name]) for name in c.effect.names},
        "ci95": {k: _sig(v) for k, v in c.ci95.items()},
        "limit": _sig(c.limit),
        "observable": c.observable,
        "rms_um": _r(c.rms / UM),
    }


def _r(x: float) -> float:
    return round(float(x), 4)


def _sig(v):
    if isinstance(v, (list, tuple)):
        return [_sig(x) for x in v]
    return float(f"{v:.6g}") if isinstance(v, (int, float)) else v
