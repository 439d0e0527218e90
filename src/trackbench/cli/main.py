"""``trackbench``: the commands, and what becomes of an error."""

from __future__ import annotations

import os
import signal
import sys
from typing import Any

import click

from trackbench import __version__
from trackbench.cli.audit import audit_command
from trackbench.cli.compare import compare_command
from trackbench.cli.completion import completion_command
from trackbench.cli.doctor import doctor_command
from trackbench.cli.inspect import inspect_command
from trackbench.cli.listing import list_command
from trackbench.cli.new import new_command
from trackbench.cli.report import report_command
from trackbench.cli.run import run_command
from trackbench.cli.serve import INTERRUPTED, serve_command
from trackbench.cli.snapshot import snapshot_command
from trackbench.cli.validate import check_command, schema_command
from trackbench.cli.view import view_command
from trackbench.errors import InputError, TrackbenchError

BAD_INPUT = 2
#: What a shell reports of a program whose reader has gone.
UNREAD = 141


class Commands(click.Group):
    """The commands; one that is interrupted says so in one line, before which Click would print an empty one."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise click.exceptions.Exit(_interrupted()) from None


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="trackbench")
def cli() -> None:
    """
    \b
    Run vehicle trackers on the same truth and noise, and compare their errors.
    Example:  trackbench run highway
    """


for _command in (
    run_command,
    compare_command,
    report_command,
    doctor_command,
    audit_command,
    list_command,
    new_command,
    check_command,
    schema_command,
    serve_command,
    view_command,
    inspect_command,
    snapshot_command,
    completion_command,
):
    cli.add_command(_command)


def main() -> None:
    """The console script. Exit status: see the README."""
    # A run that is told to end tidies up as one that is interrupted.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        status = cli.main(prog_name="trackbench", standalone_mode=False)
    except click.exceptions.Exit as stop:
        status = stop.exit_code
    except click.ClickException as error:
        error.show()
        status = BAD_INPUT
    except InputError as error:
        click.echo(str(error), err=True)
        status = BAD_INPUT
    except TrackbenchError as error:
        click.echo(f"trackbench: {error}", err=True)
        status = BAD_INPUT
    except (click.Abort, KeyboardInterrupt):
        status = _interrupted()
    except BrokenPipeError:
        status = _unread()
    except SystemExit as end:
        # Click and Rich turn a broken pipe into an exit with status 1; what a shell's completion asks ends with 0.
        status = _unread() if end.code else 0
    sys.exit(status if isinstance(status, int) else 0)


def _unread() -> int:
    """What is still buffered goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return UNREAD


def _interrupted() -> int:
    # The terminal has shown the key as ^C at the start of the line, and gets written over it.
    start = "\r" if sys.stderr.isatty() else ""
    click.echo(f"{start}interrupted: the unfinished run was not kept", err=True)
    return INTERRUPTED
