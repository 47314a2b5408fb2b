"""Reading a sweep file: what is varied, on which machine, through which tests."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjsim.batch.design import Design, check_design, make_design
from mjsim.batch.recipe import Recipe, Target, sheet_columns, value_of
from mjsim.batch.schema import SweepTable
from mjsim.batch.targets import check_drive_value, target_of, varied_test
from mjsim.batch.workshop import Job
from mjsim.campaign.chain_file import chain_in
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.schema import with_tests
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.tables import ball_bar_table
from mjsim.io.inputs import shown
from mjsim.io.toml import check, parse, read_text
from mjsim.machine.chain import Chain
from mjsim.machine.model import Machine
from mjsim.simulation.multibody import check_axes

#: Every so many ms a trace is kept where the file does not say it: the rate of a ball bar.
EVERY_MS = 5


@dataclass(frozen=True)
class Sweep:
    """A sweep that can be run: ``runs`` machines through ``tests``.

    Attributes:
        name: of the sweep. path, text: its file. data: the file's tables as plain Python.
        recipe: base machine and what is varied. design: the values of every run.
        tests: as the campaign has them, before a value of theirs is varied.
        every: ms between the samples of recorded traces; 0 records none.
        inputs: (what, SHA-256) of every file that the results depend on beside the sweep's own.
    """

    name: str
    path: Path
    text: str
    data: dict
    recipe: Recipe
    design: Design
    tests: tuple[BallBarTest, ...]
    every: int
    inputs: dict[str, str]
    _tables: tuple[tuple[Path, dict], ...] = field(repr=False)

    @property
    def runs(self) -> int:
        """Number of runs; each goes through all tests."""
        return len(self.design.values)

    @property
    def columns(self) -> tuple[Target, ...]:
        """The numbers that differ from run to run, in the order of :meth:`parameters`."""
        drawn = [] if self.design.sheet is None else sheet_columns(self.recipe.base)
        named = [t.name for t in self.recipe.targets]
        return (*self.recipe.targets, *(t for t in drawn if t.name not in named))

    def parameters(self, run: int) -> list[float]:
        """Values of :attr:`columns` in one run, in the units of their names."""
        values = self.design.values[run].tolist()
        if self.design.sheet is None:
            return values
        machine = self.recipe.machine(self.design.values[run], self.design.sheet[run])
        return values + [value_of(machine, t) for t in self.columns[len(values) :]]

    def jobs(self) -> Iterator[Job]:
        """Every test of every run, those that share a test's commands one after the other."""
        for i, order in enumerate(self._orders()):
            for run in order:
                yield self.job(int(run), i)

    def job(self, run: int, test: int) -> Job:
        """One test of one run."""
        sheet = None if self.design.sheet is None else self.design.sheet[run]
        return Job(run, test, self.test_of(run, test), self.design.values[run], sheet)

    def test_of(self, run: int, test: int) -> BallBarTest:
        """Test number ``test`` as it is in one run.

        Raises:
            InputError: it would not be possible with the run's values.
        """
        changes = {
            t.name: float(v)
            for t, v in zip(self.recipe.targets, self.design.values[run], strict=True)
            if t.kind == "test"
        }
        return varied_test(*self._place(test), changes, self.tests[test].chain) if changes else self.tests[test]

    def _place(self, test: int) -> tuple[Path, str, dict]:
        file, table = self._tables[test]
        return file, str(self.path), table

    def _orders(self) -> list[np.ndarray]:
        varied = [i for i, t in enumerate(self.recipe.targets) if t.kind == "test"]
        order = np.lexsort(self.design.values[:, varied].T[::-1]) if varied else np.arange(self.runs)
        return [order] * len(self.tests)


def read_sweep(path: str | Path) -> Sweep:
    """Read a sweep file; everything that can be wrong with it is found here.

    Raises:
        InputError: names the file, the key, what was found and what is allowed.
    """
    path = Path(path)
    text, data = read_text(path), parse(path)
    chain = chain_in(path.parent, data.get("machine"))
    table = check(path, with_tests(SweepTable, ball_bar_table(chain)), data)
    if (table.campaign is None) == (not table.test):
        found = "both campaign and [[test]]" if table.test else "neither campaign nor [[test]]"
        raise InputError(f"{path}: has {found}; allowed: one of the two, to say which tests are run")
    tests, tables, machine_file = _tests(path, table, data, chain)
    check_design(str(path), table, len(tests))
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
    sweep = Sweep(
        table.name,
        path,
        text,
        data,
        Recipe(machine, targets),
        make_design(table, machine.chain),
        tests,
        every,
        inputs,
        tables,
    )
    _check_values(sweep)
    return sweep


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
        campaign = read_campaign(_near(path, "campaign", table.campaign), traces=False)
        file = campaign.folder / "campaign.toml"
        given = path.parent / table.campaign
        file = given if given.is_file() else file
        tests, machine_file = campaign.of(BallBarTest.instrument).tests, named or campaign.machine_file
        tables = {t["name"]: t for t in parse(file)["test"]}
        raw = [tables[t.name] for t in tests]
    names = [t.name for t in tests]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f'{path}: [[test]] name "{name}" appears {names.count(name)} times; allowed: each name once'
            )
    chosen = _chosen(path, table.tests, names)
    pairs = [(t, (file, r)) for t, r in zip(tests, raw, strict=True) if t.name in chosen]
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
    files |= {f'NC program of test "{t["name"]}"': file.parent / t["program"] for file, t in tables if "program" in t}
    return {what: hashlib.sha256(file.read_bytes()).hexdigest() for what, file in files.items()}


def _check_values(sweep: Sweep) -> None:
    """Refuse values that a run would stumble over: every bound is checked at the ends of each parameter's range."""
    values, targets = sweep.design.values, sweep.recipe.targets
    try:
        sweep.recipe.machine(values[0])
    except InputError as error:
        hint = "; vary it with one value, or put the effect into the machine file" if "missing" in str(error) else ""
        raise InputError(f"{sweep.path}: {error}{hint}") from None
    for column, target in zip(values.T, targets, strict=True):
        place = f'{sweep.path}: [[vary]] "{target.name}"'
        for extreme in (float(column.min()), float(column.max())):
            if target.kind == "drive":
                check_drive_value(place, target, extreme)
            elif target.kind == "effect":
                one = values[0].copy()
                one[targets.index(target)] = extreme
                try:
                    sweep.recipe.machine(one)
                except InputError as error:
                    raise InputError(f"{place}: {error}") from None
    if any(t.kind == "test" for t in targets):
        varied = [i for i, t in enumerate(targets) if t.kind == "test"]
        for run in np.unique(values[:, varied], axis=0, return_index=True)[1]:
            for i in range(len(sweep.tests)):
                sweep.test_of(int(run), i)
