"""The error falling step by step while effects are added to the model."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A range of values beyond this ratio is shown on a logarithmic scale.
LOG_FROM = 12.0


@dataclass(frozen=True)
class LadderStep:
    """One model that was tried.

    Attributes:
        label: what the step did, such as ``+ backlash.A``.
        rms_um: RMS of the residual over all tests with this model [µm].
    """

    label: str
    rms_um: float


def ladder_figure(steps: Sequence[LadderStep], noise_um: float | None = None, title: str | None = None) -> Figure:
    """RMS residual per step, each value written at its point, above the noise floor.

    Args:
        steps: in the order they were taken, at least one.
        noise_um: RMS that measurement noise alone would leave [µm]; drawn as a line when given.
        title: heading.

    Raises:
        ValueError: no step, or an RMS below 0.
    """
    if not steps:
        raise ValueError("a ladder needs at least one step")
    values = [float(step.rms_um) for step in steps]
    if min(values) < 0.0:
        raise ValueError(f"an RMS cannot be negative: {min(values)} µm")
    width = min(max(4.2, 1.25 * len(steps) + 1.9), 11.0)
    slot = (width - 1.75) / len(steps)
    labels = [_wrapped(step.label, int(slot * 72.0 / 5.0)) for step in steps]
    size = style.fitted(max((line for label in labels for line in label.split("\n")), key=len), style.SMALL + 0.5, slot)
    bottom = 0.22 + 0.15 * max(label.count("\n") + 1 for label in labels)
    height = 2.35 + bottom + (0.3 if title else 0.0)
    figure = style.new_figure(width, height)
    top = 0.25 + (0.3 if title else 0.0)
    axes = figure.add_axes((0.7 / width, bottom / height, (width - 1.75) / width, (height - bottom - top) / height))
    places = list(range(len(steps)))
    axes.step(
        [-0.42, *places, places[-1] + 0.42],
        [values[0], *values, values[-1]],
        where="mid",
        color=style.NOMINAL,
        linewidth=1.0,
        zorder=2,
    )
    axes.plot(
        places,
        values,
        "o",
        color=style.SIMULATED,
        markersize=6.0,
        markeredgecolor="white",
        markeredgewidth=1.0,
        zorder=3,
    )
    for place, value in zip(places, values, strict=True):
        axes.annotate(
            style.micrometres(value), (place, value), xytext=(0.0, 7.0), textcoords="offset points", ha="center",
            va="bottom",
            fontsize=style.TEXT, fontweight="bold", color=style.INK,
        )  # fmt: skip
    floor = min([*values, noise_um] if noise_um else values)
    if floor > 0.0 and max(values) / floor > LOG_FROM:
        axes.set_yscale("log")
        axes.set_ylim(floor / 1.6, max(values) * 1.9)
        _log_ticks(axes)
    else:
        axes.set_ylim(0.0, max([*values, noise_um or 0.0, 1e-3]) * 1.22)
        axes.yaxis.set_major_formatter(lambda v, _: style.number(round(v, 6)))
    if noise_um is not None:
        axes.axhline(noise_um, color=style.NOISE, linewidth=0.9, linestyle=(0, (4, 2)), zorder=1)
        axes.annotate(
            f"noise floor\n{style.micrometres(noise_um)}", (1.0, noise_um), xycoords=("axes fraction", "data"),
            xytext=(5.0, 0.0),
            textcoords="offset points", ha="left", va="center", fontsize=style.SMALL, color=style.NOISE,
            annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(-0.5, len(steps) - 0.5)
    axes.set_xticks(places, labels=labels)
    axes.set_ylabel("RMS residual, µm", fontsize=style.TEXT, color=style.INK)
    axes.tick_params(axis="x", length=0, labelsize=size, labelcolor=style.INK, pad=6)
    axes.tick_params(axis="y", which="both", labelsize=style.SMALL, color=style.NOMINAL, labelcolor=style.INK)
    axes.grid(axis="y", color=style.GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)
    if title:
        style.heading(figure, title)
    return figure


def _wrapped(label: str, characters: int) -> str:
    lines = textwrap.wrap(
        label.replace("+ ", "+\u00a0").replace("− ", "−\u00a0"), max(characters, 8), break_long_words=False
    ) or [""]
    return "\n".join(lines[:3] if len(lines) <= 3 else [*lines[:2], lines[2] + " …"])


def _log_ticks(axes) -> None:
    from matplotlib.ticker import FixedLocator, NullLocator

    low, high = axes.get_ylim()
    ticks = [f * 10.0**k for k in range(-6, 7) for f in (1.0, 2.0, 5.0) if low <= f * 10.0**k <= high]
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda v, _: style.number(v))
