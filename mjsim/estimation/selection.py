"""Which effects are missing: forward search with joint refits, then every effect found is tried against its competing models."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.estimation.criteria import (
    ONE_WAY,
    PRICE,
    THRESHOLD,
    VISIBLE,
    is_feasible,
    is_large_enough,
    parameter_count,
    penalised_objective,
    wald_statistic,
)
from mjsim.estimation.curve_search import DONE, best_curve_term, is_overfit
from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit, Fitter, unabsorbed
from mjsim.estimation.one_direction import one_direction_rows
from mjsim.estimation.signatures import Candidate, Projector, SignatureBank, seeds
from mjsim.estimation.spectrum import spectral_candidates
from mjsim.machine.chain import AXES
from mjsim.machine.model import build
from mjsim.progress import Progress, silent

#: A competing model whose objective is within this of the winner's cannot be told from it (likelihood ratio e^6).
RIVAL = 12.0
_SHORTLIST = 5
#: Parameters from which a model is suspected to overfit, and at which the search ends.
_PILE, _MOST = 5, 24
#: Mean squared whitened residual below which a model counts as near; data-sheet moves (standard deviations) that an exact fit starts from.
_NEAR, _FAR = 6.0, 2.0
#: A data sheet that is moved by so many standard deviations is hiding an effect.
_BENT = 5.0
#: Triggers (standard deviations) that are further off without an effect than with it do not serve its competing models.
_DRAGGED = 1.0
#: Fall of the penalised objective by which a free shape must pay.
_SHAPE = 4.0


@dataclass
class Found:
    """One missing effect of the final model: its key, and the models with another effect in its place that the data cannot tell from it,
    by that effect's id. ``gain`` is how far the objective falls with it; ``rejected`` how much worse the others that were fitted in its
    place do, by id; where none came near enough to be fitted, the best of them by its linear gain."""

    key: str
    gain: float
    competing: dict[str, Fit] = field(default_factory=dict)
    rejected: dict[str, float] = field(default_factory=dict)

    @property
    def alternatives(self) -> tuple[str, ...]:
        return tuple(self.competing)


@dataclass
class Selection:
    """Outcome: the model without missing effects, the final one, and what was found in the order of contribution; ``first`` is what
    the first effect alone explained, ``alone`` the generic term that explains most at ``start``, where it was looked for."""

    start: Fit
    fit: Fit
    found: list[Found]
    bank: SignatureBank
    trail: list[dict] = field(default_factory=list)
    first: float = 0.0
    best_curve: CurveTerm | None = None


class ModelSelection:
    """Runs one search. ``progress(stage, done, total)`` is called as work gets on."""

    def __init__(self, fitter: Fitter, progress: Progress = silent) -> None:
        self.fitter, self.problem, self.progress = fitter, fitter.problem, progress
        self._best_curve: CurveTerm | None = None
        self._first = 0.0
        self._tried: set[tuple] = set()

    def run(self, max_effects: int = 5) -> Selection:
        """Search with at most ``max_effects`` effects."""
        start = self.start()
        bank = SignatureBank(self.problem, start)
        candidates = seeds(self.fitter.machine)
        count = [0]

        def tick() -> None:
            count[0] += 1
            self.progress("signatures", count[0], len(candidates))

        bank.compute(candidates, tick)
        fit, trail = start, []
        while True:
            better = self._best_extension(fit, bank, trail, len(fit.effects) < max_effects)
            reshaped = self._with_free_shapes(fit)
            if reshaped is not fit:
                fit = reshaped
            elif better is None or self._is_overfit(start, better):
                fit = better or fit
                break
            else:
                self._first = self._first or penalised_objective(fit) - penalised_objective(better)
                fit = better
        fit = self._prune(fit)
        found = []
        if fit.effects:
            fit, found = self._against_competing(fit, bank)
        return Selection(start, fit, found, bank, trail, self._first, self._best_curve)

    def start(self) -> Fit:
        """The machine as given, its data sheet calibrated: exactly where it looks healthy, linearised where an effect bends it."""
        linear = self.fitter.fit([], exact=False)
        return self._exact_refit(linear) if np.abs(linear.sheet_deviation).max() < _BENT else linear

    # -- growing -------------------------------------------------------------------------------------------------------

    def ranked_candidates(self, fit: Fit, bank: SignatureBank) -> list[tuple[float, np.ndarray, Candidate]]:
        """Best possible starting point of every effect at the residual of ``fit``, best first; gains are net of the parameters' penalty."""
        projector = Projector(fit)
        rows = projector.screen(bank)
        rows += one_direction_rows(fit, bank, rows)
        for axis in AXES:
            waves = spectral_candidates(self.problem, fit, bank, axis)
            gains = projector.gains([columns for _, columns in waves])
            rows += [(*gain, candidate) for gain, (candidate, _) in zip(gains, waves, strict=True)]
        rows = [
            (g - PRICE * (len(EffectVector(c.effect, c.names).vector) - 1) - ONE_WAY * ("direction" in c.effect.values), x, c)
            for g, x, c in rows
            if is_feasible(self.fitter.machine, x, c)
        ]
        rows.sort(key=lambda r: -r[0])
        best: dict[str, tuple] = {}
        for row in rows:
            best.setdefault(row[2].effect.key, row)
        return list(best.values())

    def _best_extension(self, fit: Fit, bank: SignatureBank, trail: list[dict], new_allowed: bool) -> Fit | None:
        """The best model with one effect (or one pitch-error component) more, or ``None``."""
        have = {f.effect.key for f in fit.effects}
        rows = [r for r in self.ranked_candidates(fit, bank) if r[0] > 0.5 * THRESHOLD]
        rows = [r for r in rows if (r[2].effect.search.scanned if r[2].effect.key in have else new_allowed)]
        if not rows or rows[0][0] < THRESHOLD:
            return None
        shortlist = [r for r in rows if r[0] > 0.3 * rows[0][0]][:_SHORTLIST]
        best: Fit | None = None
        for i, (gain, x, c) in enumerate(shortlist):
            if best is not None and gain < 0.5 * (penalised_objective(fit) - penalised_objective(best)):
                continue
            self.progress(f"model {len(fit.effects) + 1}: trying {c.id}", i, len(shortlist))
            trial = self._refit(self.extended(fit, c, x), fit, c)
            mine = next(f for f in trial.effects if f.effect.key == c.effect.key)
            if not is_large_enough(self.fitter.machine, mine) or not self.visible(trial, c.effect.key):
                continue
            trail.append({"effects": [f.effect.id for f in trial.effects], "objective": trial.objective})
            if best is None or penalised_objective(trial) < penalised_objective(best):
                best = trial
        if best is None or penalised_objective(fit) - penalised_objective(best) < THRESHOLD - PRICE:
            return None
        return self._exact_refit(best)

    def _is_overfit(self, start: Fit, fit: Fit) -> bool:
        """Whether a growing pile of effects does worse than one generic term: then more of them are no explanation either."""
        pile = parameter_count(fit)
        if pile < _PILE or fit.sum_squares < DONE * self.problem.count:
            return False
        if self._best_curve is None:
            self._best_curve = best_curve_term(self.problem, start)
        return pile >= _MOST or is_overfit(self.problem, start, fit, self._best_curve, self._first)

    def _with_free_shapes(self, fit: Fit) -> Fit:
        """``fit`` with the shapes of its effects free as well, where that pays: a wrong shape is easily taken for a second effect."""
        machine, near = self.fitter.machine, fit.sum_squares < _NEAR * self.problem.count
        for i, f in enumerate(fit.effects):
            for j, (start, names) in enumerate(f.effect.search.shapes(f.effect, machine.effect(f.effect.key))):
                attempt = (f.effect.key, j, len(fit.effects))
                if set(names) == set(fit.effects[i].names) or attempt in self._tried:
                    continue
                self._tried.add(attempt)
                self.progress(f"shape of {f.effect.id}", j, 4)
                effects = [EffectVector(start, names) if k == i else g for k, g in enumerate(fit.effects)]
                trial = self._exact_refit(self.fitter.fit(effects, start=fit, exact=near))
                if penalised_objective(trial) < penalised_objective(fit) - _SHAPE and is_large_enough(machine, trial.effects[i]):
                    fit = trial
        return fit

    def _refit(self, effects: list[EffectVector], start: Fit, c: Candidate) -> Fit:
        """Joint fit with a candidate: exact where a drive changes, since drives bend the data sheet's linear columns."""
        exact = not c.effect.search.quasi_static and start.sum_squares < _NEAR * self.problem.count
        fit = self.fitter.fit(effects, start=start, exact=exact, iterations=5 if exact else 4)
        return fit if exact or c.effect.search.quasi_static else self._exact_refit(fit)

    def _exact_refit(self, fit: Fit, iterations: int = 6) -> Fit:
        """Exact refit of a model that comes near the data; while effects are missing the data sheet would be driven far off."""
        if fit.sum_squares > _NEAR * self.problem.count:
            return fit
        # a linearised data sheet that was moved far is a symptom of the linearisation: start exactly, and near the sheet
        near = replace(fit, sheet_deviation=np.clip(fit.sheet_deviation, -_FAR, _FAR))
        exact = self.fitter.fit(fit.effects, start=near, exact=True, iterations=iterations)
        return exact if exact.objective < fit.objective + THRESHOLD else fit

    def extended(self, fit: Fit, c: Candidate, x: np.ndarray) -> list[EffectVector]:
        """Free effects of ``fit`` and the candidate at its linear estimate ``x``."""
        if c.effect.search.scanned:
            same = next((f for f in fit.effects if f.effect.key == c.effect.key), None)
            scaled = EffectVector(c.effect, c.names).at(x).values["components"]
            if same is not None:
                extended = same.effect.replaced(components=[*same.effect.values["components"], *scaled])
                return [EffectVector(extended, f.names) if f is same else f for f in fit.effects]
            present = next((e for e in self.fitter.machine.effects if e.key == c.effect.key), None)
            if present is not None:
                extended = present.replaced(components=[*present.values["components"], *scaled])
                return [*fit.effects, EffectVector(extended, c.names)]
        free = EffectVector(c.effect, c.names)
        v = free.vector
        if any(e.key == c.effect.key for e in self.fitter.machine.effects):
            v = v + x
        elif c.effect.search.scanned:
            v[: len(x)] = x
        else:
            v[free.linear] = free.neutral + x
        return [*fit.effects, EffectVector(free.at(v), c.names)]

    def visible(self, fit: Fit, key: str) -> bool:
        """Whether an effect of ``fit`` stands out of some test: significance alone would name what nobody needs to know."""
        present = self.fitter.machine.effect(key)
        without = fit.machine.without(key) if present is None else fit.machine.with_effect(present)
        parts = self.problem.difference(self.problem.readings(build(without)), fit.readings, fit.nuisance)
        parts = unabsorbed(self.problem, fit, parts)
        return any(np.std(p[s.good]) > VISIBLE * self.problem.noise.rms for p, s in zip(parts, self.problem.samples, strict=True))

    # -- pruning and competing models --------------------------------------------------------------------------------------------

    def _prune(self, fit: Fit) -> Fit:
        """Drop effects that the others have made unnecessary."""
        while fit.effects:
            trials = []
            for i, f in enumerate(fit.effects):
                if wald_statistic(self.fitter.machine, fit, i) > 20 * THRESHOLD:
                    continue
                rest = [g for j, g in enumerate(fit.effects) if j != i]
                trial = self._exact_refit(self.fitter.fit(rest, start=fit, exact=False, iterations=4))
                trials.append((penalised_objective(trial) - penalised_objective(fit), f, trial))
            if not trials:
                return fit
            loss, _, trial = min(trials, key=lambda t: t[0])
            if loss > THRESHOLD - PRICE:
                return fit
            fit = self._exact_refit(trial)
        return fit

    def _start_without(self, without: Fit, fit: Fit, rest: list[EffectVector]) -> Fit:
        """Where competing models start: at ``without``, or where ``fit`` ended.

        The latter holds if the lack of the effect has moved triggers or data sheet away from there: a competing model that explains
        the data as well has them where ``fit`` has.
        """
        first = self.problem.layout.length + 1
        triggers = np.abs(without.nuisance[first:] - fit.nuisance[first:]).max()
        if triggers < _DRAGGED and np.abs(without.sheet_deviation - fit.sheet_deviation).max() < _BENT:
            return without
        return self.fitter.fit(rest, start=fit, exact=False, iterations=0, fresh=False)

    def _against_competing(self, fit: Fit, bank: SignatureBank) -> tuple[Fit, list[Found]]:
        """For every effect: its contribution, and the catalogue entries that do as well in its place (a better one takes it)."""
        found: dict[str, Found] = {}
        index = 0
        swaps = 0
        while index < len(fit.effects):
            mine = fit.effects[index]
            rest = [f for j, f in enumerate(fit.effects) if j != index]
            without = self.fitter.fit(rest, start=fit, exact=False, iterations=3)
            gain = without.objective - fit.objective
            competing, better, rejected = {}, None, {}
            without = self._start_without(without, fit, rest)
            ranked_candidates = self.ranked_candidates(without, bank)
            own = max((r[0] for r in ranked_candidates if r[2].effect.key == mine.effect.key), default=gain)
            rows = [r for r in ranked_candidates if r[2].effect.key not in {f.effect.key for f in fit.effects}]
            # far from its seed a linear gain is a rough guide: refit everything that comes near
            close = [r for r in rows if r[0] > 0.8 * min(own, gain) - 3 * THRESHOLD][:6]
            for i, (_, x, c) in enumerate(close):
                self.progress(f"{mine.effect.id} against {c.id}", i, len(close))
                trial = self._refit(self.extended(without, c, x), without, c)
                if c.effect.search.quasi_static and penalised_objective(trial) < penalised_objective(fit) + max(10 * RIVAL, 0.05 * gain):
                    trial = self._exact_refit(trial)
                if any(not is_large_enough(self.fitter.machine, f) for f in trial.effects):
                    continue
                if penalised_objective(trial) < penalised_objective(fit) + RIVAL:
                    if c.id != mine.effect.id:
                        competing.setdefault(c.id, trial)
                    if penalised_objective(trial) < penalised_objective(fit) - 2.0 and (
                        better is None or penalised_objective(trial) < penalised_objective(better)
                    ):
                        better = trial
                elif c.id != mine.effect.id:
                    rejected[c.id] = min(penalised_objective(trial) - penalised_objective(fit), rejected.get(c.id, np.inf))
            if not (competing or rejected) and (far := next((r for r in rows if r[2].id != mine.effect.id), None)):
                rejected[far[2].id] = gain - far[0]
            if better is not None and swaps < 3:
                swaps += 1
                fit, found, index = better, {}, 0
                continue
            found[mine.effect.key] = Found(mine.effect.key, gain, competing, rejected)
            index += 1
        return fit, sorted(found.values(), key=lambda f: -f.gain)
