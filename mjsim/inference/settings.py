"""The numbers that decide in a diagnosis, each with its meaning and where its value comes from.

Gains and penalties are falls of the objective: squared whitened residuals plus squared prior departures, which is minus
twice a log posterior density. A likelihood ratio of e^6 is therefore 12.

Mistakes in a campaign have settings of their own (:mod:`mjsim.inference.mistakes.mistakes`).

Four sources of values: *nulls*, measured once on simulated machines without a missing effect; *bank*, chosen on the
tuning half of the campaigns of ``scripts/benchmarks/benchmark_diagnosis.py`` and checked on the other half;
*mistakes*, the same with ``scripts/benchmarks/benchmark_mistakes.py``; *assumed*, from the physics of machine and
instrument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class OutlierSettings:
    """Settings of what is left out of a trace as a disturbance (all assumed, from what knocks and reversals look like).

    Attributes:
        window: Window of the running median that follows the machine's errors, s; a disturbance lasts less than half of
            it.
        window_alone: The same where no second revolution bears witness, s: a local fault of a wheel lasts longer than a
            knock.
        height: Height above the ordinary, in robust standard deviations, where a second revolution bears witness.
        height_alone: The same where none does.
        margin: Left out as well before a disturbance, s.
        ringing: Left out as well after a disturbance while it rings out, s.
        abrupt: Around a reversal an axis may do anything for so long, s.
        most_events: More events than this in one test are no accident: they are left in for the diagnosis.
        side: A lasting jump of the reading is seen between means over so long on both sides, s.
        jump: Its least height, standard deviations of the difference of these means.
        least_jump: Its least height, m.
        jump_alone: Its least height where nothing repeats, over the test's own 90 % quantile.
        same_place: A displacement of a rotary axis in several tests is the machine's where it lies within this of one
            position, rad.
        correlation: Successive seconds of the noise that are one independent value, s.
    """

    window: float = 2.0
    window_alone: float = 0.6
    height: float = 10.0
    height_alone: float = 30.0
    margin: float = 0.1
    ringing: float = 0.4
    abrupt: float = 0.5
    most_events: int = 6
    side: float = 1.0
    jump: float = 10.0
    least_jump: float = 0.4e-6
    jump_alone: float = 4.0
    same_place: float = math.radians(1.0)
    correlation: float = 0.1


#: Settings where no others are given.
OUTLIERS = OutlierSettings()


@dataclass(frozen=True)
class PlanSettings:
    """Settings of the choice of the next test (all assumed).

    Attributes:
        decisive: Deviance of two explanations at which a test decides: the square of its separation in standard
            deviations.
        certain: Deviance beyond which more is not worth a longer test.
        refined: So many of the best tests are varied in each round.
        rounds: Rounds of varying.
        handling: Time for mounting the balls and starting, s.
    """

    decisive: float = 40.0
    certain: float = 400.0
    refined: int = 2
    rounds: int = 2
    handling: float = 240.0


#: Settings where no others are given.
PLAN = PlanSettings()


@dataclass(frozen=True)
class DiagnosisSettings:
    """Settings of a diagnosis.

    Attributes:
        indistinguishable: Likelihood-ratio statistic within which a competing model cannot be told from the best one,
            and within which another axis of a vibration cannot: a likelihood ratio of e^6 (bank).
        visible_share: Least size of an effect: standard deviation of its part of the reading in its clearest test, as a
            share of one sample's noise (bank).
        setup_limit: Largest set-up error that can hide an effect, prior standard deviations: a normal distribution has
            one in 1.7 million beyond it.
        trigger_limit: Largest trigger shift that is believed, prior standard deviations. A model that fails badly would
            drive triggers out of the range in which they act linearly (bank).
        testable_size: An effect is testable when three standard deviations of its size stay below so many typical sizes
            (assumed).
        most_vibrations: Most vibrations that are looked for (assumed).
        vibration_false_alarm: Chance of one line of constant frequency by accident in a whole campaign (gamma
            distribution of the summed periodograms).
        vibration_size: Least amplitude of a vibration, in units of one sample's noise (bank).
        vibration_common: Share of what an amplitude per test would explain that one common amplitude must explain
            (bank).
        observable: Posterior over prior standard deviation up to which a calibrated number is called observable
            (assumed).
        open_number: The same from which a number is open, so that sums with others are looked for (assumed).
        tied_numbers: Least posterior correlation of two open numbers of one sum (assumed; n numbers that only appear as
            their sum have 1/(n − 1)).
        determined_sum: Posterior over prior standard deviation up to which a sum is determined (assumed).
        narrower_sum: Share of the width of each of its numbers up to which a sum is worth telling (assumed).
        least_factor: Least factor of a number in a sum, over the largest one (assumed).
        harmonic_share: Share of a curve's power in one harmonic that makes this its period (assumed).
        hidden_shape: Shapes of a curve with so many times the usual variance are hidden by the set-up (assumed).
        outliers: What is left out of a trace as a disturbance.
        plan: How the next test is chosen.
    """

    indistinguishable: float = 12.0
    visible_share: float = 0.25
    setup_limit: float = 5.0
    trigger_limit: float = 4.0
    testable_size: float = 10.0
    most_vibrations: int = 4
    vibration_false_alarm: float = 1e-8
    vibration_size: float = 0.3
    vibration_common: float = 0.7
    observable: float = 0.8
    open_number: float = 0.5
    tied_numbers: float = 0.3
    determined_sum: float = 0.25
    narrower_sum: float = 0.4
    least_factor: float = 0.15
    harmonic_share: float = 0.6
    hidden_shape: float = 30.0
    outliers: OutlierSettings = OUTLIERS
    plan: PlanSettings = PLAN


#: Settings of every command that is not given others.
DIAGNOSIS = DiagnosisSettings()
