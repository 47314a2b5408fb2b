"""A sweep file: what is varied, on which machine, through which tests; and the values that every run gets from it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.special import ndtri

from mjsim.batch.targets import (
    DRIVERS,
    Target,
    check_drive_value,
    sheet_targets,
    target_of,
    varied_machine,
    varied_test,
)
from mjsim.campaign.chain_file import chain_in
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.schema import with_tests
from mjsim.errors import InputError
from mjsim.inference.data_sheet import calibrated, data_sheet
from mjsim.instruments.ball_bar.files import BallBarTable, ball_bar_table
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.schema import Table, Text
from mjsim.io.inputs import shown
from mjsim.io.toml import check, parse, read_text
from mjsim.machine.chain import Chain
from mjsim.machine.model import Machine
from mjsim.simulation.multibody import check_axes

#: Every so many ms a trace is kept where the file does not say it: the rate of a ball bar.
EVERY_MS = 5
#: Most simulations (runs times tests) of one sweep; more is taken for a slip.
LARGEST = 1_000_000
#: A value that is varied: whatever its bounds are, differences and ratios of two such numbers are finite.
Value = Annotated[float, Field(ge=-1e15, le=1e15, allow_inf_nan=False)]


class VaryTable(Table):
    parameter: Text
    values: Annotated[list[Value], Field(min_length=1, max_length=1_000_000)] | None = None
    from_: Annotated[Value | None, Field(alias="from")] = None
    to: Value | None = None
    count: Annotated[int, Field(ge=2, le=1_000_000)] | None = None
    scale: Literal["linear", "log"] = "linear"

    @property
    def ends(self) -> tuple[float, float]:
        """``from`` and ``to`` of an entry that has them."""
        assert self.from_ is not None and self.to is not None
        return self.from_, self.to


class SweepTable(Table):
    name: Text
    design: Literal["grid", "latin_hypercube", "tolerances"] = "grid"
    samples: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    campaign: Text | None = None
    tests: Any = "all"  # or a list of names; checked where the names are known
    machine: Text | None = None
    test: list[BallBarTable] = Field(default_factory=list)
    vary: list[VaryTable] = Field(default_factory=list)
    traces: bool = False
    every_ms: Annotated[int, Field(ge=1, le=10_000)] | None = None


class Job(NamedTuple):
    """One simulation: one test of one run, both counted from 0."""

    run: int
    test: int


@dataclass(frozen=True)
class Sweep:
    """A sweep that can be run: ``runs`` machines through ``tests``.

    Attributes:
        name: Of the sweep.
        path: Its file.
        text: Of the file.
        data: The file's tables as plain Python.
        base: The machine that is varied.
        targets: What is varied.
        values: (runs, targets) values of every run, in the units of the targets' names.
        sheet: (runs, sheet) standard deviations by which the data sheet is moved before that, or ``None``.
        tests: As the campaign has them, before a value of theirs is varied.
        every: ms between the samples of recorded traces; 0 records none.
        inputs: SHA-256 of every file that the results depend on beside the sweep's own.
    """

    name: str
    path: Path
    text: str
    data: dict
    base: Machine
    targets: tuple[Target, ...]
    values: np.ndarray
    sheet: np.ndarray | None
    tests: tuple[BallBarTest, ...]
    every: int
    inputs: dict[str, str]
    _tables: tuple[tuple[Path, dict], ...] = field(repr=False)

    @property
    def runs(self) -> int:
        """Number of runs; each goes through all tests."""
        return len(self.values)

    @cached_property
    def columns(self) -> tuple[Target, ...]:
        """The numbers that differ from run to run, in the order of :meth:`parameters`."""
        drawn = [] if self.sheet is None else sheet_targets(self.base)
        named = [t.name for t in self.targets]
        return (*self.targets, *(t for t in drawn if t.name not in named))

    def parameters(self, run: int) -> list[float]:
        """Values of :attr:`columns` in one run, in the units of their names."""
        values, more = self.values[run].tolist(), self.columns[len(self.targets) :]
        if not more:
            return values
        machine = self.machine(run)
        return values + [t.value_of(machine) for t in more]

    def machine(self, run: int) -> Machine:
        """The machine of one run.

        Raises:
            InputError: As :func:`varied_machine`.
        """
        base = self.base if self.sheet is None else calibrated(self.base, self.sheet[run])
        return varied_machine(base, self.targets, self.values[run])

    @cached_property
    def order(self) -> np.ndarray:
        """(runs,) in which order they are simulated: those that share a test's commands one after the other."""
        varied = [i for i, t in enumerate(self.targets) if t.kind == "test"]
        return np.lexsort(self.values[:, varied].T[::-1]) if varied else np.arange(self.runs)

    def jobs(self) -> Iterator[Job]:
        """Every test of every run."""
        return (Job(int(run), test) for test in range(len(self.tests)) for run in self.order)

    def test_of(self, job: Job) -> BallBarTest:
        """The test of a job, as it is in its run.

        Raises:
            InputError: It would not be possible with the run's values.
        """
        pairs = zip(self.targets, self.values[job.run], strict=True)
        changes = {t.name: float(v) for t, v in pairs if t.kind == "test"}
        if not changes:
            return self.tests[job.test]
        file, table = self._tables[job.test]
        return varied_test(file, str(self.path), table, changes, self.base.chain, self.tests[job.test].name)


def read_sweep(path: str | Path) -> Sweep:
    """Read a sweep file; everything that can be wrong with it is found here.

    Raises:
        InputError: Names the file, the key, what was found and what is allowed.
    """
    path = Path(path)
    text, data = read_text(path), parse(path)
    chain = chain_in(path.parent, data.get("machine"))
    table = check(path, with_tests(SweepTable, ball_bar_table(chain)), data)
    if (table.campaign is None) == (not table.test):
        found = "both campaign and [[test]]" if table.test else "neither campaign nor [[test]]"
        raise InputError(f"{path}: has {found}; allowed: one of the two, to say which tests are run")
    tests, tables, machine_file = _tests(path, table, data, chain)
    _check_design(str(path), table, len(tests))
    if table.every_ms is not None and not table.traces:
        raise InputError(f"{path}: every_ms = {table.every_ms} needs traces = true")
    machine = read_machine(machine_file)
    try:
        check_axes(machine.chain, tests)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    targets = tuple(target_of(f'{path}: [[vary]] "{v.parameter}"', v.parameter, machine) for v in table.vary)
    every = (table.every_ms or EVERY_MS) if table.traces else 0
    inputs = _inputs(machine, machine_file, tables)
    values, sheet = _design(table, machine.chain)
    sweep = Sweep(table.name, path, text, data, machine, targets, values, sheet, tests, every, inputs, tables)
    _check_values(sweep)
    return sweep


# -- tests and files ---------------------------------------------------------------------------------------------------


def _near(path: Path, key: str, name: str) -> Path:
    """A file that the sweep names, beside or near it; absolute paths would not move with it."""
    if not name.strip() or not name.isprintable() or Path(name).is_absolute():
        raise InputError(f"{path}: {key} = {shown(name)}; allowed: a path relative to the sweep file")
    return path.parent / name


def _tests(
    path: Path, table: SweepTable, data: dict, chain: Chain
) -> tuple[tuple[BallBarTest, ...], tuple[tuple[Path, dict], ...], Path]:
    """Tests, where each stands (file and table), and the machine file."""
    named = None if table.machine is None else _near(path, "machine", table.machine)
    if table.campaign is None:
        if named is None:
            raise InputError(f"{path}: the key 'machine' is missing; tests of its own need a machine file")
        file, raw, machine_file = path, data["test"], named
        tests = tuple(varied_test(file, str(path), t, {}, chain) for t in raw)
    else:
        given = _near(path, "campaign", table.campaign)
        campaign = read_campaign(given, traces=False)
        file = given if given.is_file() else campaign.folder / "campaign.toml"
        tests, machine_file = campaign.in_motion.tests, named or campaign.machine_file
        tables = {t["name"]: t for t in parse(file)["test"]}
        raw = [tables[t.recording] for t in tests]
    names = [t.name for t in tests]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f'{path}: [[test]] name "{name}" appears {names.count(name)} times; allowed: each name once'
            )
    chosen = _chosen(path, table.tests, list(dict.fromkeys([*names, *(t.recording for t in tests)])))
    pairs = [(t, (file, r)) for t, r in zip(tests, raw, strict=True) if t.name in chosen or t.recording in chosen]
    return tuple(t for t, _ in pairs), tuple(place for _, place in pairs), machine_file


def _chosen(path: Path, tests: object, names: list[str]) -> list[str]:
    if tests == "all":
        return names
    if not isinstance(tests, list) or not tests or not all(isinstance(t, str) for t in tests):
        raise InputError(
            f'{path}: tests = {str(tests)[:80]!r}; allowed: "all", or a list of names of: {", ".join(names)}'
        )
    for name in tests:
        if name not in names:
            raise InputError(f"{path}: tests: there is no test {name!r}; allowed: {', '.join(names)}")
    return tests


def _inputs(machine: Machine, machine_file: Path, tables: tuple[tuple[Path, dict], ...]) -> dict[str, str]:
    files = {"machine": machine_file}
    files |= {f"effect file of {e}": machine_file.parent / f for e, f in machine.effect_files.items()}
    for driver, what in DRIVERS.items():
        files |= {f'{what} of test "{t["name"]}"': file.parent / t[driver] for file, t in tables if driver in t}
    return {what: hashlib.sha256(file.read_bytes()).hexdigest() for what, file in files.items()}


# -- values of the runs ------------------------------------------------------------------------------------------------


def _check_design(place: str, table: SweepTable, tests: int) -> None:
    """Refuse keys that do not belong together, and a sweep that is too large."""
    for v in table.vary:
        _check_vary(f'{place}: [[vary]] "{v.parameter}"', v, table.design)
    names = [v.parameter for v in table.vary]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f'{place}: [[vary]] "{name}" appears {names.count(name)} times; allowed: each parameter once'
            )
    if table.design == "grid" and table.samples is not None:
        raise InputError(
            f"{place}: samples = {table.samples} does not belong to a grid, whose size follows from its [[vary]] "
            f"entries"
        )
    if table.design != "grid" and table.samples is None:
        raise InputError(
            f"{place}: the key 'samples' is missing; design = {table.design!r} needs it, a whole number of at least 1"
        )
    if table.design != "tolerances" and not table.vary:
        raise InputError(
            f"{place}: there is no [[vary]]; design = {table.design!r} needs at least one parameter to vary"
        )
    points = math.prod(len(v.values) if v.values is not None else v.count or 1 for v in table.vary)
    runs = (1 if table.design == "latin_hypercube" else points) * (table.samples or 1)
    if runs * tests > LARGEST:
        raise InputError(
            f"{place}: {runs} runs of {tests} test{'s' if tests > 1 else ''} are {runs * tests} simulations; "
            f"allowed: up to {LARGEST}, take fewer values or design = 'latin_hypercube'"
        )


def _check_vary(place: str, v: VaryTable, design: str) -> None:
    if v.values is not None:
        if v.count is not None or (v.from_, v.to) != (None, None) or v.scale != "linear":
            raise InputError(
                f"{place}: has values and from, to, count or scale; allowed: either a list of values or from and to"
            )
        if len(set(v.values)) < len(v.values):
            raise InputError(f"{place}: values has a number twice; allowed: each value once")
        return
    if v.from_ is None or v.to is None:
        raise InputError(
            f"{place}: the key {'from' if v.from_ is None else 'to'!r} is missing; allowed: values, or from and to"
        )
    if design == "latin_hypercube":
        if v.count is not None:
            raise InputError(f"{place}: count = {v.count} does not belong to a Latin hypercube, whose size is samples")
    elif v.count is None:
        raise InputError(
            f"{place}: the key 'count' is missing; design = {design!r} needs values, or from, to and count"
        )
    if v.from_ == v.to:
        raise InputError(f"{place}: from and to are both {v.to:g}; allowed: two different numbers")
    if v.scale == "log" and (v.from_ <= 0 or v.to <= 0):
        raise InputError(f"{place}: from = {v.from_:g}, to = {v.to:g} with scale = 'log'; allowed: two numbers above 0")


def _design(table: SweepTable, chain: Chain) -> tuple[np.ndarray, np.ndarray | None]:
    """Values and moves of the data sheet of every run, as :class:`Sweep` has them; the same seed gives the same.

    A Latin hypercube is stratified: each parameter has one value in each of ``samples`` equal parts of its range. An
    ensemble of tolerances is one too, of normal deviates; every point of a grid beside it gets the same machines, so
    that points can be compared.
    """
    samples = table.samples or 1
    if table.design == "latin_hypercube":
        unit = _hypercube(len(table.vary), samples, table.seed)
        return np.column_stack([_spread(v, u) for v, u in zip(table.vary, unit.T, strict=True)]), None
    levels = [_levels(v) for v in table.vary]
    grid = np.zeros((1, 0))
    if levels:
        grid = np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, len(levels))
    if table.design == "grid":
        return grid, None
    unit = _hypercube(len(data_sheet(chain)), samples, table.seed)
    return np.repeat(grid, samples, axis=0), np.tile(ndtri(unit), (len(grid), 1))


def _hypercube(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """(samples, dimensions) between 0 and 1."""
    from scipy.stats import qmc  # takes a second to load

    return qmc.LatinHypercube(dimensions, rng=np.random.default_rng(seed)).random(samples)


def _levels(v: VaryTable) -> np.ndarray:
    if v.values is not None:
        return np.array(v.values)
    return (np.geomspace if v.scale == "log" else np.linspace)(*v.ends, v.count or 2)


def _spread(v: VaryTable, u: np.ndarray) -> np.ndarray:
    """Numbers from 0 to 1 as values of a parameter; a list of values is drawn from evenly."""
    if v.values is not None:
        return np.array(v.values)[np.minimum((u * len(v.values)).astype(int), len(v.values) - 1)]
    first, last = v.ends
    if v.scale == "log":
        return np.exp(np.log(first) + u * (np.log(last) - np.log(first)))
    return first + u * (last - first)


def _check_values(sweep: Sweep) -> None:
    """Refuse values that a run would stumble over: every bound is checked at the ends of each parameter's range."""
    values, targets = sweep.values, sweep.targets
    try:
        varied_machine(sweep.base, targets, values[0])
    except InputError as error:
        hint = "; vary it with one value, or put the effect into the machine file" if "missing" in str(error) else ""
        raise InputError(f"{sweep.path}: {error}{hint}") from None
    for i, target in enumerate(targets):
        place = f'{sweep.path}: [[vary]] "{target.name}"'
        for extreme in (float(values[:, i].min()), float(values[:, i].max())):
            if target.kind == "drive":
                check_drive_value(place, target, extreme)
            elif target.kind == "effect":
                one = values[0].copy()
                one[i] = extreme
                try:
                    varied_machine(sweep.base, targets, one)
                except InputError as error:
                    raise InputError(f"{place}: {error}") from None
    varied = [i for i, t in enumerate(targets) if t.kind == "test"]
    if varied:
        for run in np.unique(values[:, varied], axis=0, return_index=True)[1]:
            for test in range(len(sweep.tests)):
                sweep.test_of(Job(int(run), test))
