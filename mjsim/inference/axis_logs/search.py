"""Which causes an axis lacks: the search by log evidence, on axis logs.

The loop is that of every search (:mod:`mjsim.inference.search`). What is proposed here: causes that the model does not
have, by the evidence that the first steps from their starts promise. Where none gains evidence: the model without a
cause that the others have made needless, the same model with a setting as stated, and the same model from elsewhere.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.inference.axis_logs.as_given import fit_as_given
from mjsim.inference.axis_logs.candidates import FRICTION, Candidate, Catalogue
from mjsim.inference.axis_logs.data import AxisData
from mjsim.inference.axis_logs.entries import CONTROLLER, DRIVE, AxisModel, Entry, KnownNumbers
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.found import AxisSelection, FoundCause, LogModel
from mjsim.inference.axis_logs.gains import read_gains
from mjsim.inference.axis_logs.probability import probability_known, probability_of_size
from mjsim.inference.axis_logs.promise import take_first_steps
from mjsim.inference.axis_logs.start import start_model
from mjsim.inference.axis_logs.waves import strongest_orders
from mjsim.inference.calibration import LIMIT_DEVIATIONS
from mjsim.inference.linear_evidence import margin
from mjsim.inference.search import FITTED, LEAST, RIVALS, Ascent, Proposal, names_to_tell
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent

#: Relative standard deviation of a position gain that is taken as stated (assumed).
_STATED = 0.03
#: Numbers on which the motion depends so nonlinearly that a fit can end in a wrong valley, and the factors on them from
#: which it is tried again.
_CURVED, _RESTARTS = ("presliding_rad", "velocity_rad_per_s", "stribeck_velocity_rad_per_s"), (0.2, 5.0)
#: Share by which the mean square of a recording grows without a cause that shows in it (assumed).
_SHOWS = 0.02
#: Starts of one cause that are fitted, and steps after which the best of them is known.
_STARTS, _FEW = 3, 3
#: Most changes of a model for each cause that may be found: it comes, another goes, and all are fitted anew.
_CHANGES = 3


@dataclass(frozen=True)
class Rivals:
    """What else could stand in the place of one cause.

    Attributes:
        without: The model without the cause.
        models: Models with something else in its place, and its id.
        rejected: How much less log evidence the next one promises, by id.
    """

    without: LogModel
    models: list[tuple[str, LogModel]]
    rejected: dict[str, float]


class AxisSearch(Ascent[LogModel]):
    """The search on one axis.

    Args:
        machine: As given.
        data: All recordings of the axis.
        threads: Simulations side by side.
        progress: Called as work gets on.
        known: What another instrument knows of the axis.
    """

    def __init__(
        self,
        machine: Machine,
        data: Sequence[AxisData],
        threads: int = 2,
        progress: Progress = silent,
        known: KnownNumbers | None = None,
    ) -> None:
        self.axis = data[0].axis
        super().__init__(lambda what, done, of: progress(f"axis {self.axis}: {what}", done, of))
        self.machine, self.known = machine, known
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
            return AxisSelection(self.axis, given, given, self.fitter.polished(given))
        model = LogModel(self.sheet())
        self._most, self._ladder, self._lesser = max_effects, [model], (model, {})
        while True:
            model = self._searched(model, _CHANGES * max_effects)
            rivals = [self._rivals_of(model, c) for c in model.causes]
            best = max((m for r in rivals for _, m in r.models), key=lambda m: m.evidence, default=model)
            if best.evidence <= model.evidence + LEAST:
                break
            model = best  # something else in a cause's place is the better explanation
            self._ladder.append(model)
        fit = self.fitter.polished(model.fit)
        causes = [self._cause(model, fit, c, r) for c, r in zip(model.causes, rivals, strict=True)]
        causes.sort(key=lambda c: -c.gain)
        sheet = self._ladder[0].fit
        return AxisSelection(self.axis, given, sheet, fit, tuple(causes), tuple(self.gains), tuple(self._ladder))

    def as_given(self) -> AxisFit:
        """The machine as it is."""
        return fit_as_given(self.fitter, self.machine)

    def orders(self, fit: AxisFit) -> list[float]:
        """Orders of waves over the motor's angle that stand out of what a fit leaves."""
        return strongest_orders(self.fitter, fit)

    def sheet(self) -> AxisFit:
        """The data sheet fitted within its priors."""
        return self.fitter.fit(start_model(self.machine, self.fitter.data, self.gains, self.known))

    # -- proposals -----------------------------------------------------------------------------------------------------

    def extend_by_each(self, model: LogModel) -> list[list[LogModel]]:
        """A model with every cause that it does not have, after the first steps from each of its starts; those of
        largest evidence first.

        A data sheet that was bent to stand for what is missing hides it, so steps are taken from the printed one too.
        Friction and a wrong integral time hide each other, so they are tried together.
        """
        fit = model.fit
        bases = [fit, self.fitter.evaluated(fit.model.as_printed())] if _has_bent_sheet(fit.model) else [fit]
        missing = self.catalogue.missing(fit.model, self.orders(fit))
        friction = [c for c in missing if c.effect.kind == FRICTION and not c.shape]
        pairs = itertools.product(friction, [c for c in missing if c.effect.kind == "integral_time"])
        out: dict[tuple[str, ...], list[LogModel]] = {}
        for causes, base in itertools.product([*((c,) for c in missing), *pairs], bases):
            trial = LogModel(take_first_steps(self.fitter, base, *causes), (*model.causes, *causes))
            out.setdefault(tuple(c.effect.id if c.wave else c.key for c in causes), []).append(trial)
        rows = (sorted(row, key=lambda m: -m.evidence) for row in out.values())
        return sorted(rows, key=lambda row: -row[0].evidence)

    def _proposals(self, model: LogModel) -> list[Proposal]:
        """The causes that promise most, in turn beside the noise alone and by evidence: one that explains nearly all of
        the data is seen best where nothing else may. What is left of the data is how far the first steps may be wrong.
        """
        entries = model.fit.model.entries
        if len(model.causes) >= self._most or (model.leaves_nothing and not any(map(_is_bent, entries))):
            return []
        rows = self.extend_by_each(model)
        alone = sorted(range(len(rows)), key=lambda i: min(m.fit.squares for m in rows[i]))
        in_turn = dict.fromkeys(itertools.chain(*zip(alone, range(len(rows)), strict=True)))
        least = model.evidence - margin(model.fit.discrepancy.missing)
        best = [rows[i] for i in list(in_turn)[:FITTED]]
        return [Proposal(row[0].keys, row) for row in best if row[0].evidence > least]

    def _fitted(self, model: LogModel, change: list[LogModel]) -> LogModel:
        """The model with a cause, fitted from the best of its starts: some steps tell which.

        With the derivatives that are there and with new ones, a fit may end in two places.
        """
        starts = change[:_STARTS]
        if len(starts) > 1 and not starts[0].causes[-1].wave:
            starts = [replace(m, fit=self.fitter.fit(m.fit.model, _FEW, 1, former=m.fit)) for m in starts]
        best = max(starts, key=lambda m: m.evidence)
        ends = (self.fitter.fit(best.fit.model, former=former) for former in (best.fit, None))
        return replace(best, fit=max(ends, key=lambda fit: fit.evidence))

    def _retimed(self, model: LogModel) -> LogModel:
        """The model from the printed data sheet, where that has more evidence."""
        if model.leaves_nothing:
            return model
        return max(model, replace(model, fit=self.fitter.fit(model.fit.model.as_printed())), key=lambda m: m.evidence)

    def _better(self, model: LogModel) -> LogModel | None:
        better = super()._better(model) or self._simpler(model) or self._as_stated(model) or self._restarted(model)
        if better is not None:
            self._ladder.append(better)
        return better

    def _simpler(self, model: LogModel) -> LogModel | None:
        """The model less a cause that it does not need: one that was found early may stand for others found later."""
        self._lesser = model, {c.key: self._less(model, c) for c in model.causes}
        best = max(self._lesser[1].values(), key=lambda m: m.evidence, default=model)
        if best is model or best.evidence <= model.evidence:
            return None
        return replace(best, fit=self.fitter.fit(best.fit.model))

    def _less(self, model: LogModel, cause: Candidate) -> LogModel:
        """A model without a cause, and without what is a shape of it."""
        less = cause.taken_from(model.fit.model, self.machine)
        kept = [c for c in model.causes if c is not cause and all(less.place(e.label) is not None for e in c.entries)]
        return LogModel(self.fitter.fit(less, passes=1, former=model.fit), tuple(kept))

    def _as_stated(self, model: LogModel) -> LogModel | None:
        """The model with a position gain of the sheet as stated, where that has more evidence.

        A position gain and an integral time are the two zeros of a P-PI cascade: near each other, a fit moves them
        apart at little gain. A setting that was read from the control is believed before that.
        """
        for e in model.fit.model.entries:
            if e.owner == CONTROLLER and e.name == "position_gain" and e.deviation > _STATED:
                stated = e.decode(e.mean)
                held = replace(e, value=stated, deviation=_STATED, centre=stated)
                entries = tuple(held if f.label == e.label else f for f in model.fit.model.entries)
                trial = replace(model, fit=self.fitter.fit(replace(model.fit.model, entries=entries), former=model.fit))
                if trial.evidence > model.evidence:
                    return trial
        return None

    def _restarted(self, model: LogModel) -> LogModel | None:
        """The same model with more evidence, from other ways and speeds of its friction."""
        best, free = model, model.fit.model
        for j, e in enumerate(free.entries):
            for factor in _RESTARTS if e.name in _CURVED else ():
                moved = free.vector
                moved[j] = np.clip(e.encode(e.value * factor), *e.bounds)
                trial = replace(model, fit=self.fitter.fit(free.with_values(moved), passes=1))
                best = max(best, trial, key=lambda m: m.evidence)
        return best if best.evidence > model.evidence + LEAST else None

    # -- what competes -------------------------------------------------------------------------------------------------

    def _rivals_of(self, model: LogModel, cause: Candidate) -> Rivals:
        """What else could stand in the place of a cause: the likeliest after the first steps are fitted."""
        self.progress(f"what could stand in the place of {cause.key}", 0, 1)
        without = self._lesser[1][cause.key] if self._lesser[0] is model else self._less(model, cause)
        own = model.evidence - without.evidence
        models, rejected, looked_at = [], {}, 0
        for row in self.extend_by_each(without):
            m = row[0]
            other, worse = m.causes[-1].effect.id, model.evidence - m.evidence
            # the same effect at another order, or in another shape, is no other cause
            if other == cause.effect.id or len(m.causes) > len(without.causes) + 1:
                continue
            if looked_at == RIVALS or worse > margin(own):
                rejected[other] = round(worse, 1)
                break
            looked_at += 1
            trial = self._fitted(without, row)
            models.append((other, trial))
        return Rivals(without, models, rejected)

    def _cause(self, model: LogModel, fit: AxisFit, cause: Candidate, rivals: Rivals) -> FoundCause:
        """One cause of the final model with its probability, and those of what could stand in its place.

        Args:
            model: The final model.
            fit: Its fit with central derivatives.
            cause: The cause.
            rivals: What else could stand in its place.
        """
        without = rivals.without.fit
        own = model.evidence - rivals.without.evidence
        whole = probability_of_size(cause, fit, without) / (1.0 + float(np.exp(-np.clip(own, -700.0, 700.0))))
        mine, told = names_to_tell(rivals.models, model.evidence)
        known = probability_known(cause, fit, without)
        p = whole * known
        others = {i: p * share for i, (share, _) in told.items()}
        shows = without.mean_squares > (1.0 + _SHOWS) * fit.mean_squares
        tests = tuple(dict.fromkeys(d.name for d, there in zip(self.fitter.rows, shows, strict=True) if there))
        competing = {i: m.fit for i, (_, m) in told.items()}
        return FoundCause(
            cause.key, cause.effect.id, own, whole, known, p * mine, others, rivals.rejected, tests, competing
        )


def _has_bent_sheet(model: AxisModel) -> bool:
    """Whether a number of the data sheet is beyond its tolerance."""
    return any(_is_bent(e) for e in model.entries if e.owner in (DRIVE, CONTROLLER))


def _is_bent(e: Entry) -> bool:
    """Whether a number is beyond what its prior stands for."""
    return abs(e.encode(e.value) - e.mean) > LIMIT_DEVIATIONS * e.deviation
