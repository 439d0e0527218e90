"""The command ``trackbench export``."""

from __future__ import annotations

from pathlib import Path

import click

from trackbench.base.errors import counted
from trackbench.cli.answer import print_answer
from trackbench.cli.options import NearestChoice
from trackbench.cli.terminal import progress, quiet_option

FORMAT_NAMES = ("csv", "parquet", "mcap")


@click.command("export")
@click.argument("scenario", type=click.Path(path_type=Path), metavar="SCENARIO")
@click.option(
    "--scans",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder of the scans; an earlier export there is replaced.",
)
@click.option("--truth", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Folder of the truth.")
@click.option(
    "--format",
    "form",
    type=NearestChoice(FORMAT_NAMES),
    default="csv",
    show_default=True,
    metavar="NAME",
    help=f"{', '.join(FORMAT_NAMES[:-1])} or {FORMAT_NAMES[-1]}.",
)
@click.option("--runs", type=click.IntRange(1), metavar="N", help="Monte-Carlo runs of each scene.")
@click.option("--scenes", type=click.IntRange(1, 1000), metavar="N", help="Number of scenes.")
@click.option("--seed", type=click.IntRange(0), metavar="S", help="Seed of the noise.")
@click.option("--set", "settings", multiple=True, metavar="KEY.PATH=VALUE", help="Change a key of the scenario.")
@quiet_option("Print nothing.")
def export_command(
    scenario: Path,
    scans: Path,
    truth: Path | None,
    form: str,
    runs: int | None,
    scenes: int | None,
    seed: int | None,
    settings: tuple[str, ...],
    quiet: bool,
) -> None:
    """Write the scans of a scenario for other programs.

    The scans are those that the trackers of the scenario get, bit for bit; manifest.json says what they mean. Tracks
    that another program makes of them come back as `use: tracks`. The truth goes into a folder of its own.

    \b
    Examples:
      trackbench export highway --scans scans --runs 5
      trackbench export highway --scans scans --truth truth --format parquet

    \b
    Exit status: 0 written, 2 bad input, 4 cannot write
    """
    from trackbench.api.scenario import load
    from trackbench.subjects.export.api import export
    from trackbench.subjects.export.manifest import MANIFEST

    loaded = load(scenario, settings, runs=runs, seed=seed, scenes=scenes)
    with progress(f"truth of {loaded.config.full_name}", "steps", quiet=quiet) as advance:
        export(loaded, scans, truth, format=form, progress=advance)
    if quiet:
        return
    for folder in (scans, truth):
        if folder is not None:
            names = sorted(file.name for file in folder.iterdir() if file.name != MANIFEST)
            shown = ", ".join(names) if len(names) <= 4 else f"{names[0]} to {names[-1]}, {counted(len(names), 'file')}"
            print_answer(f"{folder}/: {shown}, {MANIFEST}")
