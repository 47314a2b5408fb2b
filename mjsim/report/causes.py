"""What the error consists of: the calibration against its limits, and the error by cause down to the noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.commands.diagnosis import Diagnosis
from mjsim.digits import rounded_um
from mjsim.inference.calibration import Calibrated, calibrated_effects
from mjsim.inference.shares import Calibration
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.units import unit_of

#: Half the width of an interval, over that of the prior, from which a number counts as not observable. It is the
#: share at which the calibration itself draws that line.
_OBSERVABLE = 0.8
#: 95 % half width of the prior, in limits: a limit is two standard deviations.
_PRIOR = 0.98
#: Causes below this share of the error are put together in the waterfall, and the most that it shows.
_SMALL, _MOST = 0.01, 12


@dataclass(frozen=True)
class CalibrationRow:
    """One number that the machine file has a tolerance for.

    Attributes:
        effect_id: such as ``straightness.EYX``. title: the effect in words.
        name: of the number, such as ``quadratic_um``, or ``order 60`` for the amplitude of a wave. unit: its symbol.
        value: estimate. low, high: its 95 % interval. expected: what the machine file states, or neutral.
        limit: how far from ``expected`` a machine of this class may be.
        used_percent: how much of the limit the departure takes.
        beyond_percent: probability that it is farther from ``expected`` than the limit; None where it is not known.
        observable: whether the tests say more about it than the tolerance does. finding: beyond the limit.
        rms_um: RMS over all tests of what the whole effect changes in the readings [µm]; None for a finding, whose
            place in the ladder says so.
    """

    effect_id: str
    title: str
    name: str
    unit: str
    value: float
    low: float
    high: float
    expected: float
    limit: float
    used_percent: float
    beyond_percent: float | None
    observable: bool
    finding: bool
    rms_um: float | None

    @property
    def beyond(self) -> bool:
        """Whether the whole interval lies beyond the limit."""
        return self.low - self.expected > self.limit or self.high - self.expected < -self.limit


@dataclass(frozen=True)
class CauseShare:
    """One cause in the waterfall of the error.

    Attributes:
        cause: effect id; ``axis_location.*`` for all calibrated effects of a kind; or what stands for small ones.
        percent: share of the explained squared error. rms_um: RMS of the error that this share stands for [µm].
        after_um: RMS residual once this cause and those before it are in the model [µm].
        finding: a cause that matters; otherwise it is within its tolerance.
    """

    cause: str
    percent: float
    rms_um: float
    after_um: float
    finding: bool


def calibration_rows(result: Diagnosis) -> list[CalibrationRow]:
    """Every number with a tolerance: findings first, then by how much of the limit is used, then what the tests do
    not observe.
    """
    expected = {c.key: c for c in calibrated_effects(result.before.machine)}
    rows: list[CalibrationRow] = []
    for e in result.effects:
        if e.effect.key in expected:
            rows += _rows(e.effect, e.free, e.ci95, expected[e.effect.key], None)
    rows += rows_of(result.before.machine, result.calibration)
    known = {(b.effect_id, b.number): round(100.0 * b.beyond, 2) for b in result.budget if b.beyond is not None}
    rows = [replace(r, beyond_percent=known.get((r.effect_id, r.name))) for r in rows]
    return sorted(rows, key=lambda r: (not r.finding, not r.observable, -r.used_percent))


def rows_of(machine: Machine, calibration: Sequence[Calibration]) -> list[CalibrationRow]:
    """Every number of a calibration, in its order.

    Args:
        machine: As given, with the tolerance.
        calibration: What was fitted within it.
    """
    expected = {c.key: c for c in calibrated_effects(machine)}
    mine = [(c, expected[c.effect.effect.key]) for c in calibration if c.effect.effect.key in expected]
    return [row for c, e in mine for row in _rows(c.effect.effect, c.effect.names, c.ci95, e, c.rms)]


def _rows(
    effect: Effect, names: tuple[str, ...], ci95: dict, expected: Calibrated, rms: float | None
) -> Iterator[CalibrationRow]:
    """Rows of one effect; ``rms`` is None for a finding."""
    for name, limit in expected.limits.items():
        if name not in names or name not in ci95:
            continue
        mean = expected.free.effect.values[name]
        for label, unit, value, low, high, centre in _numbers(effect, name, ci95[name], mean):
            yield CalibrationRow(
                effect.key,
                effect.title,
                label,
                unit,
                value,
                low,
                high,
                centre,
                limit,
                round(100.0 * abs(value - centre) / limit, 1),
                None,
                rms is None or 0.5 * (high - low) < _OBSERVABLE * _PRIOR * limit,
                rms is None,
                None if rms is None else rounded_um(rms),
            )


def _numbers(effect: Effect, name: str, interval: list, mean) -> Iterator[tuple]:
    """Label, unit, value, interval and expected value of one size, or of every wave."""
    if name != "components":
        yield name, unit_of(name)[1], effect.values[name], *interval, mean
        return
    unit = "°" if is_rotary(effect.subject) else "µm"
    stated = {round(row[0]): row[1] for row in mean}
    for (order, amplitude, _), low, high in zip(effect.values[name], *interval, strict=True):
        yield f"order {order:g}", unit, amplitude, low[1], high[1], stated.get(round(order), 0.0)


def waterfall(result: Diagnosis) -> list[CauseShare]:
    """The error by cause, the largest first, from the machine as given to the final model.

    Mean squares add, RMS values do not: each cause takes its share of the squared error off.
    """
    explained = result.before.rms**2 - result.after.rms**2
    if explained <= 0.0:
        return []
    named = {e.effect.key for e in result.effects}
    shares = list(result.explained_shares.items())
    large = [(name, s) for name, s in shares if name in named or s >= _SMALL][:_MOST]
    rest = [s for name, s in shares if (name, s) not in large]
    if rest:
        large.append((f"{len(rest)} smaller", sum(rest)))
    out, level = [], result.before.rms**2
    for name, share in large:
        level = max(level - share * explained, 0.0)
        out.append(
            CauseShare(
                name,
                round(100.0 * share, 2),
                rounded_um(np.sqrt(max(share, 0.0) * explained)),
                rounded_um(np.sqrt(level)),
                name in named,
            )
        )
    return out
