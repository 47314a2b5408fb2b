"""Temperatures of a campaign over its clock, with the times of its tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import span_of
from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Most tests whose names have room in the picture.
_NAMED = 12
_MINUTE = 60.0


def temperature_figure(campaign: Campaign) -> Figure:
    """One line for each sensor; each test is a band.

    Args:
        campaign: With temperatures.
    """
    t = campaign.temperatures
    assert t is not None
    figure = style.new_figure(8.4, 3.6)
    axes = figure.subplots()
    colours = list(style.AXIS_COLOURS.values())
    dashes = ("-", "--", ":", "-.")
    for k, name in enumerate(t.names):
        time, value = style.thinned(t.time / _MINUTE, t.value[:, k])
        dash = dashes[k // len(colours) % len(dashes)]
        axes.plot(time, value, dash, color=colours[k % len(colours)], lw=1.1, label=name)
    spans = [(test.name, span) for test in campaign.measured if (span := span_of(campaign, test)) is not None]
    for name, (first, last) in spans:
        axes.axvspan(first / _MINUTE, last / _MINUTE, color=style.BAND, lw=0, zorder=0)
        if len(spans) <= _NAMED:
            axes.annotate(
                name,
                (first / _MINUTE, 1.0),
                (2, -3),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                rotation=90,
                va="top",
                fontsize=style.SMALL,
                color=style.SOFT,
            )
    style.label(axes, "campaign clock, min", "temperature, °C")
    axes.legend(fontsize=style.SMALL, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.tight_layout()
    return figure
