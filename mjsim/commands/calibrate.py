"""The calibration by itself: what the machine file has a tolerance for, fitted to a campaign, without any search."""

from __future__ import annotations

from dataclasses import dataclass

from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.compare import checked_logs
from mjsim.commands.axis_log.diagnose import merged
from mjsim.commands.axis_log.diagnosis import SheetNumber
from mjsim.commands.axis_log.numbers import sheet_of
from mjsim.commands.compare import compare
from mjsim.commands.comparison import Comparison
from mjsim.errors import InputError
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.found import AxisSelection
from mjsim.inference.axis_logs.search import AxisSearch
from mjsim.inference.budget import Budget, budgets, split_of_bars
from mjsim.inference.calibration import calibrated_effects
from mjsim.inference.combinations import Combination, combinations
from mjsim.inference.considered import with_instrument
from mjsim.inference.fit import Fit, Fitter, retimed
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.shares import Calibration, calibrations, parts_of
from mjsim.inference.vibration import separate
from mjsim.instruments.axis_log.measurement import LogTest, recorded_axes
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread

#: Gauss-Newton steps of a calibration: with linear data-sheet columns, and exact.
_STEPS, _EXACT = 4, 3


@dataclass(frozen=True)
class CalibratedMachine:
    """A machine that was calibrated within its tolerance.

    Attributes:
        machine: With the calibrated effects and the calibrated data sheet.
        calibration: One entry for each effect with a tolerance.
        shares: Share of each kind in the explained squared error.
        before: Comparison of the machine as given.
        after: Comparison of the calibrated machine.
        combinations: Sums of calibrated numbers that the tests determine although they leave the numbers open.
        sheet: Numbers of the data sheet that axis logs have calibrated.
        budget: Where the uncertainty of every number comes from, and the probability that it is beyond its limit.
    """

    machine: Machine
    calibration: tuple[Calibration, ...]
    shares: dict[str, float]
    before: Comparison
    after: Comparison
    combinations: tuple[Combination, ...] = ()
    sheet: tuple[SheetNumber, ...] = ()
    budget: tuple[Budget, ...] = ()


@one_blas_thread
def calibrate(campaign: Campaign, machine: Machine, threads: int = 2, progress: Progress = silent) -> CalibratedMachine:
    """Fit everything that the machine file has a tolerance for, and look for nothing else.

    Axis logs calibrate the numbers of the data sheet of their axes; ball-bar tests what the machine file has a
    tolerance for, on the machine that the logs leave.

    Args:
        campaign: With at least one measured test.
        machine: As given; with a tolerance where ball-bar tests were measured.
        threads: Tests that are worked on side by side.
        progress: Called as work gets on.

    Raises:
        InputError: The machine has no tolerance, no test is measured, or the traces show a mistake.
    """
    parts = campaign.measured_parts
    if campaign.in_motion.measured and not machine.tolerance:
        raise InputError(
            f"{machine.file}: has no [tolerance] table, so there is nothing to calibrate; "
            "`mjsim new` writes the table of a typical machine, commented out"
        )
    before = compare(campaign, machine, threads, progress)
    final, sheet, problem = machine, [], None
    entries: tuple[Calibration, ...] = ()
    shares: dict[str, float] = {}
    sums: tuple[Combination, ...] = ()
    budget: tuple[Budget, ...] = ()
    if LogTest.instrument in parts:
        final, sheet = _calibrated_by_logs(parts[LogTest.instrument], machine, threads, progress)
    if campaign.in_motion.measured:
        progress("calibrating within tolerance", 0, 1)
        problem = checked_problem(campaign, final, threads)
        separated = separate(problem, final)
        fitter = Fitter(separated.problem, separated.machine)
        fit = fit_within_tolerance(fitter)
        fit = fitter.fit(fit.effects, start=fit, exact=True, iterations=_EXACT, fresh=False)
        problem = separated.problem
        fit = with_instrument(problem, fit)
        expected = calibrated_effects(separated.machine)
        entries, shares = calibrations(parts_of(problem, fit), fit, expected, problem.settings.observable)
        budget = budgets(fit, split_of_bars(problem), {c.key: c for c in expected})
        final, sums = fit.machine.with_effects(line.effect for line in separated.lines), combinations(fit)
    after = compare(campaign, final, threads, progress, problem)
    return CalibratedMachine(final, entries, shares, before, after, sums, tuple(sheet), budget)


def _calibrated_by_logs(
    logs: Campaign, machine: Machine, threads: int, progress: Progress
) -> tuple[Machine, list[SheetNumber]]:
    """The machine with the data sheet of every recorded axis fitted, and its numbers as stated and as found."""
    logs = checked_logs(logs, machine)
    fits, numbers = [], []
    for axis in recorded_axes(logs.measured):
        progress(f"calibrating the data sheet of {axis}", 0, 1)
        search = AxisSearch(machine, axis_data(logs, axis, machine), threads)
        fit = search.sheet()
        fits.append(fit)
        numbers += sheet_of(machine, axis, AxisSelection(axis, fit, fit, fit))
    return merged(machine, fits), numbers


def fit_within_tolerance(fitter: Fitter, without: str = "") -> Fit:
    """The machine as given, with what its file has a tolerance for fitted beside set-up and data sheet.

    Args:
        fitter: Of the machine as given.
        without: Id of an effect that is left out, because it is to be fitted freely.
    """
    start = fitter.fit([], exact=False)
    expected = [c.free for c in calibrated_effects(fitter.machine) if c.free.effect.id != without]
    fit = fitter.fit(expected, start=start, exact=False, iterations=_STEPS) if expected else start
    better = retimed(fitter.problem, fit)
    return fit if better is None else fitter.fit(fit.effects, better, _STEPS, exact=False, fresh=False)
