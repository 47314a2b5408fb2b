"""Pictures of the workbench for Jupyter: tests with their errors, a test's traces, what an effect does."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.model import Machine
from mjsim.units import UM
from mjsim.workbench import svg
from mjsim.workbench.overlay import Overlay, Trace, reversals_of
from mjsim.workbench.tried import TriedModel

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


def picture(bench: TriedModel, name: str | None) -> Picture:
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
        for overlay, words in ((without, "without"), (having, "with")):
            trace = overlay.traces[test]
            figures.append(_figure(trace, svg.polar(trace, reversals_of(bench.opened, test)), True, words))
    return _made(caption, figures)


def machine_with_or_without(bench: TriedModel, effect_id: str) -> Machine:
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
