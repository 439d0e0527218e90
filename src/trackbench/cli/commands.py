"""``trackbench``: its commands, and the message and exit status of each kind of error."""

from __future__ import annotations

import errno
import io
import logging
import os
import signal
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from trackbench.base.errors import (
    InputError,
    OutputError,
    TrackbenchError,
    printable,
    shortened_text,
)
from trackbench.base.exit_status import BAD_INPUT, CANNOT_WRITE, FAULT, INTERRUPTED, UNREAD
from trackbench.base.plugins import with_plugins
from trackbench.base.subjects import Offer, kind_of_file, offered, resolve
from trackbench.base.user_code import place_of
from trackbench.cli.answer import answer
from trackbench.cli.parent import UNFINISHED

log = logging.getLogger(__name__)


def _require_stdout() -> None:
    """Raise an error if standard output is closed, before any work is done for it.

    Raises:
        OutputError: standard output is closed.
    """
    if answer() is None:
        raise OutputError("standard output is closed; to print nothing, send it to /dev/null")


def _fail(text: str, status: int) -> int:
    """Print a message on stderr, if stderr can be written, and return the exit status ``status``."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()
    return status


def _and_plugins() -> str:
    """Return the end of an error message: the names of the installed plug-ins; empty if there are none."""
    words = with_plugins()
    return words and f", {words}"


def _abandon_streams() -> None:
    """Redirect unwritable streams to the null device, so that the interpreter does not fail on them at its end."""
    for stream in (answer(), sys.stderr):
        if stream is None:
            continue
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


_WRITTEN = ["a result", "a report", *(kind_of_file(file) for file, _ in offered("artifacts"))]
RUN_SUMMARY = f"Score every tracker; write {', '.join(_WRITTEN[:-1])} and {_WRITTEN[-1]}."
COMMANDS = {
    "run": Offer("trackbench.cli.run:run_command", RUN_SUMMARY),
    "compare": Offer(
        "trackbench.cli.report:compare_command", "Compare the trackers of finished runs, or versions of them."
    ),
    "report": Offer("trackbench.cli.report:report_command", "Write the report of a saved result in any format."),
    "list": Offer("trackbench.cli.listing:list_command", "Show what a scenario or an option can name."),
    "explain": Offer("trackbench.cli.explain:explain_command", "Print the page of a term of a table or a report."),
    "check": Offer("trackbench.cli.listing:check_command", "Validate scenario files without running them."),
    "schema": Offer("trackbench.cli.listing:schema_command", "Print the JSON Schema of a scenario file, for editors."),
    **dict(offered("commands")),
}


class Commands(click.Group):
    """Click group of all commands, which imports a command only when it is called."""

    def invoke(self, ctx: click.Context) -> Any:
        # Click would print an empty line before the message of an interrupted command.
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, EOFError) as error:
            raise click.exceptions.Exit(_interrupted(error)) from None
        except OSError as error:
            # Click takes any broken pipe for that of standard output.
            if place_of(error, installed=False) is None:
                raise
            raise click.exceptions.Exit(_plugin_failed(error)) from None

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = resolve(COMMANDS[cmd_name].target)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        # The summary of a command is known without importing it.
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name].summary) for name in self.list_commands(ctx)])


@click.group(
    cls=Commands,
    commands=dict.fromkeys(COMMANDS),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="trackbench", prog_name="trackbench")
def cli() -> None:
    """
    \b
    Example:  trackbench run highway    # trackers, on the same truth and noise
    """  # noqa: D205, D212, D415


def run_command_line() -> int:
    """Run the command in ``sys.argv`` and return its exit status, which the README explains."""
    # A run that gets SIGTERM tidies up as after Ctrl-C.
    for number in (signal.SIGINT, signal.SIGTERM):
        if number == signal.SIGTERM or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interruption)
    try:
        status = _run()
        if (output := answer()) is not None:
            output.flush()
    except BrokenPipeError:
        status = UNREAD
    except OSError as error:
        where = "standard output" if error.filename is None else shortened_text(str(error.filename))
        if error.errno == errno.ENAMETOOLONG:
            status = _fail(f"{where}: the name is too long for the file system", BAD_INPUT)
        else:
            problem = f"cannot write {where}: {error.strerror or error}{_and_plugins()}"
            status = _fail(f"trackbench: {problem}", CANNOT_WRITE)
    except KeyboardInterrupt as error:
        status = _interrupted(error)
    _abandon_streams()
    return status


def _run() -> int:
    """Run the command, print the message of its error, if any, and return the exit status.

    Raises:
        OSError: standard output cannot be written.
    """
    try:
        _require_stdout()
        _require_place()
        status = cli.main(prog_name="trackbench", standalone_mode=False)
    except click.exceptions.Exit as stop:
        status = stop.exit_code
    except click.ClickException as error:
        shown = io.StringIO()
        error.show(shown)
        return _fail(shown.getvalue().rstrip(), BAD_INPUT)
    except InputError as error:
        return _fail(str(error), BAD_INPUT)
    except OutputError as error:
        return _fail(f"trackbench: {error}{_and_plugins()}", CANNOT_WRITE)
    except TrackbenchError as error:
        return _fail(f"trackbench: {error}", BAD_INPUT)
    except click.Abort as error:
        return _interrupted(error)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return _unexpected(error)
    return status if isinstance(status, int) else 0


def _unexpected(error: BaseException) -> int:
    """Print an unforeseen error, and whether trackbench or a plug-in is at fault; return the exit status.

    Raises:
        OSError: standard output cannot be written.
    """
    if place_of(error, installed=False) is not None:
        return _plugin_failed(error)
    match error:
        case OSError():
            raise error
        case SystemExit() if not with_plugins() or _raising_package(error) in ("rich", "click"):
            # Click and Rich turn a broken pipe into an exit with status 1; what a shell's completion asks ends with 0.
            return UNREAD if error.code else 0
        case MemoryError():
            return _fail("trackbench: the memory is not enough; take fewer runs, scenes or trackers at once", BAD_INPUT)
    if plugins := with_plugins():
        log.info("a command that failed", exc_info=error)
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}:{frame.lineno}, in {frame.name}"
        cause = f"{type(error).__name__}: {printable(str(error))} ({place}), {plugins}"
        return _fail(f"trackbench: no result: {cause}; if it fails without it, trackbench is at fault", BAD_INPUT)
    # Not 1, which says that an expectation failed.
    return _fail(f"{traceback.format_exc()}trackbench: this is a fault of trackbench itself", FAULT)


def _raising_package(error: BaseException) -> str:
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return str(frames[-1].f_globals.get("__name__", "")).partition(".")[0] if frames else ""


def _plugin_failed(error: BaseException) -> int:
    # Imported here: NumPy comes with it, for which --help need not wait.
    from trackbench.driving.faults import fault_of

    return _fail(f"trackbench: a plug-in failed: {fault_of(error)}", BAD_INPUT)


def _require_place() -> None:
    try:
        os.getcwd()
    except OSError:
        raise InputError("the working directory no longer exists; change to another one") from None


def _interruption(*_: object) -> None:
    raise KeyboardInterrupt


def _interrupted(error: BaseException) -> int:
    if isinstance(error, EOFError) and place_of(error, installed=False) is not None:
        return _plugin_failed(error)
    # The terminal has shown the key as ^C at the start of the line, and gets written over it.
    start = "\r" if sys.stderr.isatty() else ""
    return _fail(f"{start}interrupted: {str(error) or UNFINISHED}", INTERRUPTED)
