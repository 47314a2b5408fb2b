"""The error of the tool over the volume of a machine: what its errors of position add up to, place by place.

The machine stands still at each place. Its play is centred, as where nobody knows the last direction. The workpiece is
aligned with the linear axes and its zero point is probed where all axes are at 0, as any part is set up: what the
machine errs there is no error of the part. At small angles the tool's error at a point is e + ω × r: the shift e of the
tip, and the turn ω of the tool against the workpiece, follow from the errors of the tip and of two points beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.diagnose import diagnose
from mjsim.commands.saved import keep, read_saved
from mjsim.compensation.arithmetic import Arithmetic, corrected
from mjsim.compensation.compensate import compensate
from mjsim.compensation.tables import Corrections, ranges_of
from mjsim.errors import InputError
from mjsim.inference.posterior import Posterior
from mjsim.machine.chain import COORDINATES, Chain
from mjsim.machine.effect import Effect
from mjsim.machine.kinematics import bar_vector, machine_to_work, spindle_ball
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.prediction.predict import WARM, prior
from mjsim.prediction.tip import on_real_table
from mjsim.progress import Progress, silent
from mjsim.simulation.transmission import transmit
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, MM, UM

#: Distance of places where none is given, m, and most places of a grid.
STEP = 0.025
MOST = 1_000_000
#: Distance of the points beside the tip, m; step of derivatives by fitted numbers, typical sizes.
_BESIDE, _NUDGE = 0.1, 0.05
#: Expanded uncertainty: so many standard deviations.
COVERAGE = 2.0
_URAD = 1e-6


@dataclass(frozen=True)
class Grid:
    """Places of the tool.

    Attributes:
        chain: Axes of the machine.
        ends: Places along X, Y and Z, rising, m.
        rotary: Positions of the rotary axes, rad, by letter; 0 where none is given.
        tool: Length of the tool less that of the spindle ball's holder, m.
    """

    chain: Chain
    ends: tuple[np.ndarray, ...]
    rotary: Mapping[str, float]
    tool: float = 0.0

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of places along each linear axis."""
        return tuple(len(x) for x in self.ends)

    @property
    def points(self) -> np.ndarray:
        """Positions of the axes, (n, axes) m and rad; the first linear axis varies fastest, as in VTK."""
        mesh = np.meshgrid(*reversed(self.ends), indexing="ij")
        q = np.zeros((mesh[0].size, self.chain.count))
        for i, x in enumerate(reversed(mesh)):
            q[:, i] = x.ravel()
        for letter, angle in self.rotary.items():
            q[:, self.chain.index(letter)] = angle
        return q


def grid_of(
    chain: Chain,
    ranges: Mapping[str, tuple[float, float]],
    step: float,
    rotary: Mapping[str, float] | None = None,
    tool: float = 0.0,
) -> Grid:
    """A grid with even spacing.

    Args:
        chain: Axes of the machine.
        ranges: Lowest and highest position of every linear axis, m.
        step: About how far places are apart, m; both ends are places.
        rotary: As in :class:`Grid`.
        tool: As in :class:`Grid`.

    Raises:
        InputError: The machine has no X, Y and Z, a range is empty, or the grid is too fine.
    """
    if not chain.spatial:
        raise InputError(
            f"configuration {chain.configuration!r} has no volume; allowed: machines with three linear axes"
        )
    ends, count = [], 1
    for letter in chain.linear:
        low, high = ranges[letter]
        if not low < high:
            raise InputError(f"range of {letter}: {low / MM:g} to {high / MM:g} mm; allowed: the lower end first")
        n = max(2, round((high - low) / step) + 1)
        ends.append(np.linspace(low, high, n))
        count *= n
    if count > MOST:
        raise InputError(f"step {step / MM:g} mm: the grid has {count} places; allowed: up to {MOST}")
    return Grid(chain, tuple(ends), dict(rotary or {}), tool)


@dataclass(frozen=True)
class VolumetricError:
    """The error of the tool at every place of a grid.

    Attributes:
        grid: The places.
        shift: Of the tip against where it should be on the workpiece, in the work frame, (n, 3) m.
        turn: Of the tool against the workpiece, about X, Y and Z of the work frame, (n, 3) rad.
        uncertainty: Expanded uncertainty of the shift (k = 2), (n, 3) m; ``None`` where nothing says how well the
            machine is known.
        corrected_shift: The shift with the corrections in the control, (n, 3) m; ``None`` without corrections.
        corrected_turn: The turn likewise.
    """

    grid: Grid
    shift: np.ndarray
    turn: np.ndarray
    uncertainty: np.ndarray | None = None
    corrected_shift: np.ndarray | None = None
    corrected_turn: np.ndarray | None = None

    def columns(self) -> dict[str, np.ndarray]:
        """Everything by name, (n,) each, with units: positions of the axes, then errors."""
        chain, q = self.grid.chain, self.grid.points
        out = {f"{a.letter}_{'deg' if a.rotary else 'mm'}": q[:, i] / (DEG if a.rotary else MM)
               for i, a in enumerate(chain.axes)}  # fmt: skip
        for name, values, unit, scale in self._vectors():
            out |= {f"{name}_{c.lower()}_{unit}": values[:, i] / scale for i, c in enumerate(COORDINATES)}
        return out

    def csv_text(self) -> str:
        """A row for each place; :meth:`columns` are the columns."""
        columns = self.columns()
        rows = np.column_stack(list(columns.values())) + 0.0
        return "".join(",".join(row) + "\n" for row in [list(columns), *([f"{x:.6g}" for x in row] for row in rows)])

    def vtk_text(self, name: str) -> str:
        """A legacy VTK file (VTK File Formats, "Simple Legacy Formats"), which ParaView, pyvista and meshio read.

        A rectilinear grid in mm with vectors in µm and µrad. These lines are all that the format asks for; a library
        for it brings VTK itself.

        Args:
            name: Of the machine, for the title.
        """
        grid = self.grid
        title = " ".join(f"{name}: error of the tool; mm, um, urad".split())
        out = ["# vtk DataFile Version 3.0", title.encode("ascii", "replace").decode()[:255], "ASCII"]
        out += ["DATASET RECTILINEAR_GRID", "DIMENSIONS " + " ".join(map(str, grid.shape))]
        for letter, places in zip(COORDINATES, grid.ends, strict=True):
            out += [f"{letter}_COORDINATES {len(places)} double", " ".join(f"{x / MM:.9g}" for x in places)]
        out.append(f"POINT_DATA {len(self.shift)}")
        for field, values, unit, scale in self._vectors():
            out.append(f"VECTORS {field}_{unit} double")
            out += [" ".join(f"{v:.6g}" for v in row) for row in values / scale + 0.0]
        return "\n".join([*out, ""])

    def _vectors(self) -> list[tuple[str, np.ndarray, str, float]]:
        """Name, values (n, 3), unit, and that in SI, of everything that is known."""
        every = (
            ("error", self.shift, "um", UM),
            ("turn", self.turn, "urad", _URAD),
            ("U95_error", self.uncertainty, "um", UM),
            ("corrected_error", self.corrected_shift, "um", UM),
            ("corrected_turn", self.corrected_turn, "urad", _URAD),
        )
        return [(name, values, unit, scale) for name, values, unit, scale in every if values is not None]

    def sizes(self) -> tuple[float, float]:
        """RMS over the volume and largest length of the shift, m."""
        return _sizes(self.shift)

    @property
    def largest_uncertainty(self) -> float:
        """Largest expanded uncertainty of a component of the shift, m; 0 where none is known."""
        return 0.0 if self.uncertainty is None else float(self.uncertainty.max())

    def corrected_sizes(self) -> tuple[float, float] | None:
        """The same with the corrections; ``None`` without."""
        return None if self.corrected_shift is None else _sizes(self.corrected_shift)


def _sizes(shift: np.ndarray) -> tuple[float, float]:
    length = np.linalg.norm(shift, axis=1)
    return float(np.sqrt(np.mean(length**2))), float(length.max())


def volumetric_error(
    machine: Machine,
    grid: Grid,
    posterior: Posterior | None = None,
    corrections: Corrections | None = None,
    how: Arithmetic | None = None,
) -> VolumetricError:
    """The error of the tool over the volume.

    Args:
        machine: With all its errors, as diagnosed.
        grid: Places of the tool.
        posterior: What the diagnosis leaves uncertain.
        corrections: What the control was told.
        how: How it uses that.
    """
    plant, q = build(machine), grid.points
    shift, turn = _errors(plant, grid, q)
    uncertainty = None
    if posterior is not None:
        # numbers of the data sheet move nothing that stands still: their columns stay 0
        columns = np.zeros((len(q), 3, posterior.covariance.shape[0]))
        place = 0
        for f in posterior.effects:
            present = machine.effect(f.effect.key)
            for j in range(len(f.vector)):
                effect, change = f.nudged(j, _NUDGE)
                base = shift if present is not None else _shift_with(machine, f.effect, grid, q)
                columns[:, :, place] = (_shift_with(machine, effect, grid, q) - base) / change
                place += 1
        variance = np.einsum("nij,jk,nik->ni", columns, posterior.covariance, columns, optimize=True)
        uncertainty = COVERAGE * np.sqrt(np.maximum(variance, 0.0))
    if corrections is None:
        return VolumetricError(grid, shift, turn, uncertainty)
    return VolumetricError(grid, shift, turn, uncertainty, *_errors(plant, grid, q, Sender(corrections, how)))


@dataclass(frozen=True)
class Sender:
    """What a control makes of commands.

    Attributes:
        corrections: What it was told; ``None`` sends commands as they are.
        how: How it uses that.
    """

    corrections: Corrections | None = None
    how: Arithmetic | None = None

    def sent(self, q: np.ndarray) -> np.ndarray:
        """Commands of the drives for places ``q`` (n, axes). Each is alone: an axis that stands takes half of either
        direction.
        """
        if self.corrections is None:
            return q
        how = self.how or Arithmetic()
        return np.vstack([corrected(row[None], self.corrections, how, 1.0) for row in q])

    def axes(self, zero: np.ndarray) -> np.ndarray:
        """Directions of its X, Y and Z near ``zero`` (1, axes), one a column, (3, 3): its kinematic data may turn
        them.
        """
        if self.corrections is None:
            return np.eye(3)
        turning = Sender(Corrections(self.corrections.chain, kinematics=self.corrections.kinematics), self.how)
        moved = np.repeat(zero, 4, axis=0)
        moved[1:, :3] += _BESIDE * np.eye(3)
        sent = turning.sent(moved)[:, :3]
        return (sent[1:] - sent[0]).T / _BESIDE


def _shift_with(machine: Machine, effect: Effect, grid: Grid, q: np.ndarray) -> np.ndarray:
    return _error_at(build(machine.with_effect(effect)), grid, q, Sender(), np.zeros(3))


def _errors(plant: Plant, grid: Grid, q: np.ndarray, sender: Sender | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Shift (n, 3) m and turn (n, 3) rad at the places ``q`` (n, axes)."""
    sender = sender or Sender()
    shift = _error_at(plant, grid, q, sender, np.zeros(3))
    x, z = ((_error_at(plant, grid, q, sender, _BESIDE * e) - shift) / _BESIDE for e in np.eye(3)[[0, 2]])
    return shift, np.column_stack([-z[:, 1], z[:, 0], x[:, 1]])


def _error_at(plant: Plant, grid: Grid, q: np.ndarray, sender: Sender, beside: np.ndarray) -> np.ndarray:
    """Error of the point ``beside`` (3,) the tip, m in the tool, (n, 3) m in the work frame."""
    chain = plant.chain
    x, y, z = beside - np.array([0.0, 0.0, grid.tool])
    tip = (float(x), float(y), float(z))
    zero = np.zeros((1, chain.count))
    zero[0, 2] = grid.tool
    # at the set-point the ideal tip and this point of the workpiece are one
    work = machine_to_work(chain, q, spindle_ball(chain, q, None, tip))
    at_zero = _load(plant, sender.sent(zero))
    placed = on_real_table(plant, at_zero, work, np.zeros(3), grid.tool, sender.axes(zero))
    off = bar_vector(chain, _load(plant, sender.sent(q)), placed, plant.geometry, tip)
    return machine_to_work(chain, q, off) - machine_to_work(chain, q, np.zeros(3))


def _load(plant: Plant, sent: np.ndarray) -> np.ndarray:
    """Load-side positions (n, width) of axes that stand at ``sent`` (n, axes), each place by itself."""
    load = np.zeros((len(sent), plant.width))
    load[:, : plant.chain.count] = sent
    ops, clock = plant.op_table("", WARM), np.array([WARM])
    for n in range(len(load) if len(ops) else 0):  # nothing remembers the place before
        load[n] = transmit(ops, load[n : n + 1], clock)[0]
    return load


@dataclass(frozen=True)
class Volume:
    """The map of a campaign's machine.

    Attributes:
        error: Over a grid.
        basis: What the machine is known from, in words.
    """

    error: VolumetricError
    basis: str


@one_blas_thread
def volume_of(
    campaign: Campaign,
    machine: Machine,
    control: str | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    step: float = STEP,
    rotary: Mapping[str, float] | None = None,
    tool: float = 0.0,
    threads: int = 2,
    progress: Progress = silent,
) -> Volume:
    """The error of the tool over the volume of a campaign's machine, as its diagnosis knows it.

    The diagnosis that is kept beside the campaign is used where it is up to date; otherwise the campaign is diagnosed.
    Without any measured test it is the machine of the file, with what its tolerance leaves uncertain.

    Args:
        campaign: Of the machine.
        machine: As given.
        control: Name of a control whose corrections are looked at as well.
        ranges: Places along linear axes, m; of the others, what the tests cover.
        step: Distance of places, m.
        rotary: Where the rotary axes stand, rad; 0 for those that are missing.
        tool: Length of the tool less that of the spindle ball's holder, m.
        threads: Tests side by side.
        progress: Called as work gets on.

    Raises:
        InputError: An axis is unknown or its range is, or nothing is measured for a control's corrections.
    """
    chain, given = machine.chain, dict(ranges or {})
    for letters, allowed, what in ((given, chain.linear, "range"), (rotary or {}, chain.rotary, "place")):
        for letter in letters:
            if letter not in allowed:
                raise InputError(f"{what} of {letter}; allowed: {', '.join(allowed) or 'no axis of this machine'}")
    tests = campaign.in_motion
    covered = {**(ranges_of(tests.tests, chain) if tests.tests else {}), **given}
    missing = [a for a in chain.linear if a not in covered]
    if missing:
        raise InputError(f"no test says how far {', '.join(missing)} goes; allowed: a range for each of them")
    grid = grid_of(chain, covered, step, rotary, tool)
    if control is not None:
        made = compensate(campaign, machine, control, threads=threads, progress=progress)
        saved, how = made.saved, made.control.arithmetic(chain)
        how = replace(how, tool=tool)
        error = volumetric_error(saved.machine, grid, saved.posterior, made.corrections, how)
    elif tests.measured:
        saved = read_saved(campaign, machine)
        if saved is None:
            saved = keep(diagnose(campaign, machine, threads=threads, progress=progress), machine)
        error = volumetric_error(saved.machine, grid, saved.posterior)
    else:
        basis = "by the machine file" + (" and its tolerance" if machine.tolerance else " alone")
        return Volume(volumetric_error(machine, grid, prior(machine)), basis)
    return Volume(error, "by the diagnosis")
