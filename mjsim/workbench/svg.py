"""Traces as SVG: polar plots that a page shows at once and that follow its colours, light or dark."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np

from mjsim.plots import style
from mjsim.units import UM
from mjsim.workbench.lines import thinned
from mjsim.workbench.overlay import Trace

#: Radius of the nominal circle and of the rim, in the units of the drawing (100 is its half width).
NOMINAL, RIM = 56.0, 84.0
#: A ray at 0°, to be laid over :func:`polar` and turned.
RAY = (
    '<svg class="polar cursor" viewBox="-100 -100 200 200" aria-hidden="true">'
    f'<line x1="0" y1="0" x2="{RIM}" y2="0"/><circle cx="{RIM}" cy="0" r="2"/></svg>'
)
#: Most points of a line: lowest and highest value of so many parts of a trace.
_PARTS = {True: 130, False: 420}
_LABEL_APART = 9.0


def division_um(values: list[np.ndarray]) -> float:
    """A 1-2-5 step of three divisions to the rim that holds the values (m), µm; at least 0.1 µm."""
    largest = max((float(np.nanmax(np.abs(v))) for v in values if np.isfinite(v).any()), default=0.0)
    return max(0.1, style.nice_step(max(largest / UM, 1e-6) / 3.0))


def polar(trace: Trace, reversals: Mapping[str, np.ndarray] | None = None, small: bool = False) -> str:
    """Measured and simulated trace about the nominal circle.

    Args:
        trace: Of one test.
        reversals: φ (rad) at which axes reverse, by their letters; none are drawn where they are missing.
        small: As a small multiple: without labels.
    """
    measured, simulated = trace.centred
    step = division_um([v for v in (measured, simulated) if v is not None])
    parts = [_grid(small)]
    for name, values in (("measured", measured), ("simulated", simulated)):
        if values is not None:
            parts.append(f'<path class="{name}" d="{_path(trace.phi, values / (step * UM), small)}"/>')
    if not small:
        parts += _marks(reversals or {})
        parts.append(f'<text class="scale" x="96" y="97">1 div.: {style.number(step)} µm</text>')
    title = escape(f"{trace.test.name}: polar plot, {trace.engine}")
    box = "-87 -87 174 174" if small else "-100 -100 200 200"
    return f'<svg class="polar" viewBox="{box}" role="img" aria-label="{title}">{"".join(parts)}</svg>'


def ray_angle(trace: Trace, place: int) -> float:
    """Angle of :data:`RAY` at one sample of a trace, counterclockwise, °."""
    return float(np.degrees(trace.phi[place]))


def _grid(small: bool) -> str:
    one = (RIM - NOMINAL) / 3.0
    rings = [NOMINAL + k * one for k in range(-3, 4) if k] if not small else [NOMINAL - 3 * one, RIM]
    out = [f'<circle class="grid" r="{r:.1f}"/>' for r in rings] + [f'<circle class="nominal" r="{NOMINAL}"/>']
    inner = NOMINAL - 3 * one
    for degrees in range(0, 360, 90 if small else 30):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        ends = f'x1="{inner * c:.1f}" y1="{-inner * s:.1f}" x2="{RIM * c:.1f}" y2="{-RIM * s:.1f}"'
        out.append(f'<line class="grid" {ends}/>')
    return "".join(out)


def _path(angle: np.ndarray, divisions: np.ndarray, small: bool) -> str:
    angle, divisions = thinned(angle, divisions, _PARTS[small])
    radius = np.clip(NOMINAL + divisions * (RIM - NOMINAL) / 3.0, 0.0, 99.0)
    x, y = radius * np.cos(angle), -radius * np.sin(angle)
    there = np.isfinite(x)
    pieces = np.split(np.arange(len(x)), np.flatnonzero(np.diff(there)) + 1)
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    return "".join("M" + "L".join(points[p[0] : p[-1] + 1]) for p in pieces if len(p) and there[p[0]])


def _marks(reversals: Mapping[str, np.ndarray]) -> list[str]:
    """Ticks and letters where axes reverse, and the angles of the four quadrants."""
    places: list[tuple[float, str]] = []
    for axis, angles in reversals.items():
        for a in np.unique(np.round(np.degrees(angles) % 360.0)):
            near = next((i for i, (b, _) in enumerate(places) if abs((a - b + 180) % 360 - 180) < _LABEL_APART), None)
            if near is None:
                places.append((float(a), axis))
            elif axis not in places[near][1]:
                places[near] = (places[near][0], places[near][1] + axis)
    out = []
    for degrees, letters in places:
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        out.append(f'<line class="turn" x1="{RIM * c:.1f}" y1="{-RIM * s:.1f}" x2="{88 * c:.1f}" y2="{-88 * s:.1f}"/>')
        out.append(f'<text class="turn" x="{93 * c:.1f}" y="{-93 * s:.1f}">{escape(letters)}</text>')
    return out
