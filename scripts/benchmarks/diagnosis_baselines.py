"""Two simple ways to name a cause, as a measure for the diagnosis: orthogonal matching pursuit, and a fixed list of
features.

Both see the same data, the same signatures, and the limits of the machine file. Neither fits a model again, weighs
evidence or knows that it does not know.
"""

from __future__ import annotations

import itertools

import numpy as np

from mjsim.inference.calibration import expected_effects
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fitter
from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.signatures import Candidate, SignatureBank, seeds
from mjsim.inference.spectrum import spectral_candidates
from mjsim.inference.vibration import separate

#: Matching pursuit ends where the next signature takes less than this off the sum of squares, in variances of the
#: noise (assumed: as much as the diagnosis asks of one cause with its competitors).
_LEAST_GAIN = 30.0
_MOST = 60
#: What ball-bar software measures on a circle: reversal play, squareness, scale, straightness, cyclic error, reversal
#: spikes, servo mismatch. On a rotary axis: where it lies (eccentricity).
_FEATURES = (
    "backlash",
    "squareness",
    "scale_error",
    "straightness",
    "pitch_error",
    "friction",
    "servo_gain",
    "axis_location",
)
#: Most axes that move in a circle of two linear axes or in a rotary axis' own test.
_SIMPLE = 3
#: Standard deviations above which a feature is reported.
_CLEAR = 5.0


class Baselines:
    """The answers of both for one campaign."""

    def __init__(self, campaign, machine) -> None:
        separated = separate(checked_problem(campaign, machine, 1), machine)
        self.problem, self.machine = separated.problem, separated.machine
        self.fit = Fitter(self.problem, self.machine).fit([], exact=False)
        bank = SignatureBank(self.problem, self.fit)
        bank.compute(seeds(self.machine))
        self.candidates = list(bank.candidates)
        blocks = [bank.matrix[:, s] for s in bank.slices]
        for axis in self.machine.chain.letters:
            for candidate, columns in spectral_candidates(self.problem, self.fit, bank, axis):
                self.candidates.append(candidate)
                blocks.append(columns)
        ends = np.cumsum([0, *(b.shape[1] for b in blocks)])
        self.places = [np.arange(a, b) for a, b in itertools.pairwise(ends)]
        self.columns = np.hstack(blocks)
        self.limits = {c.key: c.limits for c in expected_effects(self.machine)} if self.machine.tolerance else {}

    def answers(self) -> dict[str, dict]:
        """What both methods say, in the form of ``mjsim diagnose --json``, as far as the marks of the bank need it."""
        named = {"matching pursuit": self.pursuit(), "list of features": self.features()}
        return {
            method: {
                "verdict": "identified" if names else "nothing_found",
                "effects": [{"id": name, "alternatives": [], "ci95": {}} for name in names],
                "unexplained": None,
                "calibration": [],
            }
            for method, names in named.items()
        }

    def pursuit(self) -> list[str]:
        """Ids by orthogonal matching pursuit with a fixed threshold: the signature that explains most is added, all are
        fitted again, until none explains enough.
        """
        gram, score = self._beside_setup(np.ones(self.problem.count, bool))
        chosen: list[int] = []
        for _ in range(_MOST):
            inside = self._columns_of(chosen)
            x = _solved(gram[np.ix_(inside, inside)], score[inside])
            rest = score - gram[:, inside] @ x
            gains = []
            for at in self.places:
                cross = gram[np.ix_(inside, at)]
                left = gram[np.ix_(at, at)] - cross.T @ _solved(gram[np.ix_(inside, inside)], cross)
                gains.append(float(rest[at] @ _solved(left, rest[at])))
            best = int(np.argmax(gains))
            if gains[best] < _LEAST_GAIN:
                break
            chosen.append(best)
        inside = self._columns_of(chosen)
        x = _solved(gram[np.ix_(inside, inside)], score[inside])
        ends = np.cumsum([0, *(len(self.places[g]) for g in chosen)])
        parts = [x[a:b] for a, b in itertools.pairwise(ends)]
        named = [self.candidates[g].id for g, v in zip(chosen, parts, strict=True) if self._beyond(g, v)]
        return list(dict.fromkeys(named))

    def features(self) -> list[str]:
        """Ids by a fixed list of features, all fitted at once to the circles of two linear axes and to the rotary
        axes' own tests, as ball-bar software does.
        """
        problem = self.problem
        counts = [int(problem.noise.rows(s).sum()) for s in problem.samples]
        simple = np.repeat([m.moves.sum() <= _SIMPLE for m in problem.motions], counts)
        if not simple.any():
            return []
        gram, score = self._beside_setup(simple)
        mine = [
            g
            for g, c in enumerate(self.candidates)
            if c.effect.kind in _FEATURES and np.trace(gram[np.ix_(self.places[g], self.places[g])]) > 1.0
        ]
        inside = self._columns_of(mine)
        matrix = gram[np.ix_(inside, inside)]
        x = _solved(matrix, score[inside])
        deviation = np.sqrt(np.diag(np.linalg.pinv(matrix, rcond=1e-9)))
        ends, named = np.cumsum([0, *(len(self.places[g]) for g in mine)]), []
        for g, a, b in zip(mine, ends[:-1], ends[1:], strict=True):
            clear = np.linalg.norm(x[a:b]) > _CLEAR * np.linalg.norm(deviation[a:b])
            if clear and self._beyond(g, x[a:b]):
                named.append(self.candidates[g].id)
        return list(dict.fromkeys(named))

    def _beside_setup(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Information and score of all signatures in some rows, after set-up, trigger and data sheet are fitted."""
        every = np.eye(self.fit.parameters.size)
        design, residual, columns = (self.fit.design @ every)[rows], self.fit.residual[rows], self.columns[rows]
        equations = LeastSquares.of_design(self.fit.parameters, design)
        cross = design.T @ columns
        return equations.left_over(columns.T @ columns, cross), columns.T @ residual - cross.T @ equations.solve(
            design.T @ residual
        )

    def _columns_of(self, chosen: list[int]) -> np.ndarray:
        return np.concatenate([self.places[g] for g in chosen]) if chosen else np.zeros(0, int)

    def _beyond(self, number: int, x: np.ndarray) -> bool:
        """Whether a fitted size lies beyond the limit of the machine file; what has none there always does."""
        c: Candidate = self.candidates[number]
        limits = self.limits.get(c.effect.key)
        if limits is None:
            return True
        free = EffectVector(c.effect, c.names)
        name = next(iter(limits))
        scale = free.specs[name].scale
        return float(np.linalg.norm(x)) * scale > limits[name]


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    if not len(matrix):
        return np.zeros(right.shape)
    ridge = 1e-9 * np.trace(matrix) / len(matrix) + 1e-6
    return np.linalg.solve(matrix + ridge * np.eye(len(matrix)), right)
