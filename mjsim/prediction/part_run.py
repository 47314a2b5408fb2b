"""A program with everything that its prediction needs: where the part stands, the tool, the allowed deviation."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mjsim.errors import InputError
from mjsim.machine.model import Machine
from mjsim.prediction.predict import predict
from mjsim.prediction.program import Reading, program_of
from mjsim.prediction.result import Prediction
from mjsim.units import MM
from mjsim.workflow.saved import SavedDiagnosis


@dataclass(frozen=True)
class PartRun:
    """One program on one table.

    Attributes:
        program: Name of a built-in part, or an NC file.
        zero: Zero point of the part in the work frame, (3,) m.
        tool: Tool's length less that of the spindle ball's holder, m.
        feed: Of a built-in part, m/s.
        dialect: Of an NC file, or all that says how it is read.
        tolerance: Allowed deviation normal to the path, m, or ``None``.
    """

    program: str
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tool: float = 0.0
    feed: float = 1000.0 * MM / 60.0
    dialect: str | Reading = "fanuc"
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.tolerance is not None and not self.tolerance > 0.0:
            raise InputError(f"tolerance of the part: {self.tolerance * 1e6:g} µm; allowed: above 0 µm")
        if not self.feed > 0.0:
            raise InputError(f"feed of the part: {self.feed / MM * 60:g} mm/min; allowed: above 0 mm/min")

    def on(self, machine: Machine, saved: SavedDiagnosis | None = None) -> Prediction:
        """The error of the part on a machine.

        Args:
            machine: Where it runs, unless ``saved`` has it.
            saved: Diagnosis of the machine.

        Raises:
            InputError: The file cannot be read, or the program does not fit the machine.
        """
        chain = machine.chain if saved is None else saved.machine.chain
        name, motion, lines, notes = program_of(self.program, chain, self.zero, self.feed, self.dialect)
        return replace(predict(motion, machine, name, saved, self.tolerance, self.tool, self.zero, lines), notes=notes)
