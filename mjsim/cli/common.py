"""What every command shares: options, progress on stderr, JSON on stdout, errors as one sentence."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import contextmanager
from functools import wraps
from pathlib import Path

import click

from mjsim.errors import InputError, SimulationError


def options(command: Callable) -> Callable:
    """Add ``--json`` and ``--quiet`` and turn errors into one sentence and exit status 1."""

    @wraps(command)
    def run(*args, **kwargs):
        try:
            return command(*args, **kwargs)
        except (InputError, SimulationError) as error:
            click.echo(f"mjsim: {error}", err=True)
            sys.exit(1)
        except BrokenPipeError:
            sys.exit(0)
        except KeyboardInterrupt:
            click.echo("mjsim: stopped; nothing half-written is left behind", err=True)
            sys.exit(130)

    run = click.option("--quiet", is_flag=True, help="No progress and no messages.")(run)
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout and nothing else there.")(run)


campaign_argument = click.argument("campaign", type=click.Path(path_type=Path))
machine_option = click.option("--machine", type=click.Path(path_type=Path), help="Machine file to use instead of the campaign's.")
threads_option = click.option("--threads", type=click.IntRange(1, 256), default=None, help="Tests worked on side by side (default: all cores).")


def cores(threads: int | None) -> int:
    """Threads asked for, or all cores."""
    import os

    return threads or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else threads or os.cpu_count() or 1


def print_json(data: dict) -> None:
    """One JSON object on stdout."""
    click.echo(json.dumps(data, indent=1, ensure_ascii=False))


@contextmanager
def progress_bar(quiet: bool):
    """A ``progress(stage, done, total)`` function that draws on stderr; silent when quiet or when stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda stage, done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    with Progress(
        TextColumn("{task.description}"), BarColumn(bar_width=24), TextColumn("{task.completed}/{task.total}"), TimeElapsedColumn(),
        console=Console(stderr=True), transient=True,
    ) as bars:
        task = bars.add_task("starting", total=1)
        now = [""]

        def show(stage: str, done: int, total: int) -> None:
            if stage != now[0]:
                now[0] = stage
                bars.reset(task, total=total, completed=done, description=stage)
            bars.update(task, completed=done, total=total)

        yield show


def say(text: str, quiet: bool) -> None:
    """A message for the user on stderr."""
    if not quiet:
        click.echo(text, err=True)


def table(columns: list[str], rows: list[list[str]], title: str | None = None) -> None:
    """A table on stdout that fits 80 columns; the first column is text, the others are numbers."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 100, highlight=False)
    t = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="bold")
    for i, name in enumerate(columns):
        t.add_column(name, justify="left" if i == 0 else "right", overflow="fold")
    for row in rows:
        t.add_row(*row)
    console.print(t)
