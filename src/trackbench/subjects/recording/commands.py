"""The commands ``view``, ``snapshot`` and ``inspect``, and the option ``--live`` of ``trackbench run``."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from trackbench import results
from trackbench.base.errors import InputError, TrackbenchError
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import Finite, OptionValues, RunOptions

if TYPE_CHECKING:
    from trackbench.scenario import Scenario
    from trackbench.subjects.recording.focus import Opening
    from trackbench.subjects.recording.live import Live


def opening_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for where a recording opens (``--at``, ``--worst``, ...) to a command that gets ``opening``."""

    @click.option("--at", "at_s", type=Finite(0), metavar="T", help="At this time, in seconds.")
    @click.option(
        "--worst",
        type=click.IntRange(1),
        is_flag=False,
        flag_value="1",
        metavar="[N]",
        help="At the largest position error, or the Nth largest; with hidden identities at the costliest event.",
    )
    @click.option("--vehicle", metavar="NAME", help="Only moments of this vehicle; a view centres on it.")
    @click.option("--tracker", metavar="NAME", help="Only moments of this tracker; with hidden identities its tracks.")
    @click.option("--function", metavar="NAME", help="With --worst: only events of this function.")
    @functools.wraps(command)
    def wrapped(*arguments: Any, **options: Any) -> None:
        from trackbench.subjects.recording.focus import Opening

        names = Opening.__dataclass_fields__
        opening = Opening(**{name: options.pop(name) for name in names})
        if opening.at_s is not None and opening.worst is not None:
            raise click.UsageError("--at and --worst both choose a time: give one of them")
        if opening.function is not None and opening.worst is None:
            raise click.UsageError("--function chooses whose worst events count: give --worst with it")
        command(*arguments, opening=opening, **options)

    return wrapped


@click.command("view")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@opening_options
def view_command(run: Path, opening: Opening) -> None:
    """Open a run in the Rerun viewer.

    RUN is the folder of a run or a recording (.rrd). The viewer centres on a vehicle only with the folder.

    \b
    Examples:
      trackbench view results/highway
      trackbench view results/highway --worst --tracker ekf_cv
      trackbench view results/highway --at 12.4 --vehicle v3
    """
    from trackbench.subjects.recording import viewer

    with viewer.playable(run, opening) as (file, time_s):
        viewer.start_viewer().open(file, time_s)


@click.command("snapshot")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.png")
@opening_options
def snapshot_command(run: Path, out: Path, opening: Opening) -> None:
    """Save a picture of a run, at a time or at its worst moment.

    Without --at and --worst it shows the moment at which `view` opens. It needs no screen, but a Vulkan driver. RUN is
    the folder of a run or a recording (.rrd).

    \b
    Examples:
      trackbench snapshot results/highway highway.png --at 12.4
      trackbench snapshot results/highway worst.png --worst --vehicle v5
    """
    if out.suffix.lower() != ".png":
        raise click.UsageError(f"the picture is a PNG: name it {out.stem}.png, not {out.name}")
    from trackbench.subjects.recording import viewer

    with viewer.playable(run, opening) as (file, time_s):
        if time_s is None:
            raise click.UsageError("a picture needs a time: give --at or --worst")
        results.write_bytes(out, *viewer.pictures(file, [time_s]))
    print_answer(str(out))


@click.command("inspect")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@opening_options
def inspect_command(run: Path, opening: Opening) -> None:
    """Read a recorded run without a viewer.

    RUN is the folder of a run or a recording (.rrd). --worst N lists the N worst moments, at which `view` opens.

    \b
    Examples:
      trackbench inspect results/highway
      trackbench inspect results/highway/recording.rrd --at 12.4
      trackbench inspect results/highway --worst 5 --tracker raw
      trackbench inspect results/nhtsa_braking --worst 10 --function fcw
    """
    from trackbench.subjects.recording.inspection import inspect

    inspect(run, opening, Console(file=answer(), highlight=False, markup=False, emoji=False))


def _add_live_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option("--live", is_flag=True, help="Show the run in the Rerun viewer as it goes.")(command)


@contextmanager
def _connect_viewer(scenarios: Sequence[Scenario], values: OptionValues) -> Iterator[Live | None]:
    """Yield the connection to the viewer; a viewer that fails to start or is lost leaves only a note on stderr."""
    if not values["live"]:
        yield None
        return
    # Only estimates of known objects are shown while a run goes on.
    for scenario in scenarios:
        if scenario.config.sensing.identities == "hidden":
            problem = "a run with hidden identities is not shown as it goes; leave --live out and `trackbench view` it"
            raise InputError(problem, file=scenario.path, key="sensing.identities")
    from trackbench.subjects.recording import viewer
    from trackbench.subjects.recording.live import Live

    try:
        started = viewer.start_viewer()
        started.wait()
    except TrackbenchError as error:
        click.echo(f"{error}\nthe run goes on without a viewer", err=True)
        yield None
        return
    live = Live(started.url)
    try:
        yield live
    finally:
        live.close()
        if live.lost:
            click.echo("the viewer was lost; the run went on without it", err=True)


RUN_OPTIONS = RunOptions(_add_live_option, _connect_viewer)
