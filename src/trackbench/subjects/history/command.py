"""``trackbench history``"""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import Whole, end_with_limits, github_option, names_in, out_option, write_suites


@click.command("history")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DIR...")
@click.option("--scenario", metavar="NAME", help="Whose results.  [that of most of them]")
@click.option("--metric", "metrics", multiple=True, metavar="NAME", help="What to look at; may be given again.")
@click.option("--trackers", metavar="A,B", help="Only these trackers.")
@click.option(
    "--gate",
    "limits",
    multiple=True,
    metavar="METRIC:PERCENT",
    help="Exit with 1 unless the last result is shown not to be worse by more than any of the window.",
)
@click.option(
    "--window",
    type=Whole(1, 10_000),
    metavar="N",
    default=5,
    show_default=True,
    help="Results before the last one that it is held against.",
)
@click.option("--junit", type=click.Path(path_type=Path), metavar="FILE", help="Write the limits as JUnit XML.")
@github_option
@out_option("Write history.html, history.md and history.json there.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def history_command(
    folders: tuple[Path, ...],
    scenario: str | None,
    metrics: tuple[str, ...],
    trackers: str | None,
    limits: tuple[str, ...],
    window: int,
    junit: Path | None,
    github: bool,
    out: Path | None,
    as_json: bool,
) -> None:
    """Show how results changed over time.

    DIR is the folder of a run, or one with such folders in it, however deep. The results of one scenario are laid in
    the order in which they were made. A change is marked where it is shown, with what else changed: versions, the
    scenario, the tracker's code, the commit. Nothing is run again.

    \b
    Examples:
      trackbench history nightly/
      trackbench history nightly/ --gate position_rmse:5 --window 10
      trackbench history nightly/ --metric velocity_rmse --out page

    \b
    Exit status: 0 shown, and each limit is shown to be kept, 1 a limit is broken
    or undecided, 2 bad input, 4 cannot write
    """
    from trackbench.compare import Limit
    from trackbench.document.terminal import print_document
    from trackbench.subjects.history.api import history_files
    from trackbench.subjects.history.changes import OPTION
    from trackbench.subjects.history.history import history_of
    from trackbench.subjects.history.report import history_document, suite_of_history

    parsed = [Limit.parse(text, OPTION) for text in limits]
    for asked_for, key in ((junit is not None, "--junit"), (github, "--github")):
        if asked_for and not parsed:
            raise InputError(f"says which limits are kept: give {OPTION} too", key=key)
    if junit is not None:
        results.require_file(junit, "--junit")
    if out is not None:
        results.require_writable(out)
    past = history_of(
        folders,
        metrics=metrics,
        trackers=None if trackers is None else names_in(trackers),
        scenario=scenario,
        limits=parsed,
        window=window,
    )
    for file, content in history_files(past, out) if out is not None else ():
        results.write_bytes(file, content)
    write_suites([suite_of_history(past)], junit, github, as_json)
    if as_json:
        print_answer(results.json_text(past.json()), nl=False)
    else:
        print_document(history_document(past), Console(file=answer()))
        if out is not None:
            click.echo(f"{out}/: history.html, history.md, history.json", err=True)
    end_with_limits(past.outcomes)
