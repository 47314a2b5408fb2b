"""A campaign that is open in the workbench: what all pages share and what no change of the model touches."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mjsim.campaign.model import Campaign
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.problem import KeptChanges, Problem
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.model import Machine, build
from mjsim.simulation.axes import AxesMotion, motions_of
from mjsim.threads import Workers, one_blas_thread


@dataclass(frozen=True)
class OpenCampaign:
    """A campaign with its machine, ready for changes of the model.

    Attributes:
        campaign: As it was read.
        machine: The model in the machine file.
        problem: The measured tests without outliers; ``None`` where nothing was measured.
        background: The same tests with motions of their own, for work that takes seconds: it never holds up a change.
        motions: The axes' motion in each test, by the test's name.
        threads: Tests that are worked on side by side.
    """

    campaign: Campaign
    machine: Machine
    problem: Problem | None
    background: Problem | None
    motions: dict[str, AxesMotion]
    threads: int

    @classmethod
    @one_blas_thread
    def of(cls, campaign: Campaign, machine: Machine, threads: int = 2) -> OpenCampaign:
        """Prepare a campaign.

        Args:
            campaign: As it was read; it needs no traces.
            machine: The model.
            threads: Tests that are worked on side by side.

        Raises:
            InputError: The traces show a mistake.
        """
        campaign = campaign.in_motion
        problem = checked_problem(campaign, build(machine), threads, machine=machine) if campaign.measured else None
        motions = {t.name: m for t, m in zip(campaign.tests, motions_of(campaign.tests), strict=True)}
        background = None
        if problem is not None:
            motions |= {t.name: m for t, m in zip(problem.tests, problem.motions, strict=True)}
            own = motions_of(problem.tests, light=True)
            background = replace(problem, motions=own, workers=Workers(1), changes=KeptChanges())
        return cls(campaign, machine, problem, background, motions, threads)

    @property
    def tests(self) -> tuple[BallBarTest, ...]:
        """All tests, measured or not, in the campaign's order."""
        return self.campaign.tests

    @property
    def measured(self) -> dict[str, int]:
        """Place in the problem of every measured test, by name."""
        return {t.name: k for k, t in enumerate(self.problem.tests)} if self.problem else {}

    def test(self, name: str) -> BallBarTest:
        """The test of this name.

        Raises:
            KeyError: there is none.
        """
        return next(t for t in self.tests if t.name == name)
