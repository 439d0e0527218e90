"""``trackbench report`` and ``trackbench compare``: commands on finished runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click
from rich.console import Console

from trackbench import results
from trackbench.base.errors import InputError, counted
from trackbench.base.subjects import kind_of_file, offered, resolve
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import NearestChoice, end_with_limits, junit_option, write_suites

if TYPE_CHECKING:
    from trackbench.document import Document
    from trackbench.document.files import Format


_SAVED = dict(offered("documents"))
_KINDS = "".join(f" or of {kind_of_file(name)}," for name in _SAVED)
_REPORT_HELP = f"""Write the report of a saved result in any format.

RUN is the folder of a run, of several runs, which are compared,{_KINDS}
or a comparison.json. Nothing is run again.

\b
Examples:
  trackbench report results/highway
  trackbench report results/highway --format latex --out paper
  trackbench report results --format html --out page.html
  trackbench report results/traffic --format mot --out exported
"""


@click.command("report", help=_REPORT_HELP)
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option(
    "--format",
    "format",
    type=NearestChoice(["terminal", "html", "markdown", "latex", "csv", "svg", "pdf", "png", "mot"]),
    default="terminal",
    show_default=True,
    help="svg, pdf, png: every figure. csv: every table. latex: tables, and figures as PDF. mot: MOTChallenge text of "
    "the recorded run, if identities are hidden.",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="PATH", help="Folder for the files.  [default: RUN]")
def report_command(run: Path, format: Format | Literal["mot"], out: Path | None) -> None:
    """Write the report of a saved result in any format."""
    if format == "mot":
        from trackbench.report.export import mot_files

        _write(dict(mot_files(results.Result.load(run))), run if out is None else out)
        return
    from trackbench.document.files import files
    from trackbench.document.terminal import print_document

    document = _document(run)
    if format == "terminal" and out is None:
        print_document(document, Console(file=answer()))
        return
    folder, name = _target(run, format, out, document.kind)
    content_of = dict(files(document, format, name))
    if not content_of:
        raise InputError(f"{run} has nothing that can be written as {format}", key="--format")
    _write(content_of, folder)


def _write(content_of: Mapping[str, Callable[[], bytes]], folder: Path) -> None:
    results.require_writable(folder)
    for path, content in content_of.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        results.write_bytes(folder / path, content())
    numbers = Counter(Path(path).parts[0] for path in content_of)
    parts = (
        name if name in content_of else f"{counted(number, 'file')} in {name}/" for name, number in numbers.items()
    )
    print_answer(f"{folder}/: {', '.join(parts)}")


def _document(run: Path) -> Document:
    from trackbench.compare import compare_results, find_results, load_comparison
    from trackbench.report.comparison.document import comparison_document
    from trackbench.report.result import result_document

    for file, offer in _SAVED.items():
        path = run if run.name == file else run / file
        if path.is_file():
            saved: Document = resolve(offer.target)(path)
            return saved
    if run.suffix == ".json" and run.name != results.SUMMARY:
        return comparison_document(load_comparison(run))
    runs = find_results(run)
    if len(runs.entries) == 1:
        return result_document(runs.entries[0].result)
    return comparison_document(compare_results([runs]))


def _target(run: Path, format: Format, out: Path | None, name: str) -> tuple[Path, str]:
    """Return the folder for a report's files, and the name of the main file without its ending."""
    from trackbench.document.files import MAIN_ENDINGS

    if out is None:
        return (run if run.is_dir() else run.parent), name
    if out.suffix and out.suffix == MAIN_ENDINGS.get(format):
        return out.parent, out.stem
    if out.suffix in (".csv", ".svg", ".pdf", ".png") or out.is_file():
        raise InputError(f"{out}: name a folder, since several files are written", key="--out")
    return out, name


@click.command("compare")
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="A [B]...")
@click.option("--trackers", metavar="A,B", help="Only these trackers.")
@click.option("--baseline", metavar="NAME", help="Tracker of one set of results that the others are shown against.")
@click.option("--metric", "metrics", multiple=True, metavar="NAME", help="Metric to compare by; repeat it for several.")
@click.option(
    "--fail-on-regression",
    "limits",
    multiple=True,
    metavar="METRIC:PERCENT",
    help="Exit with 1 unless METRIC is shown to be worse by at most PERCENT.",
)
@junit_option("Write the regressions as JUnit XML.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the comparison to a file too: .md, .html, .txt, .tex, .csv, .json, .svg, .pdf or .png.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON, and nothing else.")
def compare_command(
    paths: tuple[Path, ...],
    trackers: str | None,
    baseline: str | None,
    metrics: tuple[str, ...],
    limits: tuple[str, ...],
    junit: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Compare the trackers of finished runs, or versions of them.

    A, B and so on are folders of a run, or of the runs of several scenarios. The first is the baseline; with three
    or more the results are drawn over time. Nothing is run again. `trackbench report` shows a comparison.json again.

    \b
    Examples:
      trackbench compare results/highway --metric velocity_rmse
      trackbench compare results/
      trackbench compare results/highway --baseline ekf_cv
      trackbench compare before/ after/ --fail-on-regression position_rmse:5
      trackbench compare before/highway after/highway --out table.tex
      trackbench compare nightly/* --out nights.html

    \b
    Exit status:
      0 compared, each limit shown to be kept   1 a limit is broken or undecided
      2 bad input or not comparable   4 cannot write
    """
    from trackbench.compare import Limit, compare_results, find_sets
    from trackbench.document.files import require_ending
    from trackbench.document.terminal import print_document
    from trackbench.report.comparison.document import ENDINGS, comparison_document, comparison_files
    from trackbench.report.junit import suites_of_comparison

    parsed = [Limit.parse(text) for text in limits]
    if junit is not None and not parsed:
        raise InputError("lists the limits of --fail-on-regression: give one too", key="--junit")
    if out is not None:
        require_ending(out, ENDINGS, "--out")
    for path, key in ((junit, "--junit"), (out, "--out")):
        if path is not None:
            results.require_file(path, key)
    names = None if trackers is None else [name.strip() for name in trackers.split(",")]
    comparison = compare_results(find_sets(paths), metrics=metrics, trackers=names, baseline=baseline, limits=parsed)
    written = []
    for file, content in comparison_files(comparison, out) if out is not None else ():
        results.write_bytes(file, content)
        written.append(file)
    write_suites(suites_of_comparison(comparison), junit)
    if as_json:
        print_answer(json.dumps(comparison.json(), indent=2, allow_nan=False))
    else:
        print_document(comparison_document(comparison), Console(file=answer()))
        if out is not None:
            click.echo(", ".join(map(str, written)), err=True)
    end_with_limits(comparison.outcomes)
