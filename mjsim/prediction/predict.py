"""``predict``: the contour error of a program on a diagnosed machine, with what the diagnosis left uncertain.

The drives are simulated axis by axis; cutting forces are not part of it. The tip's deviation is linear in small errors,
so its uncertainty follows from draws of the diagnosis' normal distribution.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit

from mjsim.commands.saved import SavedDiagnosis
from mjsim.errors import InputError
from mjsim.inference.calibration import calibrated_effects
from mjsim.inference.data_sheet import data_sheet
from mjsim.inference.posterior import Posterior
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import Chain
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import AxisPlant
from mjsim.prediction.causes import Contour, Influence, Parts, across, contour, labels
from mjsim.prediction.result import FAILS, PASSES, UNKNOWN, Block, Cut, Prediction, judged
from mjsim.prediction.tip import Run
from mjsim.simulation.drive import STEP
from mjsim.simulation.stability import check_stable
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, UM

# -- how fast a control runs a program ---------------------------------------------------------------------------------

#: Acceleration of a linear and of a rotary axis, m/s² and rad/s² (assumed: an ordinary machine of this size).
LINEAR, ROTARY = 2.0, 20.0
#: Block time between looks ahead, s.
_LOOK = 2e-3


#: Followed so closely, the axes are taken to be in position at an exact stop, m and rad (Sinumerik's MD36010
#: STOP_LIMIT_FINE: 0.01 mm, 0.01°).
_IN_POSITION, _IN_POSITION_ROTARY = 10e-6, 0.01 * DEG


def rest_at_stops(axes: dict[str, AxisPlant], chain: Chain) -> float:
    """How long the set-points rest at an exact stop until all axes are in position, s.

    While an axis brakes with the acceleration a, it lags by a/K² behind at the stop, K being its position gain; from
    there the lag falls as exp(-K t).

    Args:
        axes: Drives by letter.
        chain: The machine's axes.
    """
    rests = [0.0]
    for axis in chain.axes:
        drive = axes[axis.letter]
        gain, most = drive.position_gain, ROTARY if axis.rotary else LINEAR
        lag = (1.0 - min(drive.feedforward, 1.0)) * most / gain**2
        window = _IN_POSITION_ROTARY if axis.rotary else _IN_POSITION
        rests.append(float(np.log(max(lag / window, 1.0))) / gain)
    return max(rests)


def paced(motion: Commanded, step: float, rest: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Set-points of a program on the control's clock.

    The program is run at its own feed where every axis' acceleration allows it, and more slowly elsewhere; it begins
    and ends at rest, and rests at its exact stops.

    Args:
        motion: The program.
        step: Between set-points, s.
        rest: At each exact stop, s.

    Returns:
        Time (n,) s, and block time (n,) s at these instants, as :meth:`Commanded.at` takes it.
    """
    stops = [] if motion.stops is None else motion.knots[1:][motion.stops]
    ends = np.unique(np.concatenate([[0.0], stops, [motion.duration]]))
    ends = ends[np.concatenate([[True], np.diff(ends) > 1e-12])]
    pieces = [np.linspace(a, b, max(8, int(np.ceil((b - a) / _LOOK))) + 1)[:-1] for a, b in pairwise(ends)]
    still = np.concatenate([[0], np.cumsum([len(p) for p in pieces])])
    u = np.concatenate([*pieces, [motion.duration]])
    q, du = motion.at(u), np.diff(u)
    most = np.array([ROTARY if a.rotary else LINEAR for a in motion.chain.axes])
    rate = np.diff(q, axis=0) / du[:, None] / most  # share of the acceleration limit per unit of du/dt
    bend = np.zeros(len(u))
    bend[2:-2] = np.abs(rate[3:] - rate[:-3]).max(axis=1) / du[1:-2]  # a corner between two looks belongs to both
    for k in (-1, 0, 1):  # what bends at a stop does so at rest
        bend[np.clip(still + k, 0, len(u) - 1)] = 0.0
    v2 = np.minimum(1.0, 0.5 / np.maximum(bend, 1e-12))
    v2[still] = 0.0
    _passes(v2, np.maximum(np.abs(rate).max(axis=1), 1e-12), du)
    v = np.sqrt(v2)
    seconds = np.concatenate([[0.0], np.cumsum(2.0 * du / np.maximum(v[1:] + v[:-1], 1e-6))])
    if rest > 0.0 and len(still) > 2:
        inner = still[1:-1]
        seconds = seconds + rest * np.searchsorted(inner, np.arange(len(u)), side="left")
        u, v = np.insert(u, inner + 1, u[inner]), np.insert(v, inner + 1, 0.0)
        seconds = np.insert(seconds, inner + 1, seconds[inner] + rest)
    time = np.arange(int(np.ceil(seconds[-1] / step)) + 1) * step
    return time, _at(time, seconds, u, v)


def _at(time: np.ndarray, seconds: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Block time at ``time``: constant acceleration of the block time between two looks."""
    k = np.clip(np.searchsorted(seconds, time, side="right") - 1, 0, len(u) - 2)
    t = np.clip(time - seconds[k], 0.0, seconds[k + 1] - seconds[k])
    whole = np.maximum(seconds[k + 1] - seconds[k], 1e-12)
    return np.minimum(u[k] + v[k] * t + 0.5 * (v[k + 1] - v[k]) / whole * t * t, u[-1])


@njit(cache=True, nogil=True)
def _passes(v2, rate, du):
    """Limit the squares of the pace ``v2`` so that no step asks for more than half the acceleration along the path."""
    for i in range(1, len(v2)):
        v2[i] = min(v2[i], v2[i - 1] + du[i - 1] / rate[i - 1])
    for i in range(len(v2) - 2, -1, -1):
        v2[i] = min(v2[i], v2[i + 1] + du[i] / rate[i])


#: Even instants that are kept, and draws of the uncertainty.
KEPT, DRAWS = 3000, 400
#: Longest program, s.
LONGEST = 3600.0
#: Clock of a machine that is warm, s after its start.
WARM = 20_000.0
_SEED = 20131


def prior(machine: Machine) -> Posterior:
    """What is uncertain about a machine that was not measured: its tolerance and its data sheet."""
    expected = [c for c in calibrated_effects(machine) if machine.effect(c.key) is None or c.free.effect.values]
    deviation = np.concatenate([*(c.deviation for c in expected), np.ones(len(data_sheet(machine.chain)))])
    return Posterior(tuple(c.free for c in expected), np.diag(deviation**2))


@one_blas_thread
def predict(
    motion: Commanded,
    machine: Machine,
    name: str = "program",
    saved: SavedDiagnosis | None = None,
    tolerance: float | None = None,
    tool: float = 0.0,
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0),
    lines: np.ndarray | None = None,
    clock: float = WARM,
) -> Prediction:
    """The error of the tool's tip on the workpiece when a program runs on a machine.

    Args:
        motion: The program: of an NC file (:func:`mjsim.nc.read.read_nc`), or a built-in part.
        machine: Where it runs, unless ``saved`` has it.
        name: Of the program.
        saved: Diagnosis of the machine: its fitted model, and what that leaves uncertain.
        tolerance: Allowed deviation normal to the path, m.
        tool: Tool's length less that of the spindle ball's holder, m.
        zero: Zero point of the part, where it is probed, in the work frame, m.
        lines: (blocks + 1,) lines of an NC file.
        clock: Start on the campaign clock, s.

    Raises:
        InputError: the program is too long or does not fit the machine, or the machine turns the tool by a head.
        SimulationError: a drive is unstable.
    """
    machine = machine if saved is None else saved.machine
    _check(motion, machine)
    posterior = prior(machine) if saved is None else saved.posterior
    built = build(machine)
    time, block_time = paced(motion, STEP, rest_at_stops(built.axes, machine.chain))
    commands = motion.at(block_time)
    block = np.clip(np.searchsorted(motion.knots, block_time, side="right") - 1, 0, len(motion.seconds) - 1)
    path_of, group = _numbers(motion, lines)
    kept = _kept(block, path_of, group)
    commands[:, 2] += tool
    run = Run(machine.chain, time, commands, kept, tool, np.asarray(zero, float), clock)
    influence = Influence(run, machine)
    check_stable(influence.plant)
    found = contour(run.whole_path, influence.path + influence.deviation, kept, _spans(path_of[block])[kept])
    index = block[kept]
    columns = influence.columns(posterior)
    draws = _draws(found, columns, posterior)
    numbers = np.arange(1, len(motion.seconds) + 1) if lines is None else lines[1:]
    worst = int(np.argmax(found.size))
    parts = Parts.of(influence, found)
    stated = bool(machine.tolerance)
    blocks = _blocks(found, draws, parts, group[index], numbers[index], tolerance, stated)
    largest = _largest(found, draws, slice(None))
    cuts = _cuts(found, draws, path_of, index, numbers, tolerance, stated)
    uncertain = _uncertain(found, columns, posterior, labels(posterior, machine), worst)
    if saved is not None:
        basis = "the diagnosis"
    elif machine.tolerance:
        basis = "the tolerance in the machine file, without a diagnosis"
    else:
        basis = "the data sheet alone, without a diagnosis"
    places = {f"axis_location.{e.name}" for e in machine.chain.location_errors if not e.rotation}
    verdict, reason = _verdict(largest, tolerance, stated, uncertain, places)
    return Prediction(
        name,
        machine,
        influence.path,
        found.normal,
        found.along,
        blocks,
        parts.causes(worst),
        parts.by_axis(worst),
        largest,
        tolerance,
        verdict,
        reason,
        uncertain,
        basis,
        float(time[-1]),
        time[kept],
        cuts,
        path_of[index],
    )


def _check(motion: Commanded, machine: Machine) -> None:
    if motion.chain != machine.chain:
        raise InputError(
            f"the program is for a machine with the configuration {motion.chain.configuration!r}; allowed: "
            f"{machine.chain.configuration!r}"
        )
    if machine.chain.swivelling or machine.chain.carried or not machine.chain.spatial:
        raise InputError(
            f"configuration {machine.configuration!r}: a prediction needs a tool that does not turn, and linear "
            f"axes that stand on no rotary one; allowed: rotary axes that carry the workpiece"
        )
    if not motion.paths:
        raise InputError("the program has no feed block; allowed: programs that cut")
    if motion.duration > LONGEST:
        raise InputError(f"the program lasts {motion.duration:.0f} s; allowed: up to {LONGEST:.0f} s")


def _numbers(motion: Commanded, lines: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The cutting path of every block, -1 for none, and the block of the program that it belongs to: chords of one arc
    are one block.
    """
    path_of = np.full(len(motion.seconds), -1)
    for k, (first, last) in enumerate(motion.paths):
        path_of[first : last + 1] = k
    if lines is None:
        return path_of, np.arange(len(path_of))
    new = (np.diff(lines[1:]) != 0) | (np.diff(path_of) != 0)
    return path_of, np.concatenate([[0], np.cumsum(new)])


def _kept(block: np.ndarray, path_of: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Instants that are looked at: even ones, and one of each cutting block that has none of these."""
    every = max(1, -(-len(block) // KEPT))
    even = np.arange(0, len(block), every)
    even = even[path_of[block[even]] >= 0]
    first = np.flatnonzero(np.diff(group[block], prepend=-1))
    last = np.append(first[1:], len(block)) - 1
    middle = (first + last) // 2
    missing = ~np.isin(group[block[middle]], group[block[even]]) & (path_of[block[middle]] >= 0)
    return np.union1d(even, middle[missing])


def _spans(path: np.ndarray) -> np.ndarray:
    """First and last instant of the cutting path of each instant, (n, 2)."""
    first = np.flatnonzero(np.diff(path, prepend=-2))
    last = np.append(first[1:], len(path)) - 1
    return np.repeat(np.column_stack([first, last]), last - first + 1, axis=0)


def _draws(found: Contour, columns: np.ndarray, posterior: Posterior) -> np.ndarray:
    """Normal deviation of machines as the data allow them, (n, DRAWS) m."""
    values, vectors = np.linalg.eigh(posterior.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    z = root @ np.random.default_rng(_SEED).standard_normal((len(values), DRAWS))
    change = across(found, columns)
    out = np.empty((len(columns), DRAWS))
    for part in np.array_split(np.arange(len(columns)), max(1, len(columns) // 1000)):
        moved = change[part].reshape(-1, columns.shape[2]) @ z
        moved = moved.reshape(len(part), 3, DRAWS) + found.normal[part][:, :, None]
        out[part] = np.sqrt(np.einsum("nid,nid->nd", moved, moved))
    return out


def _blocks(
    found: Contour,
    draws: np.ndarray,
    parts: Parts,
    group: np.ndarray,
    numbers: np.ndarray,
    tolerance: float | None,
    stated: bool,
) -> tuple[Block, ...]:
    """Every cutting block with its interval; ``group`` and ``numbers`` (n,) are block and line of an instant."""
    first = np.flatnonzero(np.diff(group, prepend=-1))
    ends = [*first[1:], len(group)]
    size, out = found.size, []
    most = np.maximum.reduceat(draws, first, axis=0)
    low, high = np.percentile(most, (2.5, 97.5), axis=1)
    for k, (a, b) in enumerate(zip(first, ends, strict=True)):
        at = a + int(np.argmax(size[a:b]))
        cause, share = parts.main(int(at))
        ends_of = float(low[k]), float(high[k])
        verdict = "" if tolerance is None else judged(*ends_of, tolerance, stated)
        out.append(Block(int(numbers[a]), float(size[at]), *ends_of, float(found.along[at]), cause, share, verdict))
    return tuple(out)


def _largest(found: Contour, draws: np.ndarray, part: slice | np.ndarray) -> tuple[float, float, float]:
    """Largest deviation of some instants, with its interval, m."""
    low, high = np.percentile(draws[part].max(axis=0), (2.5, 97.5))
    return float(found.size[part].max()), float(low), float(high)


def _cuts(
    found: Contour,
    draws: np.ndarray,
    path_of: np.ndarray,
    index: np.ndarray,
    numbers: np.ndarray,
    tolerance: float | None,
    stated: bool,
) -> tuple[Cut, ...]:
    """Every cutting path with its verdict; ``index`` (n,) is the block of an instant."""
    out = []
    for k in np.unique(path_of[index]):
        largest = _largest(found, draws, path_of[index] == k)
        verdict = "" if tolerance is None else judged(*largest[1:], tolerance, stated)
        own = numbers[path_of == k]
        out.append(Cut(int(own[0]), int(own[-1]), largest, verdict))
    return tuple(out)


def _uncertain(
    found: Contour, columns: np.ndarray, posterior: Posterior, names: list[str], worst: int
) -> tuple[tuple[str, float], ...]:
    """Effects that make most of the variance of the deviation where it is largest."""
    size = found.size[worst]
    direction = found.normal[worst] / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    g = direction @ across(found, columns)[worst]
    shares: dict[str, float] = {}
    parts = g * (posterior.covariance @ g)
    total = float(parts.sum()) or 1.0
    for name, part in zip(names, parts, strict=True):
        shares[name] = shares.get(name, 0.0) + float(part) / total
    ranked = sorted(shares.items(), key=lambda item: -abs(item[1]))
    return tuple((k, s) for k, s in ranked[:3] if abs(s) > 0.05)


def _verdict(
    largest: tuple[float, float, float],
    tolerance: float | None,
    stated: bool,
    uncertain: tuple[tuple[str, float], ...],
    places: set[str],
) -> tuple[str, str]:
    """Verdict and reason; ``places`` are the keys of the places of the rotary axes."""
    if tolerance is None:
        return "", ""
    value, low, high = (x / UM for x in largest)
    allowed = tolerance / UM
    found = judged(low, high, allowed, stated)
    if found == FAILS:
        return FAILS, f"the largest deviation is at least {low:.2f} µm; allowed are {allowed:g} µm"
    if found == PASSES:
        return PASSES, f"the largest deviation is at most {high:.2f} µm; allowed are {allowed:g} µm"
    if high <= allowed:
        return UNKNOWN, (
            f"the model says at most {high:.2f} µm, but the machine file states no tolerance for the errors that the "
            f"tests did not show; state one (mjsim new writes the table) and diagnose again"
        )
    name = uncertain[0][0] if uncertain else ""
    advice = f"; {name} makes most of the uncertainty" if name else ""
    if name in places:
        advice += "; tests with the spindle turned by 180° for half of a set-up (spindle_deg) show it best"
    elif name and not name.startswith("data sheet"):
        advice += f"; mjsim plan CAMPAIGN --between {name} nothing proposes the test that shows it"
    return UNKNOWN, f"the largest deviation is {value:.2f} µm, between {low:.2f} and {high:.2f} µm{advice}"
