"""``predict``: the contour error of a program on a diagnosed machine, with what the diagnosis left uncertain.

The drives are simulated axis by axis; cutting forces are not part of it. The tip's deviation is linear in small errors,
so its uncertainty follows from draws of the diagnosis' normal distribution.
"""

from __future__ import annotations

import numpy as np

from mjsim.errors import InputError
from mjsim.estimation.calibration import calibrated_effects
from mjsim.estimation.data_sheet import data_sheet
from mjsim.estimation.posterior import Posterior
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.model import Machine
from mjsim.prediction.causes import Parts, across
from mjsim.prediction.contour import Contour, contour
from mjsim.prediction.influence import Influence, labels
from mjsim.prediction.pace import paced
from mjsim.prediction.result import FAILS, PASSES, UNKNOWN, Block, Prediction, judged
from mjsim.prediction.tip import Run
from mjsim.simulation.drive import STEP
from mjsim.simulation.stability import check_stable
from mjsim.threads import one_blas_thread
from mjsim.units import UM
from mjsim.workflow.saved import SavedDiagnosis

#: Instants that are kept, and draws of the uncertainty.
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
    time, block_time = paced(motion, STEP)
    commands = motion.at(block_time)
    commands[:, 2] += tool
    every = max(1, -(-len(time) // KEPT))
    run = Run(machine.chain, time, commands, every, tool, np.asarray(zero, float), clock)
    influence = Influence(run, machine)
    check_stable(influence.plant)
    found = contour(influence.path, influence.path + influence.deviation)
    index = np.clip(np.searchsorted(motion.knots, block_time[::every], side="right") - 1, 0, len(motion.seconds) - 1)
    columns = influence.columns(posterior)
    draws = _draws(found, columns, posterior)
    worst = int(np.argmax(found.size))
    parts = Parts.of(influence, found)
    stated = bool(machine.tolerance)
    blocks, largest = _blocks(found, draws, parts, index, lines, tolerance, stated)
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
    if motion.duration > LONGEST:
        raise InputError(f"the program lasts {motion.duration:.0f} s; allowed: up to {LONGEST:.0f} s")


def _draws(found: Contour, columns: np.ndarray, posterior: Posterior) -> np.ndarray:
    """Normal deviation of machines as the data allow them, (n, DRAWS) m."""
    values, vectors = np.linalg.eigh(posterior.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    z = np.random.default_rng(_SEED).standard_normal((len(values), DRAWS))
    moved = across(found, columns).reshape(-1, columns.shape[2]) @ (root @ z)
    moved = moved.reshape(len(columns), 3, DRAWS) + found.normal[:, :, None]
    return np.sqrt(np.einsum("nid,nid->nd", moved, moved))


def _blocks(
    found: Contour,
    draws: np.ndarray,
    parts: Parts,
    index: np.ndarray,
    lines: np.ndarray | None,
    tolerance: float | None,
    stated: bool,
) -> tuple[tuple[Block, ...], tuple[float, float, float]]:
    """Every block that has an instant, and the largest deviation of all with its interval."""
    first = np.flatnonzero(np.diff(index, prepend=-1))
    ends = [*first[1:], len(index)]
    size, out = found.size, []
    most = np.maximum.reduceat(draws, first, axis=0)
    low, high = np.percentile(most, (2.5, 97.5), axis=1)
    for k, (a, b) in enumerate(zip(first, ends, strict=True)):
        at = a + int(np.argmax(size[a:b]))
        line = int(lines[index[a] + 1]) if lines is not None else int(index[a]) + 1
        cause, share = parts.main(int(at))
        ends_of = float(low[k]), float(high[k])
        verdict = "" if tolerance is None else judged(*ends_of, tolerance, stated)
        out.append(Block(line, float(size[at]), *ends_of, float(found.along[at]), cause, share, verdict))
    whole = np.percentile(draws.max(axis=0), (2.5, 97.5))
    return tuple(out), (float(size.max()), float(whole[0]), float(whole[1]))


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
