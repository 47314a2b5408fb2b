"""Times and memory of mjsim's commands, run from a shell on copies of the example hidden-backlash, and how they
grow.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from benchmark_page import Curve, Row

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_of
from mjsim.inference import signatures
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import trusted_problem
from mjsim.inference.testability import detection_limits
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples
from mjsim.simulation.axes import time_grid
from mjsim.threads import one_blas_thread

#: Seconds that the commands may take.
HELP, COMPARE, DIAGNOSE, AGAIN = 0.4, 8.0, 10.0, 3.0
#: What a diagnosis of 13 tests may need, MB.
PEAK = 600.0
#: What a further test may add to a command's memory, MB: its trace, its reading on three grids, its residual.
PER_TEST = 5.0
#: Exponent up to which growth counts as linear, times scattering as they do.
LINEAR = 1.05
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
_MJSIM = Path(sys.executable).with_name("mjsim")
_EXAMPLE = "hidden-backlash"


@dataclass(frozen=True)
class Run:
    """A command that has ended: seconds, and the largest memory that its process had, MB."""

    seconds: float
    peak: float


def run(*args: str | Path, cache: Path | str = "off") -> Run:
    """``mjsim`` with ``args`` as from a shell; the variables that hold this process' linear algebra to one core are
    not passed on. ``cache`` is the folder of its cache.
    """
    env = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")} | {"MJSIM_CACHE": str(cache)}
    begin = time.perf_counter()
    child = subprocess.Popen([_MJSIM, *map(str, args)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=env)
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - begin
    if status:
        raise SystemExit(f"mjsim {' '.join(map(str, args))}: {child.stderr.read().decode().strip()}")
    return Run(seconds, usage.ru_maxrss / 1024.0)


@contextmanager
def example() -> Iterator[Path]:
    """A copy of the example."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / _EXAMPLE
        shutil.copytree(examples() / _EXAMPLE, folder, ignore=shutil.ignore_patterns("heldout", ".mjsim"))
        yield folder


@contextmanager
def campaign_of(count: int) -> Iterator[Path]:
    """A campaign of ``count`` tests, measured on the machine of the example by the independent generator.

    Beyond 13 the example's tests come again: set up anew, later, and with noise of their own. A repeated trace
    would not do. Its noise is there twice, and a diagnosis finds what is there twice.
    """
    from independent.campaign import Case, write_files

    tests = tomllib.loads((examples() / _EXAMPLE / "campaign.toml").read_text(encoding="utf-8"))["test"]
    some = []
    for k in range(count):
        again, place = divmod(k, len(tests))
        test = dict(tests[place])
        test["name"] += f"-{again + 1}"
        test["setup"] += f"-{again + 1}"
        test["started_s"] += 5000.0 * again
        test["trace"] = f"traces/{test['name']}.csv"
        some.append(test)
    with tempfile.TemporaryDirectory() as scratch:
        hidden = {"id": "backlash.A", "width_deg": 0.002}
        write_files(Case("growth", "M1", tuple(some), (hidden,), seed=count), scratch)
        yield Path(scratch)


def steps(folder: Path) -> int:
    """1 ms steps that one simulation of all tests of a campaign takes."""
    return sum(len(time_grid(Program(t))) for t in read_campaign(folder).measured)


def commands(bare: float) -> list[Row]:
    """Start-up, ``compare`` and ``diagnose``. ``bare`` is seconds per step of a bare rollout."""
    seconds = statistics.median(run("--help").seconds for _ in range(5))
    rows = [Row("mjsim --help (median of 5)", f"{seconds:.2f} s", f"{HELP:g} s", None, seconds <= HELP)]
    with example() as folder, tempfile.TemporaryDirectory() as kept:
        n = steps(folder)
        size = f"{len(read_campaign(folder).measured)} tests, {n / 1000:.0f} s simulated"
        run("compare", folder, "--quiet")  # what Numba has not compiled yet, it compiles now
        run("diagnose", folder, "--quiet", cache=kept)
        for name, again, most in (
            ("compare", "", COMPARE),
            ("diagnose", "", DIAGNOSE),
            ("diagnose", " once more, with its cache", AGAIN),
        ):
            runs = [run(name, folder, "--quiet", cache=kept if again else "off") for _ in range(3)]
            seconds, peak = statistics.median(r.seconds for r in runs), max(r.peak for r in runs)
            rows.append(
                Row(
                    f"mjsim {name} {_EXAMPLE}{again}, {size}",
                    f"{seconds:.1f} s, peak memory {peak:.0f} MB",
                    f"{most:g} s" + (f", {PEAK:g} MB" if name == "diagnose" else ""),
                    seconds / (n * bare),
                    seconds <= most and (name != "diagnose" or peak <= PEAK),
                )
            )
    return rows


def memory() -> tuple[list[Row], list[Curve]]:
    """Peak memory of ``compare`` for the example's tests once, twice and four times."""
    counts, peaks, rows = (13, 26, 52), [], []
    for count in counts:
        with campaign_of(count) as folder:
            peaks.append(run("compare", folder, "--quiet", "--no-plots", "--as-is").peak)
        rows.append(Row(f"peak memory of mjsim compare --no-plots, {count} tests", f"{peaks[-1]:.0f} MB"))
    slope, at_none = np.polyfit(counts, peaks, 1)
    what = "  a further test adds (its trace, samples, reading and residual stay)"
    rows.append(Row(what, f"{slope:.1f} MB, to {at_none:.0f} MB", f"{PER_TEST:g} MB", None, bool(slope <= PER_TEST)))
    return rows, [Curve("peak memory of compare", "tests", "MB", counts, tuple(peaks))]


def growth(bare: float) -> tuple[list[Row], list[Curve]]:
    """Times of ``compare`` and ``diagnose`` over the number of tests, the memory of ``diagnose`` too, and the time of
    the search over the number of candidates.
    """
    rows, curves = [], []
    for name in ("compare", "diagnose"):
        counts, runs, ratios = (3, 6, 13, 26, 52), [], []
        for count in counts:
            with campaign_of(count) as folder:
                runs.append(run(name, folder, "--quiet", "--as-is"))
                ratios.append(runs[-1].seconds / (steps(folder) * bare))
        curves.append(Curve(f"mjsim {name}", "tests", "s", counts, tuple(r.seconds for r in runs)))
        rows += _rows(curves[-1], ratios)
        if name == "diagnose":
            curves.append(Curve("peak memory of diagnose", "tests", "MB", counts, tuple(r.peak for r in runs)))
            rows += _rows(curves[-1], [None] * len(counts))
    counts, seconds, n = candidates()
    curves.append(Curve("signatures and ranking", "candidates", "s", counts, seconds))
    rows += _rows(curves[-1], [t / (n * bare) for t in seconds])
    return rows, curves


@one_blas_thread
def candidates() -> tuple[tuple[int, ...], tuple[float, ...], int]:
    """Numbers of candidates, the seconds that their signatures and detection limits take on all cores, and the steps
    of one simulation.
    """
    with example() as folder:
        campaign, n = read_campaign(folder), steps(folder)
        machine = machine_of(campaign)
        fitter = Fitter(trusted_problem(campaign, machine, len(os.sched_getaffinity(0))), machine)
        start, every = fitter.fit([], exact=False), signatures.seeds(machine)
        counts, seconds = [], []
        for share in (8, 4, 2, 1):
            some = every[::share]
            begin = time.perf_counter()
            bank = signatures.SignatureBank(fitter.problem, start)
            bank.compute(some)
            detection_limits(signatures.Projector(start), bank)
            counts.append(len(some))
            seconds.append(time.perf_counter() - begin)
    return tuple(counts), tuple(seconds), n


def _rows(curve: Curve, ratios: Sequence[float | None]) -> list[Row]:
    rows = [
        Row(f"{curve.name}, {count} {curve.over}", f"{y:.{0 if curve.unit == 'MB' else 1}f} {curve.unit}", "", ratio)
        for count, y, ratio in zip(curve.x, curve.y, ratios, strict=True)
    ]
    measured = f"{curve.exponent:.2f}, {curve.last:.2f} over the last doubling"
    met = max(curve.exponent, curve.last) <= LINEAR
    rows.append(Row("  grows like a power of their number, the exponent", measured, f"{LINEAR:g}", None, met))
    return rows
