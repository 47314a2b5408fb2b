"""A small picture of what a dropped file holds."""

from __future__ import annotations

from html import escape

import numpy as np

from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest, Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.units import UM
from mjsim.workbench.lines import thinned

_WIDE, _HIGH = 240.0, 84.0
_PARTS = 220
#: Radius of the nominal circle of a polar picture, and of its rim.
_NOMINAL, _RIM = 26.0, 38.0


def preview_of_trace(test: BallBarTest, trace: Trace) -> str:
    """A trace of a ball bar as SVG: over the time, and for a whole circle also polar.

    Args:
        test: The test.
        trace: What was recorded.
    """
    value = np.where(trace.valid, trace.deviation, np.nan) / UM
    value = value - np.nanmean(value)
    largest = max(float(np.nanmax(np.abs(value))), 1e-6)
    parts = [_line(trace.time, value, largest), _label(f"± {largest:.3g} µm in {np.ptp(trace.time):.0f} s")]
    if kind_of(test).goes_round:
        parts.append(_polar(Program(test).phi(trace.time), value / largest))
    return _framed(f"{test.name}: deviation over the time", parts, _WIDE + (88 if len(parts) > 2 else 0))


def preview_of_series(name: str, time: np.ndarray, value: np.ndarray, unit: str) -> str:
    """A recorded quantity over the time as SVG.

    Args:
        name: Of what it shows.
        time: (n,) s.
        value: (n,) in ``unit``.
        unit: As the label has it.
    """
    value = value - np.nanmean(value)
    largest = max(float(np.nanmax(np.abs(value))), 1e-9)
    words = _label(f"{name}: ± {largest:.3g} {unit} in {np.ptp(time):.3g} s")
    return _framed(f"{name} over the time", [_line(time, value, largest), words], _WIDE)


def _line(time: np.ndarray, value: np.ndarray, largest: float) -> str:
    place, thin = thinned(time, value, _PARTS)
    x = (place - time[0]) / max(float(np.ptp(time)), 1e-9) * _WIDE
    y = 0.5 * _HIGH - thin / largest * 0.42 * _HIGH
    middle = f'<line class="grid" x1="0" y1="{0.5 * _HIGH}" x2="{_WIDE}" y2="{0.5 * _HIGH}"/>'
    return middle + f'<path class="measured" d="{_joined(x, y)}"/>'


def _polar(phi: np.ndarray, share: np.ndarray) -> str:
    angle, thin = thinned(phi, share, _PARTS)
    radius = _NOMINAL + thin * (_RIM - _NOMINAL)
    x, y = _WIDE + 44 + radius * np.cos(angle), 0.5 * _HIGH - radius * np.sin(angle)
    circle = f'<circle class="grid" cx="{_WIDE + 44}" cy="{0.5 * _HIGH}" r="{_NOMINAL}"/>'
    return circle + f'<path class="measured" d="{_joined(x, y)}"/>'


def _joined(x: np.ndarray, y: np.ndarray) -> str:
    there = np.isfinite(x) & np.isfinite(y)
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x[there], y[there], strict=True)) if there.any() else ""


def _label(words: str) -> str:
    return f'<text x="2" y="{_HIGH - 3}">{escape(words)}</text>'


def _framed(title: str, parts: list[str], wide: float) -> str:
    box = f'viewBox="0 0 {wide:g} {_HIGH:g}" style="width: {wide:g}px; height: {_HIGH:g}px"'
    return f'<svg class="preview" {box} role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'
