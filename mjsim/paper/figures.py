"""Figures 3 to 17 of the paper as PNG and SVG, and its numbers beside the simulated ones."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mjsim.errors import InputError
from mjsim.io.extras import need
from mjsim.io.files import check_writable, write_all
from mjsim.paper.contents import POLAR, VELOCITY_RUNS
from mjsim.paper.draw import polar_figure, velocity_figure
from mjsim.paper.machine import PaperMachine, paper_machine
from mjsim.paper.numbers import RUNS, Number, numbers
from mjsim.paper.pitch import curves_sheet, spectra_sheet
from mjsim.paper.runs import Traces
from mjsim.plots.save import encode
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

NUMBERS = tuple(range(3, 18))


@dataclass(frozen=True)
class PaperFigures:
    """What :func:`figures` made: the files, in order, and the paper's numbers beside the simulated ones."""

    files: tuple[Path, ...]
    numbers: tuple[Number, ...]

    def to_dataframe(self) -> pd.DataFrame:
        """One row per printed number: group, name, printed, simulated, tolerance, note, agrees."""
        need("to_dataframe", "dataframe", "pandas")
        import pandas as pd

        return pd.DataFrame([{**asdict(n), "agrees": n.agrees} for n in self.numbers])


def targets(out: Path, only: Collection[int] = NUMBERS) -> list[Path]:
    """Files that :func:`figures` writes."""
    return [out / f"fig{n:02d}.{kind}" for n in sorted(only) for kind in ("png", "svg")] + [out / "numbers.csv"]


@one_blas_thread
def figures(
    out: Path | str, only: Collection[int] = NUMBERS, force: bool = False, threads: int = 2, progress: Progress = silent
) -> PaperFigures:
    """Regenerate the paper's figures from the simulator.

    Args:
        out: folder for ``fig03.png``, ``fig03.svg`` … ``fig17.svg`` and ``numbers.csv``. only: numbers of the figures
            wanted.
        force: replace files that are there. threads: tests simulated side by side. progress: stage, done, total.

    Raises:
        InputError: a number that the paper's simulated figures do not have, or a file in the way; then nothing is
            written.
    """
    out = Path(out)
    unknown = sorted(set(only) - set(NUMBERS))
    if unknown:
        raise InputError(f"no figure {unknown[0]}; allowed: 3 to 17 (1, 2 and A1 of the paper are drawings)")
    for path in targets(out, only):
        check_writable(path, force)
    machine = paper_machine(threads, progress)
    runs = [run for f in POLAR if f.number in only for run in f.runs]
    traces = Traces(machine, [*runs, *(VELOCITY_RUNS if 9 in only else ()), *RUNS], threads, progress)
    found = numbers(machine, traces)
    makers = _makers(machine, traces)
    pages: dict[Path, str | bytes] = {}
    for i, n in enumerate(sorted(only)):
        progress("drawing", i, len(only))
        figure = makers[n]()
        pages |= {out / f"fig{n:02d}.{kind}": encode(figure, kind) for kind in ("png", "svg")}
    pages[out / "numbers.csv"] = _csv(found)
    write_all(pages, force)
    return PaperFigures(tuple(pages), tuple(found))


def _makers(machine: PaperMachine, traces: Traces) -> dict[int, Callable[[], Figure]]:
    polar = {f.number: (lambda f=f: polar_figure(f, traces, machine.campaign)) for f in POLAR}
    return {
        3: lambda: spectra_sheet(machine),
        4: lambda: curves_sheet(machine),
        9: lambda: velocity_figure(traces),
        **polar,
    }


def _csv(found: list[Number]) -> str:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["group", "name", "printed", "simulated", "tolerance", "agrees", "note"])
    for n in found:
        rows.writerow(
            [
                n.group,
                n.name,
                plain(n.printed),
                plain(n.simulated),
                f"{n.tolerance:g}",
                "yes" if n.agrees else "no",
                n.note,
            ]
        )
    return text.getvalue()


def plain(value: float | list[float]) -> str:
    """A number or a list of numbers as text."""
    return " ".join(f"{v:g}" for v in value) if isinstance(value, list) else f"{value:g}"
