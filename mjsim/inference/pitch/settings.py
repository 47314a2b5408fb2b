"""The numbers that decide in an identification of pitch errors; see :mod:`mjsim.inference.settings`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PitchSettings:
    """Settings of the identification of pitch errors.

    Attributes:
        false_alarm: Chance that noise alone names one component or more in one direction of one axis (chi-square
            distribution).
        trigger_limit: Largest trigger shift that is believed, prior standard deviations. Wider than the diagnosis'
            limit: phases of high orders fix the trigger well (assumed).
        teeth: Teeth that the arc must cover, so that the tooth order stands apart from what lies below it (assumed).
        explained: Mean square of a test's whitened residuals up to which it ties the triggers (assumed).
        slow_waves: So many waves below the tooth order in one test, and its machine file no longer says when the axes
            were where (assumed).
        whole_order_sd: A whole order is taken for the order where it lies within so many standard deviations (assumed).
        whole_order_sharp: Standard deviation of an order up to which that is decided (assumed).
        directions_differ: Chance of calling different what is the same in both directions (likelihood-ratio test).
        own_share: Share of a term that must be its own, not another's, to be looked at. Small: what is left by two
            waves closer than the resolution has to be explained by a second one, or its side lobes would be (assumed).
        round_share: Terms that explain less than this share of a round's best wait until the better ones are fitted
            (assumed).
        round_terms: Most terms of one round (assumed).
        rounds: Most rounds of choosing and fitting (assumed).
        fault_widths: Widths of local faults, of one tooth's pitch (assumed).
        floor_orders: Orders on both sides over which the floor of the residual's own spectrum is taken (assumed).
    """

    false_alarm: float = 1e-3
    trigger_limit: float = 5.0
    teeth: int = 4
    explained: float = 1.5
    slow_waves: int = 4
    whole_order_sd: float = 3.5
    whole_order_sharp: float = 0.12
    directions_differ: float = 0.01
    own_share: float = 0.003
    round_share: float = 0.02
    round_terms: int = 12
    rounds: int = 6
    fault_widths: tuple[float, ...] = (0.1, 0.25, 0.6)
    floor_orders: int = 60


#: Settings of every identification that is not given others.
PITCH = PitchSettings()
