"""Models with one candidate effect more or less than a fitted one: how they are ranked, started and fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.estimation.criteria import looks_like, penalised_objective, start_share
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import CONVERGED, Fit, Fitter
from mjsim.estimation.nuisance import TRIGGERS
from mjsim.estimation.one_direction import one_direction_candidates
from mjsim.estimation.signatures import Candidate, Projector, Row, SignatureBank
from mjsim.estimation.spectrum import sides_of, spectral_candidates, wave
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect
from mjsim.progress import Progress, silent

#: Gauss-Newton steps of the final model at most.
_MANY_STEPS = 30


class CandidateModels:
    """Fits candidate models. ``progress(stage, done, total)`` is called as work gets on."""

    def __init__(self, fitter: Fitter, progress: Progress = silent) -> None:
        self.fitter, self.problem, self.progress = fitter, fitter.problem, progress
        self.settings = fitter.problem.settings

    def start(self) -> Fit:
        """The machine as given, its data sheet calibrated: exactly where it looks healthy, linearised where an
        effect bends it.
        """
        linear = self.fitter.fit([], exact=False)
        return (
            self.exact_refit(linear) if np.abs(linear.sheet_deviation).max() < self.settings.distorted_sheet else linear
        )

    def objective(self, fit: Fit) -> float:
        return penalised_objective(fit, self.settings)

    def penalty(self, c: Candidate) -> float:
        """Penalty of a candidate's free parameters beyond the first, and of its direction."""
        further = len(EffectVector(c.effect, c.names).vector) - 1
        return self.settings.parameter_penalty * further + self.settings.direction_penalty * (
            "direction" in c.effect.values
        )

    def ranked_candidates(self, fit: Fit, bank: SignatureBank) -> list[Row]:
        """Best possible starting point of every effect at the residual of ``fit``, best first; gains are net of the
        parameters' penalty.
        """
        projector = Projector(fit)
        rows = projector.screen(bank)
        rows += projector.rows(one_direction_candidates(fit, bank, rows))
        for axis in self.fitter.machine.chain.letters:
            rows += projector.rows(spectral_candidates(self.problem, fit, bank, axis))
        rows = self.net(rows)
        rows.sort(key=lambda r: -r[0])
        best: dict[str, tuple] = {}
        for row in rows:
            best.setdefault(row[2].effect.key, row)
        return list(best.values())

    def net(self, rows: list[Row]) -> list[Row]:
        """Gains of candidates, net of the parameters' penalty, and where a fit of each starts."""
        shares = [start_share(self.fitter.machine, x, c) for _, x, c in rows]
        return [
            (g * t * (2.0 - t) - self.penalty(c), t * x, c)
            for (g, x, c), t in zip(rows, shares, strict=True)
            if t > 0.0
        ]

    def look_alikes(self, fit: Fit, effect: Effect, bank: SignatureBank) -> list[Row]:
        """What makes sense in the place of ``effect`` at any size, as rows of :meth:`ranked_candidates`."""
        mine = [
            (c, bank.matrix[:, columns])
            for c, columns in zip(bank.candidates, bank.slices, strict=True)
            if looks_like(c.effect, effect)
        ]
        return [(gain - self.penalty(c), x, c) for gain, x, c in Projector(fit).rows(mine)]

    def first_order(self, fit: Fit, axis: str, bank: SignatureBank) -> list[Row]:
        """A wave of one period per turn beside the other waves of a pitch error of ``axis``, as rows of
        :meth:`ranked_candidates`: the spectrum does not see it, and it acts as the wind-up by an unbalance does.
        """
        present = [f.effect for f in fit.effects if f.effect.search.scanned and f.effect.subject == axis]
        if not present or not is_rotary(axis):
            return []
        waves = bank.whitened([wave(e, 1.0) for e in present], [sides_of(bank, e, 1.0) for e in present])
        return [(gain - self.penalty(c), x, c) for gain, x, c in Projector(fit).rows(waves)]

    def refit(self, effects: list[EffectVector], start: Fit, c: Candidate) -> Fit:
        """Joint fit with a candidate: exact where a drive changes, since drives bend the data sheet's linear
        columns.
        """
        exact = not c.effect.search.quasi_static and start.sum_squares < self.settings.close_fit * self.problem.count
        steps = 5 if exact else 4
        fit = self.fitter.fit(effects, start=start, exact=exact, iterations=steps)
        if fit.objective > start.objective:  # where the effect belongs, the set-up is too far off to start from
            fit = min(fit, self.fitter.fit(effects, exact=exact, iterations=steps), key=self.objective)
        poor = fit.sum_squares > self.settings.complete_fit * self.problem.count
        if poor and "phase_deg" in c.names and self._mistimed(start):
            turned = [self.fitter.fit(_turned(effects, c, a), exact=exact, iterations=steps) for a in (120.0, 240.0)]
            fit = min(fit, *turned, key=self.objective)
        return fit if exact or c.effect.search.quasi_static else self.exact_refit(fit)

    def _mistimed(self, fit: Fit) -> bool:
        """Whether the triggers may stand where they follow a wave that the model lacks: then the phase of its linear
        estimate means nothing.
        """
        return bool(np.abs(fit.nuisance[self.problem.nuisances[TRIGGERS]]).max() > self.settings.distorted_trigger)

    def exact_refit(self, fit: Fit, iterations: int = 6) -> Fit:
        """Exact refit of a model that comes near the data; while effects are missing the data sheet would be driven
        far off.
        """
        if fit.sum_squares > self.settings.close_fit * self.problem.count:
            return fit
        # a linearised data sheet that was moved far is a symptom of the linearisation: start exactly, and near the
        # sheet
        limit = self.settings.close_sheet
        near = replace(fit, sheet_deviation=np.clip(fit.sheet_deviation, -limit, limit))
        exact = self.fitter.fit(fit.effects, start=near, exact=True, iterations=iterations)
        return exact if exact.objective < fit.objective + self.settings.likelihood_ratio else fit

    def settled(self, fit: Fit) -> Fit:
        """``fit`` carried on until it stands still: a search stops its fits earlier, and in a narrow valley, as that
        of amplitude and time constant of a slow drift, far from its end.
        """
        if fit.linear.gain(fit.step) < CONVERGED or fit.sum_squares > self.settings.close_fit * self.problem.count:
            return fit
        return self.fitter.fit(fit.effects, start=fit, iterations=_MANY_STEPS)

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

    def start_without(self, without: Fit, fit: Fit, rest: list[EffectVector]) -> Fit:
        """Where competing models start: at ``without``, or where ``fit`` ended.

        The latter holds if the lack of the effect has moved triggers or data sheet away from there: a competing model
        that explains the data as well has them where ``fit`` has.
        """
        at = self.problem.nuisances[TRIGGERS]
        triggers = np.abs(without.nuisance[at] - fit.nuisance[at]).max()
        if (
            triggers < self.settings.distorted_trigger
            and np.abs(without.sheet_deviation - fit.sheet_deviation).max() < self.settings.distorted_sheet
        ):
            return without
        return self.fitter.fit(rest, start=fit, exact=False, iterations=0, fresh=False)


def _turned(effects: list[EffectVector], c: Candidate, angle: float) -> list[EffectVector]:
    """The effects with the candidate's phase ``angle`` ° further."""

    def one(f: EffectVector) -> EffectVector:
        phase = (f.effect.values["phase_deg"] + angle + 180.0) % 360.0 - 180.0
        return EffectVector(f.effect.replaced(phase_deg=phase), f.names)

    return [one(f) if f.effect.key == c.effect.key else f for f in effects]
