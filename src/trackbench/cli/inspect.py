"""``trackbench inspect``"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from trackbench.cli.view import open_viewer


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
    from trackbench.errors import InputError, nearest
    from trackbench.recording.inspection import inspect
    from trackbench.report.inspection import print_inspection

    found = inspect(run, at, worst)
    if found["note"]:
        click.echo(f"{found['note']}: read from its tables", err=True)
    if tracker is not None and worst is not None:
        if tracker not in found["worst"]:
            message = f"no estimates of {tracker!r} in this recording; {nearest(tracker, found['worst'])}"
            raise InputError(message, key="--tracker", file=run)
        found["worst"] = {tracker: found["worst"][tracker]}
    if as_json:
        click.echo(json.dumps(found, indent=2, allow_nan=False, ensure_ascii=False))
    else:
        print_inspection(found, Console())
    if opened:
        open_viewer((run,), _time(found) if at is None else at)


def _time(found: dict[str, Any]) -> float:
    """When the largest of the worst errors was."""
    moments = [moment for of_tracker in found["worst"].values() for moment in of_tracker]
    return float(max(moments, key=lambda moment: moment["position_error_m"])["time_s"])
