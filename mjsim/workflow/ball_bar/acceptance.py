"""Compared tests against the limits of their campaign."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.instruments.ball_bar.acceptance import Measured, judge
from mjsim.instruments.ball_bar.measurement import BallBarTest


class _Compared(Protocol):
    @property
    def test(self) -> BallBarTest: ...
    @property
    def phi(self) -> np.ndarray: ...
    @property
    def measured(self) -> np.ndarray: ...
    @property
    def valid(self) -> np.ndarray: ...


def acceptance_rows(campaign: Campaign, tests: Sequence[_Compared], noise: float) -> list[dict]:
    """One row for each limit and what it was held against, in µm; empty where the campaign states no limits.

    Args:
        campaign: With or without limits.
        tests: Its compared tests.
        noise: RMS of one sample's noise, m.
    """
    if campaign.acceptance is None:
        return []
    traces = [Measured(t.test.name, t.phi[t.valid], t.measured[t.valid]) for t in tests]
    return [row.to_json() for row in judge(campaign.acceptance, traces, noise)]
