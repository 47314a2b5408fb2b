"""Which effects are missing: forward search with joint refits, then every effect found is tried against its
competing models.
"""

from __future__ import annotations

from mjsim.estimation.candidate_groups import CandidateGroups
from mjsim.estimation.candidate_models import CandidateModels
from mjsim.estimation.criteria import (
    is_large_enough,
    parameter_count,
    stands_for,
    wald_statistic,
)
from mjsim.estimation.curve_search import best_curve_term, is_overfit
from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.disturbances import without_disturbances
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.evidence import select
from mjsim.estimation.fit import Fit, Fitter
from mjsim.estimation.outcome import Found, Selection
from mjsim.estimation.signatures import SignatureBank, seeds
from mjsim.estimation.visibility import clear_tests
from mjsim.machine.effect import Effect
from mjsim.progress import Progress, counted, silent

#: How often a competing model may take an effect's place.
_SWAPS = 3
#: Loss, effect and model of a competitor, and what in the model is too small to be a cause.
_Row = tuple[float, Effect, Fit, list[EffectVector]]
#: Most competing models that are fitted in one effect's place.
_MOST_COMPETING = 6


class ModelSelection(CandidateModels):
    """Runs one selection.

    Effects are added while they pay. Then the needless ones are dropped, and the others are tried against what
    competes.
    """

    def __init__(self, fitter: Fitter, progress: Progress = silent) -> None:
        super().__init__(fitter, progress)
        self._best_curve: CurveTerm | None = None
        self._first_gain = 0.0
        self._tried: set[tuple] = set()

    def run(self, max_effects: int | None = None) -> tuple[Fitter, Selection]:
        """Search for a few effects that explain the data.

        Where an effect had hidden a disturbance, the search begins anew without it.

        Args:
            max_effects: At most so many. Without it, the search is given up where few effects are not enough.

        Returns:
            The fitter of the data that the search ends on, and what it found there.
        """
        while (selection := self._search(max_effects)) is None:
            self._tried, self._best_curve, self._first_gain = set(), None, 0.0
        return self.fitter, selection

    def _search(self, max_effects: int | None) -> Selection | None:
        """One search, or ``None`` where a disturbance came to light."""
        most = max_effects if max_effects is not None else self.settings.few_effects + 1
        start = self.start()
        bank = SignatureBank(self.problem, start)
        candidates = seeds(self.fitter.machine)
        bank.compute(candidates, counted(self.progress, "signatures", len(candidates)))
        fit, trail = start, []
        while True:
            better = self._best_extension(fit, bank, trail, len(fit.effects) < most)
            reshaped = self._with_free_shapes(fit)
            if reshaped is not fit:
                fit = reshaped
            elif better is None or self._is_overfit(start, better):
                fit = better or fit
                break
            else:
                self._first_gain = self._first_gain or self.objective(fit) - self.objective(better)
                fit = better
                if self._cleaned(fit):
                    return None
                if max_effects is None and self._needs_many(fit, bank):
                    return Selection(start, fit, [], bank, trail)
        fit = self.settled(self._prune(fit))
        found = []
        if fit.effects:
            fit, found = self._against_competing(fit, bank)
            fit = self.settled(fit)
        return Selection(start, fit, found, bank, trail)

    def _cleaned(self, fit: Fit) -> bool:
        """Leave out what happened once and what the effects of a model had hidden; whether there was such."""
        if fit.sum_squares < self.settings.complete_fit * self.problem.count:
            return False
        data = without_disturbances(self.problem, fit.readings, fit.nuisance)
        found = data is not self.problem
        self.problem, self.fitter = data, self.fitter.with_problem(data)
        return found

    # -- growing -------------------------------------------------------------------------------------------------------

    def _best_extension(self, fit: Fit, bank: SignatureBank, trail: list[dict], new_allowed: bool) -> Fit | None:
        """The best model with one effect (or one pitch-error component) more, or ``None``."""
        have = {f.effect.key for f in fit.effects}
        rows = [r for r in self.ranked_candidates(fit, bank) if r[0] > 0.5 * self.settings.likelihood_ratio]
        rows = [r for r in rows if (r[2].effect.search.scanned if r[2].effect.key in have else new_allowed)]
        if not rows or rows[0][0] < self.settings.likelihood_ratio:
            return None
        shortlist = [r for r in rows if r[0] > 0.3 * rows[0][0]][: self.settings.shortlist]
        best: Fit | None = None
        for i, (gain, x, c) in enumerate(shortlist):
            if best is not None and gain < 0.5 * (self.objective(fit) - self.objective(best)):
                continue
            self.progress(f"model {len(fit.effects) + 1}: trying {c.id}", i, len(shortlist))
            trial = self.refit(self.extended(fit, c, x), fit, c)
            mine = next(f for f in trial.effects if f.effect.key == c.effect.key)
            if not is_large_enough(self.fitter.machine, mine, self.settings) or not clear_tests(
                self.problem, trial, c.effect.key
            ):
                continue
            trail.append({"effects": [f.effect.id for f in trial.effects], "objective": trial.objective})
            if best is None or self.objective(trial) < self.objective(best):
                best = trial
        if (
            best is None
            or self.objective(fit) - self.objective(best)
            < self.settings.likelihood_ratio - self.settings.parameter_penalty
        ):
            return None
        return self.exact_refit(best)

    def _needs_many(self, fit: Fit, bank: SignatureBank) -> bool:
        """Whether more is left than a few further effects can explain."""
        misfit = fit.sum_squares / self.problem.count
        if misfit < self.settings.complete_fit:
            return False
        if len(fit.effects) != 1:
            return len(fit.effects) >= self.settings.few_effects
        groups = CandidateGroups.at(self.problem, fit, bank)
        needed = select(groups.problem.scaled(max(1.0, misfit)), groups.groups).precision
        return len({groups.members[g].key for g in needed}) >= self.settings.many_needed

    def _is_overfit(self, start: Fit, fit: Fit) -> bool:
        """Whether a growing pile of effects does worse than one generic term: then more of them are no explanation
        either.
        """
        count = parameter_count(fit)
        if count < self.settings.overfit_suspected or fit.sum_squares < self.settings.complete_fit * self.problem.count:
            return False
        if self._best_curve is None:
            self._best_curve = best_curve_term(self.problem, start)
        return count >= self.settings.most_parameters or is_overfit(
            self.problem, start, fit, self._best_curve, self._first_gain
        )

    def _with_free_shapes(self, fit: Fit) -> Fit:
        """``fit`` with the shapes of its effects free as well, where that pays: a wrong shape is easily taken for a
        second effect.
        """
        machine, near = self.fitter.machine, fit.sum_squares < self.settings.close_fit * self.problem.count
        for i, f in enumerate(fit.effects):
            for j, (start, names) in enumerate(f.effect.search.shapes(f.effect, machine.effect(f.effect.key))):
                attempt = (f.effect.key, j, len(fit.effects))
                if set(names) == set(fit.effects[i].names) or attempt in self._tried:
                    continue
                self._tried.add(attempt)
                self.progress(f"shape of {f.effect.id}", j, 4)
                effects = [EffectVector(start, names) if k == i else g for k, g in enumerate(fit.effects)]
                trial = self.exact_refit(self.fitter.fit(effects, start=fit, exact=near))
                pays = self.objective(trial) < self.objective(fit) - self.settings.shape_gain
                if pays and is_large_enough(machine, trial.effects[i], self.settings):
                    fit = trial
        return fit

    # -- pruning and competing models ----------------------------------------------------------------------------------

    def _prune(self, fit: Fit) -> Fit:
        """Drop effects that the others have made unnecessary."""
        while fit.effects:
            trials = []
            for i, f in enumerate(fit.effects):
                if wald_statistic(self.fitter.machine, fit, i) > 20 * self.settings.likelihood_ratio:
                    continue
                rest = [g for j, g in enumerate(fit.effects) if j != i]
                trial = self.exact_refit(self.fitter.fit(rest, start=fit, exact=False, iterations=4))
                trials.append((self.objective(trial) - self.objective(fit), f, trial))
            if not trials:
                return fit
            loss, _, trial = min(trials, key=lambda t: t[0])
            if loss > self.settings.likelihood_ratio - self.settings.parameter_penalty:
                return fit
            fit = self.exact_refit(trial)
        return fit

    def _against_competing(self, fit: Fit, bank: SignatureBank) -> tuple[Fit, list[Found]]:
        """For every effect: its contribution, and the catalogue entries that do as well in its place (a better one
        takes it).
        """
        found: dict[str, Found] = {}
        index = swaps = 0
        while index < len(fit.effects):
            entry, better = self._competition(fit, index, bank)
            if better is not None and swaps < _SWAPS:
                swaps += 1
                fit, found, index = better, {}, 0
                continue
            found[entry.key] = entry
            index += 1
        return fit, sorted(found.values(), key=lambda f: -f.gain)

    def _competition(self, fit: Fit, index: int, bank: SignatureBank) -> tuple[Found, Fit | None]:
        """What one effect contributes and what competes with it; the best model with another effect in its place,
        if one is better.
        """
        mine = fit.effects[index]
        rest = [f for j, f in enumerate(fit.effects) if j != index]
        without = self.fitter.fit(rest, start=fit, exact=False, iterations=3)
        gain = without.objective - fit.objective
        without = self.start_without(without, fit, rest)
        ranked = self.ranked_candidates(without, bank)
        own = max((r[0] for r in ranked if r[2].effect.key == mine.effect.key), default=gain)
        have = {f.effect.key for f in fit.effects}
        small = {f.effect.key for f in self._too_small(fit)}
        others = [r for r in [*ranked, *self.look_alikes(without, mine.effect, bank)] if r[2].effect.key not in have]
        rows = [*others, *self.first_order(without, mine.effect.subject, bank)]
        rows.sort(key=lambda r: -r[0])
        # far from its seed a linear gain is a rough guide: refit everything that comes near
        close = [r for r in rows if r[0] > 0.8 * min(own, gain) - 3 * self.settings.likelihood_ratio][:_MOST_COMPETING]
        found, as_good = Found(mine.effect.key, gain), []
        for i, (_, x, c) in enumerate(close):
            self.progress(f"{mine.effect.id} against {c.id}", i, len(close))
            trial = None  # a fit is large: the one before goes first
            trial = self.refit(self.extended(without, c, x), without, c)
            near = max(10 * self.settings.indistinguishable, 0.05 * gain)
            if c.effect.search.quasi_static and self.objective(trial) < self.objective(fit) + near:
                trial = self.exact_refit(trial)
            too_small = [f for f in self._too_small(trial) if f.effect.key not in small]
            loss = self.objective(trial) - self.objective(fit)
            if loss < self.settings.indistinguishable:
                as_good.append((loss, c.effect, trial, too_small))
        better, least = None, -self.settings.better
        for loss, effect, trial in self._credible(as_good, mine.effect):
            if effect.id != mine.effect.id:
                found.competing.setdefault(effect.id, trial)
            if len(trial.effects) < len(fit.effects):  # one cause less, of which a further wave explains as much
                loss -= 2.0 * self.settings.better
            if loss < least:
                better, least = trial, loss
        return found, better

    def _credible(self, rows: list[_Row], finding: Effect) -> list[tuple[float, Effect, Fit]]:
        """Loss, effect and model of what explains the data as well as a finding. A cause of an unlikely size stays only
        beside a likely one that it looks like, where no likely one explains more.
        """
        likely = [(0.0, finding), *((loss, effect) for loss, effect, _, too_small in rows if not too_small)]
        limit = min(loss for loss, _ in likely) + self.settings.better
        return [
            (loss, effect, fit)
            for loss, effect, fit, too_small in rows
            if not too_small or (loss < limit and all(any(stands_for(f, e) for _, e in likely) for f in too_small))
        ]

    def _too_small(self, fit: Fit) -> list[EffectVector]:
        """Effects of a model that are too small to be causes of their own."""
        return [f for f in fit.effects if not is_large_enough(self.fitter.machine, f, self.settings)]
