"""The next measurement, whatever the instrument: what tells most per minute of machine time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.compare import checked_logs
from mjsim.commands.axis_log.judge import Judge
from mjsim.commands.calibrate import fit_within_tolerance
from mjsim.commands.diagnose import diagnose
from mjsim.commands.edit import fit_effect
from mjsim.commands.plan_at_rest import MostTelling, models_between, most_telling, separating, separating_row
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.axis_logs.planning import LogPlanner, PlannedLog, unmeasured
from mjsim.inference.axis_logs.search import AxisSearch
from mjsim.inference.axis_logs.separability import inseparable
from mjsim.inference.axis_logs.shared import MOTOR_SIDE
from mjsim.inference.axis_logs.start import start_model
from mjsim.inference.findings import explain
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.noise import usual_noise
from mjsim.inference.planning.at_rest import PlannedTest
from mjsim.inference.planning.candidates import Reach, renamed
from mjsim.inference.planning.next_test import NOTHING, Plan, best_of, lacking, plan_for, typical, worth
from mjsim.inference.planning.separation import Explanation, competing_of
from mjsim.inference.planning.whole_campaign import possible_motions
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.samples import BLOCKS
from mjsim.inference.settings import DIAGNOSIS, PLAN, DiagnosisSettings, PlanSettings
from mjsim.inference.vibration import separate
from mjsim.instruments.axis_log.measurement import LogTest, recorded_axes
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, UM

# -- a new campaign ----------------------------------------------------------------------------------------------------


def r_test_motions(machine: Machine) -> list[BallBarTest]:
    """R-tests that a new campaign may have, one reading of each: with the spindle as it is, and after half a turn. That
    tells the place of the nest from that of an axis.
    """
    motions = list(possible_motions(machine))
    turned = [replace(t, spindle=np.pi) for t in motions]
    return [*motions, *(renamed(t, kind_of(t).short_name(t), t.setup) for t in turned)]


# -- the next ball-bar test --------------------------------------------------------------------------------------------


@one_blas_thread
def plan_bars(
    campaign: Campaign,
    machine: Machine,
    between: tuple[str, str] | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Plan | None:
    """The next test to run.

    Without ``between`` the campaign is diagnosed first: the first effect that has alternatives is separated from its
    first one; where nothing is ambiguous, the first effect that is not testable is made to show. ``None`` where there
    is neither.

    Args:
        between: two effect ids, or one and ``"nothing"``.
        settings: what decides.

    Raises:
        InputError: unknown effect; no traces and no ``between``.
    """
    campaign = campaign.in_motion
    ids = tuple(i for i in between or () if i != NOTHING)
    for i in ids:
        registry.effect_class(i, machine.chain)
    if between is not None and (len(between) != 2 or not ids or len(set(between)) != 2):
        raise InputError(
            f"plan between {' and '.join(between)}: allowed are two different effects, or one effect and {NOTHING!r}"
        )
    if between is not None and NOTHING in between:
        between = (ids[0], NOTHING)
    reach = Reach(machine.chain, campaign.tests)
    if not campaign.measured:
        if between is None:
            raise InputError(
                f"{campaign.folder / 'campaign.toml'}: {campaign.nothing_measured}; say which effects to separate "
                f"(--between A B)"
            )
        pair = _by_default(between[0], machine), _by_default(between[1], machine)
        return best_of(between, pair, reach, usual_noise(), BLOCKS[0], threads, progress, settings.plan)
    progress("preparing", 0, 1)
    problem = checked_problem(campaign, machine, threads, settings=settings)
    separated = separate(problem, machine)
    if between is None:
        explained = explain(separated, progress)
        return plan_for(explained.data, explained.selection, threads, progress)
    problem, fitter = separated.problem, Fitter(separated.problem, separated.machine)
    if NOTHING in between:
        here = Explanation.of_fit(NOTHING, fit_within_tolerance(fitter, without=ids[0]))
        pair = here.with_effect(ids[0], lacking(ids[0], here.machine)), here
    else:
        fits = (fit_effect(fitter, *registry.effect_class(i, machine.chain)).fit for i in between)
        first, second = (Explanation.of_fit(i, fit) for i, fit in zip(between, fits, strict=True))
        pair = first, second
    block = problem.samples[0].block
    return best_of(between, pair, reach, problem.noise, block, threads, progress, problem.settings.plan)


def _by_default(effect_id: str, machine: Machine) -> Explanation:
    """An effect at its typical size on an unmeasured machine; nothing at all for :data:`NOTHING`."""
    if effect_id == NOTHING:
        return Explanation.of_priors(NOTHING, machine, [])
    return Explanation.of_priors(effect_id, machine, [typical(effect_id, machine.chain)])


#: Command delay that is looked at where its size is not known, ms.
_DELAY_MS = 0.5


@dataclass(frozen=True)
class NextMeasurement:
    """What to measure next.

    Attributes:
        between: Ids of two explanations, or labels of numbers of which only a combination is known.
        logs: Recordings, best first.
        rests: Tests of instruments that measure at rest and would decide, best first.
        bars: The ball-bar tests; nothing where none were looked at.
        reason: One sentence.
        beside: Whether the recordings stand beside the ball-bar test, because nothing was recorded yet.
        settings: By which they were chosen.
    """

    between: tuple[str, ...]
    logs: tuple[PlannedLog, ...]
    bars: Plan | None
    reason: str
    beside: bool = False
    settings: PlanSettings = PLAN
    rests: tuple[PlannedTest, ...] = ()

    def to_json(self, most: int = 5) -> dict:
        """As ``mjsim plan --json`` prints it: the best measurement, and the runners-up of all instruments."""
        rests = [separating_row(p, self.between) for p in self.rests]
        if self.beside and self.bars is not None:
            recordings = [log_row(p, self.between) for p in self.logs]
            return self.bars.to_json(most) | {"recordings": recordings, "at_rest": rests[:most]}
        rows = [(p.worth, log_row(p, self.between)) for p in self.logs]
        rows += [(p.worth, row) for p, row in zip(self.rests, rests, strict=True)]
        if self.bars is not None:
            rows += [(worth(s), {"instrument": "ball_bar", **row}) for s, row in _bar_rows(self.bars, most)]
        rows.sort(key=lambda r: r[0], reverse=True)
        best, others = rows[0][1], [row for _, row in rows[1:most]]
        if self.bars is not None and all(r["instrument"] != "ball_bar" for r in (best, *others)):
            others.append(next(row for _, row in rows if row["instrument"] == "ball_bar"))
        enough, plenty = (round(d**0.5, 1) for d in (self.settings.decisive, self.settings.certain))
        shown = {"reason": self.reason, "enough": enough, "plenty": plenty}
        return best | shown | {"runners_up": others}


def log_row(p: PlannedLog, between: Sequence[str]) -> dict:
    """One recording as plain data."""
    m = p.motion
    test = {"name": m.name, "kind": "log", "axes": [m.axis]}
    unit, symbol = (DEG, "deg") if m.rotary else (UM, "um")
    return {
        "instrument": "axis_log",
        "between": list(between),
        "test": test,
        "motion": m.words,
        "program": m.program(),
        f"difference_{symbol}": float(f"{p.difference / unit:.4g}") if p.left is None else None,
        "separation": round(p.deviance**0.5, 1) if p.left is None else None,
        "left": None if p.left is None else round(p.left, 3),
        "minutes": round(p.minutes, 1),
        "decides": p.decides,
    }


def _bar_rows(bars: Plan, most: int) -> list:
    said = bars.to_json(most)
    rows = [{k: said[k] for k in ("between", "test", "difference_um", "separation", "minutes")}, *said["runners_up"]]
    pairs = zip(bars.choices, rows, strict=False)
    return [(s, {**row, "decides": bool(s.deviance >= bars.settings.decisive)}) for s, row in pairs]


def plan(
    campaign: Campaign,
    machine: Machine,
    between: tuple[str, str] | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> NextMeasurement | MostTelling | None:
    """The next measurement for what the campaign leaves open; ``None`` where it leaves nothing open.

    Without ``between`` the campaign is diagnosed first. The first finding that has alternatives is told from the first
    of them, with whatever instrument does it best. Where nothing is ambiguous, the first numbers are made known of
    which the logs know a combination only, or the first effect is made to show that ball-bar tests alone cannot show.
    Where something was measured at rest, the answer is the test that tells most of what the campaign does not show.

    Args:
        campaign: With recorded logs, ball-bar tests or both; with ``between`` also without any.
        machine: As given.
        between: Two effect ids, for logs of one axis; or, for ball-bar tests, one and ``"nothing"``.
        threads: Simulations side by side.
        progress: Called as work gets on.
        settings: What decides.

    Raises:
        InputError: Nothing was recorded and no effects are named, or they are not of one axis that logs show.
    """
    parts = campaign.measured_parts
    if any(INSTRUMENTS[name].at_rest for name in parts):
        if between is None:
            return _beside_rest(campaign, machine, threads, progress, settings)
        if all(INSTRUMENTS[name].at_rest for name in parts):
            return _at_rest_between(campaign, machine, between, progress, settings)
    if LogTest.instrument not in parts:
        bars = plan_bars(campaign, machine, between, threads, progress, settings)
        return _with_others(campaign, bars, machine, progress, settings.plan) if bars is not None else None
    logs = parts[LogTest.instrument]
    if between is not None:
        return _between(campaign, machine, between, threads, progress, settings)
    result = diagnose(campaign, machine, None, threads, progress, settings)
    assert result.logs is not None
    found = [e for e in result.effects if e.alternatives and e.models]
    if not found:
        return _for_logs(logs, machine, result.logs.selections, settings.plan)
    pair = found[0].effect.id, found[0].alternatives[0]
    models = [_model_of(found[0].models, i) for i in pair]
    bars = plan_bars(campaign, machine, pair, threads, progress, settings)
    return _across(logs, machine, models, bars, threads, settings)


def _model_of(models: Sequence[CompetingModel], name: str) -> CompetingModel:
    """The first model with a cause in it, by its id or its key."""
    return next(m for m in models if name in (m.effect_id, m.effect_id.split("[")[0]))


def _beside_rest(
    campaign: Campaign, machine: Machine, threads: int, progress: Progress, settings: DiagnosisSettings
) -> NextMeasurement | MostTelling | None:
    """For a campaign in which something was measured at rest."""
    parts = campaign.measured_parts
    result = diagnose(campaign, machine, None, threads, progress, settings)
    found = [e for e in result.effects if e.alternatives]
    if not found:
        return most_telling(campaign, machine, result, threads, progress, settings.plan)
    if not found[0].models:
        assert result.logs is not None
        return _for_logs(parts[LogTest.instrument], machine, result.logs.selections, settings.plan)
    pair = found[0].effect.id, found[0].alternatives[0]
    models = [_model_of(found[0].models, i) for i in pair]
    bars = plan_bars(campaign, machine, pair, threads, progress, settings) if result.has_bars else None
    rests = separating(campaign, machine, models, progress, settings.plan)
    logs: tuple[PlannedLog, ...] = ()
    if LogTest.instrument in parts:
        further = _across(parts[LogTest.instrument], machine, models, bars, threads, settings)
        logs = further.logs if further is not None else ()
    if not rests and not logs and bars is None:
        return None
    return replace(_said(pair, logs, bars, settings.plan, rests), rests=tuple(rests))


def _at_rest_between(
    campaign: Campaign, machine: Machine, between: tuple[str, str], progress: Progress, settings: DiagnosisSettings
) -> NextMeasurement:
    """For two effects that a user names, in a campaign where all was measured at rest."""
    if len(set(between)) != 2:
        raise InputError(f"plan between {' and '.join(between)}: allowed are two different effects")
    models = models_between(campaign, machine, between)
    between = (models[0].effect_id, models[1].effect_id)
    rests = separating(campaign, machine, models, progress, settings.plan)
    if not rests:
        raise InputError(f"plan between {' and '.join(between)}: no test at rest within reach separates them at all")
    return replace(_said(between, (), None, settings.plan, rests), rests=tuple(rests))


def _for_logs(campaign: Campaign, machine: Machine, selections, settings: PlanSettings) -> NextMeasurement | None:
    """For what a search on logs has left open."""
    for axis, s in selections.items():
        like = axis_data(campaign, axis, machine)[0]
        for cause in s.found:
            for other, fit in cause.competing.items():
                choices = LogPlanner(machine, axis, [s.fit, fit], like, settings).apart()
                return _said((cause.effect_id, other), choices, None, settings)
    for axis, s in selections.items():
        like = axis_data(campaign, axis, machine)[0]
        for i in inseparable(s.fit):
            choices = LogPlanner(machine, axis, [s.fit], like, settings).known(i.labels)
            return _said(i.labels, choices, None, settings)
    return None


def _across(
    campaign: Campaign,
    machine: Machine,
    models: Sequence[CompetingModel],
    bars: Plan | None,
    threads: int,
    settings: DiagnosisSettings,
) -> NextMeasurement | None:
    """For two explanations of ball-bar tests: recordings of their axes, and further ball-bar tests.

    ``campaign`` has the recorded logs alone.
    """
    ids = tuple(m.effect_id.split("[")[0] for m in models)
    kinds = {i.partition(".")[0] for i in ids}
    axes = [a for a in dict.fromkeys(i.partition(".")[2] for i in ids) if a in machine.chain.letters]
    choices: list[PlannedLog] = []
    judge = Judge(campaign, machine, threads)
    for axis in axes if kinds & set(MOTOR_SIDE) else ():
        if axis in judge.axes:
            fitter = judge.fitters[axis]
            fits = [fitter.polished(judge.fit(axis, m, {})) for m in models]
            choices += LogPlanner(machine, axis, fits, fitter.data[0], settings.plan).apart()
        else:
            fits = [unmeasured(machine, axis, m) for m in models]
            choices += LogPlanner(machine, axis, fits, settings=settings.plan).apart()
    if not choices and bars is None:
        return None
    return _said(ids, sorted(choices, key=lambda p: p.worth, reverse=True), bars, settings.plan)


def _with_others(
    campaign: Campaign, bars: Plan, machine: Machine, progress: Progress, settings: PlanSettings, most: int = 3
) -> NextMeasurement:
    """A plan for ball-bar tests with recordings of the control and tests at rest that separate the same, the best
    first.

    What a ball bar cannot tell apart, the encoder of one axis often can, without any set-up; or a laser.
    """
    axes = {i.partition(".")[2] for i in bars.between}
    kinds = {i.partition(".")[0] for i in bars.between}
    choices: list[PlannedLog] = []
    if len(axes) == 1 and axes <= set(machine.chain.letters) and kinds & set(MOTOR_SIDE):
        (axis,) = axes
        models = [unmeasured(machine, axis, competing_of(e)) for e in bars.explanations]
        choices = [p for p in LogPlanner(machine, axis, models, settings=settings).apart()[:most] if p.decides]
    truth, other = bars.explanations
    nothing = Posterior((), np.zeros((0, 0)))  # what is taken for true does not adapt
    first = CompetingModel(bars.between[0], truth.machine, nothing, 0.0)
    standing = any(registry.effect_class(i, machine.chain)[0].search.quasi_static for i in bars.between if i != NOTHING)
    rests = separating(campaign, machine, (first, competing_of(other)), progress, settings) if standing else []
    deciding = tuple(p for p in rests if p.decides)
    return NextMeasurement(bars.between, tuple(choices), bars, bars.reason, True, settings, deciding)


def _between(
    campaign: Campaign,
    machine: Machine,
    between: tuple[str, str],
    threads: int,
    progress: Progress,
    settings: DiagnosisSettings,
) -> NextMeasurement | None:
    """For two effects that a user names."""
    axes = {i.partition(".")[2] for i in between}
    place = campaign.folder / "campaign.toml"
    if NOTHING in between or len(axes) != 1 or not axes <= set(machine.chain.letters):
        raise InputError(f"{place}: plan between {' and '.join(between)}; allowed for logs: two effects of one axis")
    (axis,) = axes
    bars = None
    if campaign.in_motion.measured:
        bars = plan_bars(campaign, machine, between, threads, progress, settings)
    campaign = checked_logs(campaign, machine)
    recorded = recorded_axes(campaign.measured)
    if axis not in recorded:
        raise InputError(f"{place}: no log of {axis} has a trace; allowed: effects of {', '.join(recorded)}")
    data = axis_data(campaign, axis, machine)
    search = AxisSearch(machine, data, threads, progress)
    fits = [_with(search, effect_id, place) for effect_id in between]
    choices = LogPlanner(machine, axis, fits, data[0], settings.plan).apart()
    return _said(between, choices, bars, settings.plan)


def _with(search: AxisSearch, effect_id: str, place) -> AxisFit:
    """The data sheet with one effect, fitted."""
    sheet = search.sheet()
    if effect_id == f"servo_delay.{search.axis}":  # the log is shifted by it, or it is not in the log at all
        late = registry.make(effect_id, search.machine.chain, delay_ms=_DELAY_MS)
        start = start_model(search.machine.with_effect(late), search.fitter.data, search.gains)
        return search.fitter.polished(search.fitter.fit(start))
    able = [c for c in search.catalogue.missing(sheet.model) if c.effect.id == effect_id]
    if not able:
        allowed = ", ".join(sorted({c.effect.id for c in search.catalogue.missing(sheet.model)}))
        raise InputError(f"{place}: plan for {effect_id}; allowed for this axis' logs: {allowed}")
    fits = [search.fitter.fit(c.extend(sheet.model)) for c in able]
    return search.fitter.polished(max(fits, key=lambda f: f.evidence))


def _said(
    between: Sequence[str],
    choices: Sequence[PlannedLog],
    bars: Plan | None,
    settings: PlanSettings,
    rests: Sequence[PlannedTest] = (),
) -> NextMeasurement:
    """A plan with its reason."""
    known = bool(choices) and choices[0].left is not None
    what = f"makes {', '.join(between)} known" if known else f"separates {between[0]} from {between[1]}"
    if not known and between[1] == NOTHING:
        what = f"makes {between[0]} show"
    count = len(choices) + len(rests) + (len(bars.choices) if bars is not None else 0)
    named = (("recordings", bool(choices)), ("tests at rest", bool(rests)), ("ball-bar tests", bars is not None))
    kinds = " and ".join(name for name, have in named if have)
    decides = (
        any(p.decides for p in rests[:1]) or any(c.decides for c in choices[:1]) or (bars is not None and bars.decides)
    )
    if decides and count == 1:
        reason = f"It is the only one within reach that {what}."
    elif decides:
        reason = f"Of {count} {kinds} within reach this one {what} best per minute of machine time."
    else:
        reason = f"None of {count} {kinds} within reach {what} clearly; this one comes nearest."
    return NextMeasurement(tuple(between), tuple(choices), bars, reason, settings=settings)
