"""Progress bar and log of a command on stderr, and the options ``--quiet`` and ``--verbose``."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from trackbench.base import types

#: Time between two lines on the progress where there is no terminal, s.
LINES_EVERY_S = 30.0


@contextmanager
def progress(work: str, unit: str, *, quiet: bool = False) -> Iterator[types.NotedProgress]:
    """Show a progress bar until the work is done; if stderr is no terminal, print a line every ``LINES_EVERY_S`` s.

    Args:
        work: name of the work.
        unit: unit in which the progress is counted.
        quiet: whether nothing is shown.

    Yields:
        A function to call with the amount done, the total and, optionally, a note on what was reached.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TextColumn("{task.fields[unit]} {task.fields[note]}"),
        TimeRemainingColumn(compact=True),
    )
    # Rich may be told by its environment to write as to a terminal; what is redirected still gets no bar.
    shown = sys.stderr.isatty() and not console.is_dumb_terminal and not quiet
    with Progress(*columns, console=console, transient=True, expand=True, disable=not shown) as bar:
        task = bar.add_task(escape(work), total=None, unit=unit, note="")
        printed = time.monotonic()

        def advance(done: float, total: float, note: str = "") -> None:
            nonlocal printed
            bar.update(task, completed=done, total=total, note=note)
            if not shown and not quiet and time.monotonic() - printed >= LINES_EVERY_S:
                printed = time.monotonic()
                parts = [f"{work}: {done:.0f} of {total:.0f} {unit}", note]
                print(", ".join(filter(None, parts)), file=sys.stderr)

        yield advance


@contextmanager
def if_interrupted(kept: str) -> Iterator[None]:
    """Run a context; if Ctrl-C ends it, raise the interrupt again with ``kept``, the part of the work that is kept."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(kept) from None


Command = TypeVar("Command", bound=Callable[..., Any])

#: Name of the logger above all loggers of trackbench.
LOGGER = "trackbench"


def quiet_option(text: str) -> Callable[[Command], Command]:
    """Return the decorator that adds ``--quiet`` to a command, with ``text`` as its help."""
    return click.option("-q", "--quiet", is_flag=True, help=text)


def verbose_option(command: Command) -> Command:
    """Add ``--verbose``, which sends the log to stderr; it is not passed to the command's function."""
    return click.option(
        "-v", "--verbose", is_flag=True, expose_value=False, callback=_listen, help="Say on stderr what is done."
    )(command)


def log_to_stderr(ctx: click.Context, name: str, formatter: logging.Formatter, level: int = logging.INFO) -> None:
    """Send the messages of a logger to stderr until the command ends."""
    logger, handler = logging.getLogger(name), _Stderr()
    handler.setFormatter(formatter)
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(level)

    def end() -> None:
        logger.removeHandler(handler)
        logger.setLevel(before)

    ctx.call_on_close(end)


class _Stderr(logging.Handler):
    """Handler that looks up ``sys.stderr`` at each message, since a visible progress bar replaces it."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr)


def _listen(ctx: click.Context, _: click.Parameter, verbose: bool) -> None:
    if verbose and not ctx.resilient_parsing:
        log_to_stderr(ctx, LOGGER, logging.Formatter("%(relativeCreated)7.0f ms  %(message)s"))
