"""What each effect could explain of the error of axis logs, by one linear step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.estimation.axis_logs.as_given import fit_as_given
from mjsim.estimation.axis_logs.candidates import Catalogue
from mjsim.estimation.axis_logs.data import axis_data
from mjsim.estimation.axis_logs.fit import LogFitter
from mjsim.estimation.axis_logs.promise import linear_step
from mjsim.estimation.axis_logs.waves import strongest_orders
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import recorded_axes
from mjsim.machine.model import Machine
from mjsim.threads import one_blas_thread
from mjsim.workbench.gains import Gain
from mjsim.workbench.jobs import Stopped


@one_blas_thread
def log_gains(
    campaign: Campaign,
    machine: Machine,
    threads: int = 2,
    stopped: Callable[[], bool] = lambda: False,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> dict[str, Gain]:
    """What each effect could explain of the residual of its axis, alone, by the effect's id.

    Args:
        campaign: With axis logs.
        machine: The model.
        threads: Simulations side by side.
        stopped: Asked after every effect.
        settings: What decides whether chance explains as much.

    Raises:
        Stopped: It was stopped.
        SimulationError: A drive is unstable.
    """
    out: dict[str, Gain] = {}
    for axis in recorded_axes(campaign.measured):
        fitter = LogFitter(machine, axis_data(campaign, axis, machine), threads)
        fit = fit_as_given(fitter, machine)
        noise = float(np.sum(np.square(fitter.noise)))
        now = float(fit.mean_squares.sum())
        for candidate in Catalogue(machine, fitter.data).missing(fit.model, strongest_orders(fitter, fit)):
            if stopped():
                raise Stopped
            step = linear_step(fitter, fit, candidate)
            left = float(sum(r @ r / len(r) for r in step.left))
            share = min(max((now - left) / (now - noise), 0.0), 1.0) if now > noise else 0.0
            best = out.get(candidate.effect.id)
            if best is None or share > best.share:
                significant = step.gain(fit, fitter, settings.parameter_penalty).largest > settings.likelihood_ratio
                out[candidate.effect.id] = Gain(share, step.effect, significant)
    return out
