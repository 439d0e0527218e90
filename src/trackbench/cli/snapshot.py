"""``trackbench snapshot``"""

from __future__ import annotations

from pathlib import Path

import click

from trackbench import results
from trackbench.cli.moments import MomentCommand, opening, opening_options


@click.command("snapshot", cls=MomentCommand)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False), metavar="OUT.png")
@opening_options
def snapshot_command(
    runs: tuple[Path, ...],
    out: Path,
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
    if out.suffix.lower() != ".png":
        raise click.UsageError(f"the picture is a PNG: name it {out.stem}.png, not {out.name}")
    if at is None and worst is None:
        raise click.UsageError("a picture needs a time: give --at or --worst")
    where = opening(at, worst, vehicle, tracker)
    from trackbench.recording import viewer
    from trackbench.recording.play import playable

    with playable(runs, where) as ready:
        for note in ready.notes:
            click.echo(note, err=True)
        assert ready.time_s is not None
        results.write_bytes(out, viewer.picture(ready.files, ready.time_s))
    click.echo(out)
