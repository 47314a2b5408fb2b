"""The evidence for what a diagnosis found: parameters, shares, confidence in words, competing effects, what cannot
be tested.
"""

from __future__ import annotations

import numpy as np

from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.effects import registry
from mjsim.inference.problem import Problem
from mjsim.machine.chain import is_rotary
from mjsim.report.answer import short_test
from mjsim.report.content import Finding, NotTestable, ParameterRow, Rejected
from mjsim.units import UM, unit_of

#: Sensitivity (m/m, m/rad) below which the bar does not see an axis.
_SEEN = (0.02, 1e-3)


def findings(result: Diagnosis) -> list[Finding]:
    """One entry per effect, in the diagnosis' order."""
    data = result.to_json()["effects"]
    explainable = result.before.rms**2 - result.noise**2
    return [
        _finding(e, row, explainable, result.shares.get(e.effect.key), i < result.own_rungs)
        for i, (e, row) in enumerate(zip(result.effects, data, strict=True))
    ]


def _finding(e: DiagnosedEffect, data: dict, explainable: float, known: float | None, own: bool) -> Finding:
    share = 100.0 * (e.rms_before**2 - e.rms_after**2) / explainable if explainable > 0.0 else None
    if known is not None:
        share = 100.0 * known
    rejected = None
    if e.rejected and e.gain > 0.0:
        name, loss = min(e.rejected.items(), key=lambda r: r[1])
        rejected = Rejected(name, round(max(0.0, 100.0 * (1.0 - loss / e.gain)), 1))
    return Finding(
        e.effect.key,
        e.effect.title,
        parameter_rows(e),
        data["rms_before_um"] if own else None,
        data["rms_after_um"] if own else None,
        e.alternatives,
        f"{e.effect.signature} {'' if e.tests else 'No single test shows it above a quarter of the noise.'}".strip(),
        e.tests,
        None if share is None else round(share, 1),
        None if e.probability is None else round(100.0 * e.probability, 1),
        e.how_probable,
        rejected,
    )


def parameter_rows(e: DiagnosedEffect) -> list[ParameterRow]:
    """The fitted parameters of an effect with their 95 % intervals, components one by one."""
    rows = []
    for name in e.free:
        value, ci = e.effect.values[name], e.ci95.get(name)
        if name == "components":
            unit = "°" if is_rotary(e.effect.subject) else "µm"
            for i, (order, amplitude, phase) in enumerate(value):
                rows.append(ParameterRow(f"order {order:g}, amplitude", amplitude, *_ends(ci, i, 1), unit))
                rows.append(ParameterRow(f"order {order:g}, phase", phase, *_ends(ci, i, 2), "°"))
        else:
            low, high = ci or (None, None)
            rows.append(ParameterRow(name, value, low, high, unit_of(name)[1]))
    return rows


def _ends(ci, i: int, column: int) -> tuple[float | None, float | None]:
    return (ci[0][i][column], ci[1][i][column]) if ci else (None, None)


def untestable(ids: tuple[str, ...], problem: Problem) -> list[NotTestable]:
    """Effects that the campaign cannot show, each with its title and the reason."""
    chain = problem.chain
    moves, seen = {}, {}
    for i, a in enumerate(chain.letters):
        moves[a] = any(np.ptp(m.commands[:, i]) > 0.0 for m in problem.motions)
        seen[a] = any(np.abs(s.axes[:, i]).max() > _SEEN[chain.is_rotary(a)] for s in problem.sensitivity)
    out = []
    for effect_id in ids:
        cls, subject = registry.effect_class(effect_id, chain)
        if subject in chain.letters and not moves[subject]:
            why = f"{subject} does not move in any test"
        elif subject in chain.letters and not seen[subject]:
            why = f"the bar is at right angles to the motion of {subject} in every test"
        elif cls.search.quasi_static:
            why = "the fitted ball offsets, bar length and trigger shifts look the same here"
        else:
            why = "it hardly changes the reading at these feeds, or the fitted set-up and data sheet look the same"
        out.append(NotTestable(effect_id, f"{cls.title}: {why}."))
    return out


def next_test_sentence(following: dict | None) -> str:
    """The diagnosis' ``next_test`` in one sentence; empty where there is none."""
    if following is None:
        return ""
    a, b = following["between"]
    decides = "" if following["decides"] else " This is not enough to decide."
    test, minutes = following["test"], following["minutes"]
    return (
        f"To tell {a} from {b}, measure {test['name']} ({short_test(test)}). It takes {minutes:g} min with mounting. "
        f"The two differ by {following['difference_um']:.2f} µm RMS there.{decides} "
        "mjsim plan prints this test as a table for campaign.toml."
    )


def rest_percent(result: Diagnosis) -> float | None:
    """Share of the squared error above the noise that stays, in per cent; None where there was none."""
    explainable = result.before.rms**2 - result.noise**2
    return (
        100.0 * max(result.after.rms**2 - result.noise**2, 0.0) / explainable
        if explainable > (0.02 * UM) ** 2
        else None
    )
