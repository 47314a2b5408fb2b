"""``mjsim batch``."""

from __future__ import annotations

import re
from dataclasses import dataclass

import click

from mjsim.cli import common


@dataclass(frozen=True)
class Limit:
    """A limit of a figure, as the user wrote it."""

    text: str
    figure: str
    sign: str
    value: float

    def within(self, values):
        """Which values (a pandas column) keep the limit; those that do not exist do not."""
        return {"<=": values.le, "<": values.lt, ">=": values.ge, ">": values.gt}[self.sign](self.value)


class _LimitType(click.ParamType):
    name = "figure<=value"

    def convert(self, value, param, ctx):
        if isinstance(value, Limit):
            return value
        match = re.fullmatch(r"\s*(\w+)\s*(<=|>=|<|>)\s*([-+.\deE]+)\s*", value)
        try:
            if not match or match[1] not in _FIGURES:
                raise ValueError
            return Limit(value.strip(), match[1], match[2], float(match[3]))
        except ValueError:
            self.fail(
                f"{value!r}; allowed: one of {', '.join(_FIGURES)}, then <=, <, >= or >, then a number", param, ctx
            )


_FIGURES = ("circular_error_um", "radial_max_um", "radial_min_um", "rms_um", "max_um", "min_um", "duration_s")
LIMIT = _LimitType()


@click.command("batch")
@click.argument("sweep", type=common.path_type())
@common.folder_option("--out", help="Folder of the results.")
@click.option("--scheduler", metavar="ADDRESS", help="Run on the workers of this Dask scheduler.")
@click.option("--dry-run", is_flag=True, help="Only say how many runs there are, and how long they take.")
@click.option(
    "--limit",
    "limits",
    type=LIMIT,
    multiple=True,
    help='Count the simulations within a limit, as in "circular_error_um<=6" (repeatable).',
)
@click.option("--force", is_flag=True, help="Start anew, whatever --out holds.")
@common.threads_option
@common.options
def command(sweep, out, scheduler, dry_run, limits, force, threads) -> None:
    """Run a sweep: many machines through the same tests.

    SWEEP is a TOML file: tests, what is varied, and how. The result is a Parquet
    data set in DIR/results with its description in DIR/sweep.json. The same
    command goes on where it was stopped or killed.

    \b
    Example: mjsim batch examples/sweeps/backlash.toml --out backlash
    """
    from mjsim.batch.run import batch
    from mjsim.batch.sweep import read_sweep

    if out is None and not dry_run:
        raise click.UsageError("Missing option '--out'.")
    s = read_sweep(sweep)
    cores = common.cores(threads)
    if dry_run or out is None:
        _describe(s, cores)
        return
    with common.resumable_progress(out) as progress:
        result = batch(s, out, cores, scheduler, force, progress)
    if not common.answered(_summary(result, limits)):
        _say(result, limits)
    if result.failed == result.runs * result.tests:
        common.fail(f"every simulation of the sweep failed; the column 'error' of {out / 'results'} says why")


def _summary(r, limits: list[Limit]) -> dict:
    summary = {
        "name": r.name,
        "out": str(r.out),
        "runs": r.runs,
        "tests": r.tests,
        "simulations": r.runs * r.tests,
        "simulated": r.simulated,
        "failed": r.failed,
        "files": [str(f) for f in r.files],
        "seconds": round(r.seconds, 3),
        "simulations_per_s": round(r.simulated / r.seconds, 3),
        "steps_per_s": round(r.steps / r.seconds),
    }
    if limits:
        data = r.to_dataframe()
        summary["within_limits"] = {x.text: int(x.within(data[x.figure]).sum()) for x in limits}
    return summary


def _say(r, limits: list[Limit]) -> None:
    total = r.runs * r.tests
    if r.simulated:
        before = f" ({total - r.simulated} were there already)" if r.simulated < total else ""
        common.paragraph(
            f"{r.runs} runs of {r.tests} test{'s' if r.tests > 1 else ''}: {r.simulated} simulations in "
            f"{_duration(r.seconds)}{before}, "
            f"{r.simulated / r.seconds:.1f} a second, {r.steps / r.seconds / 1e3:.0f} thousand steps a second"
        )
    else:
        common.paragraph(f"{r.runs} runs of {r.tests} test{'s' if r.tests > 1 else ''}: all were there already")
    if r.failed:
        common.paragraph(f"{r.failed} simulations have no figures; the column 'error' says why")
    click.echo()
    _results(r, limits)
    click.echo()
    common.paragraph(f"All columns: {r.out / 'results'} (Parquet; pandas.read_parquet reads it)")


def _results(r, limits: list[Limit]) -> None:
    """The results test by test: lowest, median and highest value of each figure over the runs; runs within the
    limits.
    """
    data = r.to_dataframe()
    shown = ["circular_error_um", "max_um", "min_um", *(x.figure for x in limits)]
    rows = []
    for test, part in data.groupby("test", sort=False):
        for figure in dict.fromkeys(shown):
            values = part[figure].dropna()
            if len(values):
                rows.append([str(test), figure, *(f"{v:.3f}" for v in (values.min(), values.median(), values.max()))])
    common.table(["test", "figure", "lowest", "median", "highest"], rows, text=(0, 1))
    for x in limits:
        good = x.within(data[x.figure])
        known = int(data[x.figure].notna().sum())
        common.paragraph(
            f"{x.text}: {int(good.sum())} of {known} simulations"
            + (f" ({100 * good.sum() / known:.1f} %)" if known else "")
        )


def _describe(s, cores: int) -> None:
    from mjsim.batch.run import estimate

    steps, seconds = estimate(s, cores)
    shown = min(5, s.runs)
    names = [c.name for c in s.columns]
    rows = [s.parameters(run) for run in range(shown)]
    data = {
        "name": s.name,
        "runs": s.runs,
        "tests": [t.name for t in s.tests],
        "simulations": s.runs * len(s.tests),
        "steps": steps,
        "estimated_seconds": round(seconds, 1),
        "threads": cores,
        "first": [{"run": run, **dict(zip(names, row, strict=True))} for run, row in enumerate(rows)],
    }
    if common.answered(data):
        return
    many = f"{len(s.tests)} test{'s' if len(s.tests) > 1 else ''}"
    common.paragraph(f"{s.runs} runs of {many}: {s.runs * len(s.tests)} simulations, {steps} steps")
    common.paragraph(f"about {_duration(seconds)} on {cores} core{'s' if cores > 1 else ''}")
    drawn = len(names) - len(s.targets)
    if s.targets:
        few = slice(0, min(4, len(s.targets)))
        common.table(["run", *names[few]], [[str(i), *(f"{v:.6g}" for v in row[few])] for i, row in enumerate(rows)])
        if len(s.targets) > 4:
            common.paragraph(f"and {len(s.targets) - 4} more parameters")
    if drawn:
        common.paragraph(f"{drawn} numbers of the data sheet are drawn in every run")


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"
