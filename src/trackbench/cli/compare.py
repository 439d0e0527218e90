"""``trackbench compare``"""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.console import Console

from trackbench import results
from trackbench.cli.run import FAILED_EXPECTATION
from trackbench.errors import InputError


@click.command("compare")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN_A [RUN_B]...")
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
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE.md", help="Write the comparison as Markdown.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def compare_command(
    runs: tuple[Path, ...],
    trackers: str | None,
    metrics: tuple[str, ...],
    limits: tuple[str, ...],
    junit: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Compare the trackers of a run, or the same trackers over runs.

    A run is its folder, or the result.json in it. The first is the baseline; nothing is run again.

    \b
    Examples:
      trackbench compare results/highway
      trackbench compare results/highway --metric velocity_rmse
      trackbench compare base/demo new/demo --fail-on-regression position_rmse:5

    \b
    Exit status: 0 compared, 1 a regression, 2 bad input or not comparable
    """
    from trackbench.compare import differences, regression, stored
    from trackbench.report import compared
    from trackbench.report.junit import suites_of_comparison, to_xml

    parsed = [regression.parse(text) for text in limits]
    if junit is not None and not parsed:
        raise InputError("says which regressions there are: give --fail-on-regression too", key="--junit")
    for path, key in ((junit, "--junit"), (out, "--out")):
        if path is not None:
            results.require_file(path, key)
    chosen = None if trackers is None else [name.strip() for name in trackers.split(",")]
    wanted = list(dict.fromkeys([*metrics, *(limit.metric for limit in parsed)])) or ["position_rmse"]
    loaded = [stored.load(path) for path in runs]
    if parsed:
        regression.require_judgeable(loaded, chosen)
    outcome = differences.compare(loaded, wanted, chosen)
    judgements = regression.judge(outcome, parsed)
    if out is not None:
        results.write_text(out, compared.to_markdown(outcome, judgements))
    if junit is not None:
        results.write_text(junit, to_xml(suites_of_comparison([run.label for run in loaded], judgements)))
    found = compared.to_json(outcome, judgements)
    if as_json:
        click.echo(json.dumps(found, indent=2, allow_nan=False))
    else:
        compared.print_comparison(outcome, judgements, Console())
    raise click.exceptions.Exit(0 if found["passed"] else FAILED_EXPECTATION)
