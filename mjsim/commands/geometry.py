"""The geometry of a machine from a campaign alone: location errors of its rotary axes and squareness of its linear
axes, with their uncertainty, and what the tests cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.campaign.tolerance import TYPICAL_TOLERANCE
from mjsim.commands.calibrate import fit_within_tolerance
from mjsim.commands.diagnosis import combination_json
from mjsim.errors import InputError
from mjsim.inference.calibration import LIMIT_DEVIATIONS, Calibrated, calibrated_effects
from mjsim.inference.combinations import Combination, combinations
from mjsim.inference.considered import with_instrument
from mjsim.inference.fit import Fit, Fitter
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.vibration import separate
from mjsim.machine.chain import Chain
from mjsim.machine.effect import in_words
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import UM

#: Kinds of effects that are the geometry, with limits so wide that the tests decide alone (assumed).
_WIDE: dict[str, dict[str, float]] = {"axis_location": {"um": 400.0, "urad": 1000.0}, "squareness": {"urad": 1000.0}}
#: Gauss-Newton steps with the readings of the real kinematics.
_EXACT = 4
#: Correlation from which something else moves with a number that is open (assumed).
_MOVES_WITH = 0.5
#: Most of these that are named.
_MOST_NAMED = 3
#: Residual over noise from which the machine has more than geometry (assumed).
_MORE = 1.3


@dataclass(frozen=True)
class Located:
    """One number of the geometry.

    Attributes:
        id: of the effect, as ``axis_location.EX0C``.
        parameter: its parameter, which ends in its unit.
        value: its estimate.
        half_width: half of its 95 % interval.
        meaning: what is displaced or turned, and where.
        wanted: limit of a machine of its class: the tolerance of the machine file, or the one of a typical machine.
        instead: what else the tests may see in its place, each with the correlation, where the number is open.
    """

    id: str
    parameter: str
    value: float
    half_width: float
    meaning: str
    wanted: float
    instead: tuple[tuple[str, float], ...] = ()

    @property
    def determined(self) -> bool:
        """Whether the tests know it better than to half of what a machine of its class may have."""
        return self.half_width <= 0.5 * self.wanted

    def to_json(self) -> dict:
        """Plain numbers in the unit of the parameter."""
        return {
            "id": self.id,
            "meaning": self.meaning,
            "parameter": self.parameter,
            "value": _plain(self.value),
            "ci95": [_plain(self.value - self.half_width), _plain(self.value + self.half_width)],
            "determined": self.determined,
            "instead": [{"name": name, "correlation": round(r, 2)} for name, r in self.instead],
        }


@dataclass(frozen=True)
class Geometry:
    """What a campaign says of a machine's geometry.

    Attributes:
        chain: the axes.
        numbers: location errors from the workpiece to the tool, then squareness.
        combinations: sums that the tests determine where they leave their numbers open.
        tests: measured tests.
        ratio: residual of all tests over the noise, once everything is fitted.
        noise: of one sample, m.
    """

    chain: Chain
    numbers: tuple[Located, ...]
    combinations: tuple[Combination, ...]
    tests: int
    ratio: float
    noise: float

    @property
    def more(self) -> bool:
        """Whether the tests show more than geometry and what a machine of this class has, so that it may be wrong."""
        return self.ratio > _MORE

    def to_json(self) -> dict:
        """Keys as in the documentation of JSON."""
        return {
            "configuration": self.chain.configuration,
            "tests": self.tests,
            "residual_over_noise": round(self.ratio, 3),
            "noise_um": round(self.noise / UM, 4),
            "explained": not self.more,
            "geometry": [n.to_json() for n in self.numbers],
            "combinations": combination_json(self.combinations),
            "left_out": list(self.chain.redundant_location_errors),
        }


@one_blas_thread
def geometry(campaign: Campaign, machine: Machine, threads: int = 2, progress: Progress = silent) -> Geometry:
    """Fit location errors and squareness to a campaign, whatever their size, beside all that a machine has a little of.

    Args:
        campaign: With at least one measured test.
        machine: As given. What its file says of location errors and squareness is where the fit begins.
        threads: Tests that are worked on side by side.
        progress: Called as work gets on.

    Raises:
        InputError: no test is measured with the ball bar, no axis turns and none is square to another, or the traces
            show a mistake.
    """
    campaign = campaign.in_motion
    if not campaign.measured:
        raise InputError(
            f"{campaign.folder / 'campaign.toml'}: no ball-bar test has a trace; the geometry needs measured tests"
        )
    table = machine.tolerance or TYPICAL_TOLERANCE
    free = replace(machine, tolerance={**table, **_WIDE})
    progress("fitting the geometry", 0, 1)
    separated = separate(checked_problem(campaign, free, threads), free)
    fitter = Fitter(separated.problem, separated.machine)
    fit = fit_within_tolerance(fitter)
    fit = fitter.fit(fit.effects, start=fit, exact=True, iterations=_EXACT, fresh=False)
    fit = with_instrument(separated.problem, fit)
    limits = {c.key: _wanted(c, table) for c in calibrated_effects(free) if c.free.effect.kind in _WIDE}
    numbers = _numbers(fit, limits)
    scale = {
        f.effect.key: limits[f.effect.key] / LIMIT_DEVIATIONS / f.specs[f.names[0]].scale
        for f in fit.effects
        if f.effect.key in limits
    }
    sums = combinations(fit, separated.problem.settings, scale)
    ratio = float(np.sqrt(np.mean(fit.residual**2)))
    return Geometry(machine.chain, numbers, sums, len(campaign.measured), ratio, separated.problem.noise.rms)


def _wanted(calibrated: Calibrated, table: Mapping[str, Mapping[str, float]]) -> float:
    """The limit of a number in a machine of its class, in the unit of its parameter."""
    kind, (name,) = calibrated.free.effect.kind, calibrated.free.names
    unit = name.rpartition("_")[2]
    return table.get(kind, {}).get(unit, TYPICAL_TOLERANCE[kind][unit])


def _numbers(fit: Fit, limits: Mapping[str, float]) -> tuple[Located, ...]:
    """Every number of the geometry, with what moves with it where it is open."""
    labels = _labels(fit)
    deviation, covariance = np.sqrt(np.diag(fit.covariance)), fit.linear.covariance
    fitted = np.sqrt(np.diag(covariance))  # what moves together moves so in the fit
    out = []
    for f in (f for f in fit.effects if f.effect.key in limits):
        at = fit.parameters[f.block.name].start
        scale = f.specs[f.names[0]].scale
        one = Located(
            f.effect.id,
            f.names[0],
            float(f.effect.values[f.names[0]]),
            1.96 * float(deviation[at]) * scale,
            in_words(f.effect.subject, fit.machine.chain),
            limits[f.effect.key],
        )
        if not one.determined:
            r = covariance[at] / np.where(fitted > 0.0, fitted, np.inf) / fitted[at]
            ranked = sorted((i for i in labels if i != at), key=lambda i: -abs(r[i]))
            found = [(labels[i], float(r[i])) for i in ranked[:_MOST_NAMED] if abs(r[i]) > _MOVES_WITH]
            one = replace(one, instead=tuple(found))
        out.append(one)
    return tuple(out)


def _labels(fit: Fit) -> dict[int, str]:
    """Place in the vector -> what stands there, in words."""
    effects = {f.block.name: f.effect.id for f in fit.effects}
    out, at = {}, 0
    for block in fit.parameters.blocks:
        for label in block.labels:
            name = effects.get(block.name, f"{label} of {block.name}" if block.size > 1 else block.name)
            out[at] = name
            at += 1
    return out


def _plain(x: float) -> float:
    return float(f"{x:.4g}")
