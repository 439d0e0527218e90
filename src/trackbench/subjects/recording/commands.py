"""The commands ``view``, ``snapshot`` and ``inspect``, and the option ``--live`` of ``trackbench run``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

#: Events of a function that `inspect` lists unless a number is given.
LISTED = 10
_FUNCTION = re.compile(r"[A-Za-z][\w-]{0,63}")


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
            if rest and _FUNCTION.fullmatch(rest[0]) and not Path(rest[0]).exists():
                filled += [str(LISTED if self.name == "inspect" else 1), "--function", rest.pop(0)]
            else:
                filled.append("1")
        return super().parse_args(ctx, filled)


def worst_option(help: str) -> Callable[[Any], Any]:
    return click.option("--worst", type=Whole(1), metavar="[N|FUNCTION]", help=help)


TRACKER = click.option(
    "--tracker",
    metavar="NAME",
    help="With --worst: of this tracker alone. With hidden identities also at a time: its tracks.",
)
FUNCTION = click.option(
    "--function", metavar="NAME", help="With --worst: the worst events of this function, missed, late, false or early."
)


def opening_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--at``, ``--worst``, ``--vehicle``, ``--tracker`` and ``--function`` to a command."""
    for option in (
        FUNCTION,
        TRACKER,
        click.option("--vehicle", metavar="NAME", help="Scene and plots of this vehicle; with --worst: its moments."),
        worst_option("Stop at the moment of the largest position error, or of the Nth largest, at its vehicle."),
        click.option("--at", "at_s", type=Finite(0), metavar="T", help="Stop at this time, in seconds."),
    ):
        command = option(command)
    return command


@click.command("view", cls=MomentCommand)
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@opening_options
def view_command(run: Path, **opening: Any) -> None:
    """Open a run in the Rerun viewer.

    RUN is the folder of a run or a recording (.rrd). The viewer centres on a vehicle only with the folder.

    \b
    Examples:
      trackbench view results/highway
      trackbench view results/highway --worst --tracker ekf_cv
      trackbench view results/highway --at 12.4 --vehicle v3
    """
    from trackbench.subjects.recording import viewer

    with _playable(run, **opening) as (file, time_s):
        viewer.start_viewer().open(file, time_s)


@contextmanager
def _playable(run: Path, **options: Any) -> Iterator[tuple[Path, float | None]]:
    if options["at_s"] is not None and options["worst"] is not None:
        raise click.UsageError("--at and --worst are two times: give one of them")
    from trackbench.subjects.recording.focus import Opening
    from trackbench.subjects.recording.viewer import playable

    _require_worst(options["worst"], options["function"])
    with playable(run, Opening(**options)) as ready:
        yield ready


def _require_worst(worst: int | None, function: str | None) -> None:
    if function is not None and worst is None:
        raise click.UsageError("--function names whose worst events are meant: give --worst with it")


@click.command("snapshot", cls=MomentCommand)
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.png")
@opening_options
def snapshot_command(run: Path, out: Path, **opening: Any) -> None:
    """Save a picture of a run, at a time or at its worst moment.

    Without --at and --worst it shows the moment at which `view` opens. It needs no screen, but a Vulkan driver. RUN is
    the folder of a run or a recording (.rrd).

    \b
    Examples:
      trackbench snapshot results/highway --at 12.4 highway.png
      trackbench snapshot results/highway --worst --vehicle v5 worst.png
    """
    if out.suffix.lower() != ".png":
        raise click.UsageError(f"the picture is a PNG: name it {out.stem}.png, not {out.name}")
    from trackbench.subjects.recording import viewer

    with _playable(run, **opening) as (file, time_s):
        if time_s is None:
            raise click.UsageError("a picture needs a time: give --at or --worst")
        results.write_bytes(out, *viewer.pictures(file, [time_s]))
    print_answer(str(out))


@click.command("inspect", cls=MomentCommand)
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option("--at", "at_s", type=Finite(0), metavar="T", help="The scene at this time, in seconds.")
@worst_option("The worst moment of each tracker, or the N worst; with hidden identities the N costliest events.")
@click.option("--vehicle", metavar="NAME", help="With --worst: of this vehicle alone.")
@TRACKER
@FUNCTION
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def inspect_command(run: Path, as_json: bool, **options: Any) -> None:
    """Read a recorded run without a viewer.

    RUN is the folder of a run or a recording (.rrd).

    \b
    Examples:
      trackbench inspect results/highway
      trackbench inspect results/highway/recording.rrd --at 12.4
      trackbench inspect results/highway --worst 5 --tracker raw
      trackbench inspect results/nhtsa_braking --worst fcw
    """
    if options["vehicle"] is not None and options["worst"] is None:
        raise click.UsageError("--vehicle names whose worst moments are meant: give --worst with it")
    _require_worst(options["worst"], options["function"])
    from trackbench.subjects.recording.focus import Opening
    from trackbench.subjects.recording.inspection import inspect, print_inspection

    inspection = inspect(run, Opening(**options))
    if as_json:
        print_answer(json_text(inspection.json()), nl=False)
    else:
        print_inspection(inspection, Console(file=answer(), highlight=False, markup=False, emoji=False))


def _add(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option("--live", is_flag=True, help="Show the run in the Rerun viewer as it goes.")(command)


def _check(scenarios: Sequence[Scenario], values: OptionValues) -> None:
    """Refuse hidden identities: only estimates of known objects are shown while a run goes on."""
    for scenario in scenarios:
        if values["live"] and scenario.config.sensing.identities == "hidden":
            problem = "a run with hidden identities is not shown as it goes; leave --live out and `trackbench view` it"
            raise InputError(problem, file=scenario.path, key="sensing.identities")


@contextmanager
def _follow(values: OptionValues) -> Iterator[Live | None]:
    """Yield the connection to the viewer; a viewer that cannot start or gets lost is only a note on stderr."""
    if not values["live"]:
        yield None
        return
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


RUN_OPTIONS = RunOptions(_add, _check, _follow)
