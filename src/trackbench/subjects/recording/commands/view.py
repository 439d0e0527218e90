"""``trackbench view`` and ``trackbench snapshot``, and the options that say which moment is meant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trackbench import results

if TYPE_CHECKING:
    from trackbench.subjects.recording.focus import Opening

TRACKER = click.option(
    "--tracker",
    metavar="NAME",
    help="With --worst: of this tracker alone. With hidden identities also at a time: its tracks.",
)


class MomentCommand(click.Command):
    """A command whose ``--worst`` may stand without a number, which is 1 then."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        filled: list[str] = []
        for arg, following in zip(args, [*args, ""][1:], strict=True):
            filled += [arg, "1"] if arg == "--worst" and not following.isdigit() else [arg]
        return super().parse_args(ctx, filled)


def worst_option(help: str) -> Callable[[Any], Any]:
    """``--worst [N]``"""
    return click.option("--worst", type=click.IntRange(1), metavar="[N]", help=help)


def opening_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """``--at``, ``--worst``, ``--vehicle`` and ``--tracker`` of a command that shows a recording."""
    for option in (
        TRACKER,
        click.option("--vehicle", metavar="NAME", help="Scene and plots of this vehicle; with --worst: its moments."),
        worst_option("Stop at the moment of the largest position error, or of the Nth largest, at its vehicle."),
        click.option("--at", type=float, metavar="T", help="Stop at this time, in seconds."),
    ):
        command = option(command)
    return command


def opening(at: float | None, worst: int | None, vehicle: str | None, tracker: str | None) -> Opening:
    """What the options say.

    Raises:
        click.UsageError: they contradict each other.
    """
    from trackbench.subjects.recording.focus import Opening

    if at is not None and worst is not None:
        raise click.UsageError("--at and --worst are two times: give one of them")
    return Opening(at, worst, vehicle, tracker)


@click.command("view", cls=MomentCommand)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@opening_options
def view_command(
    runs: tuple[Path, ...], at: float | None, worst: int | None, vehicle: str | None, tracker: str | None
) -> None:
    """Open runs in the Rerun viewer.

    RUN is a recording (.rrd) or the folder of a run; several of the same traffic are laid over each other.

    \b
    Examples:
      trackbench view results/highway
      trackbench view results/highway --worst --tracker ekf_cv
      trackbench view before/highway after/highway --at 12.4 --vehicle v3
    """
    open_viewer(runs, opening(at, worst, vehicle, tracker))


def open_viewer(runs: tuple[Path, ...], where: Opening) -> None:
    """Open the viewer in a window, which stays when this program ends."""
    from trackbench.subjects.recording import viewer
    from trackbench.subjects.recording.play import playable

    with playable(runs, where) as ready:
        for note in ready.notes:
            click.echo(note, err=True)
        viewer.start().open(ready.files, ready.time_s)


@click.command("snapshot", cls=MomentCommand)
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN... OUT.png")
@opening_options
def snapshot_command(
    paths: tuple[Path, ...],
    at: float | None,
    worst: int | None,
    vehicle: str | None,
    tracker: str | None,
) -> None:
    """Save a picture of a run, at a time or at its worst moment.

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
    if at is None and worst is None:
        raise click.UsageError("a picture needs a time: give --at or --worst")
    where = opening(at, worst, vehicle, tracker)
    from trackbench.subjects.recording import viewer
    from trackbench.subjects.recording.play import playable

    with playable(runs, where) as ready:
        for note in ready.notes:
            click.echo(note, err=True)
        assert ready.time_s is not None
        results.write_bytes(out, viewer.picture(ready.files, ready.time_s))
    click.echo(out)
