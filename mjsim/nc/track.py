"""The motion that a program has commanded so far, and where the control stands: frames, tool centre point, places.

Positions are in mm and degrees here, as programs have them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import Chain
from mjsim.machine.inverse import linear_positions, serial, solutions
from mjsim.machine.kinematics import spindle_in_work, tool_direction
from mjsim.nc.limits import model_limits, scale
from mjsim.nc.words import GCodeError

#: Speed of a rapid move, mm/min and degrees/min (assumed: an ordinary machine). Rapid moves count for no verdict.
RAPID, RAPID_ROTARY = 20_000.0, 5400.0
#: How far the chord of a circle may lie inside it, mm: a thousandth of what a machine errs.
SAGITTA = 1e-4
#: How far the tool may point away from the normal of a tilted plane, as a cosine (0.1°: rounded positions).
_NORMAL = float(np.cos(np.radians(0.1)))
#: Largest step of the tool's direction between points of a great circle, rad.
_TURN = np.radians(1.0)


@dataclass
class Segment:
    """A move that waits for the next one, which may round or chamfer the corner between them.

    Attributes:
        points: (k + 1, axes) from its start on, program coordinates.
        minutes: (k,) durations. cutting: whether it is a feed move. line, begin: of the file, of its end and its start.
        stop: whether the axes come to rest at its end.
        corner: ``round`` or ``chamfer``, and its size in mm.
    """

    points: np.ndarray
    minutes: np.ndarray
    cutting: bool
    line: int
    begin: int
    stop: bool = False
    corner: tuple[str, float] | None = None


class Track:
    """Places of the axes, coordinates of the program, and the blocks so far.

    A place in the program goes to the work frame by ``turn @ place + origin``. It is then a position of the axes,
    unless the tool's tip is meant: with tool centre point control (``tcp``), or in a tilted plane that follows the
    workpiece (``follows``).

    Args:
        chain: The machine's axes.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.at = np.full(chain.count, np.nan)  # program coordinates; unknown until a word says it
        self.turn, self.origin = np.eye(3), np.zeros(3)
        self.plain = True  # whether the program's directions are the machine's
        self.tcp = self.follows = False
        self.named: dict[str, int] = {}
        self.warnings: dict[str, str] = {}
        self.points: list[np.ndarray] = []
        self.seconds: list[float] = []
        self.lines: list[int] = []
        self.tips: list[bool] = []
        self.cutting: list[bool] = []
        self.stops: list[bool] = []
        self.pending: Segment | None = None
        self.lost = False  # the axes were at a place that only the control knows
        self.number = self.place_line = 0

    # -- coordinates ---------------------------------------------------------------------------------------------------

    @property
    def tip(self) -> bool:
        """Whether linear coordinates are those of the tool's tip in the work frame."""
        return self.tcp or self.follows

    def known(self, place: np.ndarray) -> bool:
        """Whether every axis that some word has named has a known place."""
        return not any(np.isnan(v) and a in self.named for a, v in zip(self.chain.letters, place, strict=True))

    def _filled(self, places: np.ndarray) -> np.ndarray:
        """Places with 0 for axes that no word has named."""
        return np.where(np.isnan(places), 0.0, places)

    def _in_work(self, places: np.ndarray) -> np.ndarray:
        """Places (n, axes) of the program in the work frame."""
        if self.plain and not self.origin.any():
            return places
        out, linear = places.copy(), self.chain.linear_columns
        out[:, linear] = places[:, linear] @ self.turn.T + self.origin
        return out

    def _axes(self, places: np.ndarray, tip: bool) -> np.ndarray:
        """Axis positions of places (n, axes) in the work frame."""
        if not tip:
            return places
        units = np.array([scale(a) for a in self.chain.letters])
        q, linear = places * units, self.chain.linear_columns
        return np.hstack([linear_positions(self.chain, q, q[:, linear]) / units[linear], places[:, linear.stop :]])

    def axis_positions(self) -> np.ndarray | None:
        """Where the axes are, (axes,), or ``None`` where that is not known."""
        if not self.known(self.at):
            return None
        return self._axes(self._in_work(self._filled(self.at)[None]), self.tip)[0]

    def _set_axes(self, q: np.ndarray) -> None:
        """Say where the axes are, in the coordinates of now."""
        units, linear = np.array([scale(a) for a in self.chain.letters]), self.chain.linear_columns
        self.at = q.copy()
        if self.tip:
            self.at[linear] = spindle_in_work(self.chain, (q * units)[None])[0] / units[linear]
        if not self.plain or self.origin.any():
            self.at[linear] = self.turn.T @ (self.at[linear] - self.origin)

    def change(
        self,
        turn: np.ndarray | None = None,
        origin: np.ndarray | None = None,
        tcp: bool | None = None,
        follows: bool | None = None,
        forget: bool = False,
    ) -> None:
        """Other coordinates from now on; the axes stay where they are.

        Args:
            turn: Directions of the program in the work frame, (3, 3).
            origin: Its zero point there, (3,) mm.
            tcp: Tool centre point control.
            follows: Whether a tilted plane follows the workpiece.
            forget: Whether the linear axes are at an unknown place afterwards, as a length comes in that only the
                control knows.
        """
        self.flush()
        linear = self.chain.linear_columns
        rotated = turn is not None and not (turn == self.turn).all()
        switched = (tcp is not None and tcp != self.tcp) or (follows is not None and follows != self.follows)
        if (turn is not None or origin is not None) and not self.chain.spatial:
            raise GCodeError(f"a frame; allowed: machines with {', '.join(self.chain.linear)} and two more linear axes")
        simple = not rotated and not switched and self.plain
        before = None if simple or forget or np.isnan(self.at[linear]).any() else self.axis_positions()
        unnamed = np.isnan(self.at)
        old = self.origin
        self.turn = self.turn if turn is None else turn
        self.plain = bool((self.turn == np.eye(3)).all())
        self.origin = self.origin if origin is None else np.asarray(origin, float)
        self.tcp = self.tcp if tcp is None else tcp
        self.follows = self.follows if follows is None else follows
        if before is not None:
            self._set_axes(before)
            self.at[unnamed] = np.nan
        elif simple and not forget:
            self.at = self.at.copy()
            self.at[linear] += old - self.origin
        else:
            self.lose(self.chain.linear)

    def lose(self, letters: tuple[str, ...]) -> None:
        """The axes are somewhere that only the control knows."""
        self.flush()
        self.at = self.at.copy()
        for a in letters:
            self.at[self.chain.index(a)] = np.nan
        self.lost = True

    # -- directions of the tool ----------------------------------------------------------------------------------------

    def aimed(self, direction: np.ndarray, near: np.ndarray | None = None, sign: int = 0) -> np.ndarray:
        """Rotary positions that bring a direction of the work frame onto the spindle.

        Of the two ways there are, the one is taken that turns the axes least, within their travel (FANUC B-64484,
        G53.1; HEIDENHAIN TNC 620, 10/2017, PLANE without SEQ), or the one with the wanted sign.

        Args:
            direction: (3,) from the tool's tip to the spindle.
            near: (axes,) where the axes are, degrees; nothing: where they are now, or 0.
            sign: Of the position of the rotary axis next to the bed: 1, -1, or 0 for either.

        Returns:
            Positions (axes,), degrees; linear ones as in ``near``.

        Raises:
            GCodeError: the axes do not reach the direction.
        """
        chain = self.chain
        near = self._filled(self.at if near is None else near)
        order = [chain.index(a.letter) for a, _ in serial(chain)]
        if len(order) != 2:
            raise GCodeError(
                f"a tilted tool on a machine with the axes {', '.join(chain.letters)}; allowed: on five axes"
            )
        limits = model_limits(chain)
        bed = order[-1] if chain.turning else order[0]
        direction = direction / np.linalg.norm(direction)
        try:
            both = np.degrees(solutions(chain, direction[None])[:, 0])
        except InputError as error:
            raise GCodeError(str(error)) from None
        best: tuple[float, np.ndarray] | None = None
        for way in both:
            q = near.copy()
            for column, angle in zip(order, way, strict=True):
                if not np.isnan(angle):
                    q[column] = near[column] + (angle - near[column] + 180.0) % 360.0 - 180.0
                    low, high = np.degrees([limits.low[column], limits.high[column]])
                    for other in (q[column] - 360.0, q[column] + 360.0):
                        if not low - 1e-9 <= q[column] <= high + 1e-9 and low - 1e-9 <= other <= high + 1e-9:
                            q[column] = other
            inside = all(np.degrees(limits.low[c]) - 1e-9 <= q[c] <= np.degrees(limits.high[c]) + 1e-9 for c in order)
            wanted = sign == 0 or sign * q[bed] >= -1e-9
            cost = float(np.abs(q - near).max()) + (0.0 if inside else 1e6) + (0.0 if wanted else 1e4)
            if best is None or cost < best[0] - 1e-9:
                best = cost, q
        assert best is not None
        return best[1]

    def orient(self, sign: int = 0, keep_tip: bool = False, goal: np.ndarray | None = None) -> None:
        """Turn the rotary axes until the tool is normal to the tilted plane.

        Args:
            sign: As :meth:`aimed`.
            keep_tip: Whether the linear axes follow, so that the tip stays on the workpiece; otherwise they rest.
            goal: (3,) place in the plane where all axes go together; not a number: the place of now.
        """
        self.flush()
        target = self.aimed(self.turn @ np.array([0.0, 0.0, 1.0]), sign=sign)
        rotary = self.chain.rotary_columns
        for a in self.chain.rotary:
            self.named.setdefault(a, self.number)
        before = self.axis_positions() if not np.isnan(self.at[rotary]).any() else None
        if before is None:
            self.at = self.at.copy()
            self.at[rotary] = target[rotary]
            if not keep_tip:
                self.lose(self.chain.linear)
            return
        after = before.copy()
        after[rotary] = target[rotary]
        if goal is not None:
            end = self._filled(self.at)
            end[rotary] = target[rotary]
            end[self.chain.linear_columns] = np.where(np.isnan(goal), end[self.chain.linear_columns], goal)
            after = self._axes(self._in_work(end[None]), True)[0]
        if keep_tip:
            end = self.at.copy()
            end[rotary] = target[rotary]
            self.move(end[None], None, False)
            return
        if (after != before).any():
            self._bridge(before, False)
            self._append(after, self._rapid(after - before), False, False, self.number)
        self._set_axes(after)

    def check_normal(self) -> None:
        """Refuse to cut in a tilted plane with a tool that is not normal to it.

        Raises:
            GCodeError: it is not.
        """
        if self.follows and not self.tcp:
            units = np.array([scale(a) for a in self.chain.letters])
            tool = tool_direction(self.chain, (self._filled(self.at) * units)[None])[0]
            if tool @ self.turn[:, 2] < _NORMAL:
                angle = np.degrees(np.arccos(np.clip(tool @ self.turn[:, 2], -1.0, 1.0)))
                raise GCodeError(
                    f"a feed block in a tilted plane while the tool is {angle:.2f}° off its normal; allowed: rotary "
                    "axes turned there before (G53.1, CYCLE800 with a direction, PLANE … TURN)"
                )

    def great_circle(self, end: np.ndarray, direction: np.ndarray, count: int = 0) -> np.ndarray:
        """Points to ``end`` on which the tool's direction follows a great circle.

        Args:
            end: Linear places of the end, (axes,).
            direction: Of the tool there, (3,) in the work frame.
            count: Number of points; 0: so many that the direction changes by 1° at most.

        Returns:
            (k, axes); the last one is the end with its rotary positions.
        """
        units = np.array([scale(a) for a in self.chain.letters])
        start = self._filled(self.at)
        first = tool_direction(self.chain, (start * units)[None])[0]
        last = direction / np.linalg.norm(direction)
        angle = float(np.arccos(np.clip(first @ last, -1.0, 1.0)))
        count = count or max(1, int(np.ceil(angle / _TURN)))
        out, near, rotary = [], start, self.chain.rotary_columns
        for share in np.arange(1, count + 1) / count:
            vector = last
            if angle > 1e-9 and share < 1.0:
                vector = (np.sin((1 - share) * angle) * first + np.sin(share * angle) * last) / np.sin(angle)
            near = self.aimed(vector, near)
            point = end.copy() if np.isnan(self.at).any() else start + share * (end - start)
            point[rotary] = near[rotary]
            out.append(point)
        if np.isnan(self.at).any():
            return out[-1][None]
        return np.array(out)

    # -- moves ---------------------------------------------------------------------------------------------------------

    def move(
        self,
        points: np.ndarray,
        minutes: np.ndarray | None,
        cutting: bool,
        stop: bool = False,
        corner: tuple[str, float] | None = None,
    ) -> None:
        """Go through points (k, axes) in program coordinates.

        Args:
            points: Where to go.
            minutes: (k,) durations; ``None``: a rapid move.
            cutting: Whether it is a feed move.
            stop: Whether the axes come to rest at the end.
            corner: How the corner to the next move is broken.

        Raises:
            GCodeError: the end of a feed move is at an unknown place, or the tool is not normal to a tilted plane.
        """
        end = points[-1]
        if cutting:
            self.check_normal()
        if not self.known(self.at) or (cutting and not self.seconds and self.pending is None and self._fresh(end)):
            if cutting and not self.known(end):
                lost = next(a for a, v in zip(self.chain.letters, end, strict=True) if np.isnan(v) and a in self.named)
                raise GCodeError(
                    f"a feed block before {lost} has a known place; allowed: a G0 or G90 word of {lost} first"
                )
            if cutting:
                self.warn(
                    "start",
                    f"line {self.number}: a feed move from a place that the program does not say; the path begins at "
                    "its end",
                )
            self.flush()
            self.at, self.lost, self.place_line = end, True, self.number
            return
        places = self._filled(np.vstack([self.at, points]))
        if not cutting and np.array_equal(places[0], places[-1]) and len(points) == 1:
            self.at, self.place_line = end, self.number
            return
        if minutes is None:
            minutes = np.array([self._rapid(np.diff(places, axis=0).sum(axis=0)) / 60.0])
        segment = Segment(places, np.asarray(minutes, float), cutting, self.number, self.place_line, stop, corner)
        if self.pending is not None and self.pending.corner is not None and cutting and self.pending.cutting:
            self._break_corner(self.pending, segment)
        self.flush()
        self.pending, self.at, self.place_line = segment, end, self.number

    def _fresh(self, end: np.ndarray) -> bool:
        """Whether a first feed block names axes that were never at a known place."""
        return any(np.isnan(a) and not np.isnan(b) for a, b in zip(self.at, end, strict=True))

    def _rapid(self, step: np.ndarray) -> float:
        """Seconds of a rapid move."""
        linear = float(np.linalg.norm(step[self.chain.linear_columns])) / RAPID
        rotary = float(np.abs(step[self.chain.rotary_columns]).max(initial=0.0)) / RAPID_ROTARY
        return max(60.0 * max(linear, rotary), 1e-3)

    def rest(self, seconds: float = 0.0) -> None:
        """The axes come to rest, for a known time or for one that only the control knows."""
        if self.pending is not None:
            self.pending.stop = True
        self.flush()
        if self.stops:
            self.stops[-1] = True
        if seconds > 0.0 and self.points and self.known(self.at):
            place = self._in_work(self._filled(self.at)[None])[0]
            self._bridge(place, self.tip)
            self._append(place, seconds, False, True, self.number)
            self.tips[-1] = self.tip

    def flush(self) -> None:
        """Take the move that waits for its corner."""
        segment, self.pending = self.pending, None
        if segment is None:
            return
        places, tip = self._in_work(segment.points), self.tip
        self._bridge(places[0], tip, segment.begin)
        steps = np.abs(np.diff(places, axis=0)).max(axis=1) > 0.0
        for i, moved in enumerate(steps.tolist()):
            if moved:
                self._append(places[i + 1], segment.minutes[i] * 60.0, segment.cutting, False, segment.line)
                self.tips[-1] = tip
        if segment.stop and self.stops:
            self.stops[-1] = True

    def _bridge(self, start: np.ndarray, tip: bool, line: int = 0) -> None:
        """Begin at a place, or go there straight where the axes were somewhere unknown in between."""
        if not self.points:
            self.points.append(start)
            self.lines.append(line or self.number)
            self.lost = False
            return
        if not self.lost:
            return
        self.lost = False
        here = self._axes(start[None], tip)[0]
        there = self._axes(self.points[-1][None], self.tips[-1] if self.tips else tip)[0]
        if self.stops:
            self.stops[-1] = True
        if np.abs(here - there).max() < 1e-9:
            return
        self._append(here, self._rapid(here - there), False, True, line or self.number)
        if any(self.cutting):
            self.warn(
                "bridge",
                f"line {self.number}: the axes come from a place that only the control knows; taken as a straight "
                "rapid move from the last known one, which counts for nothing",
            )

    def _append(self, place: np.ndarray, seconds: float, cutting: bool, stop: bool, line: int) -> None:
        self.points.append(place)
        self.seconds.append(max(seconds, 1e-9))
        self.lines.append(line)
        self.tips.append(False)
        self.cutting.append(cutting)
        self.stops.append(stop)

    def warn(self, key: str, text: str) -> None:
        """Keep the first sentence of a kind."""
        self.warnings.setdefault(key, text)

    # -- corners -------------------------------------------------------------------------------------------------------

    def _break_corner(self, before: Segment, after: Segment) -> None:
        """Round or chamfer the corner between two moves.

        A chamfer leaves both contours at the same distance from the corner. A rounding is the circle that touches both
        lines (Sinumerik, Programming Manual Fundamentals, 6FC5398-1BP40: CHR is the width of the chamfer in the
        direction of motion, CHF its length).

        Raises:
            GCodeError: the corner cannot be broken so.
        """
        assert before.corner is not None
        kind, size = before.corner
        linear = self.chain.linear_columns
        a, b = before.points[:, linear], after.points[:, linear]
        straight = len(a) == 2 and len(b) == 2
        one, two = a[-1] - a[-2], b[1] - b[0]
        if not one.any() or not two.any():
            raise GCodeError(f"a corner of {size:g} mm next to a move without a way; allowed: between two contours")
        cosine = np.clip(one @ two / np.linalg.norm(one) / np.linalg.norm(two), -1.0, 1.0)
        if cosine > 1.0 - 1e-9:
            return
        bend = float(np.arccos(cosine))
        if kind != "chamfer" and not straight:
            raise GCodeError(
                f"a rounding or chamfer by its length ({size:g} mm) at an arc; allowed: between straight lines"
            )
        leg = {"chamfer": size, "length": 0.5 * size / np.cos(0.5 * bend), "round": size * np.tan(0.5 * bend)}[kind]
        end = _cut(before.points[::-1], leg, linear)
        start = _cut(after.points, leg, linear)
        if end is None or start is None:
            raise GCodeError(f"a corner of {size:g} mm, longer than the contour beside it; allowed: a shorter one")
        rate = before.minutes.sum() / max(_length(a), 1e-12)
        before.minutes = _shared(before.minutes, before.points, end[::-1], linear)
        after.minutes = _shared(after.minutes, after.points, start, linear)
        before.points, after.points = end[::-1], start
        if kind == "round":
            bow = _rounded(before.points[-1, linear], after.points[0, linear], one, two, size, bend)
        else:
            bow = after.points[:1, linear]
        shares = np.linspace(0.0, 1.0, len(bow) + 1)[1:, None]
        points = before.points[-1] + shares * (after.points[0] - before.points[-1])
        points[:, linear] = bow
        ways = np.linalg.norm(np.diff(np.vstack([before.points[-1:, linear], bow]), axis=0), axis=1)
        before.points = np.vstack([before.points, points])
        before.minutes = np.concatenate([before.minutes, rate * ways])
        before.corner = None

    # -- result --------------------------------------------------------------------------------------------------------

    def result(self) -> tuple[Commanded, np.ndarray] | None:
        """The motion from the first feed block to the last, and the line of each of its points; ``None`` without any
        move. A program of rapid moves alone is taken whole.
        """
        self.flush()
        cutting = np.array(self.cutting, bool)
        if not len(cutting):
            return None
        units = np.array([scale(a) for a in self.chain.letters])
        tips = np.array(self.tips)
        whole = Commanded(
            np.array(self.seconds),
            np.array(self.points) * units,
            tips if len(set(self.tips)) > 1 else bool(tips[0]),
            self.chain,
            cutting=None if cutting.all() else cutting,
            stops=np.array(self.stops) if any(self.stops) else None,
        )
        if not cutting.any():
            self.warn("rapid", "the program has no feed block, only rapid moves")
            return whole, np.array(self.lines)
        first, last = int(np.flatnonzero(cutting)[0]), int(np.flatnonzero(cutting)[-1])
        part = whole.part(first, last)
        if part.cutting is not None and part.cutting.all():
            part = Commanded(part.seconds, part.points, part.tip, part.chain, stops=part.stops)
        if part.stops is not None and not part.stops[:-1].any():
            part = Commanded(part.seconds, part.points, part.tip, part.chain, cutting=part.cutting)
        return part, np.array(self.lines)[first : last + 2]


def _length(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _cut(points: np.ndarray, leg: float, linear: slice) -> np.ndarray | None:
    """A path without its first ``leg`` mm; nothing where it is not longer than that."""
    ways = np.linalg.norm(np.diff(points[:, linear], axis=0), axis=1)
    ends = np.cumsum(ways)
    if ends[-1] <= leg:
        return None
    i = int(np.searchsorted(ends, leg, side="right"))
    share = (leg - (ends[i] - ways[i])) / ways[i]
    return np.vstack([points[i] + share * (points[i + 1] - points[i]), points[i + 1 :]])


def _shared(minutes: np.ndarray, whole: np.ndarray, part: np.ndarray, linear: slice) -> np.ndarray:
    """Durations of what is left of a path, at the pace of the whole."""
    ways = np.linalg.norm(np.diff(part[:, linear], axis=0), axis=1)
    return minutes.sum() * ways / max(_length(whole[:, linear]), 1e-12)


def _rounded(
    start: np.ndarray, end: np.ndarray, one: np.ndarray, two: np.ndarray, radius: float, bend: float
) -> np.ndarray:
    """Points (k, 3) of the circle that leaves one line at ``start`` and touches another one at ``end``."""
    ahead = one / np.linalg.norm(one)
    inward = two / np.linalg.norm(two) - ahead * np.cos(bend)
    inward /= np.linalg.norm(inward)
    angles = np.linspace(0.0, bend, chords(radius, bend) + 1)[1:, None]
    bow = start + radius * (np.sin(angles) * ahead + (1.0 - np.cos(angles)) * inward)
    bow[-1] = end
    return bow


def chords(radius: float, sweep: float) -> int:
    """Number of chords of an arc of ``radius`` mm and ``sweep`` rad that stay within :data:`SAGITTA` of it."""
    step = np.sqrt(8.0 * SAGITTA / max(radius, 8.0 * SAGITTA))
    return int(np.clip(np.ceil(abs(sweep) / step), 2, 100_000))
