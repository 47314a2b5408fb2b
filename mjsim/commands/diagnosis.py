"""What a diagnosis found, and how it is handed on."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.any_instrument import PlainComparison
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.finding import DiagnosedEffect, rounded
from mjsim.inference.budget import Budget
from mjsim.inference.combinations import Combination
from mjsim.inference.hypotheses import name_of
from mjsim.inference.local_noise import LouderPlace
from mjsim.inference.outcome import verdict_of
from mjsim.inference.posterior import Posterior
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.inference.shares import Calibration
from mjsim.inference.unexplained import FurtherCurve, Unexplained
from mjsim.inference.vibration import Hum
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io import files
from mjsim.io.extras import need
from mjsim.machine.model import Machine
from mjsim.units import UM, listed

if TYPE_CHECKING:
    import pandas as pd

#: What each verdict says.
VERDICTS = {
    "identified": "Identified: the effects below are missing, and nothing else explains the data as well.",
    "ambiguous": "Ambiguous: some effects below cannot be told from others by these tests.",
    "unknown": "Unknown: something repeatable is left that no effect of the catalogue explains.",
    "nothing_found": "Nothing found: the measurement shows no error larger than the data sheet and the machine's class "
    "allow.",
}


#: Most tests that are told to be louder than the instrument at some places, one by one.
_LOUDEST = 3


def louder_sentence(rows: Sequence[dict]) -> str:
    """Which tests are louder than the instrument, and where; empty where none is.

    Args:
        rows: ``louder`` of the JSON of ``mjsim diagnose``, the loudest test first.
    """
    if not rows:
        return ""
    told = [
        f"{r['test']} (most at {r['time_s']:.1f} s, {r['frequency_Hz'][0]:g} to {r['frequency_Hz'][1]:g} Hz: "
        f"{r['times']:.2g} times the noise)"
        for r in rows[:_LOUDEST]
    ]
    told += [f"{len(rows) - _LOUDEST} more"] if len(rows) > _LOUDEST else []
    return (
        f"Louder than the instrument at some places, as where a structure rings: {'; '.join(told)}. What is louder "
        "there counts as noise."
    )


def hum_sentence(rows: Sequence[dict]) -> str:
    """What the instrument's signal has of its own; empty where it has nothing.

    Args:
        rows: ``hum`` of the JSON of ``mjsim diagnose``.
    """
    if not rows:
        return ""
    waves = listed([f"{r['amplitude_um']:.2g} µm at {r['frequency_Hz']:.2f} Hz" for r in rows])
    alike = sorted({i for r in rows for i in r["alternatives"]})
    return (
        f"The instrument's signal hums: {waves} (amplitude), alike wherever the machine stands. That is the mains or "
        "the instrument and no axis, so it is left out of the data. Look at cable, supply and earthing."
        + (f" In these tests {' or '.join(alike)} would look the same." if alike else "")
    )


def told_beside(data: Mapping[str, Any], calibrated: Iterable[str]) -> list[str]:
    """Sentences on what the tests show beside the model, one for each kind that they show.

    Args:
        data: The JSON of ``mjsim diagnose``.
        calibrated: Ids of the effects that were calibrated.
    """
    told = [
        common_sentence(data, calibrated),
        hum_sentence(data.get("hum", ())),
        louder_sentence(data.get("louder", ())),
    ]
    return [sentence for sentence in told if sentence]


def common_sentence(data: Mapping[str, Any], calibrated: Iterable[str]) -> str:
    """What the tests show that every machine has a little of and no effect of the model is; empty where they show none.

    Args:
        data: The JSON of ``mjsim diagnose``.
        calibrated: Ids of the effects that were calibrated.
    """
    told = []
    if urad := data.get("slide_turns_urad"):
        told.append(
            f"The slides turn by about {urad:.2g} µrad (RMS over 200 mm of travel), by roll, pitch and yaw that are in "
            "no effect of the model."
        )
    if um := data.get("drift_um"):
        told.append(
            f"The tool drifts against the table by about {um:.2g} µm (RMS in each axis over the campaign), with the "
            "campaign's clock. That is in no effect of the model."
        )
    if off := data.get("bar_gain_percent"):
        told.append(f"The ball bar reads too much or too little, by some {off:.1g} %: have it calibrated.")
    if shares := data.get("friction_varies_percent"):
        axes = listed([f"{percent:.2g} % on {axis}" for axis, percent in shares.items()])
        told.append(
            f"The friction varies by about {axes} (RMS), with the direction, along the travel or in a turn of the "
            "motor. It is in no effect of the model."
        )
    if told:
        told.append(
            f"That is a part of the residual above, and every interval counts {'all of it' if told[1:] else 'it'}."
        )
    if urad and not any(i.startswith("angular_error.") for i in calibrated):
        told.append("With a limit of angular_error in [tolerance] of the machine file, each turn is fitted.")
    return " ".join(told)


@dataclass(frozen=True)
class AtRest:
    """What points show that were measured while the machine stood still.

    Attributes:
        before: Comparison of the machine as given.
        after: Comparison of the fitted machine.
        noise: Standard deviation of one value, m.
        noise_source: ``repeated points``, ``stated`` or ``assumed``.
        left: Standard deviation of what is in no model, m.
        misfit: Probability that this is more than the noise.
        set_up: Fitted numbers of set-ups and instrument, and their 95 % intervals, by name with its unit.
        classical: What a usual method gives by itself, by id of the effect, in the unit of its number.
        joint: How the answer came about beside another instrument; empty where there is one alone.
    """

    before: PlainComparison
    after: PlainComparison
    noise: float
    noise_source: str
    left: float
    misfit: float
    set_up: dict[str, tuple[float, tuple[float, float]]]
    classical: dict[str, float]
    joint: str = ""

    def to_json(self) -> dict:
        """Plain numbers."""
        return {
            "noise_um": _r(self.noise / UM),
            "noise_source": self.noise_source,
            "left_um": _r(self.left / UM),
            "misfit": round(self.misfit, 4),
            "rms_before_um": _r(self.before.rms / UM),
            "rms_after_um": _r(self.after.rms / UM),
            "set_up": [{"name": k, "value": rounded(v), "ci95": rounded(ci)} for k, (v, ci) in self.set_up.items()],
            "classical": [{"id": k, "value": rounded(v)} for k, v in self.classical.items()],
            "joint": self.joint,
            "tests": [t.to_json() for t in self.after.tests],
        }


@dataclass(frozen=True)
class Diagnosis:
    """Result of a diagnosis, with what all instruments show.

    Where ball-bar tests were measured, everything that is not in ``logs`` is theirs; of a campaign of axis logs alone
    it is that of the logs.

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
        logs: What the axis logs show, with the numbers of the drives; ``None`` where none was recorded.
        settings: What has decided.
        probabilities: Of the four verdicts by the ball-bar tests; empty where none was measured.
        discrepancy: RMS in a ball-bar test of what is in no model, m.
        common: Sizes of what every measurement has a little of and no model has, by name: ``slide_turns``, rad RMS over
            200 mm of travel; ``drift``, m RMS in each axis over the campaign; ``friction_varies.X``, RMS share of the
            friction of an axis; ``bar_gain``, share of the reading. Only of those that the data show.
        at_rest: What was measured while the machine stood still, one for each instrument.
        budget: Where the uncertainty of every fitted number comes from.
        further: Curves of unknown causes that the model has beside ``unexplained``.
        louder: Where ball-bar tests are louder than the instrument, the loudest test first.
        hums: What the instrument's signal has of its own.
    """

    campaign: Campaign
    verdict: str
    noise: float
    effects: tuple[DiagnosedEffect, ...]
    unexplained: Unexplained | None
    not_testable: tuple[str, ...]
    machine: Machine
    before: Any
    after: Any
    rungs: tuple[Any, ...] = ()
    next_test: dict | None = None
    trail: list = field(default_factory=list)
    calibration: tuple[Calibration, ...] = ()
    shares: dict[str, float] = field(default_factory=dict)
    combinations: tuple[Combination, ...] = ()
    posterior: Posterior | None = None
    logs: LogDiagnosis | None = None
    settings: DiagnosisSettings = DIAGNOSIS
    probabilities: dict[str, float] = field(default_factory=dict)
    discrepancy: float = 0.0
    common: dict[str, float] = field(default_factory=dict)
    at_rest: tuple[AtRest, ...] = ()
    budget: tuple[Budget, ...] = ()
    further: tuple[FurtherCurve, ...] = ()
    louder: tuple[LouderPlace, ...] = ()
    hums: tuple[Hum, ...] = ()

    @property
    def told_beside(self) -> list[str]:
        """Sentences on what the tests show beside the model."""
        return told_beside(self._beside_json(), (c.effect.effect.id for c in self.calibration))

    def _beside_json(self) -> dict[str, Any]:
        return {
            "slide_turns_urad": _r(self.common.get("slide_turns", 0.0) / 1e-6),
            "drift_um": _r(self.common.get("drift", 0.0) / UM),
            "bar_gain_percent": _r(self.common.get("bar_gain", 0.0) / 1e-2),
            "friction_varies_percent": {
                name[-1]: _r(size / 1e-2) for name, size in self.common.items() if name.startswith("friction_varies")
            },
            "hum": [hum.to_json() for hum in self.hums],
            "louder": [place.to_json() for place in self.louder],
        }

    @property
    def has_bars(self) -> bool:
        """Whether ball-bar tests were measured, or other readings along a motion."""
        return INSTRUMENTS[self.before.instrument].in_motion

    def of_bars(self) -> Diagnosis:
        """What concerns the ball-bar tests, whose causes the ladder has."""
        found = tuple(e for e in self.effects if INSTRUMENTS[e.found_by].in_motion)
        if found == self.effects:
            return self
        verdict = self.verdict if found else verdict_of((), self.unexplained is not None)
        return replace(self, effects=found, verdict=verdict)

    @property
    def own_rungs(self) -> int:
        """How many of the effects, from the first, have a rung of the ladder of their own; the others share one."""
        shared = sum(r is self.rungs[-1] for r in self.rungs) if self.rungs else 0
        return len(self.of_bars().effects) - (shared if shared > 1 else 0)

    @property
    def explained_shares(self) -> dict[str, float]:
        """Share of each cause in the explained squared error, the largest first; from the ladder where the selection
        has not computed them. They sum to 1.
        """
        mine = self.of_bars().effects if self.has_bars else self.effects
        if self.shares or not mine:
            return self.shares
        gains = {e.effect.key: max(0.0, e.rms_before**2 - e.rms_after**2) for e in mine}
        whole = sum(gains.values()) or 1.0
        return {key: gain / whole for key, gain in sorted(gains.items(), key=lambda item: -item[1])}

    def to_json(self) -> dict:
        """The JSON of ``mjsim diagnose``: µm, degrees and the units of the parameters' names."""
        if not self.has_bars and not self.at_rest:
            assert self.logs is not None
            return self.logs.to_json()
        out = self._bars_json()
        for rest in self.at_rest:
            out |= {INSTRUMENTS[rest.after.instrument].beside: rest.to_json()}
        if self.logs is None:
            return out
        logs = self.logs.to_json()
        keys = ("noise_um", "rms_before_um", "rms_after_um", "unexplained", "data_sheet", "not_separable", "tests")
        return out | {INSTRUMENTS[LogTest.instrument].beside: {k: logs[k] for k in keys}}

    def _bars_json(self) -> dict:
        tests = [t.to_json() for t in self.before.tests]
        return {
            "verdict": self.verdict,
            "probabilities": self.probabilities,
            "noise_um": _r(self.noise / UM),
            "discrepancy_um": _r(self.discrepancy / UM),
            **self._beside_json(),
            "rms_before_um": _r(self.before.rms / UM),
            "rms_after_um": _r(self.after.rms / UM),
            "effects": [e.to_json(self.machine) for e in self.effects],
            "unexplained": self.unexplained.to_json() if self.unexplained else None,
            "further_curves": [c.to_json() for c in self.further],
            "not_testable": list(self.not_testable),
            "samples": sum(row["samples"] for row in tests),
            "left_out": [
                {
                    "test": row["name"],
                    "disturbances": row["outliers"],
                    "samples": row["samples_left_out"],
                    "of": row["samples"],
                    "saturated": row["samples_saturated"],
                }
                for row in tests
                if row.get("samples_left_out")
            ],
            "next_test": self.next_test,
            "budget": [{k: rounded(v) for k, v in b.to_json().items()} for b in self.budget],
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
                            rows.append((name_of(e.effect), f"order {row[0]:g} {what}", row[j], low, high, same))
                else:
                    rows.append((name_of(e.effect), name, value, *(ci or (np.nan, np.nan)), same))
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
            "terms": [{"id": t.effect_id, "parameter": t.name, "factor": rounded(t.factor)} for t in c.terms],
            "value": rounded(c.value),
            "ci95": [rounded(x) for x in c.ci95],
        }
        for c in sums
    ]


def _calibration_row(c: Calibration) -> dict:
    effect = c.effect.effect
    return {
        "id": effect.id,
        "parameters": {name: rounded(effect.values[name]) for name in c.effect.names},
        "ci95": {k: rounded(v) for k, v in c.ci95.items()},
        "limit": rounded(c.limit),
        "observable": c.observable,
        "rms_um": _r(c.rms / UM),
    }


def _r(x: float) -> float:
    return round(float(x), 4)
