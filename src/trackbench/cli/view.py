"""``trackbench view``"""

from __future__ import annotations

from pathlib import Path

import click


@click.command("view")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.option("--at", type=float, metavar="T", help="Stop at this time, in seconds.")
def view_command(runs: tuple[Path, ...], at: float | None) -> None:
    """Open runs in the Rerun viewer.

    RUN is a recording (.rrd) or the folder of a run; several of the same traffic are laid over each other.

    \b
    Examples:
      trackbench view results/highway
      trackbench view before/highway after/highway --at 12.4
    """
    open_viewer(runs, at)


def open_viewer(runs: tuple[Path, ...], at: float | None) -> None:
    """Open the viewer in a window, which stays when this program ends."""
    from trackbench.recording import viewer
    from trackbench.recording.play import playable

    with playable(runs, at) as ready:
        for note in ready.notes:
            click.echo(note, err=True)
        viewer.start().open(ready.files, at)
