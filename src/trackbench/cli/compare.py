"""``trackbench compare``"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console

from trackbench import results
from trackbench.base.errors import InputError, counted
from trackbench.cli.run import FAILED_EXPECTATION


@click.command("compare")
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="A [B]...")
@click.option("--trackers", metavar="A,B", help="Only these trackers.")
@click.option("--metric", "metrics", multiple=True, metavar="NAME", help="What to compare by; may be given again.")
@click.option(
    "--fail-on-regression",
    "limits",
    multiple=True,
    metavar="METRIC:PERCENT",
    help="Exit with 1 if really worse by more.",
)
@click.option("--junit", type=click.Path(path_type=Path), metavar="FILE", help="Write the regressions as JUnit XML.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write it too: .md, .html, .txt, .tex, .csv, .json, .svg or .pdf.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def compare_command(
    paths: tuple[Path, ...],
    trackers: str | None,
    metrics: tuple[str, ...],
    limits: tuple[str, ...],
    junit: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Compare the trackers of finished runs, or versions of them.

    A and B are folders of a run, or of the runs of several scenarios. The first is the baseline; nothing is run
    again. `trackbench report` shows a comparison.json again.

    \b
    Examples:
      trackbench compare results/highway --metric velocity_rmse
      trackbench compare results/
      trackbench compare before/ after/ --fail-on-regression position_rmse:5
      trackbench compare before/highway after/highway --out table.tex

    \b
    Exit status:
      0 compared   1 a regression   2 bad input or not comparable   4 cannot write
    """
    from trackbench.compare import Limit, compare, find
    from trackbench.document.files import require_ending
    from trackbench.document.terminal import print_document
    from trackbench.report.comparison.document import ENDINGS, comparison_files, document
    from trackbench.report.junit import suites_of_comparison, to_xml

    parsed = [Limit.parse(text) for text in limits]
    if junit is not None and not parsed:
        raise InputError("says which regressions there are: give --fail-on-regression too", key="--junit")
    if out is not None:
        require_ending(out, ENDINGS, "--out")
    for path, key in ((junit, "--junit"), (out, "--out")):
        if path is not None:
            results.require_file(path, key)
    chosen = None if trackers is None else [name.strip() for name in trackers.split(",")]
    found = compare([find(path) for path in paths], metrics=metrics, trackers=chosen, limits=parsed)
    written = []
    for file, content in comparison_files(found, out) if out is not None else ():
        results.write_bytes(file, content)
        written.append(file)
    if junit is not None:
        results.write_text(junit, to_xml(suites_of_comparison(found)))
    if as_json:
        click.echo(json.dumps(found.json(), indent=2, allow_nan=False))
    else:
        print_document(document(found, times=True), Console())
        if out is not None:
            click.echo(_written(out, written), err=True)
    raise click.exceptions.Exit(0 if found.passed else FAILED_EXPECTATION)


def _written(out: Path, files: Sequence[Path]) -> str:
    """The files, those in folders of their own counted: a LaTeX file reads its tables and figures from there."""
    beside = [str(file) for file in files if file.parent == out.parent]
    folders = Counter(file.parent for file in files if file.parent != out.parent)
    return ", ".join([*beside, *(f"{counted(number, 'file')} in {folder}/" for folder, number in folders.items())])
