"""How a command keeps trackers that are not built in apart from the bench."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import click


def isolation_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options, and give the command ``isolation``, an :class:`trackbench.driving.Isolation`."""

    @click.option(
        "--tracker-timeout",
        type=click.FloatRange(0, 86_400, min_open=True),
        default=300,
        show_default=True,
        metavar="S",
        help="Most that your own tracker may take for a scan, s.",
    )
    @click.option("--in-process", is_flag=True, help="Run it in this process, without a timeout, for a debugger.")
    @functools.wraps(command)
    def wrapped(*arguments: Any, tracker_timeout: float, in_process: bool, **options: Any) -> Any:
        from trackbench.driving.isolation import Isolation

        return command(*arguments, isolation=Isolation(in_process, tracker_timeout), **options)

    return wrapped
