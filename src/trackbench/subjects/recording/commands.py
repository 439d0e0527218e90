"""The commands ``view``, ``snapshot`` and ``inspect``, and the options of ``trackbench run`` that show a run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import click
from rich.console import Console

from trackbench import results
from trackbench.base.errors import InputError, TrackbenchError
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import Finite, OptionValues, RunOptions, Whole
from trackbench.results import json_text

if TYPE_CHECKING:
    from trackbench.scenario import Scenario
    from trackbench.subjects.recording.live import Live
    from trackbench.subjects.recording.viewer import Playable, Viewer

TRACKER = click.option(
    "--tracker",
    metavar="NAME",
    help="With --worst: of this tracker alone. With hidden identities also at a time: its tracks.",
)


_NAME = re.compile(r"[A-Za-z][\w-]{0,63}")
#: Events of a function that are listed unless a number is given.
LISTED = 10
FUNCTION = click.option(
    "--function", metavar="NAME", help="With --worst: the worst events of this function, missed, late, false or early."
)


class MomentCommand(click.Command):
    """A command whose ``--worst`` may stand without a number, which is 1 then, or with the name of a function."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        filled: list[str] = []
        rest = list(args)
        while rest:
            arg = rest.pop(0)
            filled.append(arg)
            if arg != "--worst" or (rest and rest[0].isdigit()):
                continue
            if rest and _NAME.fullmatch(rest[0]) and not Path(rest[0]).exists():
                filled += [str(self.listed), "--function", rest.pop(0)]
            else:
                filled.append("1")
        return super().parse_args(ctx, filled)

    @property
    def listed(self) -> int:
        """How many events of a function are meant."""
        return LISTED if self.name == "inspect" else 1


def worst_option(help: str) -> Callable[[Any], Any]:
    return click.option("--worst", type=Whole(1), metavar="[N|FUNCTION]", help=help)


def opening_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """``--at``, ``--worst``, ``--vehicle`` and ``--tracker`` of a command that shows a recording."""
    for option in (
        FUNCTION,
        TRACKER,
        click.option("--vehicle", metavar="NAME", help="Scene and plots of this vehicle; with --worst: its moments."),
        worst_option("Stop at the moment of the largest position error, or of the Nth largest, at its vehicle."),
        click.option("--at", type=Finite(0), metavar="T", help="Stop at this time, in seconds."),
    ):
        command = option(command)
    return command


@click.command("view", cls=MomentCommand)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@opening_options
def view_command(runs: tuple[Path, ...], **opening: Any) -> None:
    """Open runs in the Rerun viewer.

    RUN is a recording (.rrd) or the folder of a run; several of the same traffic are laid over each other.

    \b
    Examples:
      trackbench view results/highway
      trackbench view results/highway --worst --tracker ekf_cv
      trackbench view before/highway after/highway --at 12.4 --vehicle v3
    """
    open_viewer(runs, **opening)


def open_viewer(runs: tuple[Path, ...], **opening: Any) -> None:
    """Open the viewer in a window, which stays when this program ends."""
    from trackbench.subjects.recording import viewer

    with _playable(runs, **opening) as ready:
        viewer.start_viewer().open(ready.files, ready.time_s)


@contextmanager
def _playable(
    runs: Sequence[Path],
    at: float | None,
    worst: int | None,
    vehicle: str | None,
    tracker: str | None,
    function: str | None = None,
) -> Iterator[Playable]:
    """Files for the viewer; notes on them go to stderr."""
    if at is not None and worst is not None:
        raise click.UsageError("--at and --worst are two times: give one of them")
    from trackbench.subjects.recording.focus import Opening
    from trackbench.subjects.recording.viewer import playable

    _require_worst(worst, function)
    with playable(runs, Opening(at, worst, vehicle, tracker, function)) as ready:
        for note in ready.notes:
            click.echo(note, err=True)
        yield ready


def _require_worst(worst: int | None, function: str | None) -> None:
    if function is not None and worst is None:
        raise click.UsageError("--function names whose worst events are meant: give --worst with it")


@click.command("snapshot", cls=MomentCommand)
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN... OUT.png")
@opening_options
def snapshot_command(paths: tuple[Path, ...], **opening: Any) -> None:
    """Save a picture of a run, at a time or at its worst moment.

    Unless either is given, at the moment at which `view` opens.

    It needs no screen, but a Vulkan driver. RUN is a recording (.rrd) or the folder of a run; several of the same
    traffic are laid over each other.

    \b
    Examples:
      trackbench snapshot results/highway --at 12.4 highway.png
      trackbench snapshot results/highway --worst --vehicle v5 worst.png
    """
    *runs, out = paths
    if out.is_dir() or out.suffix == ".rrd":
        raise click.UsageError(f"name the picture after the run: {out} {out.resolve().stem}.png")
    if out.suffix.lower() != ".png":
        raise click.UsageError(f"the picture is a PNG: name it {out.stem}.png, not {out.name}")
    if not runs:
        raise click.UsageError(f"name the run before the picture: RUN {out}")
    from trackbench.subjects.recording import viewer

    with _playable(runs, **opening) as ready:
        if ready.time_s is None:
            raise click.UsageError("a picture needs a time: give --at or --worst")
        results.write_bytes(out, *viewer.pictures(ready.files, [ready.time_s]))
    print_answer(str(out))


@click.command("inspect", cls=MomentCommand)
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option("--at", type=Finite(0), metavar="T", help="The scene at this time, in seconds.")
@worst_option("The worst moment of each tracker, or the N worst; with hidden identities the N costliest events.")
@click.option("--vehicle", metavar="NAME", help="With --worst: of this vehicle alone. With --open: show it.")
@TRACKER
@FUNCTION
@click.option("--open", "opened", is_flag=True, help="Open the viewer at that time or at the worst moment.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def inspect_command(
    run: Path,
    at: float | None,
    worst: int | None,
    vehicle: str | None,
    tracker: str | None,
    function: str | None,
    opened: bool,
    as_json: bool,
) -> None:
    """Read a recording without a viewer.

    RUN is a recording (.rrd) or the folder of a run; its scores are computed afresh from the truth and the estimates.

    \b
    Examples:
      trackbench inspect results/highway
      trackbench inspect results/highway/recording.rrd --at 12.4
      trackbench inspect results/highway --worst 5 --tracker raw --open
      trackbench inspect results/nhtsa_braking --worst fcw
    """
    if opened and at is None and worst is None:
        raise click.UsageError("--open needs a time: give --at or --worst")
    if vehicle is not None and worst is None and not opened:
        raise click.UsageError("--vehicle names whose worst moments are meant: give --worst with it")
    _require_worst(worst, function)
    from trackbench.subjects.recording.data import read
    from trackbench.subjects.recording.focus import require_worst
    from trackbench.subjects.recording.inspection import inspect
    from trackbench.subjects.recording.printing import print_inspection

    recorded = read(run)
    require_worst(recorded.result, worst, tracker)
    if recorded.note:
        click.echo(f"{recorded.note}: read from its tables", err=True)
    inspection = inspect(recorded, at, worst, tracker, vehicle, function)
    if as_json:
        print_answer(json_text(inspection.json()), nl=False)
    else:
        print_inspection(inspection, Console(file=answer(), highlight=False, markup=False, emoji=False))
    if opened:
        first = None if at is not None else 1
        open_viewer((run,), at=at, worst=first, vehicle=vehicle, tracker=tracker, function=function)


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
            click.echo("Ctrl-C ends the server of the viewer", err=True)
            try:
                viewer.process.wait()
            except KeyboardInterrupt:
                click.echo(err=True)
            finally:
                viewer.stop()


def _place(connect: str | None, host: str | None) -> tuple[str, Viewer | None]:
    """The address of the viewer, which is started unless it is there already."""
    from trackbench.subjects.recording import viewer

    if connect is not None:
        name, port = _address(connect)
        if not viewer.listens(name, port):
            raise TrackbenchError(f"no viewer answers at {connect}")
        return connect, None
    if host is not None:
        served, page = viewer.serve_viewer(host)
        click.echo(f"the run is shown at {page}", err=True)
        return served.url, served
    started = viewer.start_viewer()
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


RUN_OPTIONS = RunOptions(_add, _check, _follow)
