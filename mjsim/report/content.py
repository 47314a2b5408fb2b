"""What a report says, as plain data. :func:`mjsim.report.page.render` turns it into a page,
:meth:`ReportContent.to_json` into JSON.

Everything optional may be missing, and its place on the page then is too: a report before the diagnosis is a valid
report. Lengths of errors are in µm, as the names say; other values carry their unit beside them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal

import numpy as np

from mjsim import digits
from mjsim.instruments.ball_bar.iso230 import BidirectionalFigures, CircularFigures
from mjsim.plots.polar import PolarTrace
from mjsim.plots.residual import ResidualTrace
from mjsim.report.causes import CalibrationRow, CauseShare

#: Marks a field that only figures are made of: it is no part of the JSON.
_DRAWN = {"drawn": True}
Verdict = Literal["identified", "ambiguous", "unknown", "nothing_found"]


@dataclass(frozen=True)
class ModelRow:
    """One model of the ladder.

    Attributes:
        label: such as ``+ backlash.A``. what: what it holds, in one sentence. how: ``kinematics`` or ``full
            simulation``.
        rms_um: RMS residual over all tests [µm]. tests_um: of each test, in the report's order [µm].
    """

    label: str
    rms_um: float
    tests_um: Sequence[float] = ()
    what: str = ""
    how: str = "full simulation"


@dataclass(frozen=True)
class ParameterRow:
    """One fitted parameter, in the unit it is shown in.

    Attributes:
        name: as in the machine file, such as ``width_deg``; for one entry of a list, such as ``order 60, amplitude``.
        value: estimate. low, high: ends of the 95 % interval; None when there is none. unit: symbol, empty for ratios
            and orders.
    """

    name: str
    value: float
    low: float | None = None
    high: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Rejected:
    """An effect that was tried in the place of one that was found. ``reaches_percent``: share of its gain that this
    one reaches.
    """

    effect_id: str
    reaches_percent: float


@dataclass(frozen=True)
class Finding:
    """One effect that was found missing, and the evidence.

    Attributes:
        effect_id: such as ``backlash.A``. title: the effect in words.
        parameters: what was fitted.
        rms_before_um, rms_after_um: RMS residual over all tests without and with it [µm], along the ladder; None
            where it shares its step with others.
        alternatives: ids that these data cannot tell from this one.
        sentence: how it shows. tests: names of the tests that show it.
        share_percent: its share of the squared error above the noise that the machine as given leaves.
        probability_percent: that it is this cause, and larger than on a sound machine. confidence: the same in words.
        rejected: the competing effect that came nearest.
    """

    effect_id: str
    title: str
    parameters: Sequence[ParameterRow]
    rms_before_um: float | None
    rms_after_um: float | None
    alternatives: Sequence[str] = ()
    sentence: str = ""
    tests: Sequence[str] = ()
    share_percent: float | None = None
    probability_percent: float | None = None
    confidence: str = ""
    rejected: Rejected | None = None


@dataclass(frozen=True)
class RepairRow:
    """What the machine would do without one cause.

    Attributes:
        cause: effect id, or what else would be changed. title: in words. term: what ball-bar software calls it.
        kind: ``adjust``, ``compensate``, ``maintain`` (these can be repaired) or ``share`` (it can only be told how
            much it makes).
        remedy: how it is repaired. how: ``full simulation`` or ``drives alone``.
        rms_um: RMS of the machine's deviation without it [µm]. gain_um, gain_percent: how much that is less.
        tests_um: circular error G (arcs: peak to valley) of each test without it [µm]; empty for ``drives alone``.
        circle: the circular test whose G falls most; circle_um, circle_percent: by how much. Reversal spikes show
            there, not in an RMS.
        instead: ids of the effects that these tests cannot tell from this cause. The gain holds only if it is the
            cause.
    """

    cause: str
    title: str
    term: str
    kind: str
    remedy: str
    how: str
    rms_um: float
    gain_um: float
    gain_percent: float
    tests_um: Sequence[float] = ()
    circle: str = ""
    circle_um: float | None = None
    circle_percent: float | None = None
    instead: Sequence[str] = ()


@dataclass(frozen=True)
class WhatIf:
    """Repairs of the final model, the best first.

    Attributes:
        rms_um: RMS over all tests of the final model's deviation about the least-squares circle (arcs: about the mean)
            [µm].
        tests_um: circular error G (arcs: peak to valley) of each test [µm]. rows: one per cause, and all repairs
            together.
    """

    rms_um: float
    tests_um: Sequence[float]
    rows: Sequence[RepairRow] = ()


@dataclass(frozen=True)
class SetUpRow:
    """Nuisance estimates of one set-up, never a machine effect: offsets of both balls, (3,) each [µm]; tests
    measured in it.
    """

    setup: str
    table_ball_um: Sequence[float]
    spindle_ball_um: Sequence[float]
    tests: Sequence[str] = ()


@dataclass(frozen=True)
class TestSection:
    """One test.

    Attributes:
        name: as in the campaign. conditions: one line, such as ``cone frustum, θ = 15°, β = 10°, CCW, 1000 mm/min``.
        before, after: traces of the polar plots with the model before and after; ``after`` empty when nothing was
            added.
        residual: residual with the last model; None leaves the plot out.
        rms_before_um, rms_after_um: RMS residual [µm].
        measured, simulated_before, simulated_after: ISO 230-4 figures; None where they do not apply (partial arcs).
        trigger_ms: estimated trigger shift [ms]. setup: name of its set-up. left_out: samples that were not judged.
        worst: where the last model fails most.
    """

    __test__ = False  # not a test case, whatever pytest thinks of the name

    name: str
    conditions: str
    before: Sequence[PolarTrace] = field(default=(), metadata=_DRAWN)
    after: Sequence[PolarTrace] = field(default=(), metadata=_DRAWN)
    residual: ResidualTrace | None = field(default=None, metadata=_DRAWN)
    rms_before_um: float | None = None
    rms_after_um: float | None = None
    measured: CircularFigures | None = None
    simulated_before: CircularFigures | None = None
    simulated_after: CircularFigures | None = None
    trigger_ms: float | None = None
    setup: str | None = None
    left_out: int = 0
    worst: str = ""


@dataclass(frozen=True)
class BidirectionalRow:
    """G(b) and D of one path that was run in both directions: names of the CCW and the CW test, figures of each
    model or None.
    """

    tests: tuple[str, str]
    measured: BidirectionalFigures
    simulated_before: BidirectionalFigures | None = None
    simulated_after: BidirectionalFigures | None = None


@dataclass(frozen=True)
class PartSection:
    """The predicted error of one part: as ``mjsim predict --json`` has it, with the blocks that decide; its figure."""

    predicted: dict
    figure: Any = field(default=None, metadata=_DRAWN)


@dataclass(frozen=True)
class NotTestable:
    """An effect that this campaign cannot show, and why, in one sentence."""

    effect_id: str
    reason: str = ""


@dataclass(frozen=True)
class ReportContent:
    """A whole report.

    Attributes:
        title: heading of the page.
        summary: (name, text) pairs on machine and campaign: configuration, number of tests, instrument and so on.
        verdict: as in the output of ``mjsim diagnose``; None before a diagnosis. verdict_sentence: how sure the answer
            is.
        answer: the answer, one line per cause; empty before a diagnosis.
        models: the ladder, from rigid kinematics to the final model. start: index of the machine as given.
        findings: missing effects in the order of their contribution.
        tests: one section each.
        noise_um: noise floor, the RMS that a perfect model leaves [µm]. noise_source: where that number comes from.
        setups: nuisance estimates per set-up. length_offset_um: estimated error of the bar's length [µm].
        bidirectional: figures of paths run in both directions.
        acceptance: figures against the campaign's limits, as ``mjsim compare --json`` has them.
        compensation: what a control without limits could correct, as ``mjsim compensate --json`` has it; ``None``
            leaves the section out.
        parts: predicted error of programs.
        unexplained: what is left that repeats and no catalogue effect explains, in one sentence.
        not_testable: effects this campaign cannot show. next_test: which test to run next and what it would tell apart.
        what_if: repairs and what each would gain.
        calibration: numbers that the machine file has a tolerance for. waterfall: the error by cause.
        diagnosis: the JSON of ``mjsim diagnose``; None without one.
        instrument_source: from what the errors of the instrument are known.
        provenance: (name, text) pairs: versions, seed, model hash. date: as it is to be printed; given by the caller.
        curve: what the unexplained rest looks like, as :func:`mjsim.plots.curve.curve_figure` takes it.
        traces: what the interactive plots are made of (:mod:`mjsim.report.build`); None leaves them out.
    """

    title: str
    summary: Sequence[tuple[str, str]]
    verdict: Verdict | None
    verdict_sentence: str
    models: Sequence[ModelRow]
    findings: Sequence[Finding]
    tests: Sequence[TestSection]
    answer: Sequence[str] = ()
    start: int = 0
    noise_um: float | None = None
    noise_source: str = ""
    setups: Sequence[SetUpRow] = ()
    length_offset_um: float | None = None
    bidirectional: Sequence[BidirectionalRow] = ()
    acceptance: Sequence[dict] = ()
    compensation: dict | None = None
    parts: Sequence[PartSection] = ()
    unexplained: str = ""
    not_testable: Sequence[NotTestable] = ()
    next_test: str = ""
    what_if: WhatIf | None = None
    calibration: Sequence[CalibrationRow] = ()
    waterfall: Sequence[CauseShare] = ()
    diagnosis: dict | None = None
    instrument_source: str = ""
    provenance: Sequence[tuple[str, str]] = ()
    date: str = ""
    curve: tuple | None = field(default=None, metadata=_DRAWN)
    traces: list[dict] | None = field(default=None, metadata=_DRAWN)

    def to_json(self) -> dict:
        """Every number and text of the page: what ``mjsim report --json`` prints and what the page carries with it."""
        return plain(self)


def plain(value: Any) -> Any:
    """Dataclasses, tuples and numpy numbers as what JSON has; drawn fields are left out."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value) if not f.metadata.get("drawn")}
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


# -- numbers as the report prints them ---------------------------------------------------------------------------------

NONE = "–"


def um(value: float | None, decimals: int = 2) -> str:
    """An error in µm, without its unit; a dash for None and NaN."""
    return fixed(value, decimals)


def fixed(value: float | None, decimals: int) -> str:
    """A number with that many decimals; a dash for None and NaN; no negative zero."""
    if value is None or not math.isfinite(value):
        return NONE
    return _minus(digits.fixed(value, decimals))


def ends_of(parameter: ParameterRow) -> tuple[float, float] | None:
    """The 95 % interval; None when there is none."""
    return None if parameter.low is None or parameter.high is None else (parameter.low, parameter.high)


def estimate(parameter: ParameterRow) -> str:
    """The estimate, as finely as its interval allows."""
    return _minus(digits.estimate(parameter.value, ends_of(parameter)))


def interval(parameter: ParameterRow) -> str:
    """The 95 % interval ``low to high``; a dash when there is none."""
    return _minus(digits.interval(ends_of(parameter)))


def percent_removed(before: float | None, after: float | None) -> str:
    """How much of an RMS is gone, of its square (the error's power), in percent; a dash when it cannot be said."""
    if before is None or after is None or not before > 0.0 or not math.isfinite(after):
        return NONE
    return fixed(100.0 * (1.0 - (after / before) ** 2), 1) + " %"


def _minus(text: str) -> str:
    return text.replace("-", "−")
