"""The command ``trackbench serve``."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

import click

from trackbench.base.errors import InputError
from trackbench.cli.answer import print_answer
from trackbench.cli.options import isolation_options
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
    help="A tracker of a scenario, with the scenario's sensors.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=4567, show_default=True, help="0 for any free port.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@isolation_options
@click.pass_context
def udacity_command(ctx: click.Context, tracker: str, port: int, host: str, isolation: Isolation) -> None:
    """Speak the protocol of the Udacity term-2 simulator, until Ctrl-C.

    Each client has its own tracker, which starts afresh when the client connects again or restarts its data set.
    Programs may connect; pages in a browser are refused. It needs `trackbench[serve]`.

    \b
    Example:
      trackbench serve udacity --tracker scripted/figure_eight#ekf
    """
    path, hash_sign, name = tracker.rpartition("#")
    if not hash_sign or not path or not name:
        raise InputError(f"write SCENARIO#NAME, not {tracker!r}", key="--tracker")
    if not host:
        # An empty address would be every address of this machine.
        raise InputError("is empty", key="--host")
    try:
        from trackbench.subjects.serve.server import serve_udacity
    except ModuleNotFoundError:
        raise InputError("serving needs one more package: pip install 'trackbench[serve]'") from None
    from trackbench.subjects.serve.session import load_served

    tracker_served = load_served(load_scenario(path), name, isolation)
    log_to_stderr(ctx, "trackbench.subjects.serve", logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%X"))
    for kind in {"lidar", "radar"} - set(tracker_served.sensors):
        click.echo(f"{path} has no {kind}: such measurements are ignored", err=True)

    def ready(address: str, actual: int) -> None:
        shown = f"[{address}]" if ":" in address else address
        print_answer(f"{tracker} listens at ws://{shown}:{actual}; Ctrl-C ends it")

    asyncio.run(serve_udacity(tracker_served, host, port, ready))
