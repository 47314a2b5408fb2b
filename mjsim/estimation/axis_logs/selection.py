"""Which causes an axis lacks: forward search with joint refits, then each one found against what competes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjsim.estimation.axis_logs.as_given import fit_as_given
from mjsim.estimation.axis_logs.candidates import FRICTION, Candidate, Catalogue
from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.entries import CONTROLLER, AxisModel, Entry
from mjsim.estimation.axis_logs.fit import AxisFit, LogFitter, gain, misfits
from mjsim.estimation.axis_logs.found import AxisSelection, FoundCause
from mjsim.estimation.axis_logs.gains import read_gains
from mjsim.estimation.axis_logs.likelihood import Gain
from mjsim.estimation.axis_logs.probability import probability_of
from mjsim.estimation.axis_logs.promise import linear_step
from mjsim.estimation.axis_logs.start import start_model
from mjsim.estimation.axis_logs.trials import Trial, ahead, taken
from mjsim.estimation.axis_logs.trifles import is_trifle
from mjsim.estimation.axis_logs.waves import strongest_orders
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import Workers

#: Candidates that are fitted in one step of the search, and in the place of one that was found.
_SHORTLIST, _COMPETING = 2, 1
#: Relative standard deviation of a position gain that is taken as stated (assumed).
_STATED = 0.03
#: Share of the largest gain that a candidate must promise to be fitted.
_WORTH = 0.3
#: Causes up to which a search starts from the printed data sheet as well.
_FIRST = 3
#: Numbers on which the motion depends so nonlinearly that a fit can end in a wrong valley, and the factors on them from
#: which it is tried again.
_CURVED, _RESTARTS = ("presliding_rad", "velocity_rad_per_s", "stribeck_velocity_rad_per_s"), (0.2, 5.0)
#: Steps of a fit that only has to be good enough for a comparison; it ends where the objective falls by less in one.
_SHORT, _SLOWING = 10, 5.0
#: Steps after which candidates are compared: those that are ahead go on.
_FEW = 3
#: Share by which the mean square of a recording grows without a cause that shows in it (assumed).
_SHOWS = 0.02


class AxisSearch:
    """The search on one axis.

    Args:
        machine: As given.
        data: All recordings of the axis.
        threads: Simulations side by side.
        settings: What decides.
        progress: Called as work gets on.
        shared: Numbers that another instrument knows, with what it knows as their priors.
    """

    def __init__(
        self,
        machine: Machine,
        data: Sequence[AxisData],
        threads: int = 2,
        settings: DiagnosisSettings = DIAGNOSIS,
        progress: Progress = silent,
        shared: Sequence[Entry] = (),
    ) -> None:
        self.machine, self.settings, self.progress, self.shared = machine, settings, progress, tuple(shared)
        # one fit does not keep all cores busy; of its own, as these fits wait for the simulations of the fitter's
        self._fits = Workers(threads)
        self.axis = data[0].axis
        self._prepare(machine, data, threads)

    def _prepare(self, machine: Machine, data: Sequence[AxisData], threads: int) -> None:
        """What fits, what is looked for, and what recorded outputs say."""
        self.fitter = LogFitter(machine, data, threads)
        self.gains = read_gains(machine, data)
        self.catalogue = Catalogue(machine, data, self.gains)

    def run(self, max_effects: int = 8) -> AxisSelection:
        """Search with at most ``max_effects`` causes."""
        given = self.as_given()
        if all(np.ptp(d.record.command) <= d.resolution for d in self.fitter.data):  # it stood still all the time
            return AxisSelection(self.axis, given, given, (given,), self.fitter.polished(given), ())
        fit = sheet = self.sheet()
        found, ladder = self._opening(fit) if max_effects else ([], [fit])
        fit, restarted = ladder[-1], 0
        while len(found) < max_effects:
            self.progress(f"axis {self.axis}: cause {len(found) + 1}", len(found), max_effects)
            better = self._best_extension(fit, sheet=len(found) < _FIRST)
            if better is None and restarted < len(found):
                fresh, restarted = self._restarted(fit), len(found)
                if fresh is not None:
                    fit = ladder[-1] = fresh
                    continue
            if better is None:
                break
            candidate, fit = better
            found.append(candidate)
            ladder.append(fit)
        order = [c.key for c in found]
        lesser, fit = self._pruned(found, fit)
        if found:
            # the causes that are left may need a data sheet that was not bent for those that came before them
            fresh = self.fitter.fit(fit.model.as_printed())
            if float(np.diff(misfits([fresh, fit]))[0]) > self.settings.indistinguishable:
                lesser, fit = self._pruned(list(lesser), fresh)
        fit = self.fitter.polished(self._as_stated(fit))

        def judged(row: tuple[int, tuple[Candidate, AxisFit | None]]) -> FoundCause:
            self.progress(f"axis {self.axis}: what competes", row[0], len(lesser))
            return self._against_competing(fit, *row[1])

        causes = self._fits.map(judged, enumerate(lesser.items()))
        kept = tuple(sorted((c for c in causes if c.gain > 0.0), key=lambda c: -c.gain))
        return AxisSelection(self.axis, given, sheet, tuple(ladder), fit, kept, tuple(self.gains), tuple(order))

    def as_given(self) -> AxisFit:
        """The machine as it is."""
        return fit_as_given(self.fitter, self.machine)

    def orders(self, fit: AxisFit) -> list[float]:
        """Orders of waves over the motor's angle that stand out of what a fit leaves."""
        return strongest_orders(self.fitter, fit)

    def sheet(self) -> AxisFit:
        """The data sheet fitted within its priors."""
        return self.fitter.fit(start_model(self.machine, self.fitter.data, self.gains, self.shared))

    def _short(self, model: AxisModel, former: AxisFit | None = None, steps: int = _SHORT) -> AxisFit:
        """A fit that is good enough for a comparison, with the derivatives of a ``former`` one to begin with."""
        return self.fitter.fit(model, steps, 1, least=_SLOWING, former=former)

    # -- growing -------------------------------------------------------------------------------------------------------

    def _opening(self, sheet: AxisFit) -> tuple[list[Candidate], list[AxisFit]]:
        """The first causes and the models with them, from the printed data sheet.

        Every axis has friction, and a wrong integral time changes what friction does: looked for one after the other,
        each is hidden by a data sheet that was bent to stand for both.
        """
        printed, none = sheet.model.as_printed(), [c for c in self.catalogue.missing(sheet.model)]
        friction = [c for c in none if c.effect.kind == FRICTION and not c.shape]
        times = [c for c in none if c.effect.kind == "integral_time"]
        found, ladder = [], [sheet]
        for first, seconds in ((friction, times), (times, [])):
            alone = self._best_of([c.extend(printed) for c in first])
            pairs = [b.extend(a.extend(printed)) for a in first for b in seconds]
            if alone is None:
                continue
            pair = self._best_of(pairs)
            here = [(first[0], alone), (seconds[0], pair)] if pair is not None and seconds else [(first[0], alone)]
            if gain(sheet, here[-1][1]) - self.settings.parameter_penalty * len(here) < self.settings.likelihood_ratio:
                continue
            for candidate, fit in here:
                if gain(ladder[-1], fit) > self.settings.likelihood_ratio:
                    found.append(candidate)
                    ladder.append(fit)
            if found:
                break
        return found, ladder

    def _best_of(self, models: Sequence[AxisModel]) -> AxisFit | None:
        """The best fit of models that differ in their starts, the best of short ones carried on."""
        short = self._fits.map(self._short, models)
        return self.fitter.fit(short[int(np.argmin(misfits(short)))].model) if short else None

    def ranked(self, fit: AxisFit, sheet: bool = False) -> list[tuple[Gain, Candidate, AxisModel]]:
        """Candidates with the gain that one linear step from their starts promises, the best start of each.

        Args:
            fit: Of the model that they extend.
            sheet: Also start from the printed data sheet: one that was bent to stand for what is missing hides it.
        """
        best: dict[str, tuple[Gain, Candidate, AxisModel]] = {}
        orders, bases = self.orders(fit), [fit]
        if sheet:
            bases.append(self.fitter.evaluated(fit.model.as_printed()))
        for base in bases:
            for candidate in self.catalogue.missing(fit.model, orders):
                step = linear_step(self.fitter, base, candidate)
                promised = step.gain(fit, self.fitter, self.settings.parameter_penalty)
                if candidate.key not in best or promised.largest > best[candidate.key][0].largest:
                    best[candidate.key] = (promised, candidate, step.model)
        return sorted(best.values(), key=lambda row: -row[0].slow)

    def _restarted(self, fit: AxisFit) -> AxisFit | None:
        """A better fit of the same model from other ways and speeds of its friction; nothing where none is."""
        best = fit
        for j, e in enumerate(fit.model.entries):
            for factor in _RESTARTS if e.name in _CURVED else ():
                moved = best.model.vector
                moved[j] = np.clip(e.encode(e.value * factor), *e.bounds)
                trial = self._short(best.model.with_values(moved))
                if -float(np.diff(misfits([best, trial]))[0]) > self.settings.indistinguishable:
                    best = self.fitter.fit(trial.model)
        return best if best is not fit else None

    def _best_extension(self, fit: AxisFit, sheet: bool) -> tuple[Candidate, AxisFit] | None:
        """The cause that lowers the residuals most, fitted, or ``None`` where none pays."""
        rows = self.ranked(fit, sheet)
        fine = sorted(rows, key=lambda row: -row[0].fine)
        shortlist = {row[1].key: row for row in (*rows[:_SHORTLIST], *fine[:_SHORTLIST])}
        penalty = self.settings.parameter_penalty

        def is_worth(promised: Gain) -> bool:
            share = max(promised.slow / max(rows[0][0].slow, 1.0), promised.fine / max(fine[0][0].fine, 1.0))
            return promised.largest >= 0.3 * self.settings.likelihood_ratio and share >= _WORTH

        trials = self._fits.map(
            lambda row: Trial.of(fit, row[1], self._short(row[2], fit, _FEW), penalty),
            [row for row in shortlist.values() if is_worth(row[0])],
        )
        for best in ahead(trials):  # they go on, until one is taken
            further = self._short(best.fit.model, best.fit)
            trials[trials.index(best)] = Trial.of(fit, best.candidate, further, penalty)
            if taken(fit, trials, self.settings, only_size=True):
                break
        best = taken(fit, trials, self.settings)
        if best is None:
            return None
        return best.candidate, self.fitter.fit(best.fit.model, _SHORT, former=best.fit)

    def _pruned(self, found: list[Candidate], fit: AxisFit) -> tuple[dict[Candidate, AxisFit | None], AxisFit]:
        """The causes that the final model still needs: one that was found early may stand for others found later.

        Each comes with the fit without it, where the model did not change afterwards.
        """
        kept: dict[Candidate, AxisFit | None] = {}
        for candidate in found:
            without = self._short(candidate.taken_from(fit.model, self.machine), fit)
            if is_trifle(fit.model, candidate) or gain(without, fit) < self.settings.likelihood_ratio:
                fit = self.fitter.fit(without.model, former=without)
                kept = dict.fromkeys(kept)
            else:
                kept[candidate] = without
        return kept, fit

    def _as_stated(self, fit: AxisFit) -> AxisFit:
        """The model with the position gains of the sheet where the recordings do not contradict them.

        A position gain and an integral time are the two zeros of a P-PI cascade: near each other, a fit moves them
        apart at little gain. A setting that was read from the control is believed before that.
        """
        for e in fit.model.entries:
            if e.owner != CONTROLLER or e.name != "position_gain" or e.deviation <= _STATED:
                continue
            now, stated = fit.model.entries, e.decode(e.mean)
            held = replace(e, value=stated, deviation=_STATED, centre=stated)
            model = replace(fit.model, entries=tuple(held if f.label == e.label else f for f in now))
            trial = self._short(model, fit)
            if gain(trial, fit) < self.settings.likelihood_ratio:
                fit = trial
        return fit

    # -- what competes -------------------------------------------------------------------------------------------------

    def _against_competing(self, fit: AxisFit, candidate: Candidate, without: AxisFit | None) -> FoundCause:
        """What one cause contributes, beyond the fit ``without`` it, and what does as well in its place."""
        without = without or self._short(candidate.taken_from(fit.model, self.machine), fit)
        own = gain(without, fit)
        competing, rejected = {}, {}
        # the same effect at another order, or in another shape, is no other cause
        rows = [r for r in self.ranked(without) if r[1].effect.id != candidate.effect.id]
        for promised, other, model in rows[:_COMPETING]:
            if promised.largest < 0.3 * own:
                rejected[other.effect.id] = round(own - max(promised.largest, 0.0), 1)
                continue
            trial = self._short(model, without)
            worse = gain(trial, fit)
            if worse < self.settings.indistinguishable:
                competing[other.effect.id] = trial
            else:
                rejected[other.effect.id] = round(worse, 1)
        shows = without.mean_squares > (1.0 + _SHOWS) * fit.mean_squares
        tests = tuple(d.name for d, there in zip(self.fitter.data, shows, strict=True) if there)
        p = probability_of(candidate, fit, without, self.fitter.data)
        return FoundCause(candidate.key, candidate.effect.id, own, tuple(competing), rejected, tests, competing, p)
