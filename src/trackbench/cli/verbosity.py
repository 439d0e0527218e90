"""How much a command says: ``--quiet`` and ``--verbose``."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import click

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


class _Since(logging.Formatter):
    """Each message after the time since the start."""

    def format(self, record: logging.LogRecord) -> str:
        return f"{record.relativeCreated / 1000:7.2f} s  {super().format(record)}"


def _listen(ctx: click.Context, _: click.Parameter, verbose: bool) -> None:
    if verbose and not ctx.resilient_parsing:
        log_to_stderr(ctx, LOGGER, _Since())
