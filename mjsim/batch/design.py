"""The design of a sweep: which values every run has."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from mjsim.batch.schema import SweepTable, VaryTable
from mjsim.errors import InputError
from mjsim.estimation.data_sheet import data_sheet
from mjsim.machine.chain import Chain

#: Most simulations (runs times tests) of one sweep; more is taken for a slip.
LARGEST = 1_000_000


@dataclass(frozen=True)
class Design:
    """Values of every run.

    Attributes:
        values: (runs, parameters) in the units of the parameters' names.
        sheet: (runs, sheet) standard deviations by which the data sheet is moved, or ``None``.
    """

    values: np.ndarray
    sheet: np.ndarray | None = None


def run_count(table: SweepTable) -> int:
    """Runs that a checked sweep file asks for, found without making them."""
    if table.design == "latin_hypercube":
        return table.samples or 0
    grid = math.prod(len(v.values) if v.values is not None else v.count or 1 for v in table.vary)
    return grid * (table.samples or 1)


def check_design(place: str, table: SweepTable, tests: int) -> None:
    """Refuse a sweep whose keys do not belong together, or that is too large.

    Raises:
        InputError: names the key, what was found and what is allowed.
    """
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
    simulations = run_count(table) * tests
    if simulations > LARGEST:
        raise InputError(
            f"{place}: {run_count(table)} runs of {tests} test{'s' if tests > 1 else ''} are {simulations} "
            f"simulations; "
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


def make_design(table: SweepTable, chain: Chain) -> Design:
    """The values of every run of a checked sweep; the same seed gives the same design.

    A Latin hypercube is stratified: each parameter has one value in each of ``samples`` equal parts of its range. An
    ensemble of tolerances is one too, of normal deviates; every point of a grid beside it gets the same machines, so
    that points can be compared.

    Args:
        table: the sweep file.
        chain: axes of the base machine.
    """
    samples = table.samples or 1
    if table.design == "latin_hypercube":
        unit = _hypercube(len(table.vary), samples, table.seed)
        return Design(np.column_stack([_spread(v, u) for v, u in zip(table.vary, unit.T, strict=True)]))
    levels = [_levels(v) for v in table.vary]
    grid = (
        np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, len(levels)) if levels else np.zeros((1, 0))
    )
    if table.design == "grid":
        return Design(grid)
    unit = _hypercube(len(data_sheet(chain)), samples, table.seed)
    return Design(np.repeat(grid, samples, axis=0), np.tile(ndtri(unit), (len(grid), 1)))


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
