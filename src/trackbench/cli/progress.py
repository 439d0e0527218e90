"""How far long work has come, and how long it will take, on stderr where that is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.table import Column
from rich.text import Text

from trackbench.base import types


class _Left(ProgressColumn):
    """ "120 of 401 steps, 0:03 left"."""

    def render(self, task: Task) -> Text:
        if task.total is None:
            return Text()
        text = f"{task.completed:.0f} of {task.total:.0f} {task.fields['unit']}"
        if task.time_remaining is not None:
            minutes, seconds = divmod(round(task.time_remaining), 60)
            hours, minutes = divmod(minutes, 60)
            text += f", {hours}:{minutes:02}:{seconds:02} left" if hours else f", {minutes}:{seconds:02} left"
        return Text(text, no_wrap=True)


@contextmanager
def progress(what: str, unit: str, *, quiet: bool = False) -> Iterator[types.Progress]:
    """A bar that goes away when the work is done; until it is told of a total, it only says that work goes on.

    Args:
        what: the work.
        unit: what is counted.
        quiet: show nothing.

    Yields:
        A function to be called with how much is done and how much there is.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
        BarColumn(bar_width=20),
        _Left(),
    )
    # Rich may be told by its environment to write as to a terminal; what is redirected still gets no bar.
    shown = sys.stderr.isatty() and not console.is_dumb_terminal and not quiet
    with Progress(*columns, console=console, transient=True, expand=True, disable=not shown) as bar:
        task = bar.add_task(escape(what), total=None, unit=unit)
        yield lambda done, total: bar.update(task, completed=done, total=total)
