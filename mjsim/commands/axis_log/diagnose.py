"""What is missing from a machine's model, from axis logs; and the numbers of its drives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.compare import checked_logs, overlay_logs
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.axis_log.numbers import parameter_intervals, sheet_of
from mjsim.commands.finding import DiagnosedEffect
from mjsim.errors import InputError
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.encoders import BETWEEN, EncoderFitter, EncoderSearch, encoder_data
from mjsim.inference.axis_logs.entries import CONTROLLER, KnownNumbers
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.found import AxisSelection, FoundCause
from mjsim.inference.axis_logs.gains import CONTRADICTED, unused
from mjsim.inference.axis_logs.search import AxisSearch
from mjsim.inference.axis_logs.separability import inseparable, undetermined
from mjsim.inference.axis_logs.shared import MOTOR_SIDE
from mjsim.inference.axis_logs.together import known_together
from mjsim.inference.axis_logs.unexplained import unexplained_rest
from mjsim.inference.findings import FINDING
from mjsim.inference.outcome import verdict_of
from mjsim.instruments.axis_log.measurement import LogTest, recorded_axes
from mjsim.instruments.axis_log.signals import (
    Finding,
    counts_against,
    fed_forward,
    findings,
    not_used_because,
    used_up_to_a_factor,
    used_without_law,
)
from mjsim.machine.model import Machine, sheet_name
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread

#: Effects behind the motor's encoder, which a log without an encoder at the load cannot show.
_BEHIND = ("backlash", "pitch_error", "scale_error", "worm_wear", "thermal_drift", "drive_compliance")
#: Why an encoder at the load is not used beside the actual position of an axis whose encoder is said to be there.
_ACTUAL_IS_LOAD = 'the actual position is that of the load (encoder = "load" in the machine file)'
#: Most causes that are looked for on each axis where the user does not say.
_MOST = 8


@one_blas_thread
def diagnose_logs(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    known: Mapping[str, KnownNumbers] | None = None,
) -> LogDiagnosis:
    """Find what is missing from the model of the recorded axes, and the numbers of their drives.

    Axes do not act on each other in a log: each is searched alone, over all its recordings.

    Args:
        campaign: With at least one recording.
        machine: As given.
        max_effects: At most so many causes on each axis; without it eight.
        threads: Simulations side by side.
        progress: Called as work gets on.
        known: What another instrument knows, by axis.

    Raises:
        InputError: No log has a recording, or a controller is missing.
    """
    campaign = checked_logs(campaign, machine)
    data = {axis: axis_data(campaign, axis, machine) for axis in recorded_axes(campaign.measured)}
    loads = {a: recorded for a, d in data.items() if (recorded := encoder_data(d, machine))}

    def run(searches: Mapping[str, AxisSearch]) -> dict[str, AxisSelection]:
        return {axis: search.run(max_effects or _MOST) for axis, search in searches.items()}

    between = run({a: EncoderSearch(machine, d, threads, progress) for a, d in loads.items()})
    # where the loop is closed on the load, what is between the encoders is inside it
    inside = merged(machine, [s.fit for a, s in between.items() if machine.drives[a].encoder != "motor"])
    searches = {axis: AxisSearch(inside, d, threads, progress, (known or {}).get(axis)) for axis, d in data.items()}
    selections = run(searches)
    fitters = {a: s.fitter for a, s in searches.items()}
    return log_diagnosis(campaign, machine, fitters, selections, between)


def log_diagnosis(
    campaign: Campaign,
    machine: Machine,
    fitters: Mapping[str, LogFitter],
    selections: Mapping[str, AxisSelection],
    between: Mapping[str, AxisSelection] | None = None,
) -> LogDiagnosis:
    """What the searches of all axes come to.

    Args:
        campaign: What was recorded.
        machine: As given.
        fitters: Of the axes, by letter.
        selections: What was found, by letter.
        between: What was found between the two encoders of an axis, by letter.
    """
    between = between or {}
    fitted = merged(machine, [s.fit for s in (*between.values(), *selections.values())])
    before = overlay_logs(campaign, machine, {a: (fitters[a], s.given) for a, s in selections.items()})
    after = overlay_logs(campaign, fitted, {a: (fitters[a], s.fit) for a, s in selections.items()})
    every = (*selections.values(), *between.values())
    effects = sorted((e for s in every for e in effects_of(s)), key=lambda e: -e.gain)
    small = {c.effect_id: None for s in every for c in s.found}
    rest = [
        r
        for a, s in selections.items()
        if (r := unexplained_rest(fitters[a], s.fit, machine.drives[a].gear)) is not None
    ]
    for a, s in between.items():
        own = EncoderFitter(machine, encoder_data(fitters[a].data, machine), 1)
        if (r := unexplained_rest(own, s.fit, machine.drives[a].gear)) is not None:
            rest.append(replace(r, between=True))
    return LogDiagnosis(
        campaign,
        "unknown" if rest else verdict_of((e.is_open for e in effects), False),
        tuple(effects),
        tuple(n for a, s in selections.items() for n in sheet_of(machine, a, s)),
        tuple(i for s in selections.values() for i in inseparable(s.fit)),
        tuple(rest),
        tuple(hidden_effects(campaign, machine)),
        fitted,
        before,
        after,
        selections,
        between,
        tuple(_signals(campaign, machine, fitters, selections)),
        tuple(i for i in small if i not in {e.effect.id for e in effects}),
    )


def _signals(
    campaign: Campaign, machine: Machine, fitters: Mapping[str, LogFitter], selections: Mapping[str, AxisSelection]
) -> Iterator[Finding]:
    """What the recorded channels are like, and which of them this diagnosis did not use."""
    yield from (f for f in findings(campaign.measured, campaign.traces, campaign.instrument) if not f.refused)
    for axis, s in selections.items():
        for g in (g for g in s.gains if g.channel not in ("torque", "force", "velocity_command")):
            said = [sheet_name(name)[0] for name in g.values]
            mine = [d.name for d in fitters[axis].data if d.test.controller == g.controller]
            yield from (used_up_to_a_factor(test, axis, g.channel, said) for test in mine)
        for g in s.gains:
            if g.feedforward is None:
                continue
            share, deviation = g.feedforward
            stated = machine.under(g.controller).drives[axis].feedforward
            for d in fitters[axis].data:
                of_this = d.test.controller == g.controller and d.record.velocity_command is not None
                if of_this and abs(share - stated) > CONTRADICTED * deviation:
                    yield fed_forward(d.name, axis, share, stated)
        rows = {(r.name, r.channel) for r in fitters[axis].rows}
        for d in fitters[axis].data:
            given = campaign.traces[d.name].axes[axis]
            for name in ("torque", "force"):
                recorded, used = getattr(given, name), getattr(d.record, name)
                if recorded is not None and np.any(recorded != used):
                    yield counts_against(d.name, axis, name)
        for (test, name), why in unused(machine, fitters[axis].data, s.gains).items():
            yield (used_without_law if (test, name) in rows else not_used_because)(test, axis, name, why)
        if machine.drives[axis].encoder == "load":
            for d in (d for d in fitters[axis].data if d.record.load is not None):
                yield not_used_because(d.name, axis, "load", _ACTUAL_IS_LOAD)


def hidden_effects(campaign: Campaign, machine: Machine) -> list[str]:
    """Ids of effects behind the encoders of the recorded axes that no recorded encoder at the load shows."""
    loads = {a for t in campaign.measured for a in t.axes if campaign.traces[t.name].axes[a].load is not None}
    axes = recorded_axes(campaign.measured)
    loop_at = {a: machine.drives[a].encoder for a in axes}
    shown = {a: ("backlash",) if loop_at[a] == "load" else BETWEEN if a in loads else () for a in axes}
    hidden = [f"{kind}.{a}" for a in axes for kind in _BEHIND if kind not in shown[a]]
    return [h for h in hidden if exists(h, machine)]


def seen_by_logs(campaign: Campaign, machine: Machine) -> set[str]:
    """Ids of effects of the recorded drives that the recordings can show."""
    axes = recorded_axes(campaign.measured)
    every = {f"{kind}.{a}" for a in axes for kind in (*MOTOR_SIDE, *_BEHIND)}
    return {i for i in every if exists(i, machine)} - set(hidden_effects(campaign, machine))


def exists(effect_id: str, machine: Machine) -> bool:
    """Whether the catalogue has an effect for this machine."""
    from mjsim.effects import registry

    try:
        registry.effect_class(effect_id, machine.chain)
    except InputError:
        return False
    return True


def merged(machine: Machine, fits: list[AxisFit]) -> Machine:
    """One machine with the fitted numbers and effects of every axis."""
    drives, controllers = dict(machine.drives), {n: dict(c) for n, c in machine.controllers.items()}
    out = machine
    for fit in fits:
        axis, found = fit.model.axis, fit.model.machine
        drives[axis] = found.drives[axis]
        ran = {e.where for e in fit.model.entries if e.owner == CONTROLLER}
        for name, axes in found.controllers.items():
            if axis in axes:
                controllers[name][axis] = axes[axis]
        # positions fix ratios of torques only: what the logs scaled, they scaled for every controller of the axis
        ratios = [found.controllers[n][axis].velocity_gain / machine.controllers[n][axis].velocity_gain for n in ran]
        for name, axes in machine.controllers.items():
            if ratios and axis in axes and name not in ran:
                scaled = axes[axis].velocity_gain * float(np.exp(np.mean(np.log(ratios))))
                controllers[name][axis] = replace(axes[axis], velocity_gain=scaled)
        for effect in found.effects:
            if effect.subject == axis:
                out = out.with_effect(effect)
    return replace(out, drives=drives, controllers=controllers)


def _order_of(cause: FoundCause) -> float | None:
    """Order of the wave that a cause is one of several of."""
    several = cause.effect_id.partition(".")[0] in ("cogging", "pitch_error")
    return float(cause.key.rpartition(" ")[2]) if several else None


def effects_of(selection: AxisSelection) -> list[DiagnosedEffect]:
    """Findings on one axis with their parameters; two shapes of one effect are one cause."""
    fit, out = selection.fit, {}
    ranges, open_ = parameter_intervals(fit), undetermined(fit)
    for cause in selection.found:
        effect, ci = fit.model.machine.effect(cause.effect_id), ranges.get(cause.effect_id, {})
        assert effect is not None
        # where more is left than a sound machine leaves, a finding may be the work of what is in no catalogue
        is_finding = cause.whole >= FINDING and cause.whole * cause.known >= 0.5
        if not is_finding or (effect.id in out and out[effect.id].gain >= cause.gain):
            continue
        out[effect.id] = DiagnosedEffect(
            effect,
            tuple(ci),
            ci,
            *selection.step_of(cause.key),
            tuple(cause.others),
            cause.tests,
            cause.gain,
            cause.rejected,
            found_by=LogTest.instrument,
            together=known_together(fit, effect.id, _order_of(cause)),
            probability=cause.probability,
            others=cause.others,
            whole=cause.whole * cause.known,
            undetermined=tuple(name for name in ci if f"{effect.id}.{name}" in open_),
        )
    return list(out.values())
