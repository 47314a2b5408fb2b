"""Touch probe and calibration sphere as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from mjsim.errors import InputError
from mjsim.instruments.base import Channel, Instrument, Mistake, Nuisances, Observation, Stops, register
from mjsim.instruments.schema import Clock, Length, Number, OwnLength, Table, printable
from mjsim.instruments.sphere.measurement import (
    POINT_TIME,
    Points,
    Probe,
    SphereTest,
    probe_columns,
    sides_of,
    sphere_columns,
    stops_of,
)
from mjsim.instruments.sphere.mistakes import sphere_mistakes
from mjsim.io.inputs import check_columns, csv_table, need_columns
from mjsim.io.times import check_growing
from mjsim.machine.chain import COORDINATES, Chain, chain_of
from mjsim.machine.kinematics import Geometry, bar_vector, turn_about
from mjsim.units import DEG, MM, UM

# -- sphere tests of a campaign ----------------------------------------------------------------------------------------

#: Fewest points of a test.
FEWEST = 3
#: Columns of the measured deviations.
DEVIATIONS = tuple(f"d{c.lower()}_um" for c in COORDINATES)
#: Words of headers of other systems for what was found, before or behind the letter of a coordinate, lower case.
_FOUND = ("measured", "meas", "actual", "act", "ist", "centre", "center", "m")
OFF = ("d", "delta", "δ", "dev", "deviation", "diff", "error", "err", "abw", "abweichung")
#: The same for what was commanded.
_NOMINAL = ("nominal", "nom", "soll", "command", "cmd")
_WORDS = {"spindle": "spindle", "spindel": "spindle", "run": "run", "lauf": "run", "time": "time", "zeit": "time"}
#: Angles of a file that are those of a plan, rad.
_SAME = 0.1 * DEG
#: Columns that a file may have besides those of axes, deviations and sides.
MORE = ("time_s", "run", "spindle_deg")

Angle = Annotated[float, Field(ge=-100_000, le=100_000, allow_inf_nan=False)]


class SphereTable(Table):
    """A ``[[test]]`` table of a sphere."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Literal["sphere"]
    sphere_mm: Annotated[list[Length], Field(min_length=3, max_length=3)]
    trace: str | None = None
    setup: Annotated[str, Field(max_length=200), AfterValidator(printable)] | None = None
    tool_length_mm: Annotated[float, Field(gt=0, le=5000)] | None = None
    angles_deg: Annotated[list[list[Angle]], Field(max_length=1000)] = Field(default=[])
    spindle_deg: Annotated[list[Number], Field(max_length=1000)] = Field(default=[])
    approach: Annotated[list[list[Literal[-1, 1]]], Field(max_length=1000)] = Field(default=[])
    started_s: Clock = 0.0


def sphere_test(file: Path, t: SphereTable, chain: Chain) -> SphereTest:
    """The test that a ``[[test]]`` table describes.

    Args:
        file: Where it stands.
        t: The table.
        chain: Axes of the machine.

    Raises:
        InputError: The machine lacks axes, or a list has another length than it needs.
    """
    place = f'{file}: [[test]] "{t.name}"'
    if not chain.spatial or not chain.rotary:
        raise InputError(
            f"{place}: the machine has the axes {', '.join(chain.letters)}; allowed for a sphere: a machine with "
            f"{', '.join(COORDINATES)} and at least one rotary axis"
        )
    for row in t.angles_deg:
        if len(row) != len(chain.rotary):
            raise InputError(
                f"{place}: angles_deg has the row {row}; allowed: {len(chain.rotary)} numbers a row, the angles of "
                f"{', '.join(chain.rotary)}"
            )
    for key, values in (("spindle_deg", t.spindle_deg), ("approach", t.approach)):
        if values and len(values) != len(t.angles_deg):
            raise InputError(
                f"{place}: {key} has {len(values)} entries for {len(t.angles_deg)} rows of angles_deg; allowed: one "
                "for each row, or none"
            )
    for row in t.approach:
        if len(row) != len(chain.rotary):
            raise InputError(
                f"{place}: approach has the row {row}; allowed: {len(chain.rotary)} numbers a row, 1 or -1 for each of "
                f"{', '.join(chain.rotary)}"
            )
    if t.tool_length_mm is not None and chain.swivelling:
        chain = chain_of(chain.configuration, chain.placements, t.tool_length_mm * MM, chain.singular)
    x, y, z = (v * MM for v in t.sphere_mm)
    angles = tuple(tuple(a * DEG for a in row) for row in t.angles_deg)
    spindle = tuple(a * DEG for a in t.spindle_deg)
    approach = tuple(tuple(row) for row in t.approach)
    return SphereTest(t.name, (x, y, z), t.setup or t.name, t.trace, chain, angles, spindle, approach, t.started_s)


def columns_of(chain: Chain) -> dict[str, float]:
    """Columns that every file must have, each with its SI unit."""
    axes = {f"{a}_deg" if chain.is_rotary(a) else f"{a}_mm": DEG if chain.is_rotary(a) else MM for a in chain.letters}
    return axes | dict.fromkeys(DEVIATIONS, UM)


def read_points(path: Path, test: SphereTest) -> Points:
    """Read the CSV of one test, plain or compressed (``.csv.gz``).

    Args:
        path: The file.
        test: What it is to hold.

    Raises:
        InputError: Names the file, the line or column, what was found and what is allowed.
    """
    names, table, _ = csv_table(path, lambda names: _check_header(path, names, test))
    if len(table) < FEWEST:
        raise InputError(f"{path}: {len(table)} points; allowed: at least {FEWEST}")
    return points_of(path, names, table, test)


def points_of(path: Path, names: list[str], table: np.ndarray, test: SphereTest) -> Points:
    """Points from a table of numbers.

    Args:
        path: Of the file, for messages.
        names: Of the columns, as in a trace.
        table: (n, columns) in the units of the names.
        test: What it is of.

    Raises:
        InputError: A clock runs backwards, or a side is neither +1 nor -1.
    """
    chain, column = test.chain, {n: table[:, i] for i, n in enumerate(names)}
    need = columns_of(chain)
    position = np.column_stack([column[n] * need[n] for n in list(need)[: chain.count]])
    deviation = np.column_stack([column[n] * need[n] for n in DEVIATIONS])
    side = sides_of(position[:, chain.rotary_columns])
    for i, a in enumerate(chain.rotary):
        if (name := f"from_{a}") in column:
            side[:, i] = column[name]
            if wrong := np.flatnonzero(~np.isin(side[:, i], (-1.0, 0.0, 1.0))).tolist():
                found = f"{column[name][wrong[0]]:g}"
                raise InputError(
                    f"{path}, line {wrong[0] + 2}: {name} = {found}; allowed: 1 where the last move of {a} was towards "
                    "larger angles, -1 where towards smaller ones, 0 where nobody knows"
                )
    n = len(table)
    timed = "time_s" in column
    time = column["time_s"] if timed else POINT_TIME * np.arange(n)
    if timed:
        check_growing(path, time, lambda i: i + 2)
    spindle = column.get("spindle_deg", np.zeros(n)) * DEG
    return Points(position, deviation, side, spindle, time, timed, column.get("run", np.ones(n)))


def _check_header(path: Path, names: list[str], test: SphereTest) -> None:
    """Refuse columns that are missing, unknown or double."""
    need = list(columns_of(test.chain))
    allowed = [*need, *MORE, *(f"from_{a}" for a in test.chain.rotary)]
    if "time_s" in names and not any(n in names for n in need[: test.chain.count]):
        raise InputError(
            f"{path}, line 1: there are no positions of axes, as in the recording of an R-test along a motion, which "
            f'has kind = "r_test"; allowed: one row a point, with the columns {", ".join(need)}'
        )
    check_columns(path, names, allowed)
    need_columns(path, names, need)


def trace_text(test: SphereTest, points: Points) -> str:
    """A trace as :func:`read_points` reads it."""
    need = columns_of(test.chain)
    names = [*need, *(f"from_{a}" for a in test.chain.rotary)]
    values = np.column_stack([points.position, points.deviation]) / np.array(list(need.values()))
    columns = [*values.T, *points.side.T]
    forms = ["%.6f"] * test.chain.count + ["%.4f"] * 3 + ["%.0f"] * len(test.chain.rotary)
    more = (
        ("spindle_deg", points.spindle / DEG, "%.4f", points.spindle.any()),
        ("time_s", points.time, "%.3f", points.timed),
    )
    for name, column, form, present in (*more, ("run", points.run, "%.0f", points.run.max() > 1)):
        if present:
            names.append(name)
            columns.append(column)
            forms.append(form)
    rows = [",".join(f % v for f, v in zip(forms, row, strict=True)) for row in np.column_stack(columns)]
    return "\n".join([",".join(names), *rows, ""])


# -- circles through the measured centres, as the cycles of controls fit them ------------------------------------------
# While one rotary axis turns and the others stand, the centre of the sphere goes round on a circle. Its plane's normal
# is the direction of the axis, its centre lies on it. The cycles take the probe for calibrated and the linear axes for
# perfect; so squareness and straightness errors go into these numbers (SINUMERIK CYCLE996, HEIDENHAIN KinematicsOpt).

#: Fewest positions of a circle, and the least angle that they span, rad: below that a circle means nothing.
_FEWEST, _SPAN = 3, 30.0 * DEG
#: Step of derivatives, m and rad.
_STEP = 1e-5


@dataclass(frozen=True)
class Circle:
    """What one rotary axis does to the sphere.

    Attributes:
        axis: Its letter.
        test: Name of the test.
        centre: Of the circle, machine frame, (3,) m.
        direction: Unit vector along the axis, (3,).
        radius: m.
        rows: Points on it.
    """

    axis: str
    test: str
    centre: np.ndarray
    direction: np.ndarray
    radius: float
    rows: np.ndarray


def circle_through(points: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Centre (3,), direction (3,) and radius of the circle through points (n, 3), least squares, all in m.

    Args:
        points: At least three, not on a line.
        along: Which of the two directions of the normal is wanted, (3,).
    """
    middle = points.mean(axis=0)
    first, second, normal = np.linalg.svd(points - middle, full_matrices=False)[2]
    normal = normal * np.sign(normal @ along)
    flat = (points - middle) @ np.column_stack([first, second])
    a = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, c = np.linalg.lstsq(a, (flat**2).sum(axis=1), rcond=None)[0]
    return middle + x * first + y * second, normal, float(np.sqrt(c + x * x + y * y))


def circles_of(test: SphereTest, points: Points, deviation: np.ndarray | None = None) -> list[Circle]:
    """The circle of every rotary axis that turns alone somewhere in a test, over the largest angle.

    Args:
        test: The test.
        points: What was measured.
        deviation: In the place of the measured one, (n, 3) m.
    """
    chain = test.chain
    if chain.carried:  # the machine frame is none of axis positions
        return []
    centres = points.position[:, chain.linear_columns] + (points.deviation if deviation is None else deviation)
    angles = points.position[:, chain.rotary_columns]
    out = []
    for i, letter in enumerate(chain.rotary):
        others = np.delete(angles, i, axis=1)
        best: np.ndarray | None = None
        for place in np.unique(np.round(others / (0.01 * DEG)), axis=0):
            rows = np.flatnonzero((np.round(others / (0.01 * DEG)) == place).all(axis=1))
            turned = np.unique(np.round(angles[rows, i] / (0.01 * DEG)))
            if len(turned) < _FEWEST or _spanned(angles[rows, i]) < _SPAN:
                continue
            if best is None or _spanned(angles[rows, i]) > _spanned(angles[best, i]) + 1e-6:
                best = rows
        if best is not None and np.linalg.norm(np.ptp(centres[best], axis=0)) > 1e-3:
            axis = chain.axis(letter)
            along = np.array(axis.unit, float)
            others_at = angles[best[0]].copy()
            others_at[i] = 0.0
            centre, direction, radius = circle_through(centres[best], _turned_by_others(test, letter, others_at, along))
            out.append(Circle(letter, test.name, centre, direction, radius, best))
    return out


def _spanned(angles: np.ndarray) -> float:
    """Angle that positions cover, rad: a full turn less its largest gap."""
    a = np.sort(np.mod(angles, 2 * np.pi))
    return 2 * np.pi - float(np.diff(np.append(a, a[0] + 2 * np.pi)).max())


def _turned_by_others(test: SphereTest, letter: str, angles: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Direction (3,) of an axis while the axes that carry it stand at ``angles`` (rotary,), rad."""
    chain, out = test.chain, [np.array([v]) for v in along]
    for side in (chain.work, tuple(reversed(chain.tool))):
        letters = [a.letter for a in side]
        if letter in letters:
            for a in side[letters.index(letter) + 1 :]:
                if a.rotary:
                    at = np.array([angles[chain.rotary.index(a.letter)]])
                    out = turn_about(a, out, at)
    return np.array([float(v[0]) for v in out])


def location_errors(tests: Sequence[SphereTest], recordings: Mapping[str, Points]) -> dict[str, float]:
    """Location errors that the circles alone give, m and rad by name; those that no circle shows are left out.

    Args:
        tests: Measured tests.
        recordings: By name of the test.
    """
    best: dict[str, tuple[SphereTest, Circle]] = {}
    for t in tests:
        for c in circles_of(t, recordings[t.name]):
            now = best.get(c.axis)
            if now is None or _angle(recordings, c, t) > _angle(recordings, now[1], now[0]) + 1e-6:
                best[c.axis] = t, c
    if not best:
        return {}
    names = [e.name for e in tests[0].chain.location_errors]

    def seen(errors: dict[str, float] | None) -> np.ndarray:
        """Centre and direction of all circles; as measured, or as a machine with these errors shows them."""
        out = []
        for axis, (t, c) in best.items():
            points = recordings[t.name]
            if errors is None:
                found = c
            else:
                made = -bar_vector(t.chain, points.position, np.array(t.sphere), Geometry(errors, {}))
                found = next(x for x in circles_of(t, points, made) if x.axis == axis)
            across = [k for k in range(3) if k != int(np.argmax(np.abs(c.direction)))]
            out += [*found.centre[across], *found.direction[across]]
        return np.array(out)

    ideal = seen({})
    columns = np.column_stack([(seen({n: _STEP}) - ideal) / _STEP for n in names])
    # a number that circles of this campaign do not determine has no unique solution
    _, values, vectors = np.linalg.svd(columns)
    rank = int((values > 1e-6 * values[0]).sum())
    x = np.linalg.lstsq(columns, seen(None) - ideal, rcond=1e-6)[0]
    hidden = np.abs(vectors[rank:]).max(axis=0) if rank < len(names) else np.zeros(len(names))
    return {n: float(v) for n, v, h in zip(names, x, hidden, strict=True) if h < 1e-3}


def _angle(recordings: Mapping[str, Points], c: Circle, t: SphereTest) -> float:
    """Angle over which a circle was measured, rad."""
    return _spanned(recordings[c.test].position[c.rows, t.chain.index(c.axis)])


#: Prior standard deviation of the place of a sphere on the table, m.
SPHERE = 1.0 * MM
#: Prior standard deviation of the amplitude of a three-lobed pre-travel, m.
LOBES = 0.5 * UM
_LOWER = tuple(c.lower() for c in COORDINATES)
#: Numbers of set-up and probe, with their units.
SPHERE_NAMES = tuple(f"sphere_{c}_um" for c in _LOWER)
PROBE_NAMES = (*(f"probe_{c}_um" for c in _LOWER), "pretravel_cos_um", "pretravel_sin_um")


@register
class SphereProbe(Instrument[SphereTest, Points]):
    """The centre of a sphere on the table, found with a touch probe while the machine stands still."""

    name = SphereTest.instrument
    noun = "touch probe"
    test_noun = "sphere test"
    beside = "sphere_tests"
    order = 2
    at_rest = True
    plan_option = "--points 30"
    usual = Probe()
    by_itself_noun = "from circles"
    by_itself_note = (
        "From circles: centre and direction of each axis as the cycles of controls compute them, with linear axes and "
        "probe taken for perfect."
    )
    own_keys = dict.fromkeys(("repeatability_um", "probe_offset_um"), (OwnLength, None))

    def kinds(self) -> Sequence[str]:
        return (self.name,)

    def table(self, chain: Chain) -> type[SphereTable]:
        return SphereTable

    def test_of(self, file: Path, table: SphereTable, chain: Chain) -> SphereTest:
        return sphere_test(file, table, chain)

    def data_of(self, table: Any) -> Probe:
        stated, offset = table.repeatability_um, table.probe_offset_um
        return Probe(None if stated is None else stated * UM, (20.0 if offset is None else offset) * UM)

    def known_from(self, data: Probe, recordings: Mapping[str, Points]) -> Probe:
        scatters = [p.scatter for p in recordings.values()]
        return data.with_scatter(sum(s for s, _ in scatters), sum(f for _, f in scatters))

    def read(self, path: Path, test: SphereTest, data: Probe) -> Points:
        return read_points(path, test)

    def file_columns(self, test: SphereTest) -> dict[str, tuple[str, str]]:
        chain = test.chain
        out = {a: ("angle", "deg") if chain.is_rotary(a) else ("deviation", "mm") for a in chain.letters}
        for c in COORDINATES:
            out[f"d{c.lower()}"] = "deviation", "um"
            out[f"{c.lower()}_measured"] = "deviation", "mm"
        return (
            out
            | {f"from_{a}": ("", "") for a in chain.rotary}
            | {"spindle": ("angle", "deg"), "run": ("", ""), "time": ("time", "s")}
        )

    def column_named(self, test: SphereTest, header: str, word: str) -> str:
        chain = test.chain
        for a in chain.rotary:  # the letter would be taken for a unit
            if header.strip().lower() == f"from_{a.lower()}":
                return f"from_{a}"
        word = word.replace(" ", "_").strip("_")
        if own := _WORDS.get(word):
            return own
        if word.upper() in chain.letters:
            return word.upper()
        for c in (c.lower() for c in COORDINATES):
            parts = word.replace(c, "_", 1).strip("_") if word.count(c) == 1 else ""
            if c in word and parts in OFF:
                return f"d{c}"
            if c in word and parts in _FOUND:
                return f"{c}_measured"
        parts = word.split("_")
        if len(parts) == 2 and parts[0].upper() in chain.letters and parts[1] in _NOMINAL:
            return parts[0].upper()
        return ""

    def missing_columns(self, test: SphereTest, have: Collection[str]) -> list[str]:
        missing = [a for a in test.chain.rotary if a not in have]
        for c in (c.lower() for c in COORDINATES):
            if f"d{c}" not in have and f"{c}_measured" not in have:
                missing.append(f"d{c} or {c}_measured")
        return missing

    def from_columns(self, source: Path, test: SphereTest, columns: dict[str, np.ndarray]) -> tuple[Points, list[str]]:
        """Linear positions that the table lacks are those of an ideal machine. Sides and angles of the spindle that it
        lacks are those of the plan, where it has the positions of the plan.
        """
        chain, notes, si = test.chain, [], dict(columns)
        angles = np.column_stack([si[a] for a in chain.rotary])
        centred, plan = test.centred(angles), test.planned
        if len(plan.position) == len(angles) and np.allclose(
            plan.position[:, chain.rotary_columns], angles, atol=_SAME
        ):
            known = {f"from_{a}": side for a, side in zip(chain.rotary, plan.side.T, strict=True)}
            known["spindle"] = plan.spindle
            if lacking := [n for n in known if n not in si]:
                notes.append(f"no column for {', '.join(lacking)}: as planned, for the positions are those of the plan")
                si |= {n: known[n] for n in lacking}
        if lacking := [a for a in chain.linear if a not in si]:
            notes.append(f"no column for {', '.join(lacking)}: where the tool of an ideal machine is in the sphere")
        for i, a in enumerate(chain.linear):
            si.setdefault(a, centred[:, i])
        for i, c in enumerate(COORDINATES):
            low = c.lower()
            if f"d{low}" not in si:
                si[f"d{low}"] = si[f"{low}_measured"] - si[chain.linear[i]]
        order = [*chain.letters, *(f"d{c.lower()}" for c in COORDINATES)]
        out = {name: si[own] / size for own, (name, size) in zip(order, columns_of(chain).items(), strict=True)}
        out |= {n: si[n] for n in si if n.startswith("from_")}
        if "spindle" in si:
            out["spindle_deg"] = si["spindle"] / DEG
        for own, name in (("run", "run"), ("time", "time_s")):
            if own in si:
                out[name] = si[own]
        return points_of(source, list(out), np.column_stack(list(out.values())), test), notes

    def trace_text(self, test: SphereTest, recording: Points) -> str:
        return trace_text(test, recording)

    def found_columns(self, test: SphereTest) -> Sequence[str]:
        return DEVIATIONS

    def planned_text(self, test: SphereTest) -> str:
        """A trace without what is to be found."""
        if not test.angles:
            return ""
        head, *rows = trace_text(test, test.planned).splitlines()
        names = head.split(",")
        kept = [i for i, n in enumerate(names) if n not in DEVIATIONS]
        lines = [",".join(row.split(",")[i] for i in kept) for row in (head, *rows)]
        return "\n".join([*lines, ""])

    def planned_noise(self, test: SphereTest, data: Probe) -> np.ndarray:
        return np.full(3, data.noise)

    def test_table(self, test: SphereTest) -> dict[str, Any]:
        return {
            "name": test.name,
            "kind": test.kind,
            "sphere_mm": [round(v / MM, 4) for v in test.sphere],
            "setup": test.setup,
            "angles_deg": [[round(a / DEG, 4) for a in row] for row in test.angles],
            "spindle_deg": [round(a / DEG, 4) for a in test.spindle],
            "approach": [list(row) for row in test.approach],
        }

    def facts(self, test: SphereTest, recording: Points) -> dict[str, Any]:
        angles = recording.position[:, test.chain.rotary_columns] / DEG
        out: dict[str, Any] = {"points": len(angles)}
        for i, letter in enumerate(test.chain.rotary):
            out[f"{letter}_deg"] = [round(float(angles[:, i].min()), 3), round(float(angles[:, i].max()), 3)]
        return out | {
            "both_sides": [a for a, s in zip(test.chain.rotary, recording.side.T, strict=True) if np.ptp(s) > 1]
        }

    def channels(self, test: SphereTest) -> tuple[Channel, ...]:
        return tuple(Channel(f"d{c}") for c in _LOWER)

    def observe(self, test: SphereTest, recording: Points) -> Observation:
        time = recording.time - recording.time[0]
        return Observation(time, recording.deviation, np.ones(recording.deviation.shape, bool))

    def stops(self, test: SphereTest, recording: Points) -> Stops:
        return stops_of(test, recording)

    def reading(self, test: SphereTest, position: np.ndarray, geometry: Geometry) -> np.ndarray:
        return -bar_vector(test.chain, position, np.array(test.sphere), geometry)

    def nuisances_of(self, test: SphereTest, recording: Points, time: np.ndarray, data: Probe) -> Nuisances:
        columns = (
            np.concatenate([sphere_columns(test, recording.position), probe_columns(test, recording)], axis=2) * UM
        )
        spread = np.array([SPHERE] * 3 + [data.offset] * 3 + [LOBES] * 2) / UM
        return Nuisances((*SPHERE_NAMES, *PROBE_NAMES), columns, spread, PROBE_NAMES)

    def noise(self, test: SphereTest, recording: Points, data: Probe) -> np.ndarray:
        return np.full(3, data.noise)

    def figures_of(
        self, test: SphereTest, recording: Points, time: np.ndarray, reading: np.ndarray
    ) -> dict[str, float]:
        """Range per direction about the sphere's place (ISO 10791-6), and centre and direction of every rotary axis."""
        columns = sphere_columns(test, recording.position).reshape(-1, 3)
        rest = reading - (columns @ np.linalg.lstsq(columns, reading.ravel(), rcond=None)[0]).reshape(-1, 3)
        out = {f"range_{c}_um": float(np.ptp(r)) / UM for c, r in zip(_LOWER, rest.T, strict=True)}
        for circle in circles_of(test, recording, reading):
            out |= {f"{circle.axis}_centre_{c}_mm": float(v) / MM for c, v in zip(_LOWER, circle.centre, strict=True)}
            out |= {f"{circle.axis}_direction_{c}": float(v) for c, v in zip(_LOWER, circle.direction, strict=True)}
        return out

    def by_itself(self, tests: Sequence[SphereTest], recordings: Mapping[str, Points]) -> dict[str, float]:
        """Location errors from circles, as the cycles of controls compute them."""
        return {f"axis_location.{n}": v / UM for n, v in location_errors(tests, recordings).items()}  # µrad alike

    def mistakes(self, tests: Sequence[SphereTest], recordings: dict[str, Points], data: Probe) -> list[Mistake]:
        return sphere_mistakes(tests, recordings, data)
