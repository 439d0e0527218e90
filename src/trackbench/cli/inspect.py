"""``trackbench inspect``"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from trackbench.cli.view import open_viewer
from trackbench.errors import InputError, nearest
from trackbench.results import to_json

if TYPE_CHECKING:
    from trackbench.recording.inspection import Inspection


@click.command("inspect")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option("--at", type=float, metavar="T", help="The scene at this time, in seconds.")
@click.option("--worst", type=click.IntRange(1), metavar="N", help="The N worst moments of each tracker.")
@click.option("--tracker", metavar="NAME", help="With --worst: of this tracker alone.")
@click.option("--open", "opened", is_flag=True, help="Open the viewer at that time or at the worst moment.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def inspect_command(
    run: Path, at: float | None, worst: int | None, tracker: str | None, opened: bool, as_json: bool
) -> None:
    """Read a recording without a viewer.

    RUN is a recording (.rrd) or the folder of a run; its scores are computed afresh from the truth and the estimates.

    \b
    Examples:
      trackbench inspect results/highway
      trackbench inspect results/highway/recording.rrd --at 12.4
      trackbench inspect results/highway --worst 5 --tracker raw --open
    """
    if opened and at is None and worst is None:
        raise click.UsageError("--open needs a time: give --at or --worst")
    if tracker is not None and worst is None:
        raise click.UsageError("--tracker names whose worst moments are listed: give --worst with it")
    from trackbench.cli.inspection import print_inspection
    from trackbench.recording.inspection import inspect

    found = inspect(run, at, worst)
    if found.recorded.note:
        click.echo(f"{found.recorded.note}: read from its tables", err=True)
    if found.worst is not None and tracker is not None:
        if tracker not in found.worst:
            message = f"no estimates of {tracker!r} in this recording; {nearest(tracker, found.worst)}"
            raise InputError(message, key="--tracker", file=run)
        found = replace(found, worst={tracker: found.worst[tracker]})
    if as_json:
        click.echo(to_json(found.json()), nl=False)
    else:
        print_inspection(found, Console())
    if opened:
        open_viewer((run,), _worst_time(found) if at is None else at)


def _worst_time(found: Inspection) -> float:
    """When the largest of the worst errors was.

    Raises:
        InputError: no estimate was scored.
    """
    moments = [moment for of_tracker in (found.worst or {}).values() for moment in of_tracker]
    if not moments:
        raise InputError("no estimate in this recording counts, so none is the worst", file=found.recorded.file)
    return max(moments, key=lambda moment: moment.position_error_m or 0.0).time_s
