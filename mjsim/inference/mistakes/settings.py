"""The numbers that decide in a recognition of mistakes; see :mod:`mjsim.inference.settings`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MistakeSettings:
    """Settings of the recognition of mistakes in a campaign.

    Attributes:
        agreement: Correlation of the spikes at reversals that a corrected test must reach (mistakes).
        improvement: By how much that correlation must be better than as given (mistakes).
        runner_up: The second best correction must leave so many times more (mistakes).
        noise_ratio: A test without spikes whose noise is so many times less than the others' is in another unit
            (mistakes).
        same_span: Programs whose measured parts begin and end within this of each other can have each other's trace, s
            (assumed).
        contradiction: A test that fits so much better as given contradicts a mistake of all tests (mistakes).
        weak_agreement: So much correlation still says something of sign and size (mistakes).
        same_size: Sizes that differ by more than this factor are not of the same mistake (mistakes).
        setup_disagrees: A set-up whose tests disagree by more than this has a mistake in it, m (mistakes).
        setup_share: Corrected, they must disagree by less than this share of it (mistakes).
        setup_agrees: Corrected, they must agree within this, m (mistakes).
        independent: Independent values in what a model leaves of one path: sine and cosine of two waves (assumed).
        wrong_sense: How often the sense of an axis is wrong in a machine file, before the data (assumed).
        sure: Probability from which a wrong sense is named.
        visible_spike: A model's spikes are visible from this RMS on, m: about the noise that is as sharp (mistakes).
    """

    agreement: float = 0.5
    improvement: float = 0.5
    runner_up: float = 2.0
    noise_ratio: float = 12.0
    same_span: float = 0.5
    contradiction: float = 0.2
    weak_agreement: float = 0.15
    same_size: float = 4.0
    setup_disagrees: float = 3e-6
    setup_share: float = 0.2
    setup_agrees: float = 3e-6
    independent: float = 4.0
    wrong_sense: float = 0.05
    sure: float = 0.95
    visible_spike: float = 0.06e-6


#: Settings of every check that is not given others.
MISTAKES = MistakeSettings()
