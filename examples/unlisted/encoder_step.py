"""A step in the scale of a rotary axis: from one position on, the encoder reads wrong by a constant.

Written after `mjsim diagnose examples/unlisted` had said that the rest depends on the position of C and had drawn its
curve: flat, with one step near -300°. Two numbers say all of it, and both can be fitted.
"""

import numpy as np

import mjsim

#: The step is spread over this much travel, rad, so that its place can be fitted (assumed).
BLUR = np.radians(0.05)


@mjsim.register
class EncoderStep(mjsim.Effect):
    kind = "encoder_step"
    subjects = ("A", "C")
    title = "Step in the scale of a rotary axis"
    parameters = (
        mjsim.Parameter("step_deg", "height of the step", -1.0, 1.0, neutral=0.0, scale=0.001),
        mjsim.Parameter("at_deg", "axis position of the step", -4000.0, 4000.0, scale=1.0),
    )
    definition = "x + step where x > at"
    source = "the curve of mjsim's empirical term; a lost count or a damaged line of the scale"
    signature = "A step wherever the axis passes one position, in both directions of motion."
    search = mjsim.SearchHints(free=("step_deg", "at_deg"), seeds=[{"step_deg": 0.001, "at_deg": -300.0}])

    def position_error(self, motion):
        i = motion.column(self.subject)
        out = np.zeros_like(motion.position)
        beyond = (motion.position[:, i] - self.si("at_deg")) / BLUR
        out[:, i] = self.si("step_deg") * 0.5 * (1.0 + np.tanh(beyond))
        return out
