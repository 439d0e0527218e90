"""``trackbench snapshot``"""

from __future__ import annotations

from pathlib import Path

import click

from trackbench import results
from trackbench.subjects.recording.commands.moments import MomentCommand, opening, opening_options


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
