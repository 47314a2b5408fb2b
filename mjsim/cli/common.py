"""What every command shares: options, progress on stderr, JSON on stdout, errors as one sentence."""

from __future__ import annotations

import io
import json
import math
import os
import shutil
import signal
import sys
import textwrap
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import NoReturn

import click

from mjsim.errors import InputError, SimulationError, shortened

# -- ctrl-C and SIGTERM ------------------------------------------------------------------------------------------------


class Terminated(KeyboardInterrupt):
    """SIGTERM."""


_stop: KeyboardInterrupt | None = None


@contextmanager
def caught() -> Iterator[None]:
    """Inside, Ctrl-C and SIGTERM raise; one that the caller ignores (a job in the background) stays ignored.

    Only a process' main thread can have that.
    """
    global _stop
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: object) -> None:
        global _stop
        _stop = Terminated() if number == signal.SIGTERM else KeyboardInterrupt()
        raise _stop

    _stop = None
    wanted = [n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) is not signal.SIG_IGN]
    former = {n: signal.signal(n, stop) for n in wanted}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler or signal.SIG_DFL)


def raise_again() -> None:
    """Raise once more what came in: Python drops an exception that is raised inside a destructor or a library's
    callback.
    """
    if _stop is not None:
        raise _stop


def status(stop: KeyboardInterrupt) -> int:
    """Exit status of a stopped command."""
    return 143 if isinstance(stop, Terminated) else 130


#: Columns that output fits where stdout is no terminal.
WIDTH = 80
#: Where the context of a command has its wishes.
_JSON, _QUIET = "mjsim.json", "mjsim.quiet"
#: With this variable set, a fault of mjsim's own shows where it happened.
TRACEBACK = "MJSIM_TRACEBACK"


def options(command: Callable) -> Callable:
    """Add ``--json`` and ``--quiet``; turn errors into one sentence and exit status 1, never a traceback."""

    @wraps(command)
    def run(*args, no_cache: bool = False, **kwargs):
        for stream in (sys.stdout, sys.stderr):  # a terminal that has no µ, a folder's name that is no text
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")
        try:
            from mjsim.io.cache import cached

            with caught(), warnings.catch_warnings(), cached(wanted=not no_cache):
                if (
                    not sys.warnoptions
                ):  # what numpy or a plotting library has to say is for developers (python -W default shows it)
                    warnings.simplefilter("ignore")
                return command(*args, **kwargs)
        except (InputError, SimulationError) as error:
            fail(str(error))
        except BrokenPipeError:
            sys.exit(0)
        except OSError as error:
            fail(f"{error.filename or 'file'}: {error.strerror or error}")
        except MemoryError:
            fail("not enough memory for this; fewer or shorter tests, thinner traces or fewer --threads need less")
        except KeyboardInterrupt as stop:
            click.echo("mjsim: stopped; nothing half-written is left behind", err=True)
            sys.exit(status(stop))
        except click.exceptions.Exit:
            raise
        except click.ClickException:
            raise
        except Exception as fault:
            if os.environ.get(TRACEBACK):
                raise
            if line := _line_of_user(fault):
                fail(f"{line}: raised {type(fault).__name__}: {fault}")
            _own_fault(fault)

    run = click.option("--no-cache", is_flag=True, help="Compute everything anew.")(run)
    run = _flag("--quiet", _QUIET, "Print nothing but errors (and the JSON, with --json).")(run)
    return _flag("--json", _JSON, "Print one JSON object on stdout and nothing else there.")(run)


def _flag(option: str, key: str, text: str):
    """An option that all below the command can look at, whatever stands between."""

    def keep(ctx: click.Context, param: click.Parameter, value: bool) -> None:
        ctx.meta[key] = value

    return click.option(option, is_flag=True, expose_value=False, callback=keep, help=text)


def _is_set(key: str) -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and context.meta.get(key, False)


def wants_json() -> bool:
    """Whether stdout is for one JSON object."""
    return _is_set(_JSON)


def is_quiet() -> bool:
    """Whether nothing but errors and JSON is printed."""
    return _is_set(_QUIET)


def _line_of_user(fault: Exception) -> str:
    """File and line of a user's own effect that an error passed through last; empty where there is none."""
    import traceback

    frames = [
        (f, n)
        for f, n in traceback.walk_tb(fault.__traceback__)
        if str(f.f_globals.get("__name__")).startswith("mjsim_user_")
    ]
    return f"{Path(frames[-1][0].f_code.co_filename).name}, line {frames[-1][1]}" if frames else ""


def _own_fault(fault: Exception) -> NoReturn:
    """One line for what should not have happened, and exit status 3."""
    import traceback

    at = traceback.extract_tb(fault.__traceback__)[-1]
    place = f"{Path(at.filename).name}, line {at.lineno}"
    click.echo(
        "mjsim: "
        + shortened(f"a fault of mjsim itself: {type(fault).__name__} in {place}: {fault}", 450)
        + f"; please report it, with the output under {TRACEBACK}=1",
        err=True,
    )
    sys.exit(3)


def fail(sentence: str) -> NoReturn:
    """One line on stderr and exit status 1."""
    click.echo("mjsim: " + shortened(sentence), err=True)
    sys.exit(1)


class _Finite(click.ParamType):
    """A number; not nan and not infinite, which Python's own reading of numbers takes as well."""

    name = "float"

    def convert(self, value, param, ctx):
        number = click.FLOAT.convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


NUMBER = _Finite()


def effect_ids(ctx: click.Context, param: click.Parameter, incomplete: str) -> list:
    """Completions of an effect's id: the kinds, then the kind's ids; a file of one's own where it looks like one."""
    from click.shell_completion import CompletionItem

    from mjsim.effects import registry

    if "/" in incomplete or os.sep in incomplete or incomplete.startswith("~"):
        return [CompletionItem(incomplete, type="file")]
    return [CompletionItem(i) for i in registry.all_ids() if i.startswith(incomplete)]


def test_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Completions of a test's name, from the campaign that the line names; none where it cannot be read."""
    import tomllib

    from click.shell_completion import split_arg_string

    # with `--test` still open click has not looked at the arguments yet: the campaign is the first word that is one
    words = [str(ctx.params.get("campaign") or ""), *split_arg_string(os.environ.get("COMP_WORDS", ""))]
    for word in filter(None, words):
        folder = Path(word).expanduser()
        file = folder if folder.name.endswith(".toml") else folder / "campaign.toml"
        try:
            names = [str(t["name"]) for t in tomllib.loads(file.read_text(encoding="utf-8-sig"))["test"]]
        except (OSError, ValueError, KeyError, TypeError):
            continue
        return [n for n in names if n.startswith(incomplete)]
    return []


def path_type(**more) -> click.Path:
    """A path, as :class:`click.Path`; one that cannot be read is no wrong usage, so its reader says that."""
    return click.Path(path_type=Path, readable=False, **more)


def path_option(*names: str, **more):
    """An option with the path of a file or folder that is read.

    Args:
        names: Of the option, as :func:`click.option` takes them.
        more: As there.
    """
    return click.option(*names, type=path_type(), **more)


def file_option(*names: str, **more):
    """An option with the path of a file to write; see :func:`path_option`."""
    return click.option(*names, type=path_type(dir_okay=False), **more)


def folder_option(*names: str, **more):
    """An option with the path of a folder to write into; see :func:`path_option`."""
    return click.option(*names, type=path_type(file_okay=False), **more)


campaign_argument = click.argument("campaign", type=path_type())
machine_option = path_option("--machine", help="Machine file to use instead of the campaign's.")
test_option = click.option(
    "--test",
    "only",
    multiple=True,
    shell_complete=test_names,
    help="Use this measured test only (may be given more than once).",
)
names_option = click.option(
    "--test",
    "names",
    multiple=True,
    shell_complete=test_names,
    help="Only this test (may be given more than once).",
)


def range_option(text: str):
    """``--range AXIS LOW HIGH``, several times.

    Args:
        text: What it says of the option.
    """
    kind = (str, NUMBER, NUMBER)
    return click.option("--range", "ranges", type=kind, multiple=True, metavar="AXIS LOW HIGH", help=text)


def sphere_option(text: str):
    """``--sphere X Y Z``, the centre of a sphere.

    Args:
        text: What it says of the option.
    """
    return click.option("--sphere", nargs=3, type=NUMBER, metavar="X Y Z", default=None, help=text)


max_effects_option = click.option(
    "--max-effects",
    type=click.IntRange(1, 20),
    help="Look for at most so many effects; otherwise for all that the data prove.",
)
as_is_option = click.option(
    "--as-is", is_flag=True, help="Do not look for a wrong unit, sign or direction first (see mjsim check)."
)
threads_option = click.option(
    "--threads", type=click.IntRange(1, 256), default=None, help="Tests worked on side by side (default: all cores)."
)


def campaign_and_machine(
    campaign: Path, machine: Path | None, as_is: bool = False, traces: bool = True, empty: bool = False
):
    """What a command is about.

    Args:
        campaign: Folder of the campaign.
        machine: Machine file in the place of the campaign's own.
        as_is: Do not look for mistakes in it.
        traces: Read the measurements.
        empty: Allow a campaign that has no test yet.

    Raises:
        InputError: One of them cannot be read.
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of

    c = read_campaign(campaign, traces, as_is=as_is, empty=empty)
    return c, machine_of(c, machine)


def cores(threads: int | None) -> int:
    """Threads asked for, or all cores."""
    if threads:
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def each_part(parts, data: dict):
    """Each instrument's part with its own JSON in turn; above all but the first one a heading is printed.

    Args:
        parts: Of a check or a comparison.
        data: Their JSON as one object.
    """
    from mjsim.commands.comparison import apart
    from mjsim.instruments.base import INSTRUMENTS

    for i, (part, mine) in enumerate(apart(parts, data)):
        if i:
            click.echo(f"\n{INSTRUMENTS[part.instrument].test_noun}s:")
        yield part, mine


def print_json(data: dict) -> None:
    """One JSON object on stdout."""
    from mjsim.io.files import finite

    text = json.dumps(finite(data), indent=1, ensure_ascii=False, allow_nan=False)
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:  # escapes are JSON as well
        text = json.dumps(finite(data), indent=1, allow_nan=False)
    click.echo(text)


def answered(data: dict) -> bool:
    """Print the JSON where it is asked for; whether there is nothing more to print on stdout."""
    if wants_json():
        print_json(data)
    return wants_json() or is_quiet()


def styled(stream) -> bool:
    """Whether output may have colours: NO_COLOR forbids them, FORCE_COLOR asks for them, otherwise a terminal that
    is not dumb has them.
    """
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or (
        stream.isatty() and os.environ.get("TERM", "") not in ("dumb", "unknown")
    )


@contextmanager
def progress_bar(left: bool = False):
    """A ``progress(stage, done, total)`` function that draws on stderr; silent when quiet or when stderr is no
    terminal.

    ``left``: show the time left as well, where the steps of a stage take equally long.

    Without colours the bar is plain text on one line that is written again and again.
    """
    if is_quiet() or not sys.stderr.isatty():
        yield lambda stage, done, total: None
        return
    if not styled(sys.stderr):
        yield _plain_progress
        sys.stderr.write("\r" + " " * (WIDTH - 1) + "\r")
        sys.stderr.flush()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    with Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.completed}/{task.total}"),
        TimeElapsedColumn(),
        *([TextColumn("left"), TimeRemainingColumn()] if left else []),
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


@contextmanager
def resumable_progress(out: Path):
    """A progress bar for work that the same command continues where it was stopped.

    Args:
        out: Where finished results are.
    """
    try:
        with progress_bar(left=True) as bar:

            def progress(stage: str, done: int, total: int) -> None:
                raise_again()
                bar(stage, done, total)

            yield progress
    except KeyboardInterrupt as stop:
        say(f"mjsim: stopped; finished results are in {out}, and the same command continues from there", always=True)
        sys.exit(status(stop))


def _plain_progress(stage: str, done: int, total: int) -> None:
    sys.stderr.write("\r" + f"{stage} {done}/{total}"[: WIDTH - 1].ljust(WIDTH - 1))
    sys.stderr.flush()


def say(text: str, always: bool = False) -> None:
    """A message for the user on stderr; wrapped on a terminal, one line elsewhere.

    Args:
        text: Of one or several lines.
        always: Also where the user wants it quiet.
    """
    if always or not is_quiet():
        columns = shutil.get_terminal_size((WIDTH, 24)).columns
        click.echo(
            "\n".join(_wrapped(line, columns) for line in text.split("\n")) if sys.stderr.isatty() else text, err=True
        )


def width() -> int:
    """Columns of the terminal, 80 where stdout is none."""
    return shutil.get_terminal_size((WIDTH, 24)).columns if sys.stdout.isatty() else WIDTH


def paragraph(text: str, indent: str = "") -> None:
    """A text on stdout, wrapped."""
    click.echo(_wrapped(text, width(), indent))


def _wrapped(text: str, columns: int, indent: str = "") -> str:
    """Lines of at most so many columns; paths and names are not broken."""
    return textwrap.fill(
        text,
        columns,
        initial_indent=indent,
        subsequent_indent=indent + "  ",
        break_on_hyphens=False,
        break_long_words=False,
    )


def next_steps(*steps: str) -> None:
    """What a user does next, numbered."""
    click.echo("\nNext:")
    for number, step in enumerate(steps, start=1):
        click.echo(f"  {number}. {step}")


def table(columns: list[str], rows: list[list[str]], text: tuple[int, ...] = (0,)) -> None:
    """A table on stdout that fits the terminal, or 80 columns; the columns ``text`` hold text, the others numbers."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    colours = styled(sys.stdout)
    # the colour system is all or nothing: rich on its own leaves bold type where NO_COLOR is set
    console = Console(width=width(), highlight=False, force_terminal=colours, color_system="auto" if colours else None)
    lines = box.SIMPLE_HEAD if sys.stdout.isatty() else None
    t = Table(box=lines, show_edge=False, pad_edge=False, header_style="bold")
    widths = _column_widths([columns, *rows], width() - (len(columns) - 1) * (3 if lines else 2))
    for i, name in enumerate(columns):
        t.add_column(Text(name), justify="left" if i in text else "right", overflow="fold", max_width=widths[i])
    for row in rows:
        t.add_row(*map(Text, row))
    with console.capture() as captured:
        console.print(t)
    click.echo("\n".join(line.rstrip() for line in captured.get().splitlines()), color=colours)


def _column_widths(rows: list[list[str]], room: int) -> list[int]:
    """Widths of the columns of a table in so many characters: the widest column is wrapped first, and no word is broken
    while there is room for its column.
    """
    cells = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in cells]
    words = [max(len(word) for cell in column for word in ["", *cell.split()]) for column in cells]
    while sum(widths) > room and widths != words:
        widest = max((i for i in range(len(cells)) if widths[i] > words[i]), key=widths.__getitem__)
        widths[widest] -= 1
    return widths
