"""When the catalogue does not explain what is left: generic terms that say on what the rest depends, and an effect file
in that form that is ready to be edited.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjsim.inference.curve_fit import bends, changes, orders
from mjsim.inference.curve_terms import RADIAL, TABLE, CurveTerm, StrokeColumns
from mjsim.inference.fit import Fit
from mjsim.inference.problem import Problem
from mjsim.inference.shares import unabsorbed
from mjsim.inference.variables import LOG_SECONDS, VARIABLES, in_json
from mjsim.machine.chain import Chain, is_rotary
from mjsim.units import DEG, UM


@dataclass(frozen=True)
class Unexplained:
    """Something repeatable that no catalogue effect explains.

    Attributes:
        axes, variable: on what it depends. period: in units of the variable (°, mm, s), or ``None``. rms: m. tests:
            where it shows.
        angles: per test of ``tests``, φ (deg) where it is largest. summary: one sentence.
        curve: knots of the variable, the empirical term there and its standard deviation (file units: mm, °, m/s ...
            and µm or °).
        labels: of the curve's two axes. left: RMS of what remains beyond the empirical term, m.
        probability: that there is such a cause, larger than a machine of its class may have, on these axes and with
            this variable. alternatives: what else it may be: axes, variable, probability.
        source: text of an effect file in that form. effect_file, plot: where they were written, if they were.
    """

    axes: tuple[str, ...]
    variable: str
    period: float | None
    rms: float
    tests: tuple[str, ...]
    angles: tuple[float, ...]
    summary: str
    curve: tuple[np.ndarray, np.ndarray, np.ndarray]
    labels: tuple[str, str]
    left: float = 0.0
    probability: float = 1.0
    alternatives: tuple[tuple[tuple[str, ...], str, float], ...] = ()
    source: str = ""
    effect_file: str | None = None
    plot: str | None = None

    @property
    def stem(self) -> str:
        """Name of its files, without the ending."""
        return _stem(self.axes)

    def to_json(self) -> dict:
        """As in the JSON of ``mjsim diagnose``."""
        return {
            "axes": list(self.axes),
            "variable": in_json(self.variable),
            "period": self.period,
            "rms_um": round(self.rms / UM, 4),
            "left_um": round(self.left / UM, 4),
            "probability": round(self.probability, 4),
            "alternatives": [
                {"axes": list(axes), "variable": in_json(variable), "probability": round(p, 4)}
                for axes, variable, p in self.alternatives
            ],
            "tests": list(self.tests),
            "largest_at_phi_deg": [round(a, 1) for a in self.angles],
            "summary": self.summary,
            "effect_file": self.effect_file,
            "plot": self.plot,
        }


@dataclass(frozen=True)
class FurtherCurve:
    """A curve of an unknown cause that the model has, and that is not the one that is told in full.

    Attributes:
        axis: Whose motion it depends on; empty for the clock.
        moves: What it displaces, as in :class:`mjsim.inference.curve_terms.CurveTerm`.
        variable: Of the axis.
        largest: Its largest displacement, m or rad.
        limit: What a machine of its class may have there, m or rad; 0 where it has nothing of the kind.
        rms: In the readings, m.
        probability: That it is beyond the limit.
        mode: Frequency (Hz) and damping ratio where the structure swings; empty for a curve.
    """

    axis: str
    moves: str
    variable: str
    largest: float
    limit: float
    rms: float
    probability: float
    mode: tuple[float, float] | tuple[()] = ()

    @property
    def summary(self) -> str:
        """One sentence."""
        factor, unit = (1.0 / DEG, "°") if is_rotary(self.moves) else (1.0 / UM, " µm")
        size = f"up to {self.largest * factor:.2g}{unit}, {self.rms / UM:.2f} µm RMS in the readings"
        if self.mode:
            frequency, damping = self.mode
            at = f"at {frequency:.1f} Hz (damping ratio {damping:.2g})"
            return f"The structure swings {at} when axes accelerate: {size}."
        what = acts_on(self.axis, self.moves, self.variable)
        allowed = f"; a machine of its class may have {self.limit * factor:.2g}{unit}" if self.limit else ""
        return f"Something that is not in the catalogue {what}: {size}{allowed}."

    def to_json(self) -> dict:
        """As in the JSON of ``mjsim diagnose``."""
        factor, unit = (1.0 / DEG, "deg") if is_rotary(self.moves) else (1.0 / UM, "um")
        mode = {"frequency_Hz": round(self.mode[0], 2), "damping_ratio": round(self.mode[1], 4)} if self.mode else {}
        return {
            "axis": self.axis,
            "moves": self.moves,
            "variable": in_json(self.variable),
            **mode,
            f"largest_{unit}": float(f"{self.largest * factor:.3g}"),
            f"limit_{unit}": float(f"{self.limit * factor:.3g}"),
            "rms_um": round(self.rms / UM, 4),
            "probability": round(self.probability, 4),
            "summary": self.summary,
        }


#: Most steps, bends or waves of a curve that are told (assumed).
_MOST_TOLD = 3
_MOVED = {**dict.fromkeys(TABLE, "the table"), RADIAL: "the table along the ball's radius"}


def describe(
    problem: Problem,
    fit: Fit,
    term: CurveTerm,
    probability: float = 1.0,
    others: Sequence[tuple[CurveTerm, float]] = (),
) -> Unexplained:
    """A fitted term in words, with its curve and its effect file.

    Args:
        problem: The measured tests.
        fit: The model that was fitted together with the term.
        term: With its coefficients.
        probability: That such a cause is larger than the class allows, and acts and depends on what the term does.
        others: What else it may be, with probabilities.
    """
    # what the nuisances cannot take up
    parts = unabsorbed(problem, fit, [c @ term.coefficients for c in term.columns])
    explained = [c @ term.coefficients for c in term.columns]
    rms = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
    rest = problem.residual(fit.readings, fit.nuisance)
    left = float(
        np.sqrt(
            np.mean(
                np.concatenate([(r - p)[s.good] for r, p, s in zip(rest, explained, problem.samples, strict=True)]) ** 2
            )
        )
    )
    spread = [float(np.std(p)) for p in parts]
    order = sorted(
        (k for k in range(len(parts)) if spread[k] > problem.settings.visible_share * problem.noise_of(k).rms),
        key=lambda k: -spread[k],
    )
    where = tuple(
        float(np.degrees(problem.motions[k].program.phi(_worst_time(problem, fit, k, parts[k])))[0]) for k in order
    )
    shows = tuple(problem.tests[k].name for k in order)
    x, name, x_unit, period = _file_units(term, fit, problem.settings.harmonic_share)
    factor, y_unit = (1.0 / DEG, "°") if is_rotary(term.moves) else (1.0 / UM, "µm")
    shown, spread_of = _seen(term, problem.settings.hidden_shape)
    size = shown * term.unit
    power = np.sum([(c**2).sum(axis=0) for c in term.columns], axis=0)
    reached = power > 1e-4 * power.max()
    curve = x, np.where(reached, size * factor, np.nan), spread_of * term.unit * factor  # nan: no test goes there
    if VARIABLES[term.variable].is_counted:  # drawn from one number to the next
        curve = np.column_stack([x, x + 1.0]).ravel(), np.repeat(curve[1], 2), np.repeat(curve[2], 2)
    repeats = f", repeating every {period:.4g} {x_unit}" if period else ""
    most = f", most in {shows[0]} near φ = {where[0]:.0f}°" if shows else ""
    or_else = " or ".join(f"{_acts(t)} ({100 * p:.0f} %)" for t, p in others)
    summary = (
        f"Something that is not in the catalogue {_acts(term)}{repeats}: {rms / UM:.2f} µm RMS in the readings{most}; "
        f"{left / UM:.2f} µm stay after an empirical curve of that form."
        + shape_in_words(term, x, factor, x_unit, y_unit)
        + (f" That is {100 * probability:.0f} % sure; these tests leave open that it {or_else}." if or_else else "")
    )
    axes = term.axes or (term.moves,)
    alternatives = tuple((t.axes or (t.moves,), t.variable, p) for t, p in others)
    # numbers of the model, such as a location error, go with the level of a curve that was fitted with them
    fitted = bridged(term, term.coefficients * term.unit, reached)
    source = effect_source(problem.chain, term, fitted, summary, f"{_stem(axes)}.py")
    labels = (f"{name}, {x_unit}", f"displacement of {_moved(term.moves)}, {y_unit}")
    return Unexplained(
        axes,
        term.variable,
        period,
        rms,
        shows,
        where,
        summary,
        curve,
        labels,
        left,
        probability,
        alternatives,
        source,
    )


def _moved(moves: str) -> str:
    """What a term displaces."""
    return _MOVED.get(moves, f"the {moves} axis")


def acts_on(axis: str, moves: str, variable: str) -> str:
    """What a term acts on, and on what it depends; arguments as of :class:`FurtherCurve`."""
    of = VARIABLES[variable]
    if axis == moves:
        return f"acts on the {axis} axis and depends on {of.its}"
    on = f"depends on the {axis} axis' {of.words}" if axis else "follows the campaign's clock"
    return f"acts on {_moved(moves)} and {on}"


def _acts(term: CurveTerm) -> str:
    return acts_on(term.axis, term.moves, term.variable)


def bridged(term: CurveTerm, values: np.ndarray, reached: np.ndarray) -> np.ndarray:
    """Values of a curve at all knots. Those of a free one that no test reaches mean nothing: it is straight from one
    place that a test reaches to the next.

    Args:
        term: Whose curve it is.
        values: At its knots, (k,).
        reached: At which knots the data say something, (k,) bool.
    """
    if term.shape != "free":
        return values
    return np.interp(term.knots, term.knots[reached], values[reached], period=term.period)


def shape_in_words(term: CurveTerm, knots: np.ndarray, factor: float, x_unit: str, unit: str) -> str:
    """A sentence about a curve that is simple enough for one.

    Args:
        term: With its coefficients.
        knots: Its knots in the units that users read.
        factor: From m or rad to ``unit``.
        x_unit: Of the knots.
        unit: Of the curve.
    """
    if VARIABLES[term.variable].is_counted:  # knots that are no neighbours have no steps or bends between them
        return ""
    curve = term.coefficients * term.unit * factor
    step, closed = knots[1] - knots[0], term.period is not None

    def at(place: float) -> str:
        if x_unit == LOG_SECONDS:
            return f"{10.0 ** (knots[0] + place * step):.3g} s"
        return f"{knots[0] + place * step:.4g}{'' if x_unit == '°' else ' '}{x_unit}"

    if term.shape == "waves" and 0 < len(found := orders(curve)) <= _MOST_TOLD:
        waves = "1 wave" if found == [1] else f"{' and '.join(map(str, found))} waves"
        return f" The curve has {waves} per {'turn' if is_rotary(term.axis) else 'period'}."
    if term.shape == "steps" and 0 < len(jumps := changes(curve, closed)) <= _MOST_TOLD:
        told = " and ".join(f"{size:+.2g}{'' if unit == '°' else ' '}{unit} at {at(place)}" for place, size in jumps)
        return f" The curve is flat but for {'a step' if len(jumps) == 1 else 'steps'} of {told}."
    if term.shape == "bends" and not closed and len(found := bends(curve)) <= _MOST_TOLD:
        told = f", with {'a bend' if len(found) == 1 else 'bends'} at {' and '.join(map(at, found))}" if found else ""
        return f" The curve is straight{told}."
    return ""


def _stem(axes: tuple[str, ...]) -> str:
    return f"unexplained_{'_'.join(axes)}"


def _seen(term: CurveTerm, hidden: float) -> tuple[np.ndarray, np.ndarray]:
    """The curve (k,) and its standard deviation without the shapes that set-up errors could take up as well (its
    level, above all): those with more than ``hidden`` times the usual variance.
    """
    information, modes = np.linalg.eigh(term.precision)
    variance, modes = 1.0 / information[::-1], modes[:, ::-1]
    along = modes.T @ term.coefficients
    kept = (variance < hidden * np.median(variance)) | (np.abs(along) > 3.0 * np.sqrt(np.abs(variance)))
    return modes[:, kept] @ along[kept], np.sqrt(np.clip((modes[:, kept] ** 2) @ variance[kept], 0.0, None))


def _worst_time(problem: Problem, fit: Fit, k: int, part: np.ndarray) -> np.ndarray:
    s = problem.samples[k]
    return s.centre[[int(np.argmax(np.abs(part - part.mean())))]] - problem.shift(k, fit.nuisance)


def _file_units(term: CurveTerm, fit: Fit, harmonic: float) -> tuple[np.ndarray, str, str, float | None]:
    """Knots in the units that users read, what they are, their unit, and the period in it: that of the harmonic with
    more than the share ``harmonic`` of the curve's power, where there is one.
    """
    variable = VARIABLES[term.variable]
    scale, unit = variable.shown_of(term.axis)
    name = f"{term.axis} axis: {variable.words}" if term.axis else "campaign clock"
    if term.moves == RADIAL:
        name = f"ball's angle about the {term.axis} axis"
    period = None if term.period is None else term.period * scale
    if period and term.variable in ("position", "direction"):
        power = np.abs(np.fft.rfft(term.coefficients)[1 : len(term.knots) // 3]) ** 2
        if len(power) and power.max() > harmonic * power.sum():
            period /= int(np.argmax(power)) + 1
    return term.knots * scale, name, unit, period


#: How far it goes on, in lengths of that end, and the least length of such an end, of the whole curve (assumed).
_FAR, _LONG_END = 10.0, 0.2

_TEMPLATE = '''"""{summary}

Written by mjsim from the measurement: an empirical curve, not an explanation. Replace the curve
by the physics that you suspect, rename the effect, and try it with `mjsim add CAMPAIGN {file_name}`.
"""

import numpy as np

import mjsim
{imports}
{columns}
#: {variable} at which the curve is given, {unit}
KNOTS = np.array([{knots}])
#: what is added to {target} there, {size}
VALUES = np.array([{values}])


@mjsim.register
class {class_name}(mjsim.Effect):
    kind = "{kind}"
    subjects = ("{subject}",)
    title = "{title}"
    parameters = (mjsim.Parameter("gain", "factor on the curve", -10.0, 10.0, neutral=0.0, scale=1.0),)
    definition = "{target} + gain · curve({variable})"
    source = "empirical, from this campaign"
    signature = "{signature}"

    def position_error(self, motion):
        {before}x = {argument}
        size = self.values["gain"] * {sign}np.interp(x, KNOTS, VALUES{period})
        out = np.zeros_like(motion.position)
        {act}
        return out
'''

_ON_AXIS = "out[:, MOVED] = size"
#: The work moves one way in the table's frame: seen from the machine, the spindle moves the other way.
_ON_TABLE = """moved = work_to_machine(CHAIN, motion.position, {direction})
        out[:, CHAIN.linear_columns] = -size[:, None] * moved"""
#: Where the ball stands about the axis, and which way is outwards.
_ALONG_RADIUS = """angle, outwards = radius_of(CHAIN.axis("{axis}"), motion.ball)
        """
#: The same where centrelines do not pass through the origin: the place of a point less that of the origin.
_ON_PLACED_TABLE = """origin = work_to_machine(CHAIN, motion.position, np.zeros(3))
        moved = work_to_machine(CHAIN, motion.position, {direction}) - origin
        out[:, CHAIN.linear_columns] = -size[:, None] * moved"""


def _chain_text(chain: Chain) -> str:
    """Python text that makes a chain."""
    more = f", {chain.placements!r}, {chain.tool_length!r}" if chain.placements else ""
    return f"chain_of({chain.configuration!r}{more})"


def effect_source(chain: Chain, term: CurveTerm, values: np.ndarray, summary: str, file_name: str) -> str:
    """Python text of an effect that adds an empirical curve.

    Args:
        chain: axes of the machine.
        term: on what it depends and what it moves.
        values: at the term's knots, (n,) m or rad.
        summary: first sentence of the file.
        file_name: for its own doc string.
    """
    knots, values = _continued(term, values)
    # a machine may have several unknown causes, each with a kind of its own
    moved = f"moves_{term.moves}" if term.moves != term.axis else ""
    kind = "_".join(filter(None, ("unexplained", term.variable, term.axis, moved))).replace(" ", "_").lower()
    variable = VARIABLES[term.variable]
    target, before, argument, direction = f"the {term.moves} axis", "", variable.argument, "DIRECTION"
    columns = imports = ""
    act = _ON_AXIS
    if term.axis:
        columns = f"AXIS = {chain.index(term.axis)}  # column of the {term.axis} axis in {', '.join(chain.letters)}\n"
    if term.moves == RADIAL:
        target, before = "the work on the table, along the ball's radius", _ALONG_RADIUS.format(axis=term.axis)
        argument, direction = f"{argument} + angle", "outwards"
    elif term.moves in TABLE:
        target = f"the work on the table, along {term.moves[-1]}"
        columns += f"DIRECTION = np.array({np.eye(3)[TABLE.index(term.moves)].tolist()})  # in the work frame"
    else:
        columns += f"MOVED = {chain.index(term.moves)}  # column of the {term.moves} axis"
    if term.moves in (RADIAL, *TABLE):
        columns = f"CHAIN = {_chain_text(chain)}\n{columns}"
        act = (_ON_PLACED_TABLE if chain.placements else _ON_TABLE).format(direction=direction)
        imports = (
            f"from mjsim.machine.chain import {'Placement, ' if chain.placements else ''}chain_of\n"
            "from mjsim.machine.kinematics import work_to_machine\n"
            f"{'from mjsim.machine.axis import radius_of' if term.moves == RADIAL else ''}\n"
        )
    return _TEMPLATE.format(
        summary=summary,
        file_name=file_name,
        imports=imports,
        columns=columns.rstrip(),
        before=before,
        variable=term.variable.replace("_", " ") + (f" of {term.axis}" if term.axis else ""),
        unit=variable.unit_of(term.axis),
        target=target,
        size="rad" if is_rotary(term.moves) else "m",
        knots=_numbers(knots),
        values=_numbers(values),
        class_name="".join(w.capitalize() for w in kind.split("_")),
        kind=kind,
        subject=term.axis or term.moves,
        title=f"Unexplained error of {target}",
        signature=summary.replace('"', "'"),
        argument=argument,
        sign="np.sign(motion.velocity[:, AXIS]) * " if term.signed else "",
        period=f", period={term.period:.12g}" if term.period else "",
        act=act,
    )


def _continued(term: CurveTerm, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knots and values of a curve that goes on beyond what was measured where its end is straight for long enough. It
    stays at its last value elsewhere.
    """
    knots, last = term.knots, len(term.knots) - 1
    if isinstance(term.columns, StrokeColumns):
        return term.columns.clock.ravel(), np.repeat(values, 2)
    if term.shape != "bends" or term.period is not None or not VARIABLES[term.variable].goes_on:
        return knots, values
    places, least = bends(term.coefficients), _LONG_END * last
    first, final = min(places, default=last), max(places, default=0)
    to_first, from_final = slice(int(first), None, -1), slice(int(np.ceil(final)), None)
    before = _beyond(knots[to_first], values[to_first]) if first >= least else ([], [])
    after = _beyond(knots[from_final], values[from_final]) if last - final >= least else ([], [])
    return np.concatenate([before[0], knots, after[0]]), np.concatenate([before[1], values, after[1]])


def _beyond(knots: np.ndarray, values: np.ndarray) -> tuple[list[float], list[float]]:
    """A knot far beyond the last of a straight end, and the value there."""
    far = knots[-1] + _FAR * (knots[-1] - knots[0])
    return [far], [np.polyval(np.polyfit(knots, values, 1), far)]


def _numbers(x: np.ndarray) -> str:
    lines = [", ".join(f"{v:.6g}" for v in x[i : i + 8]) for i in range(0, len(x), 8)]
    return "\n    " + ",\n    ".join(lines) + ",\n"
