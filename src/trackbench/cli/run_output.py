"""Terminal output of ``trackbench run``, as a listener to the run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.text import Text

from trackbench import results
from trackbench.api.plan import Listener, Prepared
from trackbench.base.types import NotedProgress, Scan
from trackbench.cli.answer import answer
from trackbench.cli.terminal import progress
from trackbench.results import Result

if TYPE_CHECKING:
    from trackbench.compare import Comparison
    from trackbench.runner.recorded import OnRecordedRun, RecordedInstant


class RunOutput(Listener):
    """Listener that shows progress bars and each scenario's outcome; with ``as_json`` it prints nothing to stdout."""

    def __init__(self, as_json: bool, quiet: bool, *, wide: bool = False) -> None:
        self._as_json = as_json
        self._quiet = quiet
        self._wide = wide
        self._console = Console(file=answer())
        self.followers: list[Listener] = []
        """Listeners of optional parts of the bench, such as ``--live``, to which messages are passed on."""

    @property
    def observes(self) -> bool:
        return any(follower.observes for follower in self.followers)

    @contextmanager
    def progress(self, work: str, unit: str) -> Iterator[NotedProgress]:
        with progress(work, unit, quiet=self._quiet) as advance:
            yield advance

    def note(self, text: str) -> None:
        click.echo(text, err=True)

    def begin(self, item: Prepared) -> OnRecordedRun | None:
        observers = [observe for follower in self.followers if (observe := follower.begin(item)) is not None]

        def observe_all(observed: list[Scan] | RecordedInstant) -> None:
            for observe in observers:
                observe(observed)

        return observe_all if observers else None

    def end(self, result: Result, folder: Path | None) -> None:
        from trackbench.report.console import print_outcome, print_summary

        for follower in self.followers:
            follower.end(result, folder)
        if self._as_json:
            return
        if self._quiet:
            print_outcome(result, self._console)
            return
        print_summary(result, self._console, folder, wide=self._wide)
        written = [file for file in result.summary.artifacts.values() if not file.endswith(".parquet")]
        files = f"{folder}/: {', '.join([results.SUMMARY, *written])}"
        self._console.print(Text(f"{files}\n", "dim"), soft_wrap=True)

    def compared(self, comparison: Comparison, page: Path) -> None:
        """Print which tracker leads, the page's path, and which scenarios are left out.

        Where scenarios were run in several worlds (kinds of drivers and sensors), print also in which worlds the order
        of the trackers holds.
        """
        from trackbench.document.terminal import print_table
        from trackbench.report.comparison.document import scenarios_without_truth
        from trackbench.report.comparison.figures import competitors
        from trackbench.report.comparison.over_scenarios import who_is_ahead
        from trackbench.report.comparison.sentences import world_tables

        if not self._as_json and not self._quiet:
            for group in comparison.groups:
                if len(competitors(group)) > 1 and len(group.scenarios) > 1:
                    self._console.print(Text(who_is_ahead(group)))
                for table in world_tables(group):
                    print_table(table, self._console)
            scenarios = sum(len(group.scenarios) for group in comparison.groups)
            parts = [f"Comparison of {scenarios} scenarios: {page}", *scenarios_without_truth(comparison)]
            self._console.print("; ".join(parts), highlight=False, soft_wrap=True)
