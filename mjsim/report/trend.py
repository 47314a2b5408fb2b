"""Several campaigns of one machine over time: which ISO 230-4 figure or which effect's parameter has changed beyond
its uncertainty.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version

from mjsim.commands.ball_bar.compare import BarComparison
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.digits import rounded_um
from mjsim.effects import registry
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import table_of
from mjsim.machine.chain import is_rotary
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.report.content import plain
from mjsim.units import UM, unit_of

#: 95 % interval of a circular error from the noise σ of one sample: it is the difference of two extremes, each with one
#: sample's noise.
_TWO_EXTREMES = 1.96 * math.sqrt(2.0)

#: Verdicts of a series that has changed.
CHANGED = ("grew", "shrank")


@dataclass(frozen=True)
class CampaignRow:
    """One campaign: name, day, number of tests, noise and RMS residual of the machine as given and of the final model
    [µm], verdict,
    and the effects found."""

    name: str
    date: str
    tests: int
    noise_um: float
    rms_before_um: float
    rms_after_um: float | None
    verdict: str | None
    effects: Sequence[str]


@dataclass(frozen=True)
class Series:
    """One quantity over the campaigns.

    Attributes:
        name: what it is. unit: symbol. group: ``figure`` or ``parameter``.
        values, lows, highs: per campaign, with 95 % intervals; None where the campaign does not say.
        notes: per campaign, such as ``not found``.
        change: last less first that are there. uncertainty: of that difference, 95 %; None where one has no interval.
        verdict: ``grew``, ``shrank``, ``within uncertainty`` or ``cannot be said``.
        since: place of the campaign in which the change was first beyond its uncertainty.
    """

    name: str
    unit: str
    group: str
    values: Sequence[float | None]
    lows: Sequence[float | None]
    highs: Sequence[float | None]
    notes: Sequence[str] = ()
    change: float | None = None
    uncertainty: float | None = None
    verdict: str = "cannot be said"
    since: int | None = None


@dataclass(frozen=True)
class TrendContent:
    """A trend page."""

    title: str
    summary: Sequence[tuple[str, str]]
    campaigns: Sequence[CampaignRow]
    series: Sequence[Series]
    sentence: str
    provenance: Sequence[tuple[str, str]]

    def to_json(self) -> dict:
        """Every number and text of the page."""
        return plain(self)


def content(results: Sequence[Diagnosis | BarComparison]) -> TrendContent:
    """The trend of campaigns in the order given.

    Args:
        results: diagnoses, or comparisons where nothing was diagnosed; all of one machine.
    """
    befores = [r.before if isinstance(r, Diagnosis) else r for r in results]
    figures, parameters = figure_series(befores), parameter_series(results)
    series = [*figures, *parameters]
    machine = befores[-1].machine
    return TrendContent(
        f"{machine.name}: trend over {len(results)} campaigns",
        [
            ("Machine", f"{machine.name}, configuration {machine.configuration}"),
            ("Tests that all campaigns share", ", ".join(_shared(befores)) or "none"),
        ],
        [_campaign(r, b) for r, b in zip(results, befores, strict=True)],
        series,
        _sentence(figures, parameters),
        [
            ("mjsim", version("mjsim")),
            ("MuJoCo", version("mujoco")),
            ("Python", platform.python_version()),
            ("seed", "none: no random numbers are drawn"),
        ],
    )


def _sentence(figures: list[Series], parameters: list[Series]) -> str:
    """What changed between the first and the last campaign: parameters by name, figures by the one that changed
    most.
    """
    parts = [f"{s.name} {s.verdict}" for s in parameters if s.verdict in CHANGED]
    moved = [s for s in figures if s.verdict in CHANGED]
    if moved:
        most = max(moved, key=lambda s: abs(s.change or 0.0))
        parts.append(
            f"{len(moved)} of {len(figures)} circular errors changed, {most.name} the most ({most.change:+.2f} µm)"
        )
    if not parts:
        return "Nothing changed by more than its uncertainty."
    return f"Between the first and the last campaign: {', '.join(parts)}. These changes exceed their uncertainty."


def _campaign(r: Diagnosis | BarComparison, before: BarComparison) -> CampaignRow:
    day = before.campaign.measured_on
    done = isinstance(r, Diagnosis)
    return CampaignRow(
        before.campaign.name,
        day.isoformat() if day else "",
        len(before.tests),
        rounded_um(before.noise),
        rounded_um(before.rms),
        rounded_um(r.after.rms) if done else None,
        r.verdict if done else None,
        [e.effect.key for e in r.effects] if done else [],
    )


def _conditions(t: BallBarTest) -> dict:
    return {k: v for k, v in table_of(t).items() if k not in ("setup", "revolutions")}


def _shared(befores: Sequence[BarComparison]) -> list[str]:
    """Names of the tests that every campaign has under the same conditions."""
    tables = [{t.test.name: _conditions(t.test) for t in b.tests} for b in befores]
    return [name for name, table in tables[0].items() if all(other.get(name) == table for other in tables[1:])]


def figure_series(befores: Sequence[BarComparison]) -> list[Series]:
    """Measured circular errors G and G(b) of the tests that all share.

    D is left out: it hangs on the bar's length, which is calibrated anew for every campaign.
    """
    shared, out = _shared(befores), []
    spread = [_TWO_EXTREMES * b.noise / UM for b in befores]
    for name in shared:
        iso = [next(t.iso for t in b.tests if t.test.name == name) for b in befores]
        if any(iso):
            out.append(
                series_of(
                    f"G {name}",
                    "µm",
                    "figure",
                    [i["measured"]["circular_error_um"] if i else None for i in iso],
                    spread,
                )
            )
        ranges = [next(t.ranges for t in b.tests if t.test.name == name) for b in befores]
        if all(ranges):
            values = [r["measured"]["range_um"] for r in ranges]
            out.append(series_of(f"range {name}", "µm", "figure", values, spread))
    pairs = [{(p["ccw"], p["cw"]): p["measured"]["circular_error_um"] for p in b.bidirectional} for b in befores]
    for pair in pairs[0]:
        if set(pair) <= set(shared) and all(pair in p for p in pairs):
            out.append(series_of(f"G(b) {pair[0]} / {pair[1]}", "µm", "figure", [p[pair] for p in pairs], spread))
    return out


def series_of(
    name: str, unit: str, group: str, values: list, half: list, notes: Sequence[str] = (), neutral: float = 0.0
) -> Series:
    """A series with symmetric intervals, and what its ends say."""
    lows = [None if v is None or h is None else round(v - h, 8) for v, h in zip(values, half, strict=True)]
    highs = [None if v is None or h is None else round(v + h, 8) for v, h in zip(values, half, strict=True)]
    there = [i for i, v in enumerate(values) if v is not None]
    if len(there) < 2:
        return Series(name, unit, group, values, lows, highs, notes)
    first, last = there[0], there[-1]
    beyond = [i for i in there[1:] if _exceeds(values, half, first, i)]
    change = values[last] - values[first]
    uncertainty = None if half[first] is None or half[last] is None else math.hypot(half[first], half[last])
    if uncertainty is None:
        verdict = "cannot be said"
    elif abs(change) <= uncertainty:
        verdict = "within uncertainty"
    else:
        verdict = "grew" if abs(values[last] - neutral) > abs(values[first] - neutral) else "shrank"
    since = beyond[0] if verdict in CHANGED else None
    return Series(name, unit, group, values, lows, highs, notes, change, uncertainty, verdict, since)


def _exceeds(values: list, half: list, a: int, b: int) -> bool:
    return half[a] is not None and half[b] is not None and abs(values[b] - values[a]) > math.hypot(half[a], half[b])


def parameter_series(results: Sequence[Diagnosis | BarComparison]) -> list[Series]:
    """Sizes of the effects that any diagnosis has found; without diagnoses, those of the machine files, which have
    no intervals.
    """
    done = [r for r in results if isinstance(r, Diagnosis)]
    if done:
        keys = dict.fromkeys((e.effect.key, e.effect.id) for r in done for e in r.effects)
    else:
        keys = dict.fromkeys((e.key, e.id) for r in results for e in r.machine.effects)
    out = []
    for key, effect_id in keys:
        rows = [_sizes(r, key) for r in results]
        cls, subject = registry.effect_class(effect_id, _machine(results[0]).chain)
        neutral = {p.name: p.neutral for p in cls.parameters_of(subject)}
        for name in dict.fromkeys(n for sizes, _ in rows for n in sizes):
            off = 0.0 if name.startswith("order ") else neutral.get(name)
            values, half, notes = [], [], []
            for sizes, note in rows:
                value, h = sizes.get(name, (None, None))
                if value is None and note != "not testable":
                    value, h = off, 0.0
                values.append(value)
                half.append(h)
                notes.append(note)
            unit = ("°" if is_rotary(subject) else "µm") if name.startswith("order ") else unit_of(name)[1]
            out.append(series_of(f"{key} {name}", unit, "parameter", values, half, notes, off or 0.0))
    return out


def _machine(r: Diagnosis | BarComparison) -> Machine:
    return r.before.machine if isinstance(r, Diagnosis) else r.machine


def _sizes(r: Diagnosis | BarComparison, key: str) -> tuple[dict[str, tuple[float, float | None]], str]:
    """(value, half width of its 95 % interval) of an effect's sizes by name in one campaign, and a note."""
    if isinstance(r, Diagnosis):
        found = next((e for e in r.effects if e.effect.key == key), None)
        if found is not None:
            note = f"or {', '.join(found.alternatives)}" if found.alternatives else ""
            return _of_effect(found.effect, found), note
    present = _machine(r).effect(key)
    if present is not None:
        return _of_effect(present, None), "as in the machine file"
    hidden = isinstance(r, Diagnosis) and key in r.not_testable
    return {}, "not testable" if hidden else "not found"


def _of_effect(effect: Effect, found: DiagnosedEffect | None) -> dict[str, tuple[float, float | None]]:
    out: dict[str, tuple[float, float | None]] = {}
    for p in effect.parameters_of(effect.subject):
        value, ci = effect.values.get(p.name), found.ci95.get(p.name) if found else None
        if p.kind == "components":
            for i, (order, amplitude, _) in enumerate(value or []):
                out[f"order {order:g}, amplitude"] = (amplitude, 0.5 * (ci[1][i][1] - ci[0][i][1]) if ci else None)
        elif p.kind == "number" and p.leading and isinstance(value, float):
            out[p.name] = (value, 0.5 * (ci[1] - ci[0]) if ci else None)
    return out
