"""The way of the magnified bar's end, and the way without error, in the frame where both are closed curves."""

from __future__ import annotations

import numpy as np

from mjsim.animation.scene import BLUE, RED, Line, Stage
from mjsim.animation.story import Story
from mjsim.instruments.ball_bar.kinds import kind_of

#: Points of the trail per second of a usual turn (36 s) and the most that are shown at once: one turn of a circle.
POINTS = 180


class Trail:
    """Ways of one test, found once."""

    def __init__(self, story: Story, stage: Stage):
        begin, end = story.program.measured_span
        turns = story.test.revolutions if kind_of(story.test).goes_round else 1
        n = POINTS * turns + 1
        self.time = np.linspace(begin, end, n)
        self._stage = stage
        ideal, error = np.empty((n, 3)), np.empty((n, 3))
        for k, time in enumerate(self.time):
            balls = stage.pose(story.position(time))
            ideal[k] = stage.to_carrier(balls.ghost)
            known = np.isfinite(story.error.at(time + 0.02))
            error[k] = (
                stage.to_carrier(stage.pose(story.position(time), story.stretch(time + 0.02)).ghost)
                if known
                else np.nan
            )
        self._ideal, self._error = ideal[: POINTS + 1], error

    def lines(self, time: float, scale: float) -> list[Line]:
        """The lines to draw at ``time`` s in a picture of ``scale``; one turn of the error at most: turns would
        cover each other.
        """
        done = int(np.searchsorted(self.time, time, side="right"))
        to_world, wide = self._stage.to_world, max(1.0, 2.5 * scale)
        lines = [Line(to_world(self._ideal), BLUE, 0.6 * wide)]
        if done > 1:
            lines.append(Line(to_world(self._error[max(0, done - POINTS - 1) : done]), RED, wide))
        return lines
