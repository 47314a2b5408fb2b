"""Which causes an axis lacks: forward search with joint refits, then each one found against what competes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.estimation.axis_logs.candidates import SIMPLER, Candidate, Catalogue
from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.entries import PHASE, AxisModel, Entry
from mjsim.estimation.axis_logs.fit import WAVES, AxisFit, LogFitter, gain
from mjsim.estimation.axis_logs.gains import GainsRead, read_gains
from mjsim.estimation.axis_logs.start import nuisance_model, start_model
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent

#: Candidates that are fitted in one step of the search, and in the place of one that was found.
_SHORTLIST, _COMPETING = 3, 2
#: Least share by which a cause must lower the RMS of a recording to be a cause of its own.
_LEAST_SHARE = 0.01
#: Share by which the mean square of a recording grows without a cause that shows in it (assumed).
_SHOWS = 0.02


@dataclass(frozen=True)
class FoundCause:
    """One cause of the final model.

    Attributes:
        key: Of the candidate.
        effect_id: Of the effect.
        gain: Twice the logarithm of the likelihood ratio against the model without it.
        alternatives: Ids of effects that the recordings cannot tell from it.
        rejected: How much worse others do in its place, by id.
        tests: Where it shows.
    """

    key: str
    effect_id: str
    gain: float
    alternatives: tuple[str, ...] = ()
    rejected: dict[str, float] = field(default_factory=dict)
    tests: tuple[str, ...] = ()


@dataclass(frozen=True)
class AxisSelection:
    """Outcome of the search on one axis.

    Attributes:
        axis: Letter.
        given: The machine as it is, nuisances fitted.
        sheet: With the data sheet fitted within its priors.
        ladder: The models on the way, one cause more each; the last is the final one before competing models.
        fit: The final model.
        found: Its causes, the largest gain first.
        gains: Read back from recorded outputs.
        order: Keys of the causes in the order of the ladder.
    """

    axis: str
    given: AxisFit
    sheet: AxisFit
    ladder: tuple[AxisFit, ...]
    fit: AxisFit
    found: tuple[FoundCause, ...]
    gains: tuple[GainsRead, ...] = ()
    order: tuple[str, ...] = ()


class AxisSearch:
    """The search on one axis.

    Args:
        machine: As given.
        data: All recordings of the axis.
        threads: Simulations side by side.
        settings: What decides.
        progress: Called as work gets on.
    """

    def __init__(
        self,
        machine: Machine,
        data: Sequence[AxisData],
        threads: int = 2,
        settings: DiagnosisSettings = DIAGNOSIS,
        progress: Progress = silent,
    ) -> None:
        self.machine, self.settings, self.progress = machine, settings, progress
        self.fitter = LogFitter(data, threads)
        self.catalogue = Catalogue(machine, data)
        self.axis = data[0].axis
        self.gains = read_gains(machine, data)

    def run(self, max_effects: int = 8) -> AxisSelection:
        """Search with at most ``max_effects`` causes."""
        given = self.fitter.fit(nuisance_model(self.machine, self.fitter.data))
        fit = sheet = self.fitter.fit(start_model(self.machine, self.fitter.data, self.gains))
        found: list[Candidate] = []
        ladder = [fit]
        while len(found) < max_effects:
            self.progress(f"axis {self.axis}: cause {len(found) + 1}", len(found), max_effects)
            better = self._best_extension(fit)
            if better is None:
                break
            candidate, fit = better
            found.append(candidate)
            ladder.append(fit)
        fit = self.fitter.polished(fit)
        causes = []
        for i, candidate in enumerate(found):
            self.progress(f"axis {self.axis}: what competes", i, len(found))
            causes.append(self._against_competing(fit, candidate))
        kept = tuple(sorted((c for c in causes if c.gain > 0.0), key=lambda c: -c.gain))
        return AxisSelection(
            self.axis, given, sheet, tuple(ladder), fit, kept, tuple(self.gains), tuple(c.key for c in found)
        )

    # -- growing -------------------------------------------------------------------------------------------------------

    def ranked(self, fit: AxisFit) -> list[tuple[float, Candidate, AxisModel]]:
        """Candidates with the gain that one linear step from their starts promises, the best start of each."""
        best: dict[str, tuple[float, Candidate, AxisModel]] = {}
        # a data sheet that was bent to stand for what is missing hides it: the printed one is often nearer
        printed = self.fitter.evaluated(fit.model.as_printed())
        handicap = -gain(printed, replace(fit, independent=printed.independent))
        for base, start in ((fit, 0.0), (printed, handicap)):
            for candidate in self.catalogue.missing(fit.model):
                promised, model = self._promise(base, candidate)
                promised += start
                if candidate.key not in best or promised > best[candidate.key][0]:
                    best[candidate.key] = (promised, candidate, model)
        return sorted(best.values(), key=lambda row: -row[0])

    def _promise(self, fit: AxisFit, candidate: Candidate) -> tuple[float, AxisModel]:
        model = candidate.extend(fit.model)
        if candidate.effect.kind in WAVES.values():
            model = self._with_phases(fit, model, candidate.effect)
        names = {e.label for e in candidate.entries}
        vector = model.vector
        residual = self.fitter.residual(model, vector)
        new = [j for j, e in enumerate(model.entries) if e.label in names or fit.model.place(e.label) is None]
        columns = self.fitter.columns(model, vector, residual, new)
        old = [j for j, e in enumerate(fit.model.entries) if model.place(e.label) is not None and e.label not in names]
        deviation = np.array(
            [fit.model.entries[j].deviation for j in old] + [model.entries[j].deviation for j in new], dtype=float
        )
        size = [np.hstack([d[:, old], c]) * w for d, c, w in zip(fit.design, columns, fit.weight, strict=True)]
        white = [r * w for r, w in zip(residual, fit.weight, strict=True)]
        design, target = np.vstack(size), np.concatenate(white)
        normal = design.T @ design + np.diag(deviation**-2.0)
        step = np.linalg.solve(normal + 1e-9 * np.diag(np.diag(normal)), design.T @ target)
        bounds = [fit.model.entries[j].bounds for j in old] + [model.entries[j].bounds for j in new]
        now = np.array([fit.model.vector[j] for j in old] + [vector[j] for j in new])
        step = np.clip(now + step, *np.array(bounds).T) - now
        left = [w - s @ step for w, s in zip(white, size, strict=True)]
        before = [r * w for r, w in zip(fit.residual, fit.weight, strict=True)]
        ratios = [np.log(max(b @ b, 1e-30) / max(a @ a, 1e-30)) for a, b in zip(left, before, strict=True)]
        more = len(model.entries) - len(fit.model.entries) - 1
        promised = float(np.array(self.fitter.independent(left)) @ ratios)
        return promised - self.settings.parameter_penalty * more, model

    def _with_phases(self, fit: AxisFit, model: AxisModel, effect: Effect) -> AxisModel:
        """A model with a wave over the screw's angle: its phase is each set-up's own, started from a linear fit."""
        label, kind = effect.id, effect.kind
        i, j = model.place(f"{label}.cosine"), model.place(f"{label}.sine")
        assert i is not None and j is not None
        zero = model.vector
        zero[[i, j]] = 1e-6, 0.0
        columns = self.fitter.columns(model, zero, fit.residual, [i, j])
        waves: dict[str, list[np.ndarray]] = {}
        for k, d in enumerate(self.fitter.data):
            design = np.hstack([columns[k], fit.design[k]]) * fit.weight[k]
            right = np.array([0.0, 0.0] + [e.deviation for e in fit.model.entries])
            ridge = np.where(right > 0.0, np.maximum(right, 1e-9), 1e3) ** -2.0
            part = np.linalg.solve(design.T @ design + np.diag(ridge), design.T @ (fit.residual[k] * fit.weight[k]))
            waves.setdefault(d.test.setup, []).append(part[:2])
        means = {setup: np.mean(parts, axis=0) for setup, parts in waves.items()}
        first = means[self.fitter.first_setup]
        amplitude = float(np.mean([np.hypot(*w) for w in means.values()]))
        angle = float(np.arctan2(first[1], first[0]))
        entries = []
        for e in model.entries:
            if e.owner == label and e.name in ("cosine", "sine"):
                value = amplitude * (np.cos(angle) if e.name == "cosine" else np.sin(angle)) * e.scale
                entries.append(replace(e, value=float(value)))
            elif e.owner != PHASE or e.name != kind:
                entries.append(e)
        for setup, wave in means.items():
            if setup != self.fitter.first_setup:
                turned = float(np.arctan2(wave[1], wave[0])) - angle
                entries.append(Entry(PHASE, kind, turned, setup, deviation=10.0))
        return AxisModel(model.machine, model.axis, tuple(entries))

    def _best_extension(self, fit: AxisFit) -> tuple[Candidate, AxisFit] | None:
        """The cause that lowers the residuals most, fitted, or ``None`` where none pays."""
        trials: list[tuple[float, Candidate, AxisFit]] = []
        for promised, candidate, model in self.ranked(fit)[:_SHORTLIST]:
            if trials and promised < 0.3 * max(t[0] for t in trials):
                continue
            trial = self.fitter.fit(model, rounds=2)
            more = len(model.entries) - len(fit.model.entries) - 1
            trials.append((gain(fit, trial) - self.settings.parameter_penalty * more, candidate, trial))
        if not trials:
            return None
        best = max(trials, key=lambda t: t[0])
        close = best[0] - self.settings.indistinguishable
        best = next((t for t in trials if t[1].effect.kind in SIMPLER and t[0] > close), best)
        if best[0] < self.settings.likelihood_ratio or not _visible(fit, best[2]):
            return None
        return best[1], self.fitter.fit(best[2].model, rounds=2)

    # -- what competes -------------------------------------------------------------------------------------------------

    def _against_competing(self, fit: AxisFit, candidate: Candidate) -> FoundCause:
        """What one cause contributes, and what does as well in its place."""
        without = self.fitter.fit(self._less(fit.model, candidate), rounds=2, steps=5)
        own = gain(without, fit)
        alternatives, rejected = [], {}
        rows = [r for r in self.ranked(without) if r[1].key != candidate.key]
        for promised, other, model in rows[:_COMPETING]:
            if promised < 0.3 * own:
                rejected[other.effect.id] = round(own - max(promised, 0.0), 1)
                continue
            trial = self.fitter.fit(model, rounds=2, steps=5)
            worse = gain(trial, fit)
            if worse < self.settings.indistinguishable and other.effect.id != candidate.effect.id:
                alternatives.append(other.effect.id)
            else:
                rejected[other.effect.id] = round(worse, 1)
        shows = without.mean_squares > (1.0 + _SHOWS) * fit.mean_squares
        tests = tuple(d.name for d, there in zip(self.fitter.data, shows, strict=True) if there)
        return FoundCause(candidate.key, candidate.effect.id, own, tuple(alternatives), rejected, tests)

    def _less(self, model: AxisModel, candidate: Candidate) -> AxisModel:
        """A model without one cause."""
        if not candidate.shape:
            return model.without(candidate.effect.id, self.machine.effect(candidate.effect.id))
        names = {e.label for e in candidate.entries}
        entries = tuple(e for e in model.entries if e.label not in names)
        effect = model.machine.effect(candidate.effect.id)
        assert effect is not None
        plain = {
            e.name: p.default for e in candidate.entries for p in effect.parameters_of(self.axis) if p.name == e.name
        }
        return AxisModel(model.machine.with_effect(effect.replaced(**plain)), model.axis, entries)


def _visible(less: AxisFit, more: AxisFit) -> bool:
    """Whether a cause lowers the RMS of some recording by more than a trifle."""
    ratio = np.sqrt(more.mean_squares / np.maximum(less.mean_squares, 1e-30))
    return bool(ratio.min() < 1.0 - _LEAST_SHARE)
