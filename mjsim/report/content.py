"""What a report says, as plain data. :func:`mjsim.report.page.render` turns it into a page.

Everything optional may be missing, and its place on the page then is too: a report before the diagnosis is a valid report.
Lengths of errors are in µm, as the names say; other values carry their unit beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from mjsim.measure.iso230 import BidirectionalFigures, CircularFigures
from mjsim.plots.polar import PolarTrace
from mjsim.plots.residual import ResidualTrace

Verdict = Literal["identified", "ambiguous", "unknown", "nothing_found"]


@dataclass(frozen=True)
class LadderRow:
    """One model that was tried, in the order of trying.

    Attributes:
        label: what the step did, such as ``+ backlash.A``.
        rms_um: RMS residual over all tests [µm].
        rms_by_test_um: test -> RMS residual [µm]; a test may be missing.
    """

    label: str
    rms_um: float
    rms_by_test_um: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ParameterRow:
    """One fitted parameter, in the unit it is shown in.

    Attributes:
        name: as in the machine file, such as ``width_deg``; for one entry of a list, such as ``order 60, amplitude``.
        value: estimate.
        low, high: ends of the 95 % interval; None when there is none.
        unit: symbol, empty for ratios and orders.
    """

    name: str
    value: float
    low: float | None = None
    high: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Finding:
    """One effect that was found missing, and the evidence.

    Attributes:
        effect_id: such as ``backlash.A``.
        title: the effect in words.
        parameters: what was fitted.
        rms_before_um, rms_after_um: RMS residual over all tests without and with it [µm].
        alternatives: ids that these data cannot tell from this one.
        sentence: the evidence in one sentence: where in which tests it shows.
        tests: names of the tests that show it.
    """

    effect_id: str
    title: str
    parameters: Sequence[ParameterRow]
    rms_before_um: float
    rms_after_um: float
    alternatives: Sequence[str] = ()
    sentence: str = ""
    tests: Sequence[str] = ()


@dataclass(frozen=True)
class SetUpRow:
    """Nuisance estimates of one set-up: never a machine effect.

    Attributes:
        setup: its name in the campaign.
        table_ball_um: (3,) offset of the table ball in the work frame, x y z [µm].
        spindle_ball_um: (3,) offset of the spindle ball, x y z [µm].
        tests: names of the tests measured in it.
    """

    setup: str
    table_ball_um: Sequence[float]
    spindle_ball_um: Sequence[float]
    tests: Sequence[str] = ()


@dataclass(frozen=True)
class TestSection:
    """One test.

    Attributes:
        name: as in the campaign.
        conditions: one line, such as ``cone frustum, θ = 15°, β = 10°, CCW, 1000 mm/min``.
        before, after: traces of the polar plots with the model before and after; ``after`` empty when nothing was added.
        residual: residual with the last model; None leaves the plot out.
        rms_before_um, rms_after_um: RMS residual [µm].
        measured, simulated_before, simulated_after: ISO 230-4 figures; None where they do not apply (partial arcs).
        trigger_ms: estimated trigger shift [ms].
        setup: name of its set-up.
    """

    __test__ = False  # not a test case, whatever pytest thinks of the name

    name: str
    conditions: str
    before: Sequence[PolarTrace]
    after: Sequence[PolarTrace] = ()
    residual: ResidualTrace | None = None
    rms_before_um: float | None = None
    rms_after_um: float | None = None
    measured: CircularFigures | None = None
    simulated_before: CircularFigures | None = None
    simulated_after: CircularFigures | None = None
    trigger_ms: float | None = None
    setup: str | None = None


@dataclass(frozen=True)
class BidirectionalRow:
    """G(b) and D of one path that was run in both directions.

    Attributes:
        tests: names of the counter-clockwise and the clockwise test.
        measured, simulated_before, simulated_after: the figures; None where there is no such model.
    """

    tests: tuple[str, str]
    measured: BidirectionalFigures
    simulated_before: BidirectionalFigures | None = None
    simulated_after: BidirectionalFigures | None = None


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
        verdict: as in the output of ``mjsim diagnose``; None before a diagnosis.
        verdict_sentence: the result in one or two sentences.
        ladder: models tried, in order.
        findings: missing effects in the order of their contribution.
        tests: one section each.
        noise_um: noise floor, the RMS that a perfect model leaves [µm].
        noise_source: where that number comes from, in one sentence.
        setups: nuisance estimates per set-up.
        length_offset_um: estimated error of the bar's length [µm].
        bidirectional: figures of paths run in both directions.
        unexplained: what is left that repeats and no catalogue effect explains, in one sentence.
        not_testable: effects this campaign cannot show.
        next_test: which test to run next and what it would tell apart, in one sentence.
        provenance: (name, text) pairs: versions, seed, model hash.
        date: as it is to be printed; given by the caller, so that the page is reproducible.
    """

    title: str
    summary: Sequence[tuple[str, str]]
    verdict: Verdict | None
    verdict_sentence: str
    ladder: Sequence[LadderRow]
    findings: Sequence[Finding]
    tests: Sequence[TestSection]
    noise_um: float | None = None
    noise_source: str = ""
    setups: Sequence[SetUpRow] = ()
    length_offset_um: float | None = None
    bidirectional: Sequence[BidirectionalRow] = ()
    unexplained: str = ""
    not_testable: Sequence[NotTestable] = ()
    next_test: str = ""
    provenance: Sequence[tuple[str, str]] = ()
    date: str = ""
