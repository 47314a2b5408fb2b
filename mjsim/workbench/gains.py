"""How much of the present residual each effect of the catalogue could explain."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mjsim.inference.bar_search import further_candidates
from mjsim.inference.discrepancy import Discrepancy, Sizes
from mjsim.inference.findings import FINDING
from mjsim.inference.fit import Fitter
from mjsim.inference.hypotheses import Hypotheses
from mjsim.inference.linear_model import Products
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import SignatureBank, seeds
from mjsim.inference.vibration import Separated, separate, without_vibrations
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, counted, silent
from mjsim.threads import one_blas_thread
from mjsim.workbench.jobs import Stopped
from mjsim.workbench.overlay import OpenCampaign


@dataclass(frozen=True)
class Gain:
    """What one effect could do for the present model.

    Attributes:
        share: Of the squared residual above the noise that it could explain, 0 to 1.
        effect: The effect at its linear estimate.
        significant: Whether it is there, with 95 % probability, if nothing else is.
    """

    share: float
    effect: Effect
    significant: bool


class Gains:
    """Signatures of the whole catalogue, computed once, and what they say of the present residual.

    Signatures of small errors hardly depend on what else is in the model, so those of the machine file serve all
    models.

    Args:
        opened: A campaign with measured tests.
    """

    def __init__(self, opened: OpenCampaign) -> None:
        self.opened = opened
        #: Held by whoever uses the campaign's background problem.
        self.turn = threading.Lock()
        self._separated: Separated | None = None
        self._fitter: Fitter | None = None
        self._signatures: tuple[SignatureBank, Products] | None = None

    @property
    def ready(self) -> bool:
        """Whether :meth:`prepare` is done."""
        return self._signatures is not None

    @property
    def problem(self) -> Problem:
        """The measured tests without vibrations."""
        assert self._separated is not None
        return self._separated.problem

    @one_blas_thread
    def prepare(self, progress: Progress = silent, stopped: Callable[[], bool] = lambda: False) -> None:
        """Compute the signatures; takes some seconds, and nothing where they are there already.

        Args:
            progress: Stage, done, total.
            stopped: Asked after each signature.

        Raises:
            Stopped: It was stopped.
        """
        with self.turn:
            if self.ready:
                return
            fitter = self._fitter_of_file()
            bank = SignatureBank(self.problem, fitter.fit([], exact=False))
            candidates = seeds(fitter.machine)
            told = counted(progress, "signatures of the catalogue", len(candidates))

            def done() -> None:
                told()
                if stopped():
                    raise Stopped
                self.turn.release()  # a fit that waits goes first
                time.sleep(0.001)
                self.turn.acquire()

            bank.compute(candidates, done)
            self._signatures = bank, Products(Discrepancy.of_tests(self.problem), bank.matrix)

    def _fitter_of_file(self) -> Fitter:
        """The fitter of the machine file's model, made once."""
        if self._fitter is None:
            assert self.opened.background is not None
            self._separated = separate(self.opened.background, self.opened.machine)
            self._fitter = Fitter(self.problem, self._separated.machine)
        return self._fitter

    def fitter(self, machine: Machine) -> Fitter:
        """A fitter of a model; to be called while :attr:`turn` is held."""
        return Fitter(self.problem, without_vibrations(machine), near=self._fitter_of_file())

    @one_blas_thread
    def of(self, machine: Machine, waves: bool = True) -> dict[str, Gain]:
        """What each effect could explain of a model's residual, by the effect's id.

        Args:
            machine: The model.
            waves: Look for pitch errors and torque ripples as well, whose orders are read off a spectrum.
        """
        with self.turn:
            assert self._signatures is not None and self._separated is not None
            problem, fitter = self.problem, self.fitter(machine)
            fit = fitter.fit([], exact=False)
            bank, products = self._signatures
            design = products.discrepancy.plain(fit)
            noise_alone = [Sizes(0.0, 0.0, np.ones(len(problem.tests)))]
            further = further_candidates(problem, fit, bank) if waves else None
            beside = Hypotheses(fit, design, bank, products, {}, noise_alone, further=further)
            odds, width = beside.linear.odds({})
            lines = [line for line in self._separated.lines if machine.effect(line.effect.key) is None]
            above = max(fit.sum_squares - problem.count, 0.0) + sum(line.gain for line in lines)
            out: dict[str, Gain] = {}
            for g in np.flatnonzero(np.isfinite(odds)):
                chosen = {int(g): float(width[g])}
                explained = beside.linear.explained(chosen)
                share, key = min(explained / above, 1.0) if above else 0.0, beside.all[g].id
                if key not in out or share > out[key].share:
                    effect = beside.model_of(chosen, beside.linear)[0][-1].effect
                    out[key] = Gain(share, effect, odds[g] > np.log(FINDING / (1.0 - FINDING)))
            for line in lines:
                out[line.effect.id] = Gain(min(line.gain / above, 1.0) if above else 0.0, line.effect, True)
            return out
