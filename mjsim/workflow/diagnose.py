"""Which physical effects are missing from a machine's model, with honest confidence."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjsim.ballbar.measurement import BallBarTest
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.estimation.curve_search import best_curve_term
from mjsim.estimation.disturbances import readmitted
from mjsim.estimation.fit import Fitter, unabsorbed, with_effects
from mjsim.estimation.joint_selection import JointSelector
from mjsim.estimation.lines import Line
from mjsim.estimation.mistakes.checked_problem import checked_problem
from mjsim.estimation.planning.next_test import plan_for
from mjsim.estimation.problem import Problem
from mjsim.estimation.selection import ModelSelection, Selection
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.estimation.shares import Calibration, calibrations
from mjsim.estimation.signatures import Projector
from mjsim.estimation.testability import not_testable
from mjsim.estimation.unexplained import Unexplained, describe, find_unexplained
from mjsim.estimation.vibration import Separated, is_news, phased, separate
from mjsim.io import files
from mjsim.io.extras import need
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, silent
from mjsim.simulation.multibody import reading_of, simulate_each
from mjsim.threads import one_blas_thread
from mjsim.units import UM
from mjsim.workflow.compare import Comparison, overlay

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class DiagnosedEffect:
    """One missing effect.

    Attributes:
        effect: with fitted parameters. free: names of the fitted ones. ci95: [low, high] per fitted parameter, file
            units.
        rms_before, rms_after: of all tests, m, along the ladder of the effects found. alternatives: ids that the data
            cannot tell
        from this one. tests: where it shows. gain: how far the objective (squared residuals in units of the noise)
        falls with it; rejected: how much less of that the others reach that were fitted in its place, by id.
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


@dataclass(frozen=True)
class Diagnosis:
    """Result of :func:`diagnose`. ``machine`` has the effects and the calibrated data sheet in it; ``before``,
    ``after`` are the full comparisons of the machine as given and of the fitted one, ``rungs`` those of the ladder
    between them (one effect more each; the last has the calibrated data sheet as well). Where the machine file states a
    tolerance, ``calibration`` has the
    effects inside it, the first rung has these, and ``shares`` are those of the explained squared error."""

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

    def to_json(self) -> dict:
        """The JSON of ``mjsim diagnose``: µm, degrees and the units of the parameters' names."""
        return {
            "verdict": self.verdict,
            "noise_um": _r(self.noise / UM),
            "rms_before_um": _r(self.before.rms / UM),
            "rms_after_um": _r(self.after.rms / UM),
            "effects": [
                {
                    "id": e.effect.id,
                    "parameters": {k: _sig(v) for k, v in e.effect.values.items()},
                    "ci95": {k: _sig(v) for k, v in e.ci95.items()},
                    "rms_before_um": _r(e.rms_before / UM),
                    "rms_after_um": _r(e.rms_after / UM),
                    "alternatives": list(e.alternatives),
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
            "calibration": [_calibration_row(c) for c in self.calibration],
            "shares": [{"id": name, "share": round(share, 4)} for name, share in self.shares.items()],
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
    path = folder / f"{u.stem}.py"
    files.write_whole(path, u.source, force=True)
    return replace(result, unexplained=replace(u, effect_file=str(path)))


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


@one_blas_thread
def diagnose(
    campaign: Campaign,
    machine: Machine,
    max_effects: int = 5,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Find what is missing.

    The search runs on the drives' motions; every error that is reported comes from the full multibody simulation.

    Args:
        campaign: With at least one measured test.
        machine: As given.
        max_effects: At most so many different effects.
        threads: Tests that are worked on side by side.
        progress: Called as work gets on.
        settings: What decides.

    Raises:
        InputError: no measured test, or the traces show a mistake (:mod:`mjsim.estimation.mistakes`).
    """
    if not campaign.measured:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: no test has a trace; a diagnosis needs measured tests")
    progress("preparing", 0, 1)
    separated = separate(checked_problem(campaign, build(machine), threads, settings=settings), machine)
    explained = _explain(separated, max_effects, progress)
    data, selection, unexplained = explained.data, explained.selection, explained.unexplained
    hidden = not_testable(data, Projector(selection.start), selection.bank)
    found = sorted(
        [*_found(data, selection), *(_vibration(data, line) for line in separated.lines if is_news(line, machine))],
        key=lambda f: -f[0],
    )
    problem = data.restored()

    def simulated(m: Machine, stage: str) -> Comparison:
        count = [0]

        def done(_: BallBarTest) -> None:
            count[0] += 1
            progress(stage, count[0], len(problem.tests))

        return overlay(problem, m, simulate_each(m, problem.tests, reading_of, threads, done))

    before = simulated(phased(problem, machine), "simulating the machine as given")
    expected = with_effects(machine, [c.effect.effect for c in explained.calibration])
    calibrated = (
        simulated(phased(problem, expected), "simulating the calibrated machine")
        if explained.calibration and found
        else None
    )
    ladder = [calibrated or before]
    for i in range(1, len(found)):
        part = phased(problem, with_effects(expected, [e.effect for _, e in found[:i]]))
        ladder.append(simulated(part, f"simulating with {i} effect{'s' if i > 1 else ''}"))
    final = with_effects(selection.fit.machine, [line.effect for line in separated.lines])
    after = simulated(final, "simulating the fitted machine")
    ladder.append(after)
    effects = tuple(
        replace(e, rms_before=a.rms, rms_after=b.rms) for (_, e), a, b in zip(found, ladder, ladder[1:], strict=False)
    )
    if effects:
        verdict = "ambiguous" if any(e.alternatives for e in effects) else "identified"
    else:
        verdict = "unknown" if unexplained else "nothing_found"
    following = plan_for(problem, selection, threads, progress, hidden=False)
    named = {e.effect.id for e in effects} | {a for e in effects for a in e.alternatives}
    return Diagnosis(
        campaign,
        verdict,
        problem.noise.rms,
        effects,
        unexplained,
        tuple(h for h in hidden if h not in named),
        final,
        before,
        after,
        tuple(ladder),
        next_test=following.to_json() if following else None,
        trail=selection.trail,
        calibration=explained.calibration,
        shares=explained.shares,
    )


@dataclass(frozen=True)
class _Explained:
    """Outcome of the model selection: the data that it ends on, the model, what is left, and what was calibrated."""

    data: Problem
    selection: Selection
    unexplained: Unexplained | None
    calibration: tuple[Calibration, ...] = ()
    shares: dict[str, float] = field(default_factory=dict)


def _explain(separated: Separated, max_effects: int, progress: Progress) -> _Explained:
    """The model selection on data without vibrations."""
    problem = separated.problem
    fitter = Fitter(problem, separated.machine)
    if separated.machine.tolerance:
        return _explain_within_tolerance(problem, fitter, progress)
    selection = ModelSelection(fitter, progress).run(max_effects)
    unexplained, selection = find_unexplained(problem, selection, progress)
    if selection.found:
        data = readmitted(problem, selection.fit.readings, selection.fit.nuisance)
        if data is not problem:
            refitted = fitter.with_problem(data).fit(selection.fit.effects, start=selection.fit)
            return _Explained(data, replace(selection, fit=refitted), unexplained)
    return _Explained(problem, selection, unexplained)


def _explain_within_tolerance(problem: Problem, fitter: Fitter, progress: Progress) -> _Explained:
    """The same for a machine whose file states a tolerance: everything is calibrated at once, and findings lie
    beyond it.
    """
    joint = JointSelector(fitter, progress).run()
    fit = joint.selection.fit
    rest = best_curve_term(problem, fit) if joint.curve is not None else None
    progress("shares of the error", 0, 1)
    entries, shares = calibrations(problem, fit, joint.calibrated)
    return _Explained(problem, joint.selection, describe(problem, fit, rest) if rest else None, entries, shares)


def _found(problem: Problem, selection: Selection) -> list[tuple[float, DiagnosedEffect]]:
    """Gain and entry of every effect of the search; errors are filled in by the full simulation."""
    out = []
    for f in selection.found:
        at = next(j for j, g in enumerate(selection.fit.effects) if g.effect.key == f.key)
        free = selection.fit.effects[at]
        ci = free.interval(free.vector, selection.fit.covariance_of(free))
        where = _where(problem, selection, at)
        out.append(
            (f.gain, DiagnosedEffect(free.effect, free.names, ci, 0.0, 0.0, f.alternatives, where, f.gain, f.rejected))
        )
    return out


def _vibration(problem: Problem, line: Line) -> tuple[float, DiagnosedEffect]:
    i, size = problem.chain.index(line.effect.subject), line.effect.si("amplitude_um")
    spread = [size * np.sqrt(np.mean(s.axes[:, i] ** 2) / 2) for s in problem.sensitivity]
    tests = tuple(
        t.name
        for t, x in zip(problem.tests, spread, strict=True)
        if x > problem.settings.visible_share * problem.noise.rms
    )
    return line.gain, DiagnosedEffect(
        line.effect, line.effect.search.free, line.ci95, 0.0, 0.0, line.alternatives, tests, line.gain
    )


def _where(problem: Problem, selection: Selection, index: int) -> tuple[str, ...]:
    """Tests in which an effect's part of the reading stands out of the noise (RMS above a quarter of it).

    A set-up error that takes some of it up in one test moves the others of that set-up as well; these show nothing of
    the effect.
    """
    machine = selection.fit.machine.without(selection.fit.effects[index].effect.key)
    original = selection.fit.base.effect(selection.fit.effects[index].effect.key)
    if original is not None:
        machine = machine.with_effect(original)
    parts = problem.difference(problem.readings(build(machine)), selection.fit.readings, selection.fit.nuisance)
    left = unabsorbed(problem, selection.fit, parts)
    least = problem.settings.visible_share * problem.noise.rms
    return tuple(t.name for t, *both in zip(problem.tests, parts, left, strict=True) if min(map(np.std, both)) > least)
