"""The options ``--live``, ``--connect`` and ``--serve`` of ``trackbench run``, and the viewer that they open."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import click

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.cli.run_options import OptionValues, RunOptions

if TYPE_CHECKING:
    from trackbench.scenario import Scenario
    from trackbench.subjects.recording.live import Live
    from trackbench.subjects.recording.viewer import Viewer

NAMES = ("live", "connect", "serve", "host")
SCHEMES = ("rerun", "rerun+http", "rerun+https")


def _add(command: Callable[..., Any]) -> Callable[..., Any]:
    options = (
        click.option("--live", is_flag=True, help="Show the run in the Rerun viewer as it goes."),
        click.option("--connect", metavar="URL", help="Show it in a viewer that is already open."),
        click.option("--serve", is_flag=True, help="Show it in a browser, until Ctrl-C."),
        click.option("--host", metavar="ADDRESS", help="Where --serve listens [default: this machine alone]."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def _check(scenarios: Sequence[Scenario], values: OptionValues) -> None:
    """Only estimates of known objects are shown while a run goes on."""
    wanted = any(values[name] for name in NAMES)
    for scenario in scenarios:
        if wanted and scenario.config.sensing.identities == "hidden":
            problem = "a run with hidden identities is not shown as it goes; leave --live out and `trackbench view` it"
            raise InputError(problem, file=scenario.path, key="sensing.identities")


@contextmanager
def _follow(values: OptionValues) -> Iterator[Live | None]:
    """The connection to the viewer, or None: a viewer that is missing or gets lost is no error, only a note on stderr.

    Raises:
        InputError: the options contradict each other, or are no addresses.
    """
    live, connect, serve, host = (values[name] for name in NAMES)
    if connect is not None and serve:
        raise InputError("a run is shown in one place: either --connect or --serve", key="--connect")
    if host is not None and not serve:
        raise InputError("says where --serve listens, which is not asked for", key="--host")
    if not (live or serve or connect is not None):
        yield None
        return
    from trackbench.subjects.recording.live import Live
    from trackbench.subjects.recording.viewer import LOOPBACK

    try:
        url, viewer = _place(connect, host or LOOPBACK if serve else None)
    except TrackbenchError as error:
        if isinstance(error, InputError) and error.key is not None:
            raise
        click.echo(f"{error}\nthe run goes on without a viewer", err=True)
        yield None
        return
    stream = Live(url)
    try:
        yield stream
    finally:
        stream.close()
        if stream.lost:
            click.echo("the viewer was lost; the run went on without it", err=True)
        if serve and viewer is not None:
            _until_interrupted(viewer)


def _place(connect: str | None, host: str | None) -> tuple[str, Viewer | None]:
    """The address of the viewer, which is started unless it is there already."""
    from trackbench.subjects.recording import viewer

    if connect is not None:
        name, port = _address(connect)
        if not viewer.listens(name, port):
            raise TrackbenchError(f"no viewer answers at {connect}")
        return connect, None
    if host is not None:
        served, page = viewer.serve(host)
        click.echo(f"the run is shown at {page}", err=True)
        return served.url, served
    started = viewer.start()
    started.wait()
    return started.url, started


def _address(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    try:
        if parts.scheme in SCHEMES and parts.hostname and parts.port and parts.path == "/proxy":
            return parts.hostname, parts.port
    except ValueError:
        pass
    raise InputError(f"write rerun+http://HOST:PORT/proxy, not {url!r}", key="--connect")


def _until_interrupted(viewer: Viewer) -> None:
    click.echo("Ctrl-C ends the server of the viewer", err=True)
    try:
        viewer.process.wait()
    except KeyboardInterrupt:
        click.echo(err=True)
    finally:
        viewer.stop()


RUN_OPTIONS = RunOptions(_add, _check, _follow)
