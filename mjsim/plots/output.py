"""What simulations and comparisons look like as files: CSV, plots, ladder."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjsim.commands.ball_bar.compare import BarComparison, ComparedBarTest
from mjsim.commands.history import Step
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.iso230 import circular_figures
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.files import write_all
from mjsim.plots.curve import curve_figure
from mjsim.plots.ladder import LadderStep, ladder_figure
from mjsim.plots.pitch import PitchCurves, PitchSpectrum, curves_figure, spectrum_figure
from mjsim.plots.polar import PolarTrace, centre_of, off_centre, overview_figure, polar_figure
from mjsim.plots.residual import ResidualTrace, residual_figure
from mjsim.plots.save import encoded, save
from mjsim.plots.signature import SignatureTrace, signature_figure
from mjsim.progress import Progress, silent
from mjsim.simulation.multibody import Simulation
from mjsim.units import DEG, MM, UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mjsim.commands.diagnosis import Diagnosis
    from mjsim.commands.explain import Explanation
    from mjsim.inference.pitch.result import DirectionIdentification, PitchIdentification


def simulation_csv(s: Simulation) -> str:
    """One simulated test as CSV, every 5 ms: time_s, phi_deg, deviation_um, commanded and actual axis positions
    (mm, °).
    """
    columns = s.columns()
    data = np.column_stack(list(columns.values()))[::5]
    text = io.StringIO()
    np.savetxt(
        text, data, delimiter=",", header=",".join(columns), comments="", fmt=["%.3f", "%.6f", "%.4f"] + ["%.7f"] * 10
    )
    return text.getvalue()


def _span(program: Program, time: np.ndarray) -> np.ndarray:
    lo, hi = program.measured_span
    return (time >= lo) & (time <= hi)


def simulation_summary(results: list[Simulation]) -> list[dict]:
    """Per test: duration, extremes and, for full circles, G (µm), over the part that would be measured."""
    rows = []
    for s in results:
        program = Program(s.test)
        keep = _span(program, s.time)
        row = {"name": s.test.name, "duration_s": round(program.duration, 3)}
        try:
            if kind_of(s.test).goes_round and not s.test.component:
                row |= {
                    k: round(v, 4)
                    for k, v in asdict(circular_figures(s.phi[keep], s.deviation[keep])).items()
                    if not isinstance(v, tuple)
                }
        except InputError:
            pass
        rows.append(
            row
            | {
                "max_um": round(float(s.deviation[keep].max() / UM), 4),
                "min_um": round(float(s.deviation[keep].min() / UM), 4),
            }
        )
    return rows


def conditions(test) -> str:
    """One line that says how a test was run."""
    x, y, z = (v / MM for v in test.table_ball)
    ball = "sphere" if test.component else "table ball"
    bar = "" if test.component else f"L = {test.length / MM:g} mm, "
    where = f"{ball} ({x:g}, {y:g}, {z:g}) mm, {bar}F = {test.feed * 60 / MM:g} mm/min"
    return f"{kind_of(test).words(test)}; {where}"


def polar_of_simulation(s: Simulation) -> Figure:
    """Paper-style polar plot of one simulated test."""
    keep = _span(Program(s.test), s.time)
    phi, deviation = s.phi[keep][::5], s.deviation[keep][::5]
    deviation = deviation - off_centre(centre_of(s.test, phi, deviation), phi)
    trace = PolarTrace("simulated", phi / DEG, deviation / UM, "simulated")
    return polar_figure([trace], s.test.name, conditions(s.test))


def polar_traces(t: ComparedBarTest) -> list[PolarTrace]:
    """Measured and simulated trace of a compared test, both about the least-squares centre of the measured one
    (ISO 230-4): what is between them is the residual.
    """
    centre = off_centre(centre_of(t.test, t.phi[t.valid], t.measured[t.valid]), t.phi)
    return [
        PolarTrace(name, t.phi / DEG, np.where(t.valid, getattr(t, name) - centre, np.nan) / UM, name)
        for name in ("measured", "simulated")
    ]


def residual_trace(t: ComparedBarTest, noise: float) -> ResidualTrace:
    """Residual of a compared test on angle, with axis reversals."""
    events = {a: list(p / DEG) for a, p in t.reversals.items()}
    round_ = kind_of(t.test).goes_round
    return ResidualTrace(t.test.name, t.phi / DEG, t.residual / UM, events, noise / UM, ~t.valid, round_)


def bar_plot_files(tests: Iterable[BallBarTest], folder: Path) -> list[Path]:
    """Files that :func:`bar_plots` writes for these tests."""
    return [folder / f"{name}.png" for name in ("overview", "residual", *(t.name for t in tests))]


def bar_plots(result: BarComparison, folder: Path, progress: Progress = silent) -> list[Path]:
    """Polar plot per test, an overview, and the residuals; returns the files."""
    overview, residual, *files = bar_plot_files((t.test for t in result.tests), folder)
    total = len(result.tests) + 2
    pages = {}
    for i, (t, path) in enumerate(zip(result.tests, files, strict=True)):
        progress("plotting", i, total)
        pages[path] = encoded(polar_figure(polar_traces(t), t.test.name, conditions(t.test)), path)
    progress("plotting", total - 2, total)
    pages[overview] = encoded(_overview(result), overview)
    progress("plotting", total - 1, total)
    title = f"{result.campaign.name}: residual {result.rms / UM:.3f} µm RMS, noise {result.noise / UM:.3f} µm"
    pages[residual] = encoded(
        residual_figure([residual_trace(t, result.noise) for t in result.tests], title=title), residual
    )
    write_all(pages, force=True)
    return [overview, residual, *files]


def overview_plot(result: BarComparison, path: Path) -> None:
    """All tests of a comparison in one picture."""
    save(_overview(result), path)


def _overview(result: BarComparison) -> Figure:
    title = f"{result.campaign.name}: measured and simulated"
    return overview_figure([(t.test.name, polar_traces(t)) for t in result.tests], title=title)


def unexplained_plot(result: Diagnosis, folder: Path) -> Diagnosis:
    """The empirical term of an unexplained rest as a picture beside its effect file; the diagnosis that names the
    file.
    """
    u = result.unexplained
    if u is None:
        return result
    path = folder / f"{u.stem}.png"
    title = f"{result.campaign.name}: {u.summary}"
    save(curve_figure(*u.curve, u.labels, title, u.period), path)
    return replace(result, unexplained=replace(u, plot=str(path)))


def ladder_plot(steps: list[Step], path: Path) -> None:
    """The error falling from model to model."""
    save(
        ladder_figure([LadderStep(s.label, s.rms_um) for s in steps], steps[-1].noise_um, "Residual RMS of each model"),
        path,
    )


def pitch_plot_files(axes: Iterable[str], folder: Path) -> list[Path]:
    """Files that :func:`pitch_plots` writes for these axes."""
    return [folder / f"{what}-{a.lower()}.png" for a in axes for what in ("spectrum", "curves")]


def pitch_plots(name: str, results: dict[str, PitchIdentification], folder: Path) -> list[Path]:
    """Spectra (paper, Fig. 3) and curves (Fig. 4) of identified pitch errors, per axis; returns the files."""
    files = pitch_plot_files(results, folder)
    pages = {}
    for (axis, r), spectra, curves in zip(results.items(), files[::2], files[1::2], strict=True):
        ways = r.directions.values()
        pages[spectra] = encoded(
            spectrum_figure([pitch_spectrum(d) for d in ways], f"{name}: pitch errors of {axis}"), spectra
        )
        pages[curves] = encoded(
            curves_figure([pitch_curves(d) for d in ways], f"{name}: pitch-error curves of {axis}"), curves
        )
    write_all(pages, force=True)
    return files


def pitch_spectrum(d: DirectionIdentification) -> PitchSpectrum:
    """One direction's spectrum as it is drawn."""
    named = [(c.order, c.amplitude_deg) for c in d.components]
    return PitchSpectrum(
        f"{d.axis} {d.direction}", d.orders, d.amplitude_deg, d.floor_deg, d.limit_deg, named, d.tooth_order
    )


def pitch_curves(d: DirectionIdentification) -> PitchCurves:
    """One direction's curves as they are drawn."""
    return PitchCurves(f"{d.axis} {d.direction}", d.position_deg, d.raw_deg, d.modified_deg, d.identified_deg)


def explanation_plot(result: Explanation, path: Path) -> None:
    """The signature of one effect over all traces, as PNG or SVG."""
    traces = [
        SignatureTrace(
            t.test.name,
            t.phi / DEG,
            t.signature / UM,
            np.where(t.valid, t.residual, np.nan) / UM,
            {axis: (angles / DEG).tolist() for axis, angles in t.reversals.items()},
        )
        for t in result.tests
    ]
    what = "departure from the file" if result.departs else "size"
    size = f"at {'its fitted' if result.fitted else 'a typical'} {what}"
    note = f"{result.effect.title}, {size}: what it changes in the reading once the set-up is fitted"
    save(signature_figure(traces, f"{result.effect.id}: {result.role}", note), path)
