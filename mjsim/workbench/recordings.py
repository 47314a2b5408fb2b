"""The workbench of recordings of any instrument but a ball bar, without a page: a model and what changes do to it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mjsim.campaign.machine_file import machine_document
from mjsim.campaign.model import Campaign
from mjsim.commands import history
from mjsim.commands.axis_log.diagnose import diagnose_logs, merged
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.axis_log.numbers import parameter_intervals
from mjsim.commands.compare import compare
from mjsim.commands.comparison import Comparison
from mjsim.errors import InputError
from mjsim.inference.axis_logs.as_given import fit_as_given
from mjsim.inference.axis_logs.candidates import Catalogue
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.entries import Entry
from mjsim.inference.axis_logs.fit import LogFitter
from mjsim.inference.axis_logs.found import LogModel
from mjsim.inference.axis_logs.gains import read_gains
from mjsim.inference.axis_logs.promise import take_first_steps
from mjsim.inference.axis_logs.start import start_model
from mjsim.inference.axis_logs.waves import strongest_orders
from mjsim.inference.search import LEAST
from mjsim.instruments.axis_log.measurement import recorded_axes
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.files import write_all
from mjsim.io.toml import read_text
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.workbench import catalogue
from mjsim.workbench import save as saving
from mjsim.workbench.gains import Gain
from mjsim.workbench.jobs import Stopped
from mjsim.workbench.overlay import DRIVES
from mjsim.workbench.tried import ChangedModel


class SharedRecordings:
    """What all workbenches of one campaign share.

    Args:
        campaign: As it was read, without ball-bar tests that were measured.
        machine: The model to begin with.
        threads: Simulations side by side.

    Raises:
        InputError: Nothing was measured, a controller is missing, or a recording shows a mistake.
    """

    def __init__(self, campaign: Campaign, machine: Machine, threads: int = 2) -> None:
        self.campaign, self.machine, self.threads = campaign, machine, threads
        self.first = compare(campaign, machine, threads)
        self.text = read_text(machine.path) if machine.path else ""


class RecordingsBench(ChangedModel):
    """A model that is changed effect by effect. Nothing is written before :meth:`save`.

    Args:
        shared: Of the campaign.
    """

    diagnosis: LogDiagnosis | None

    def __init__(self, shared: SharedRecordings) -> None:
        super().__init__(shared.campaign, shared.machine, shared.text, shared.threads)
        self.shared = shared

    @property
    def can_fit(self) -> bool:
        """Only axis logs fit effects so far."""
        return False

    def fit(self, effect_id: str) -> Effect:
        """Fit one effect.

        Raises:
            InputError: The instrument fits none.
        """
        raise self._unable("fit")

    def fit_all(self) -> list[Effect]:
        """Fit all effects together that the machine file lacks or has with other values.

        Raises:
            InputError: The instrument fits none.
        """
        raise self._unable("fit")

    def diagnose(self, progress: Progress = silent) -> LogDiagnosis:
        """Search for what the present model lacks.

        Raises:
            InputError: No diagnosis works with the instrument.
        """
        raise self._unable("diagnosis")

    def take_fitted(self) -> None:
        """Take the whole machine of the last diagnosis; nothing happens where there was none."""

    def _unable(self, what: str) -> InputError:
        noun = INSTRUMENTS[self.campaign.measured[0].instrument].noun
        return InputError(f"{self.campaign.folder / 'campaign.toml'}: no {what} works with the tests of a {noun}")

    @property
    def noise(self) -> float:
        """Largest noise of a linear axis, m; 0 where there is none."""
        return self.shared.first.noise

    def quick(self, machine: Machine | None = None) -> Comparison:
        """The present model (or another one) laid over all recordings; some 20 ms for a recording of 4 s.

        Raises:
            InputError: An effect acts on what the machine does not have.
            SimulationError: A drive is unstable.
        """
        machine = machine or self.machine
        result = compare(self.campaign, machine, self.threads)
        self.ladder.note(machine, result.rms, DRIVES)
        return result

    def update_gains(self, stopped: Callable[[], bool] = lambda: False) -> dict[str, Gain]:
        """What each effect could explain is not known of any instrument; ``stopped`` is asked now and then."""
        return {}

    def save_makes_worse(self) -> bool:
        """Whether the present model fits worse than the machine file's."""
        return self.quick().rms > self.quick(self.saved).rms

    def save(self, force: bool = False, progress: Progress = silent) -> list[saving.Change]:
        """Write the present model to the machine file; the former text is kept in ``.mjsim``.

        Args:
            force: Save a model that fits worse than the file's, too.
            progress: Stage, done, total.

        Raises:
            InputError: The file was changed meanwhile, or the model fits worse.
        """
        with self._lock:
            steps, path = self.unsaved, self.machine.file
            if not steps:
                return []
            saving.check_unchanged(path, self._text)
            progress("simulating what is saved", 0, 1)
            if not force and self.save_makes_worse():
                raise InputError(f"{path}: the model fits worse than the file's; nothing was written")
            document = machine_document(self.machine, path, self._text)
            write_all(history.changed_machine(document, path, self.campaign), force=True)
            self.saved, self._text = self.machine, read_text(path)
        return steps


# -- the workbench of a campaign of axis logs, without a page ----------------------------------------------------------

#: Prior standard deviation of a fitted number, logarithms and typical sizes: next to none.
_WIDE, _WIDE_LOG = 1e3, 10.0


class LogBench(RecordingsBench):
    """A model of the recorded axes, whose effects and data sheet can be fitted and searched.

    Args:
        shared: Of the campaign.
    """

    @property
    def can_fit(self) -> bool:
        """The recordings of an axis fit its effects."""
        return True

    @property
    def catalogue(self) -> dict[str, list[catalogue.Entry]]:
        """The effects that can be put in, by recorded axis."""
        groups = catalogue.by_axis(self.machine, logs=True)
        return {a: rows for a, rows in groups.items() if a in recorded_axes(self.campaign.measured)}

    def update_gains(self, stopped: Callable[[], bool] = lambda: False) -> dict[str, Gain]:
        """How much of the present residual of its axis each effect could explain, by its id; takes some seconds.

        Args:
            stopped: Asked now and then.

        Raises:
            Stopped: It was stopped.
            SimulationError: A drive is unstable.
        """
        machine = self.machine
        found = log_gains(self.campaign, machine, self.threads, stopped)
        self.gains, self._gains_of, self.gains_complete = found, machine, True
        return found

    def fit(self, effect_id: str) -> Effect:
        """Fit one effect, with the data sheet of its axis and the nuisances beside it.

        Raises:
            InputError: There is no such effect, its axis was not recorded, or it is a wave in several set-ups.
        """
        effect = self.effect(effect_id) or self.start_of(effect_id)
        self.put(f"fit {effect.id}", self._fitted([effect]))
        fitted = self.effect(effect.id)
        assert fitted is not None
        return fitted

    def fit_all(self) -> list[Effect]:
        """Fit all effects together that the machine file lacks or has with other values, axis by axis.

        Raises:
            InputError: There is none, or one of them is a wave in several set-ups.
        """
        free = self.need_changed_effects()
        self.put("fit all", self._fitted(free))
        return [e for e in self.machine.effects if e.id in {f.id for f in free}]

    @one_blas_thread
    def _fitted(self, effects: list[Effect]) -> Machine:
        """The present model with some effects fitted, those of one axis together."""
        machine, recorded, fits = self.machine, recorded_axes(self.campaign.measured), []
        for axis in dict.fromkeys(e.subject for e in effects):
            mine = [e for e in effects if e.subject == axis]
            if axis not in recorded:
                raise InputError(f"{mine[0].key}: {axis} was not recorded; allowed: {', '.join(recorded)}")
            data = axis_data(self.campaign, axis, machine)
            model = start_model(machine, data, read_gains(machine, data))
            for effect in mine:
                model = model.extended(effect, _entries(effect, len({d.test.setup for d in data})))
            fitter = LogFitter(machine, data, self.threads)
            fits.append(fitter.polished(fitter.fit(model)))
        for fit in fits:
            self.intervals |= parameter_intervals(fit)
        return merged(machine, fits)

    def diagnose(self, progress: Progress = silent) -> LogDiagnosis:
        """Search for what the present model lacks, as ``mjsim diagnose`` does.

        Args:
            progress: Stage, done, total; what it raises stops the search.
        """
        self.diagnosis = diagnose_logs(self.campaign, self.machine, threads=self.threads, progress=progress)
        return self.diagnosis

    def take_fitted(self) -> None:
        """Take the whole machine of the last diagnosis: its effects and the numbers of its drives."""
        if self.diagnosis is not None:
            self.intervals |= {e.effect.key: e.ci95 for e in self.diagnosis.effects}
            self.put("fitted machine", self.diagnosis.machine)

    @property
    def unsaved(self) -> list[saving.Change]:
        """Steps from the machine file to the present model."""
        return [*super().unsaved, *self._drive_changes()]

    def _drive_changes(self) -> list[saving.Change]:
        now, file = self.machine, self.saved
        changed = [
            a
            for a in now.chain.letters
            if now.drives[a] != file.drives[a]
            or any(c.get(a) != file.controllers[n].get(a) for n, c in now.controllers.items())
        ]
        return [saving.Change("add", f"drive.{a}", now) for a in changed]


def _entries(effect: Effect, setups: int) -> list[Entry]:
    """What is free of an effect: its numbers, those that cannot be negative by their logarithm; a wave by its two
    parts.
    """
    specs = {p.name: p for p in effect.parameters_of(effect.subject)}
    if "phase_deg" in specs or any(p.kind == "components" for p in specs.values()):
        if setups > 1:
            raise InputError(f"{effect.key}: a wave has a phase in every set-up; diagnose fits it")
        return _wave_entries(effect)
    out = []
    for p in specs.values():
        value = effect.values.get(p.name)
        if p.kind != "number" or value is None or (p.neutral is None and not p.leading and value == p.default):
            continue
        if p.lower >= 0.0 and value > 0.0:
            low = max(p.lower, 1e-6 * value)
            out.append(Entry(effect.id, p.name, value, log=True, lower=low, upper=p.upper, deviation=_WIDE_LOG))
        else:
            out.append(
                Entry(effect.id, p.name, value, scale=p.scale, deviation=_WIDE, lower=p.lower, upper=p.upper,
                      centre=p.neutral or 0.0)
            )  # fmt: skip
    return out


def _wave_entries(effect: Effect) -> list[Entry]:
    """Cosine and sine of every wave; orders stay."""
    if "components" in effect.values:
        rows = [(f" {row[0]:g}", row[1]) for row in effect.values["components"]]
    else:
        name = next(p.name for p in effect.parameters_of(effect.subject) if p.name.startswith("amplitude_"))
        rows = [("", effect.values[name])]
    out = []
    for order, size in rows:
        scale = size or 1e-3
        out += [Entry(effect.id, f"{part}{order}", v, scale=scale, deviation=_WIDE, centre=0.0)
                for part, v in (("cosine", size), ("sine", 0.0))]  # fmt: skip
    return out


@one_blas_thread
def log_gains(
    campaign: Campaign,
    machine: Machine,
    threads: int = 2,
    stopped: Callable[[], bool] = lambda: False,
) -> dict[str, Gain]:
    """What each effect could explain of the residual of its axis, alone, by the effect's id.

    Args:
        campaign: With axis logs.
        machine: The model.
        threads: Simulations side by side.
        stopped: Asked after every effect.

    Raises:
        Stopped: It was stopped.
        SimulationError: A drive is unstable.
    """
    out: dict[str, Gain] = {}
    for axis in recorded_axes(campaign.measured):
        fitter = LogFitter(machine, axis_data(campaign, axis, machine), threads)
        fit = fit_as_given(fitter, machine)
        # what a torque was recorded of is in its own units
        noise = float(np.sum(np.square(fitter.noise[: fit.positions])))
        now = float(fit.mean_squares[: fit.positions].sum())
        for candidate in Catalogue(machine, fitter.data).missing(fit.model, strongest_orders(fitter, fit)):
            if stopped():
                raise Stopped
            step = LogModel(take_first_steps(fitter, fit, candidate), (candidate,))
            left = float(step.fit.mean_squares[: fit.positions].sum())
            share = min(max((now - left) / (now - noise), 0.0), 1.0) if now > noise else 0.0
            best = out.get(candidate.effect.id)
            if best is None or share > best.share:
                significant = step.evidence > fit.evidence + LEAST
                effect = step.fit.model.machine.effect(candidate.effect.id)
                assert effect is not None
                out[candidate.effect.id] = Gain(share, effect, significant)
    return out
