"""The workbench of recordings of any instrument but a ball bar, without a page: a model and what changes do to it."""

from __future__ import annotations

from collections.abc import Callable

from mjsim.campaign.machine_file import machine_document
from mjsim.campaign.model import Campaign
from mjsim.commands import history
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.compare import compare
from mjsim.commands.comparison import Comparison
from mjsim.errors import InputError
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.files import write_all
from mjsim.io.toml import read_text
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.workbench import save as saving
from mjsim.workbench.gains import Gain
from mjsim.workbench.readings import DRIVES
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
        super().__init__(shared.campaign, shared.machine, shared.text)
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
        result = compare(self.campaign, machine, self.shared.threads)
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
