"""``trackbench snapshot``"""

from __future__ import annotations

from pathlib import Path

import click

from trackbench import results


@click.command("snapshot")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False), metavar="OUT.png")
@click.option("--at", type=float, required=True, metavar="T", help="The time to show, in seconds.")
def snapshot_command(runs: tuple[Path, ...], out: Path, at: float) -> None:
    """Save a picture of a run in the viewer.

    It needs no screen, but a Vulkan driver. RUN is a recording (.rrd) or the folder of a run.

    \b
    Example:
      trackbench snapshot results/highway --at 12.4 highway.png
    """
    if out.suffix.lower() != ".png":
        raise click.UsageError(f"the picture is a PNG: name it {out.stem}.png, not {out.name}")
    from trackbench.recording import viewer
    from trackbench.recording.play import playable

    with playable(runs, at) as ready:
        for note in ready.notes:
            click.echo(note, err=True)
        results.write_bytes(out, viewer.picture(ready.files, at))
    click.echo(out)
