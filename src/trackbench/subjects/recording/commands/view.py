"""``trackbench view``"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from trackbench.subjects.recording.commands.moments import MomentCommand, opening, opening_options

if TYPE_CHECKING:
    from trackbench.subjects.recording.focus import Opening


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
