"""The workbench without a page: a model, its changes and what they do to the error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_of
from mjsim.campaign.model import Campaign
from mjsim.commands.diagnose import diagnose
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.edit import best_effect, resolve_effect
from mjsim.commands.saved import saved_of
from mjsim.errors import InputError
from mjsim.inference.considered import with_instrument
from mjsim.inference.effect_vector import EffectVector
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.io.toml import read_text
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.prediction.part_run import PartRun
from mjsim.prediction.result import Prediction
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import UM
from mjsim.workbench import save as saving
from mjsim.workbench import svg
from mjsim.workbench.gains import Gain, Gains
from mjsim.workbench.jobs import Stopped
from mjsim.workbench.overlay import OpenCampaign, Overlay, Readings, Trace, overlay, reversals_of, with_one
from mjsim.workbench.recordings import LogBench, RecordingsBench, SharedRecordings
from mjsim.workbench.tried import ChangedModel


class Shared:
    """What all workbenches of one campaign share: the campaign, simulated readings, signatures.

    Args:
        opened: The campaign.
    """

    def __init__(self, opened: OpenCampaign) -> None:
        self.opened = opened
        self.readings = Readings(opened)
        self.gains = Gains(opened) if opened.problem is not None else None
        self.text = read_text(opened.machine.path) if opened.machine.path else ""


class Workbench(ChangedModel):
    """A model that is changed effect by effect while its error is watched. Nothing is written before :meth:`save`.

    Args:
        shared: Of the campaign; :func:`workbench` makes it.
    """

    diagnosis: Diagnosis | None

    def __init__(self, shared: Shared) -> None:
        self.shared, self.opened = shared, shared.opened
        super().__init__(self.opened.campaign, self.opened.machine, shared.text, self.opened.threads)

    @property
    def can_fit(self) -> bool:
        """Whether a test was measured."""
        return self.shared.gains is not None

    def quick(self, machine: Machine | None = None) -> Overlay:
        """The present model (or another one) over all tests, with what is there of the multibody model and the drives
        alone for the rest; some 0.1 s.

        Raises:
            InputError: An effect acts on what the machine does not have.
            SimulationError: A drive is unstable.
        """
        machine = machine or self.machine
        kept = self.shared.readings.kept(machine)
        missing = [t.name for t in self.opened.tests if t.name not in kept]
        alone = self.shared.readings.drives_alone(machine, missing) if missing else {}
        return self._noted(overlay(self.opened, machine, alone | kept))

    def quick_one(self, name: str, now: Overlay) -> Overlay:
        """One test of the present model beside the other tests of an earlier overlay: what a page can show first; some
        0.01 s.

        Raises:
            InputError: An effect acts on what the machine does not have.
            SimulationError: A drive is unstable.
        """
        machine, readings = self.machine, self.shared.readings
        found = readings.kept(machine, [name]) or readings.drives_alone(machine, [name])
        return with_one(self.opened, machine, name, found[name], now)

    def full(self, names: Sequence[str] | None = None, machine: Machine | None = None) -> Overlay:
        """As :meth:`quick`, after some tests (all) were simulated in the multibody model.

        Args:
            names: Of the tests.
            machine: In place of the present model.

        Raises:
            InputError: There is no multibody model of such a machine.
            SimulationError: The simulation cannot be trusted.
        """
        machine = machine or self.machine
        self.shared.readings.multibody(machine, names if names is not None else [t.name for t in self.opened.tests])
        return self.quick(machine)

    def _noted(self, result: Overlay) -> Overlay:
        if result.rms is not None:
            self.ladder.note(result.machine, result.rms, result.engine)
        return result

    @property
    def noise(self) -> float | None:
        """RMS of one sample's noise, m; ``None`` where nothing was measured."""
        return self.opened.problem.noise.rms if self.opened.problem is not None else None

    def __repr__(self) -> str:
        rms = self.ladder.present.rms
        error = f", residual RMS {rms / UM:.3f} µm ({self.ladder.present.engine})" if rms is not None else ""
        return f"<{type(self).__name__} {self.campaign.name}: {self.ladder.present.label}{error}>"

    # -- what effects could explain ------------------------------------------------------------------------------------

    def update_gains(
        self, waves: bool = True, progress: Progress = silent, stopped: Callable[[], bool] = lambda: False
    ) -> dict[str, Gain]:
        """How much of the present residual each effect could explain, by its id; takes some seconds.

        Args:
            waves: Also look for pitch errors and torque ripples, whose orders are read off a spectrum.
            progress: Stage, done, total.
            stopped: Asked now and then.

        Raises:
            Stopped: It was stopped.
        """
        if self.shared.gains is None:
            return {}
        self.shared.gains.prepare(progress, stopped)
        if stopped():
            raise Stopped
        machine = self.machine
        found = self.shared.gains.of(machine, waves)
        self.gains, self._gains_of, self.gains_complete = found, machine, waves
        return found

    # -- fits and the diagnosis ----------------------------------------------------------------------------------------

    def _need_gains(self) -> Gains:
        if self.shared.gains is None:
            raise InputError(f"{self.campaign.folder / 'campaign.toml'}: no test has a trace; there is nothing to fit")
        return self.shared.gains

    def fit(self, effect_id: str) -> Effect:
        """Fit one effect, with set-up, instrument and data sheet beside it; it enters the model at its best values.

        Raises:
            InputError: There is no such effect, or it changes no reading.
        """
        gains, machine = self._need_gains(), self.machine
        present = machine.effect(effect_id)
        known = self.gains.get(effect_id)
        if present is None and known is not None and known.significant:
            present = known.effect
        done = fit(gains, machine, [present]) if present else fit_new(gains, machine, effect_id)
        self.intervals |= done.intervals
        self.put(f"fit {effect_id}", done.machine)
        effect = self.effect(effect_id)
        assert effect is not None
        return effect

    def fit_all(self) -> list[Effect]:
        """Fit all effects together that the machine file lacks or has with other values.

        Raises:
            InputError: There is none.
        """
        gains, free = self._need_gains(), self.need_changed_effects()
        done = fit(gains, self.machine, free)
        self.intervals |= done.intervals
        self.put("fit all", done.machine)
        return self.changed_effects()

    def diagnose(self, progress: Progress = silent, max_effects: int | None = None) -> Diagnosis:
        """Search for what the present model lacks, as ``mjsim diagnose`` does.

        Args:
            progress: Stage, done, total; what it raises stops the search.
            max_effects: At most so many effects; without it as many as the data prove.

        Raises:
            InputError: No test was measured.
        """
        self.diagnosis = diagnose(self.campaign, self.machine, max_effects, self.threads, progress)
        return self.diagnosis

    def predict(self, run: PartRun) -> Prediction:
        """The error of a part on the present model.

        The interval follows from the last diagnosis, where the model has what that found; otherwise from the
        tolerances in the machine file.

        Args:
            run: The program.

        Raises:
            InputError: The file cannot be read, or the program does not fit the machine.
        """
        machine, found = self.machine, self.diagnosis
        if found is None or found.posterior is None or any(machine.effect(e.effect.key) is None for e in found.effects):
            return run.on(machine)
        return run.on(machine, replace(saved_of(found), machine=machine))

    # -- writing -------------------------------------------------------------------------------------------------------

    def save_makes_worse(self) -> bool:
        """Whether the present model fits worse than the machine file's, by the drives alone."""
        now, file = self.quick().rms, self.quick(self.saved).rms
        return now is not None and file is not None and now > file

    def save(self, force: bool = False, progress: Progress = silent) -> list[saving.Change]:
        """Write the present model to the machine file, and its steps to the history, as ``mjsim add`` does.

        Args:
            force: Save a model that fits worse than the file's, too.
            progress: Stage, done, total.

        Raises:
            InputError: The file was changed meanwhile, nothing was measured, or the model fits worse.
        """
        with self._lock:
            machine = self.machine
            done = saving.save(self.shared.readings, self.saved, machine, self._text, force, progress)
            if done:
                self.saved, self._text = machine, read_text(machine.file)
        return done

    # -- pictures ------------------------------------------------------------------------------------------------------

    def show(self, name: str | None = None) -> Picture:
        """A picture that Jupyter draws.

        Args:
            name: A test: its traces. An effect: the tests that it changes most, with and without it. Nothing: all
                tests with their errors.

        Raises:
            InputError: There is no such test or effect.
        """
        return picture(self, name)


def workbench(campaign: Campaign | str | Path, machine: Machine | str | Path | None = None, threads: int = 2) -> Any:
    """Open a campaign in the workbench, without a page.

    Args:
        campaign: A campaign or its folder; with ball-bar tests it needs no traces.
        machine: A model or the file of one; the campaign's own where it is missing.
        threads: Tests that are worked on side by side.

    Returns:
        A :class:`Workbench` of its ball-bar tests; a :class:`~mjsim.workbench.recordings.LogBench` where axis logs, and
        a :class:`~mjsim.workbench.recordings.RecordingsBench` where other recordings are all that was measured.

    Raises:
        InputError: A file is wrong, or the traces show a mistake.
    """
    if not isinstance(campaign, Campaign):
        campaign = read_campaign(campaign)
    if not isinstance(machine, Machine):
        machine = machine_of(campaign, machine)
    return bench_of(shared_of(campaign, machine, threads))


def shared_of(campaign: Campaign, machine: Machine, threads: int) -> Shared | SharedRecordings:
    """What all workbenches of a campaign share; ball-bar tests go first."""
    measured = campaign.measured_parts
    if campaign.in_motion.measured or not measured:
        return Shared(OpenCampaign.of(campaign, machine, threads))
    return SharedRecordings(campaign, machine, threads)


def bench_of(shared: Shared | SharedRecordings) -> Workbench | RecordingsBench:
    """A workbench of a campaign: with fits and a diagnosis where ball-bar tests or axis logs were measured."""
    if isinstance(shared, Shared):
        return Workbench(shared)
    logs = set(shared.campaign.measured_parts) == {LogTest.instrument}
    return LogBench(shared) if logs else RecordingsBench(shared)


# -- fits of effects ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Fitted:
    """Effects at their best values.

    Attributes:
        machine: The model with them.
        intervals: 95 % intervals by the effect's key and the parameter's name, in the units of the names.
    """

    machine: Machine
    intervals: dict[str, dict]


def names_of(effect: Effect) -> tuple[str, ...]:
    """Names of the parameters of an effect that a fit sets free."""
    return effect.search.free_of(effect.parameters_of(effect.subject))


@one_blas_thread
def fit(gains: Gains, machine: Machine, effects: list[Effect]) -> Fitted:
    """Fit some effects together with set-up, instrument and data sheet; of these, only the effects enter the model.

    Args:
        gains: Of the campaign.
        machine: The model; it need not have the effects.
        effects: Where the fit starts.

    Raises:
        InputError: None of them changes a reading of this campaign.
    """
    usual = [e for e in effects if e.kind != "vibration"]
    intervals: dict[str, dict] = {}
    for e in effects:
        if e.kind == "vibration":
            machine, intervals[e.key] = _fit_from_file(gains, machine, e.id)
    if usual:
        with gains.turn:
            fitter = gains.fitter(machine)
            free = [EffectVector(e, names_of(e)) for e in usual]
            near = fitter.fit(free, exact=False)
            result = with_instrument(fitter.problem, fitter.fit(near.effects, start=near))
        for f in result.effects:
            machine = machine.with_effect(f.effect)
            intervals[f.effect.key] = f.interval(f.vector, result.covariance_of(f))
    return Fitted(machine, intervals)


@one_blas_thread
def fit_new(gains: Gains, machine: Machine, effect_id: str) -> Fitted:
    """Fit an effect that the model lacks, from all its starting points, as ``mjsim add`` does.

    Args:
        gains: Of the campaign.
        machine: The model.
        effect_id: ``kind.SUBJECT``.

    Raises:
        InputError: There is no such effect, or it changes no reading of this campaign.
    """
    machine, intervals = _fit_from_file(gains, machine, effect_id)
    return Fitted(machine, {effect_id: intervals})


def _fit_from_file(gains: Gains, machine: Machine, effect_id: str) -> tuple[Machine, dict]:
    cls, subjects, _ = resolve_effect(effect_id, machine.chain)
    problem = gains.opened.background
    if problem is None:
        raise InputError(f"effect {effect_id}: nothing to fit; no test of the campaign has a trace")
    with gains.turn:
        effect, intervals = best_effect(problem, machine, cls, subjects)
    return machine.with_effect(effect), intervals


# -- pictures of the workbench for Jupyter -----------------------------------------------------------------------------

#: Tests that a picture of an effect has.
_TESTS = 3
_STYLE = """<style>
.mjsim { display: flex; flex-wrap: wrap; gap: 12px; font: 12px sans-serif; padding: 8px;
  color: #1a1a1a; background: #fff }
.mjsim figure { margin: 0; width: 180px } .mjsim figure.large { width: 340px } .mjsim figcaption { text-align: center }
.mjsim p { flex-basis: 100%; margin: 0 } .mjsim path, .mjsim circle, .mjsim line { fill: none; stroke-width: 0.6 }
.mjsim .grid { stroke: #dedede } .mjsim .nominal { stroke: #8a8a8a } .mjsim .turn { stroke: #0072b2 }
.mjsim path.measured { stroke: #222 } .mjsim path.simulated { stroke: #d9480f }
.mjsim text { font-size: 6px; stroke: none; fill: #1a1a1a; text-anchor: middle; dominant-baseline: middle }
.mjsim text.scale { text-anchor: end }
</style>"""


@dataclass(frozen=True)
class Picture:
    """A picture: Jupyter shows it, ``html`` is its text.

    Attributes:
        html: The whole picture.
        caption: What it shows, in one sentence.
    """

    html: str
    caption: str

    def _repr_html_(self) -> str:
        return self.html

    def __repr__(self) -> str:
        return self.caption


def picture(bench: Workbench, name: str | None) -> Picture:
    """What the workbench shows in Jupyter: see :meth:`mjsim.workbench.state.Workbench.show`."""
    now = bench.full()
    if name is None:
        caption = f"{bench.ladder.present.label}: {error_words(now, bench.noise)}"
        return _made(caption, [_figure(t, svg.polar(t, small=True)) for t in now.traces.values()])
    if name in now.traces:
        trace = now.traces[name]
        drawn = svg.polar(trace, reversals_of(bench.opened, name))
        return _made(f"{name}: {_rms(trace)} ({trace.engine})", [_figure(trace, drawn, True)])
    other = machine_with_or_without(bench, name)
    present = bench.effect(name) is not None
    without, having = (bench.full(machine=other), now) if present else (now, bench.full(machine=other))
    caption = f"{name}: {error_words(without, None)} without it, {error_words(having, bench.noise)} with it"
    figures = []
    for test in most_changed(without, having)[:_TESTS]:
        for laid, words in ((without, "without"), (having, "with")):
            trace = laid.traces[test]
            figures.append(_figure(trace, svg.polar(trace, reversals_of(bench.opened, test)), True, words))
    return _made(caption, figures)


def machine_with_or_without(bench: Workbench, effect_id: str) -> Machine:
    """The present model with an effect that it lacks, or without one that it has.

    Raises:
        InputError: There is no such test or effect.
    """
    if bench.effect(effect_id) is not None:
        return bench.machine.without(effect_id)
    try:
        return bench.machine.with_effect(bench.start_of(effect_id))
    except InputError as error:
        raise InputError(f"{error}; tests: {', '.join(t.name for t in bench.opened.tests)}") from None


def most_changed(a: Overlay, b: Overlay) -> list[str]:
    """Names of the tests, those first whose simulated traces differ most between two overlays."""

    def change(name: str) -> float:
        x, y = a.traces[name].simulated, b.traces[name].simulated
        return float(np.std(x - y)) if len(x) == len(y) else 0.0

    return sorted(a.traces, key=lambda name: -change(name))


def error_words(overlay: Overlay, noise: float | None) -> str:
    """Such as ``residual RMS 1.082 µm (multibody), noise 0.117 µm``."""
    if overlay.rms is None:
        return f"simulated ({overlay.engine}); nothing was measured"
    said = f"residual RMS {overlay.rms / UM:.3f} µm ({overlay.engine})"
    return said + (f", noise {noise / UM:.3f} µm" if noise is not None else "")


def _rms(trace: Trace) -> str:
    return f"RMS {trace.rms / UM:.3f} µm" if trace.measured is not None else "not measured"


def _figure(trace: Trace, drawn: str, large: bool = False, words: str = "") -> str:
    text = f"{trace.test.name}{f', {words}' if words else ''}: {_rms(trace)}"
    return f'<figure class="{"large" if large else ""}">{drawn}<figcaption>{escape(text)}</figcaption></figure>'


def _made(caption: str, figures: list[str]) -> Picture:
    legend = f"{caption}. Black: measured. Orange: simulated."
    return Picture(f'{_STYLE}<div class="mjsim"><p>{escape(legend)}</p>{"".join(figures)}</div>', caption)
