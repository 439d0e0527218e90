"""``trackbench serve``"""

from __future__ import annotations

import logging
import signal
from typing import TYPE_CHECKING

import click

from trackbench.base.errors import InputError
from trackbench.base.exit_status import INTERRUPTED
from trackbench.cli.answer import print_answer
from trackbench.cli.options import Whole, isolation_options, scenario_paths
from trackbench.cli.terminal import log_to_stderr
from trackbench.scenario import load_scenario

if TYPE_CHECKING:
    from trackbench.driving.isolation import Isolation


@click.group("serve")
def serve_command() -> None:
    """Let a simulator drive a tracker of a scenario, live.

    \b
    Example:
      trackbench serve udacity --tracker scripted/figure_eight#ekf
    """


@serve_command.command("udacity")
@click.option(
    "--tracker",
    required=True,
    metavar="SCENARIO#NAME",
    shell_complete=scenario_paths,
    help="A tracker of a scenario, whose sensors it reads.",
)
@click.option("--port", type=Whole(0, 65535), default=4567, show_default=True, help="0 for any that is free.")
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen at: this machine's own unless given."
)
@click.option(
    "--allow-origin",
    "origins",
    multiple=True,
    metavar="URL",
    help="Let pages of this origin in, such as http://viewer.example:8000; may be given again.",
)
@isolation_options
@click.option("-v", "--verbose", is_flag=True, help="Log every frame that is no event, too.")
@click.pass_context
def udacity_command(
    ctx: click.Context,
    tracker: str,
    port: int,
    host: str,
    origins: tuple[str, ...],
    isolation: Isolation,
    verbose: bool,
) -> None:
    """Speak the protocol of the Udacity term-2 simulator, until Ctrl-C.

    Each client has its own tracker, which starts afresh when it connects again or restarts its data set. Programs and
    pages of this machine may connect; pages from elsewhere in a browser are refused unless --allow-origin names them.

    \b
    Example:
      trackbench serve udacity --tracker scripted/figure_eight#ekf
    """
    path, hash_sign, name = tracker.rpartition("#")
    if not hash_sign or not path or not name:
        raise InputError(f"write SCENARIO#NAME, not {tracker!r}", key="--tracker")

    if not host:
        # To the operating system, no address means all of them.
        raise InputError("is empty; 127.0.0.1 is this machine alone, 0.0.0.0 opens the server to others", key="--host")
    import asyncio

    from trackbench.subjects.serve.server import require_origin, serve_udacity
    from trackbench.subjects.serve.session import served

    try:
        allowed = [require_origin(origin) for origin in origins]
    except InputError as error:
        raise InputError(error.message, key="--allow-origin") from None
    tracker_served = served(load_scenario(path), name, isolation)
    _log(ctx, verbose)
    for kind in {"lidar", "radar"} - set(tracker_served.sensors):
        click.echo(f"{path} has no {kind}: such measurements are passed over", err=True)

    def ready(address: str, actual: int) -> None:
        shown = f"[{address}]" if ":" in address else address
        print_answer(f"{tracker} listens at ws://{shown}:{actual}; Ctrl-C ends it")

    if asyncio.run(serve_udacity(tracker_served, host, port, ready, allowed)) == signal.SIGINT:
        raise click.exceptions.Exit(INTERRUPTED)


class OneLine(logging.Formatter):
    """A record in one line: an exception is named, not traced."""

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        cause = record.exc_info[1] if record.exc_info else None
        record.exc_info = record.exc_text = None
        text = super().format(record) + (f": {cause}" if cause else "")
        return " ".join(text.split())


def _log(ctx: click.Context, verbose: bool) -> None:
    formatter = OneLine("%(asctime)s %(levelname)s %(message)s", "%H:%M:%S")
    log_to_stderr(ctx, "trackbench.subjects.serve", formatter, logging.DEBUG if verbose else logging.INFO)
    # The library tells every step of a connection at the level of information.
    logging.getLogger("trackbench.subjects.serve.server.websockets").setLevel(logging.WARNING)
