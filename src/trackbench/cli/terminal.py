"""What a command shows on stderr while it works: a progress bar, ``--quiet`` and ``--verbose``."""

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

#: Seconds from one line on the progress to the next where there is no terminal.
LINES_EVERY_S = 30.0


@contextmanager
def progress(what: str, unit: str, *, quiet: bool = False) -> Iterator[types.NotedProgress]:
    """A bar that goes away when the work is done; until it is told of a total, it only says that work goes on. Without
    a terminal a line every ``LINES_EVERY_S``.

    Args:
        what: the work.
        unit: what is counted.
        quiet: show nothing.

    Yields:
        A function to be called with how much is done, how much there is and, perhaps, what was reached.
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
        task = bar.add_task(escape(what), total=None, unit=unit, note="")
        said = time.monotonic()

        def advance(done: float, total: float, note: str = "") -> None:
            nonlocal said
            bar.update(task, completed=done, total=total, note=note)
            if not shown and not quiet and time.monotonic() - said >= LINES_EVERY_S:
                said = time.monotonic()
                parts = [f"{what}: {done:.0f} of {total:.0f} {unit}", note]
                print(", ".join(filter(None, parts)), file=sys.stderr)

        yield advance


@contextmanager
def if_interrupted(kept: str) -> Iterator[None]:
    """Say what is kept of the work in this context, where Ctrl-C ends it."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(kept) from None


Command = TypeVar("Command", bound=Callable[..., Any])

#: What every layer of trackbench says of its work goes to a logger below this one.
LOGGER = "trackbench"


def quiet_option(text: str) -> Callable[[Command], Command]:
    """``--quiet`` with its meaning for a command, which gets it as ``quiet``."""
    return click.option("-q", "--quiet", is_flag=True, help=text)


def verbose_option(command: Command) -> Command:
    """``--verbose``: the log of a command's work goes to stderr while it runs. The command gets nothing of it."""
    return click.option(
        "-v", "--verbose", is_flag=True, expose_value=False, callback=_listen, help="Say on stderr what is done."
    )(command)


def log_to_stderr(ctx: click.Context, name: str, formatter: logging.Formatter, level: int = logging.INFO) -> None:
    """Send what a logger gets to stderr, until the command ends."""
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
    """Writes to stderr as it is at each message: a progress bar stands in for it while it is shown."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr)


def _listen(ctx: click.Context, _: click.Parameter, verbose: bool) -> None:
    if verbose and not ctx.resilient_parsing:
        log_to_stderr(ctx, LOGGER, logging.Formatter("%(relativeCreated)7.0f ms  %(message)s"))
