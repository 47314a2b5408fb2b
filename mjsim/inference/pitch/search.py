"""The search for pitch errors: that on ball-bar tests, for what belongs to the gears of the rotary axes.

A worm wheel has waves of its own in each direction of motion, since another flank carries. So the two directions are
looked at apart, and the evidence says in the end whether they agree. What is longer than a tooth is common to both:
both flanks are cut on one blank. A worn stretch of a wheel is looked for as well: it would pass for many waves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from mjsim.effects import registry
from mjsim.inference.bar_search import BarSearch, in_each_direction
from mjsim.inference.calibration import Calibrated, calibrated_effects
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fitter
from mjsim.inference.hypotheses import Hypotheses
from mjsim.inference.linear_evidence import without
from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.problem import Problem
from mjsim.inference.search import Model
from mjsim.inference.signatures import Candidate, Offer, Row, SignatureBank
from mjsim.inference.spectrum import order_gains, sides_of, wave
from mjsim.machine.effect import Effect
from mjsim.progress import Progress, silent

#: Peaks of each spectrum that are looked at, the highest.
_PEAKS = 8


class GearSearch(BarSearch):
    """The search for pitch errors.

    Args:
        fitter: Of the machine without the pitch errors that are looked for.
        directions: In which the tests turned the axes.
        progress: Called as work gets on.
    """

    def __init__(self, fitter: Fitter, directions: Sequence[TurnDirection], progress: Progress = silent) -> None:
        self.directions = tuple(directions)
        self.resolution = {w.axis: w.resolution for w in directions}
        ids = [f"{kind}.{axis}" for axis in self.resolution for kind in ("pitch_error", "worm_wear")]
        super().__init__(fitter, progress, [registry.effect_class(i, fitter.machine.chain) for i in ids])
        self.seeds = [Candidate(e, c.names) for c in self.seeds for e in in_each_direction(c.effect) or [c.effect]]

    # -- models --------------------------------------------------------------------------------------------------------

    def best_from(self, effects: Sequence[EffectVector] = ()) -> Model[Problem]:
        """The best model that is found from one with these effects."""
        known = {c.key: c for c in calibrated_effects(self.machine) if c.free.effect.id not in self.only}
        model = self._model_with([*(c.free for c in known.values()), *effects], known)
        return self._found(self._searched(model)).model

    def with_common_waves(self, model: Model[Problem], axis: str) -> Model[Problem]:
        """A model with one pitch error of an axis for both directions in the place of one for each."""
        mine = [f for f in model.fit.effects if f.effect.id == f"pitch_error.{axis}"]
        rows = {row[0]: row for f in mine for row in f.effect.values["components"]}
        others = [f for f in model.fit.effects if f not in mine]
        return self._model_with([*others, self._waves(axis, [*rows.values()])], model.expected)

    def _model_with(self, effects: Sequence[EffectVector], expected: Mapping[str, Calibrated]) -> Model[Problem]:
        """The model with these effects; a quick local fault must not pass for a disturbance before it is known."""
        return self._settled(self._model_of(self._first(effects), dict(expected)))

    def _waves(self, axis: str, rows: list[list[float]], direction: str = "") -> EffectVector:
        """A pitch error with these components, free to be fitted."""
        cls, subject = registry.effect_class(f"pitch_error.{axis}", self.machine.chain)
        values = {"direction": direction} if direction else {}
        return EffectVector(cls(subject, components=rows, **values), ("components",))

    # -- hypotheses ----------------------------------------------------------------------------------------------------

    def orders_in_place_of(self, model: Model[Problem], effect: Effect, order: float) -> dict[float, float]:
        """Probabilities of the orders that one wave of a model may have, with all others as they are.

        Args:
            model: The model.
            effect: The pitch error of the wave.
            order: Of the wave.
        """
        hypotheses = self._hypotheses(model, curves=False)
        here = self._widths(hypotheses)
        orders = {}
        for g, h in enumerate(hypotheses.all):
            of = h.free or h.candidate
            if h.name == effect.key and of is not None:
                orders[g] = of.effect.values["components"][h.wave or 0][0]
        mine = next(g for g in here if orders.get(g) == order)
        odds, _ = hypotheses.linear.odds(without(here, mine))
        share = np.exp(odds[[*orders]] - odds[[*orders]].max())
        return dict(zip(orders.values(), (share / share.sum()).tolist(), strict=True))

    def _hypotheses(self, model: Model[Problem], curves: bool) -> Hypotheses:
        """Curves of unknown causes do not compete: what is asked is which waves there are."""
        return super()._hypotheses(model, curves=False)

    def _further(self, model: Model[Problem], bank: SignatureBank) -> Callable[[list[Row]], Iterable[Offer]]:
        return lambda _: (offer for axis in self.resolution for offer in self._spectral(model, bank, axis))

    def _spectral(self, model: Model[Problem], bank: SignatureBank, axis: str) -> list[Offer]:
        """Waves of an axis at the peaks of its spectra, and at the orders beside those that the model has."""
        teeth, reach = self.machine.drives[axis].gear, np.ceil(0.5 * self.resolution[axis])
        waves, works = [], []
        for way, gains in order_gains(self.plain, model.fit, bank, axis).items():
            empty = self._waves(axis, [], way).effect
            present = model.fit.machine.effect(empty.key)
            own = {row[0] for row in present.values["components"]} if present else set()
            orders = np.arange(1.0, len(gains) + 1.0)
            gains = np.where((orders >= teeth) == bool(way), gains, -np.inf)
            around = np.pad(gains, 1, constant_values=-np.inf)
            peaks = np.flatnonzero(gains > np.maximum(around[:-2], around[2:]))
            peaks = peaks[np.argsort(-gains[peaks])[:_PEAKS]]
            near = [n for n in orders[np.isfinite(gains)] if any(abs(n - other) <= reach for other in own)]
            for n in sorted({*orders[peaks], *near} - own):
                waves.append(wave(empty, float(n)))
                works.append(sides_of(bank, empty, float(n)))
        return bank.whitened(waves, works)
