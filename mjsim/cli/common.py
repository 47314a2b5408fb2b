"""What every command shares: options, progress on stderr, JSON on stdout, errors as one sentence."""

from __future__ import annotations

import json
import math
import shutil
import sys
import textwrap
from collections.abc import Callable
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import NoReturn

import click

from mjsim.errors import InputError, SimulationError

#: Columns that output fits where stdout is no terminal.
WIDTH = 80


def options(command: Callable) -> Callable:
    """Add ``--json`` and ``--quiet`` and turn errors into one sentence and exit status 1."""

    @wraps(command)
    def run(*args, **kwargs):
        try:
            return command(*args, **kwargs)
        except (InputError, SimulationError) as error:
            fail(str(error))
        except BrokenPipeError:
            sys.exit(0)
        except OSError as error:
            fail(f"{error.filename or 'file'}: {error.strerror or error}")
        except KeyboardInterrupt:
            click.echo("mjsim: stopped; nothing half-written is left behind", err=True)
            sys.exit(130)

    run = click.option("--quiet", is_flag=True, help="Print nothing but errors (and the JSON, with --json).")(run)
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout and nothing else there.")(run)


def fail(sentence: str) -> NoReturn:
    """One line on stderr and exit status 1."""
    click.echo("mjsim: " + "".join(c if c.isprintable() else " " for c in " ".join(sentence.split())), err=True)
    sys.exit(1)


campaign_argument = click.argument("campaign", type=click.Path(path_type=Path))
machine_option = click.option("--machine", type=click.Path(path_type=Path), help="Machine file to use instead of the campaign's.")
threads_option = click.option(
    "--threads", type=click.IntRange(1, 256), default=None, help="Tests worked on side by side (default: all cores)."
)


def cores(threads: int | None) -> int:
    """Threads asked for, or all cores."""
    import os

    return threads or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else threads or os.cpu_count() or 1


def print_json(data: dict) -> None:
    """One JSON object on stdout."""
    click.echo(json.dumps(finite(data), indent=1, ensure_ascii=False, allow_nan=False))


def finite(value):
    """The same data with ``null`` for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def progress_bar(quiet: bool):
    """A ``progress(stage, done, total)`` function that draws on stderr; silent when quiet or when stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda stage, done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    with Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.completed}/{task.total}"),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
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


def width() -> int:
    """Columns of the terminal, 80 where stdout is none."""
    return shutil.get_terminal_size((WIDTH, 24)).columns if sys.stdout.isatty() else WIDTH


def paragraph(text: str, indent: str = "") -> None:
    """A text on stdout, wrapped."""
    click.echo(
        textwrap.fill(text, width(), initial_indent=indent, subsequent_indent=indent + "  ", break_on_hyphens=False, break_long_words=False)
    )


def table(columns: list[str], rows: list[list[str]], text: tuple[int, ...] = (0,)) -> None:
    """A table on stdout that fits the terminal, or 80 columns; the columns ``text`` hold text, the others numbers."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(width=width(), highlight=False)
    t = Table(box=box.SIMPLE_HEAD if console.is_terminal else None, show_edge=False, pad_edge=False, header_style="bold")
    for i, name in enumerate(columns):
        t.add_column(Text(name), justify="left" if i in text else "right", overflow="fold")
    for row in rows:
        t.add_row(*map(Text, row))
    with console.capture() as captured:
        console.print(t)
    click.echo("\n".join(line.rstrip() for line in captured.get().splitlines()))
