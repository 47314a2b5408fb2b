"""The table of scripts/benchmarks/benchmark.py, its page docs/speed.md and its picture."""

from __future__ import annotations

import os
import platform
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjsim.plots import style
from mjsim.plots.save import save


@dataclass(frozen=True)
class Row:
    """One line of the table. ``ratio``: seconds over those of a bare rollout of the same number of steps; ``met``:
    whether the target is
    met, ``alone``: by processor time at least, which is what passes where no other work is on the cores."""

    item: str
    measured: str
    target: str = ""
    ratio: float | None = None
    met: bool | None = None
    alone: bool = False

    def cells(self) -> list[str]:
        """The texts of the five columns."""
        verdict = "" if self.met is None else "met" if self.met else "met by processor time" if self.alone else "MISSED"
        return [self.item, self.measured, self.target, "" if self.ratio is None else f"{self.ratio:.2f}", verdict]


COLUMNS = ["item", "measured", "target", "ratio to bare rollout", ""]


@dataclass(frozen=True)
class Curve:
    """Something measured, ``y`` in ``unit``, over the number ``x`` of ``over``."""

    name: str
    over: str
    unit: str
    x: tuple[int, ...]
    y: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Slope of the straight line through the logarithms: 1 is linear, less is a part that does not grow."""
        return float(np.polyfit(np.log(self.x), np.log(self.y), 1)[0])

    @property
    def last(self) -> float:
        """The same between the last two points, where what grows faster would show first."""
        return float(np.log(self.y[-1] / self.y[-2]) / np.log(self.x[-1] / self.x[-2]))


def header(more: str) -> str:
    """One line about this computer and what was measured on it."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    versions = f"Python {platform.python_version()}, MuJoCo {mujoco.__version__}"
    return f"{cpu()}, {cores} cores, load average {os.getloadavg()[0]:.1f} before; {versions}; {more}"


def cpu() -> str:
    """Name of the processor's model."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.M)
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or platform.machine()


def table(rows: list[Row]) -> str:
    """The rows as text, aligned."""
    cells = [COLUMNS, *(r.cells() for r in rows)]
    widths = [max(len(c[i]) for c in cells) for i in range(len(COLUMNS))]
    lines = [
        "  ".join(t.ljust(w) if i == 0 else t.rjust(w) for i, (t, w) in enumerate(zip(c, widths, strict=True)))
        for c in cells
    ]
    return "\n".join(line.rstrip() for line in lines)


def write_page(docs: Path, head: str, rows: list[Row], curves: list[Curve]) -> list[Path]:
    """Write speed.md and images/speed.png below ``docs``; returns both."""
    page, picture = docs / "speed.md", docs / "images" / "speed.png"
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    lines += [f"| {' | '.join(c.replace('  ', '· ') for c in r.cells())} |" for r in rows]
    head = f"Written by `scripts/benchmarks/benchmark.py --write`. Do not edit this page. Measured on: {head}."
    page.write_text(TEXT.format(head=textwrap.fill(head, 100), table="\n".join(lines)), encoding="utf-8")
    save(figure(curves), picture)
    return [page, picture]


def figure(curves: list[Curve]):
    """Every curve on logarithmic axes, with the straight line of its exponent, and a dotted one that is linear."""
    drawing = style.new_figure(7.6, 2.3 + 2.6 * ((len(curves) - 1) // 2))
    rows = -(-len(curves) // 2)
    for k, c in enumerate(curves):
        axes = drawing.add_subplot(rows, 2, k + 1)
        x = np.array(c.x, float)
        fit = np.polyval(np.polyfit(np.log(x), np.log(c.y), 1), np.log(x))
        axes.loglog(x, c.y[-1] * x / x[-1], ":", color=style.NOMINAL, linewidth=1.0, label="linear")
        axes.loglog(x, np.exp(fit), "-", color=style.SIMULATED, linewidth=1.0, label=f"exponent {c.exponent:.2f}")
        axes.loglog(x, c.y, "o", color=style.MEASURED, markersize=4.5, label="measured")
        axes.set_title(c.name, fontsize=style.TEXT, color=style.INK, fontweight="bold")
        axes.set_xlabel(c.over, fontsize=style.SMALL)
        axes.set_ylabel(c.unit, fontsize=style.SMALL)
        axes.set_xticks(c.x, labels=[str(n) for n in c.x])
        low, high = min(c.y), max(c.y)
        marks = [v for decade in range(-3, 6) for v in (10.0**decade, 2.0 * 10.0**decade, 5.0 * 10.0**decade)]
        shown = [v for v in marks if 0.6 * low <= v <= 1.6 * high]
        axes.set_yticks(shown, labels=[style.number(v) for v in shown])
        axes.set_ylim(0.55 * low, 1.7 * high)
        axes.minorticks_off()
        axes.tick_params(labelsize=style.SMALL)
        axes.grid(color=style.GRID, linewidth=0.5)
        axes.legend(fontsize=style.SMALL, frameon=False)
    drawing.tight_layout()
    return drawing


TEXT = textwrap.dedent("""\
    # Speed

    {head}

    The *ratio* is the time over the time of a bare `mujoco.rollout` of the shipped machine's model,
    with the same number of 1 ms steps on one core, timed in the same run. The bare rollout has no
    drives, no effects, no commands and no files. For a command, the steps are those of one simulation
    of all its tests. In the first rows the bare rollout is of the model in question, which has four
    more joints if every effect is on. Ratios depend little on the computer. Seconds do.

    {table}

    ![Time over the number of tests and of candidates, and memory over the number of tests](images/speed.png)

    *Points: measured. Line: the fitted power. Dotted: growth in proportion.*

    ## What takes the time

    **A simulation.** Half of the time and more is the step of MuJoCo itself: kinematics of ten bodies,
    mass matrix and bias forces. The simulated model leaves out what only serves to look at: meshes,
    cameras, lights and the bar. It also leaves out gravity if every moving body is balanced. The rest
    is the callback: drives and friction in two sub-steps for each axis, and the operations of the
    transmission. Most of these are one sine or one exponential. No Python runs in it.

    **Compare.** It simulates every test once, fits the nuisances and draws the plots. The plots take
    about as long as the simulations. The simulation of a test is discarded as soon as its reading is
    there. Its trace, its reading on three grids and its residual stay. The equations of the nuisances
    are put together test by test. They grow with the number of tests, not with its square.

    **Diagnose.** It computes the signatures of some 300 candidate effects on all tests. Signatures of
    quasi-static effects follow from one motion. For effects of a drive, its axis is simulated again.
    Then come joint fits of the best. The memory is that of the whitened signatures, (blocks,
    candidates), and of the columns of the data sheet. It grows with the number of tests.

    **The first command.** Numba compiles the engine when a command first needs it, and once more after
    an update of the code. This takes some ten seconds.

    More figures: [sweeps](batch.md#speed) and [videos](animation.md).
    """)
