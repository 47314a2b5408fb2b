"""A video of the ladder: what each model leaves unexplained, test by test, and the RMS falling beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjsim.animation.board import Board
from mjsim.animation.movie import Film, Format
from mjsim.campaign.model import Campaign
from mjsim.commands.ball_bar.compare import BarComparison, compare_bars
from mjsim.commands.history import machine_of_step, read_history
from mjsim.errors import InputError
from mjsim.io import files
from mjsim.progress import Progress, silent

#: Polar plots in one picture at most, and how long a model stands and gives way to the next, s.
MOST_TESTS, STAND, CHANGE = 9, 1.5, 1.0


@dataclass(frozen=True)
class LadderFilm(Film):
    """A video of a ladder: tests shown, and each model's name and RMS (m)."""

    tests: tuple[str, ...]
    models: tuple[tuple[str, float], ...]


def animate_ladder(
    campaign: Campaign,
    file: str | Path,
    tests: Sequence[str] = (),
    size: str | None = None,
    fps: float | None = None,
    seconds: float | None = None,
    force: bool = False,
    threads: int = 2,
    progress: Progress = silent,
) -> LadderFilm:
    """Write a video of the models in a campaign's history, each simulated and compared again.

    Args:
        campaign: with traces and a history of at least two models.
        file, size, fps, force: as :func:`mjsim.animation.movie.animate` has them. tests: up to nine names; the worst
            ones when missing.
        seconds: duration; 1.5 s for each model and 1 s between two of them when missing.

    Raises:
        InputError: no history, one that does not hold the machines, unknown or too many tests, a wrong value, a file in
            the way.
    """
    file = Path(file)
    form = Format.of(file, size, fps)
    measured = [t.name for t in campaign.in_motion.measured]
    for name in tests:
        if name not in measured:
            raise InputError(
                f"{campaign.folder / 'campaign.toml'}: no measured test {name!r}; it has: "
                f"{', '.join(measured) or 'none'}"
            )
    if len(tests) > MOST_TESTS:
        raise InputError(f"{len(tests)} tests; allowed: up to {MOST_TESTS} in one picture")
    steps = read_history(campaign)
    if len(steps) < 2:
        raise InputError(
            f"{campaign.folder}: the ladder has {'no' if not steps else 'only one'} model; "
            f"`mjsim add {campaign.folder} EFFECT` records the first steps"
        )
    machines = [machine_of_step(campaign, s) for s in steps]
    count = form.frames(STAND * len(steps) + CHANGE * (len(steps) - 1) if seconds is None else seconds)
    files.check_writable(file, force)
    rungs = []
    for i, machine in enumerate(machines):
        part = lambda stage, done, total, i=i: progress(f"model {i + 1} of {len(machines)}", done, total)  # noqa: E731
        rungs.append(compare_bars(campaign, machine, threads, part))
    shown = _chosen(rungs[0], tests)
    board = Board(campaign.name, [s.label for s in steps], rungs, shown, form.size)
    form.write(file, map(board.frame, places(len(steps), count)), count, force, progress)
    return LadderFilm(
        file,
        count,
        form.size,
        form.fps,
        tuple(shown),
        tuple((s.label, c.rms) for s, c in zip(steps, rungs, strict=True)),
    )


def places(models: int, frames: int) -> np.ndarray:
    """Where on the ladder each frame stands, (frames,): whole numbers are models, between them one gives way to the
    next.
    """
    whole = STAND * models + CHANGE * (models - 1)
    time = np.linspace(0.0, whole, frames)
    index = np.minimum(np.floor(time / (STAND + CHANGE)), models - 1)
    x = np.clip((time - index * (STAND + CHANGE) - STAND) / CHANGE, 0.0, 1.0)
    return np.minimum(index + x * x * (3.0 - 2.0 * x), models - 1)


def _chosen(first: BarComparison, tests: Sequence[str]) -> list[str]:
    """Tests to show, in the campaign's order: those asked for, or the ones that the first model explains worst."""
    worst = sorted(first.tests, key=lambda t: -t.rms)[:MOST_TESTS]
    wanted = set(tests) or {t.test.name for t in worst}
    return [t.test.name for t in first.tests if t.test.name in wanted]
