"""Acceptance: limits of ISO 230-4 figures, and the decision with the measurement's uncertainty after ISO 14253-1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from mjsim.instruments.ball_bar.iso230 import bidirectional_figures, circular_figures
from mjsim.units import UM

#: Figures that a limit may be for: of one test, of two tests in both directions, of an arc.
CIRCULAR = ("circular_error", "radial_max", "radial_min")
BIDIRECTIONAL = ("bidirectional_error", "mean_radial_error")
RANGE = "range"
FIGURES = (*CIRCULAR, *BIDIRECTIONAL, RANGE)
PASS, FAIL, UNDECIDED = "pass", "fail", "inside the uncertainty"
_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Limit:
    """One limit.

    Attributes:
        tests: Names of the tests that it is for; of a bidirectional figure the CCW and the CW one.
        figure: One of :data:`FIGURES`.
        limit: Largest allowed absolute value, m.
        source: Standard, number and table that it is from, as the user writes it.
    """

    tests: tuple[str, ...]
    figure: str
    limit: float
    source: str


@dataclass(frozen=True)
class Acceptance:
    """The limits of a campaign.

    Attributes:
        limits: All of them.
        instrument: Expanded uncertainty (k = 2) of the instrument's reading, as its certificate says, m.
        probability: Of a right decision at the limit; 0.95 is the default of ISO 14253-1:2017.
    """

    limits: tuple[Limit, ...]
    instrument: float
    probability: float = 0.95

    @property
    def factor(self) -> float:
        """Guard band in standard uncertainties: one-sided, as only one limit is near."""
        return NormalDist().inv_cdf(self.probability)


@dataclass(frozen=True)
class Judged:
    """One figure against its limit, µm.

    Attributes:
        limit: The limit.
        tests: What it was measured in.
        value_um: The figure.
        uncertainty_um: Its standard uncertainty.
        guard_um: Guard band.
        decision: ``pass``, ``fail`` or ``inside the uncertainty``.
    """

    limit: Limit
    tests: tuple[str, ...]
    value_um: float
    uncertainty_um: float
    guard_um: float
    decision: str

    @property
    def probability_beyond(self) -> float:
        """Probability that the figure is beyond its limit (JCGM 106)."""
        u, limit = max(self.uncertainty_um, 1e-12), self.limit.limit / UM
        normal = NormalDist(self.value_um, u)
        return 1.0 - normal.cdf(limit) + normal.cdf(-limit)

    def to_json(self) -> dict:
        """Plain numbers in µm."""
        return {
            "tests": list(self.tests),
            "figure": self.limit.figure,
            "value_um": round(self.value_um, 3),
            "limit_um": round(self.limit.limit / UM, 3),
            "standard_uncertainty_um": round(self.uncertainty_um, 3),
            "guard_band_um": round(self.guard_um, 3),
            "decision": self.decision,
            "probability_beyond": round(self.probability_beyond, 4),
            "source": self.limit.source,
        }


@dataclass(frozen=True)
class Measured:
    """A measured trace: name, φ (n,) rad, reading (n,) m."""

    name: str
    phi: np.ndarray
    deviation: np.ndarray


def decide(value: float, limit: float, guard: float) -> str:
    """Pass, fail, or neither, for the absolute ``value`` of a figure: what is within the guard band proves nothing."""
    size = abs(value)
    return PASS if size <= limit - guard else FAIL if size > limit + guard else UNDECIDED


def judge(acceptance: Acceptance, traces: Sequence[Measured], noise: float) -> list[Judged]:
    """Every limit against what was measured; tests that were not measured have no row.

    Args:
        acceptance: Limits and uncertainties.
        traces: Measured tests.
        noise: RMS of one sample's noise, m.

    Raises:
        InputError: a trace leaves part of its circle open, so that its figures are not defined.
    """
    by_name = {t.name: t for t in traces}
    out = []
    for limit in acceptance.limits:
        have = [by_name[n] for n in limit.tests if n in by_name]
        groups = ([have] if len(have) == 2 else []) if limit.figure in BIDIRECTIONAL else [[t] for t in have]
        for group in groups:
            value = _figure(limit.figure, group)
            spread = _repeatability(limit.figure, group)
            u = float(np.sqrt(max(spread, noise / UM) ** 2 + (0.5 * acceptance.instrument / UM) ** 2))
            guard = acceptance.factor * u
            decision = decide(value, limit.limit / UM, guard)
            out.append(Judged(limit, tuple(t.name for t in group), value, u, guard, decision))
    return out


def _figure(figure: str, group: list[Measured]) -> float:
    """A figure in µm."""
    first = group[0]
    if figure in BIDIRECTIONAL:
        both = bidirectional_figures(first.phi, first.deviation, group[1].phi, group[1].deviation)
        return both.circular_error_um if figure == BIDIRECTIONAL[0] else both.mean_radial_error_um
    if figure == RANGE:
        return float(np.ptp(first.deviation)) / UM
    return float(getattr(circular_figures(first.phi, first.deviation), f"{figure}_um"))


def _repeatability(figure: str, group: list[Measured]) -> float:
    """Standard uncertainty of a figure from its scatter between revolutions, µm; 0 where there is one only."""
    turns = [_revolutions(t) for t in group]
    count = min(map(len, turns))
    if figure == RANGE or count < 2:
        return 0.0
    values = [_figure(figure, [t[k] for t in turns]) for k in range(count)]
    return float(np.std(values, ddof=1) / np.sqrt(count))


def _revolutions(trace: Measured) -> list[Measured]:
    """The whole revolutions of a trace, one by one."""
    number = np.floor(np.abs(trace.phi) / _TURN + 1e-9).astype(int)
    out = []
    for k in range(number.max() + 1):
        part = number == k
        if np.ptp(trace.phi[part]) > 0.97 * _TURN:
            out.append(Measured(trace.name, trace.phi[part], trace.deviation[part]))
    return out
