"""``trackbench new``"""

from __future__ import annotations

from pathlib import Path

import click

from trackbench.cli.options import NearestChoice
from trackbench.subjects.templates.plug_in import KINDS, class_name, decisions, new

#: How a scenario names a new plug-in of each kind.
NAMED = {
    "tracker": '  trackers: {{mine: {{use: "{use}"}}}}',
    "multi-tracker": '  trackers: {{mine: {{use: "{use}"}}}}  # with sensing: {{identities: hidden}}',
    "motion-model": '  trackers: {{mine: {{filter: ekf, motion: "{use}", ...}}}}',
    "sensor": '  sensors: {{front: {{type: "{use}", rate_hz: 10, ...}}}}',
    "truth": '  truth: {{source: "{use}", duration_s: 20, rate_hz: 20, ...}}',
    "metric": '  score: {{metrics: ["{use}"]}}',
}


@click.command("new")
@click.argument("kind", type=NearestChoice(list(KINDS)), metavar="KIND")
@click.argument("name")
@click.option("--around", metavar="MODULE:CLASS", help="A filter with predict and update for the tracker to run.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=".",
    metavar="DIR",
    help="Where to; here unless given.",
)
def new_command(kind: str, name: str, around: str | None, out: Path) -> None:
    """Write a plug-in of your own that works, with its test.

    KIND is tracker (of one object), multi-tracker (of several, with hidden identities), motion-model, sensor, truth or
    metric; a tracker gets a scenario too. No file is overwritten.

    \b
    Examples:
      trackbench new tracker my_tracker
      trackbench new multi-tracker my_tracks
      trackbench new tracker my_ekf --around my_filters:Ekf
    """
    paths = new(kind, name, out, around)
    for path in paths:
        click.echo(f"written: {path}")
    use = f"{name}:{class_name(name)}"
    click.echo(f"\nTest it (pip install pytest):\n  python -m pytest {paths[1]}")
    if len(paths) > 2:
        click.echo(f"Run it:\n  trackbench run {paths[2]}")
    click.echo(f"Name it in a scenario beside {paths[0].name}:\n{NAMED[kind].format(use=use)}")
    lines = decisions(paths[0])
    if lines:
        word = "1 decision: line" if len(lines) == 1 else f"{len(lines)} decisions: lines"
        click.echo(f"{paths[0]} leaves you {word} {', '.join(map(str, lines))}")
