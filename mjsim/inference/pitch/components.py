"""Choice of the components against the noise floor: the best explanation first, everything refitted, until only noise
is left.

A dictionary holds waves of all orders and local faults. All set-up nuisances, the data sheet and the terms that are
already in the model are projected out of it first, so that side lobes of a partial arc, an eccentricity or a friction
glitch that the data sheet's tolerance explains count for nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.pitch.model import PitchModel, State
from mjsim.inference.pitch.terms import Fault, Term, Wave

#: Median of a chi-square of two degrees of freedom.
_MEDIAN = 2.0 * np.log(2.0)


def threshold(candidates: int, false_alarm: float) -> float:
    """Fall of the squared residual that noise alone reaches with probability ``false_alarm`` somewhere among
    ``candidates`` waves.
    """
    return 2.0 * float(np.log(candidates / false_alarm))


class Dictionary:
    """Candidate terms of one direction with their whitened columns, everything known projected out.

    Attributes:
        terms: candidates. floor: (n,) by which the residual's own spectrum exceeds the noise model around each, at
            least 1.
        gain: (n,) fall of the squared residual by each.
    """

    def __init__(self, model: PitchModel, state: State, direction: TurnDirection) -> None:
        self.model, self.state, self.direction = model, state, direction
        self._at = {k: self._middles(k) for k in direction.tests}
        design = np.vstack([model.whitened(k, model.columns(k, state)) for k in direction.tests])
        rest = np.concatenate([model.whitened(k, model.residual(k, state)) for k in direction.tests])
        prior, now = np.sqrt(state.parameters.precision()), state.parameters.departure(state.vector)
        active = design.any(axis=0)
        q = np.linalg.qr(np.vstack([design[:, active], np.diag(prior[active])]))[0]
        rest = np.concatenate([rest, -(prior * now)[active]])
        rest = rest - q @ (q.T @ rest)
        # rows of the priors are zero in every candidate: all inner products are with the rows of the data
        self._q, self._rest = q[: len(design)], rest[: len(design)]
        self._rest_prior, self._q_prior = rest[len(design) :], q[len(design) :]
        self.orders, self.terms, self._raw = self._candidates()
        self.limit = threshold(len(self.terms), model.settings.false_alarm)
        self._start = np.cumsum([0, *(1 if isinstance(t, Fault) else 2 for t in self.terms)])
        self._project(self._q, first=True)
        self.update()

    def _project(self, q: np.ndarray, first: bool = False) -> None:
        """Take directions ``q`` (rows, j) out of the candidates' inner products."""
        onto = q.T @ self._raw
        i = self._start[:-1][np.diff(self._start) == 2]
        if first:
            self._size = np.einsum("ij,ij->j", self._raw, self._raw)
            self._length = self._size.copy()
            self._cross = np.einsum("ij,ij->j", self._raw[:, i], self._raw[:, i + 1])
        self._length = self._length - np.einsum("ij,ij->j", onto, onto)
        self._cross = self._cross - np.einsum("ij,ij->j", onto[:, i], onto[:, i + 1])

    def _middles(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Position of the axis and reading per rad at the middle of every block of a test."""
        m, w = self.model, self.direction
        s, shift = m.problem.samples[k], m.problem.shift(k, self.state.nuisance)
        return s.sample(m.position[k][w.axis], shift), s.sample(m.factor(k, Wave(w.axis, w.direction, 1.0)), shift)

    def _candidates(self) -> tuple[np.ndarray, list[Term], np.ndarray]:
        """Orders of the waves, all candidates (those waves first) and their columns; kept for the next dictionary of
        this direction.

        A trigger that has moved meanwhile turns sine and cosine of a wave into each other, which leaves what they
        explain together.
        """
        w, p, kept = self.direction, self.model.problem, self.model.kept
        key = (w.axis, w.direction, id(p.noise), tuple(self.model.weight[list(w.tests)]))
        if key not in kept:
            step = min(1.0, 0.75 * w.resolution)
            orders = np.arange(np.ceil(w.lowest / step) * step, w.highest(p.samples[0].block) + 1e-9, step)
            terms: list[Term] = [Wave(w.axis, w.direction, float(n)) for n in orders]
            low = np.arange(0.5 * w.resolution, w.lowest, 0.5 * w.resolution)
            terms += [Wave(w.axis, w.direction, float(n), test=p.tests[k].name) for k in w.tests for n in low]
            span = [self.model.position[k][w.axis] for k in w.tests]
            first, last = min(x.min() for x in span), max(x.max() for x in span)
            for width in (r * 2 * np.pi / w.teeth for r in self.model.settings.fault_widths):
                centres = np.arange(first + width, min(last, first + 2 * np.pi) - width, width)
                terms += [Fault(w.axis, w.direction, float(c), width) for c in centres]
            kept[key] = orders, terms, self.columns(terms)
        return kept[key]

    def columns(self, terms: Sequence[Term]) -> np.ndarray:
        """Whitened columns of terms of this direction (waves two, faults one), rows as the residual's.

        A block's mean stands for its middle: good enough to choose by, the fit that follows takes the mean.
        """
        m, w = self.model, self.direction
        blocks = []
        for k in w.tests:
            name, x, factor = m.problem.tests[k].name, *self._at[k]
            cols = []
            for t in terms:
                own = t.columns(x)[: 1 if isinstance(t, Fault) else 2]
                cols += [c if t.test is None or t.test == name else np.zeros(len(x)) for c in own]
            blocks.append(m.whitened(k, factor[:, None] * np.column_stack(cols)))
        return np.vstack(blocks)

    def update(self) -> None:
        """Gains of all candidates with the present residual."""
        b = self._rest @ self._raw
        at, waves = self._start[:-1], np.diff(self._start) == 2
        i, j, own, least = at[waves], at[~waves], self._length, self.model.settings.own_share * self._size
        self.gain = np.zeros(len(self.terms))
        self.gain[waves] = _pair_gain(b[i], b[i + 1], own[i], own[i + 1], self._cross, least[i])
        self.gain[~waves] = np.where(own[j] > least[j], b[j] ** 2 / np.maximum(own[j], 1e-30), 0.0)
        n = len(self.orders)
        floor = noise_excess(self.gain[:n], self.orders, self.model.settings.floor_orders)
        self.floor = np.full(len(self.terms), max(1.0, float(np.median(floor))))
        self.floor[:n] = floor

    def best(self) -> tuple[int, float, bool]:
        """The candidate with the largest gain, the gain, and whether it stands above what noise alone reaches."""
        i = int(np.argmax(self.gain))
        return i, float(self.gain[i]), bool(self.gain[i] > self.limit * self.floor[i])

    def take(self, i: int) -> Term:
        """Put a candidate into the model: refined, and projected out of residual and dictionary; with its estimated
        size.
        """
        term = self._refined(self.terms[i])
        own = self._own([term])
        q, r = np.linalg.qr(own)
        size = np.linalg.solve(r, q.T @ np.concatenate([self._rest, self._rest_prior]))
        rows = len(self._rest)
        taken, taken_prior = q[:rows], q[rows:]
        along = r @ size
        self._rest, self._rest_prior = self._rest - taken @ along, self._rest_prior - taken_prior @ along
        self._q, self._q_prior = np.hstack([self._q, taken]), np.hstack([self._q_prior, taken_prior])
        self._project(taken)
        self.update()
        return term.moved(np.concatenate([size, np.zeros(term.size - len(size))]))

    def _refined(self, term: Term) -> Term:
        """The term at the order, or the place and width, around the candidate's that explains most."""
        rest = np.concatenate([self._rest, self._rest_prior])
        if isinstance(term, Fault):
            for fine in (1.0, 0.5, 0.25):
                shifts, stretches = 0.5 * fine * np.arange(-2, 3), 1.35 ** (fine * np.arange(-2, 3))
                near = [
                    replace(term, centre=term.centre + d * term.width, width=term.width * f)
                    for f in stretches
                    for d in shifts
                ]
                d = self._own(near)
                gain = (d.T @ rest) ** 2 / np.maximum(np.einsum("ij,ij->j", d, d), 1e-30)
                term = near[int(np.argmax(gain))]
            return term
        step = self.orders[1] - self.orders[0]
        near = [replace(term, order=term.order + float(d)) for d in np.linspace(-0.5, 0.5, 9) * step]
        d = self._own(near)
        b, own = d.T @ rest, np.einsum("ij,ij->j", d, d)
        cross = np.einsum("ij,ij->j", d[:, ::2], d[:, 1::2])
        return near[int(np.argmax(_pair_gain(b[::2], b[1::2], own[::2], own[1::2], cross, np.zeros(len(near)))))]

    def _own(self, terms: Sequence[Term]) -> np.ndarray:
        """Columns of terms with everything known and taken projected out, rows of data and priors."""
        d = self.columns(terms)
        onto = self._q.T @ d
        return np.vstack([d - self._q @ onto, -self._q_prior @ onto])


def noise_excess(gain: np.ndarray, orders: np.ndarray, neighbours: int) -> np.ndarray:
    """By how much the residual's own spectrum lies above the noise model around each of the evenly spaced
    ``orders``, at least 1; taken over so many ``neighbours`` on both sides.
    """
    side = round(neighbours / float(orders[1] - orders[0]))
    return np.maximum(1.0, _running_median(gain, side) / _MEDIAN)


def _running_median(x: np.ndarray, side: int) -> np.ndarray:
    """Median over ``side`` values on both sides; near the ends over as many, all of them inside."""
    side = max(1, min(side, (len(x) - 1) // 2))
    inner = median_filter(x, size=2 * side + 1)[side : len(x) - side]
    return np.concatenate([np.full(side, inner[0]), inner, np.full(side, inner[-1])])


def _pair_gain(b1, b2, g1, g2, g12, least) -> np.ndarray:
    """Fall of the squared residual by pairs of columns with inner products ``g`` among them and ``b`` with the
    residual.
    """
    det = g1 * g2 - g12**2
    ok = (np.minimum(g1, g2) > least) & (det > 1e-9 * g1 * g2)
    return np.where(ok, (g2 * b1**2 - 2 * g12 * b1 * b2 + g1 * b2**2) / np.where(ok, det, 1.0), 0.0)


def chosen(model: PitchModel, state: State, direction: TurnDirection) -> list[Term]:
    """Terms that the residual of ``state`` still asks for, the best first: none where only noise is left."""
    d = Dictionary(model, state, direction)
    out: list[Term] = []
    first = 0.0
    while len(out) < model.settings.round_terms:
        i, gain, stands_out = d.best()
        first = max(first, gain)
        if not stands_out or gain < model.settings.round_share * first:
            break
        out.append(d.take(i))
    return out
