"""``trackbench inspect``"""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from trackbench.results import to_json
from trackbench.subjects.recording.commands.view import TRACKER, MomentCommand, open_viewer, worst_option


@click.command("inspect", cls=MomentCommand)
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option("--at", type=float, metavar="T", help="The scene at this time, in seconds.")
@worst_option("The worst moment of each tracker, or the N worst; with hidden identities the N costliest events.")
@click.option("--vehicle", metavar="NAME", help="With --worst: of this vehicle alone. With --open: show it.")
@TRACKER
@click.option("--open", "opened", is_flag=True, help="Open the viewer at that time or at the worst moment.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def inspect_command(
    run: Path,
    at: float | None,
    worst: int | None,
    vehicle: str | None,
    tracker: str | None,
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
    """
    if opened and at is None and worst is None:
        raise click.UsageError("--open needs a time: give --at or --worst")
    if vehicle is not None and worst is None and not opened:
        raise click.UsageError("--vehicle names whose worst moments are meant: give --worst with it")
    from trackbench.subjects.recording.commands.printing import print_inspection
    from trackbench.subjects.recording.data import read
    from trackbench.subjects.recording.focus import Opening, require_worst
    from trackbench.subjects.recording.inspection import inspect

    recorded = read(run)
    require_worst(recorded.result, worst, tracker)
    if recorded.note:
        click.echo(f"{recorded.note}: read from its tables", err=True)
    inspection = inspect(recorded, at, worst, tracker, vehicle)
    if as_json:
        click.echo(to_json(inspection.json()), nl=False)
    else:
        print_inspection(inspection, Console(highlight=False, markup=False, emoji=False))
    if opened:
        open_viewer((run,), Opening(at, None if at is not None else 1, vehicle, tracker))
