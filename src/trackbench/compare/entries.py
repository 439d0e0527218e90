"""Stored results to be compared, loaded from the folder of a run or from a folder with folders of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.base.subjects import kind_of_file, offered
from trackbench.base.types import Array
from trackbench.metrics import Interval, Metric, clustered
from trackbench.metrics.intervals import FEWEST_SCENES
from trackbench.metrics.sums import SHORTEST
from trackbench.results import Result
from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.load import scenario_of
from trackbench.scenario.validate import same_every_run

#: Overrides that remove parts of a scenario that a comparison does not read, and whose code may be missing.
LEFT_OUT = ("score.metrics=[]", "expect=[]", "recording.scene=0")
#: Overrides with trackers that any scenario may have, even without sensors, by ``identities``.
ANY = {"known": "trackers={raw: {use: raw}}", "hidden": "trackers={one: {use: tracks, path: none.csv}}"}


@dataclass(frozen=True)
class Entry:
    """Stored result that takes part in a comparison, with its folder."""

    label: str
    """Folder of the result, as the user wrote it."""
    result: Result

    @property
    def trackers(self) -> list[str]:
        """Names of the ranked trackers, best first."""
        return self.result.summary.ranking

    @cached_property
    def scenario(self) -> ScenarioConfig:
        """Scenario as it was run, but without trackers, metrics and expectations.

        Raises:
            InputError: this version does not read the scenario, or a plug-in of its truth or sensors is missing.
        """
        summary = self.result.summary
        stored, trackers = summary.scenario, ANY[summary.identities]
        try:
            return scenario_of(stored.text, Path(stored.name), [*stored.overrides, trackers, *LEFT_OUT]).config
        except InputError as error:
            problem = "this version of trackbench cannot read its scenario"
            if error.message.startswith("cannot import "):
                problem = "a plug-in of its truth and sensors must be importable here"
            raise InputError(f"{problem}: {error.message}", file=self.label, key=error.key) from None

    def table(self, name: str) -> pa.Table:
        """Return the table of the result with this name.

        Raises:
            InputError: the table is missing or damaged.
        """
        if name not in self.result.tables:
            raise InputError(f"missing {name}.parquet beside {results.SUMMARY}, needed to compare", file=self.label)
        return self.result.tables[name]

    def failure(self, tracker: str) -> str | None:
        """Return why a tracker is not compared with other trackers, such as a failure; None if it is compared."""
        return self.result.why_unscored(self.result[tracker]) or None

    def coverage(self, tracker: str) -> float:
        """Return the share of the due estimates that a tracker gave; 0 if the result does not state it."""
        metric = self.result[tracker].metrics.get("coverage")
        return (metric.value if metric else None) or 0.0

    @cached_property
    def stretches(self) -> int:
        """Number of stretches of time that intervals come from; 0 where they come from runs or scenes."""
        table = self.result.tables.if_there("stretches")
        return len(pc.unique(table["stretch"])) if len(table) else 0

    def over_stretches(self, metric: Metric) -> bool:
        """Return whether the interval of a metric is computed from stretches of time instead of runs or scenes."""
        return {*metric.columns} <= {*self.result.tables.if_there("stretches").column_names}

    @cached_property
    def repeatable(self) -> bool:
        """Whether the run uses no random numbers, so that a repetition gives an unchanged tracker the same values."""
        return same_every_run(self.scenario)

    def without_interval(self, metric: Metric) -> str:
        """Return why the result cannot show that a metric got worse, with advice; empty if it can show that.

        To show that a metric got worse takes an interval, or recorded data without random numbers.
        """
        summary = self.result.summary
        scenes = len(summary.truth.scenes)
        if self.repeatable or (self.stretches > 1 and self.over_stretches(metric)):
            return ""
        if 0 < scenes < FEWEST_SCENES:
            return f"{scenes} scenes give no interval of {metric.path}: take {FEWEST_SCENES} or more"
        if summary.runs > 1:
            return ""
        if self.stretches > 1:
            return f"{metric.path} has one value in a run, so a single run gives no interval: pool several logs"
        if self.stretches == 1:
            seconds = summary.score.to_s - summary.score.from_s
            needed = f"at least {2 * SHORTEST:g} s, for two stretches of time, or several logs"
            return f"{seconds:.2g} s of a single run give no interval: record {needed}"
        if summary.identities == "hidden":
            what = "cut a log by truth.stretches, pool several logs, or take more runs"
            return f"a single run with hidden identities gives no interval: {what}"
        return "a single run of another version gives no interval: run it again"

    def interval(
        self, tracker: str, metric: Metric, runs: NDArray[np.intp] | None = None, *, over_stretches: bool = False
    ) -> Interval | None:
        """Return a metric of a tracker with the influence of each run or scene; None where there is nothing to compare.

        With several scenes, the interval has the influence of each scene, else of each run.

        Args:
            tracker: name of the tracker.
            metric: metric to read.
            runs: numbers of the runs to take; None for all.
            over_stretches: whether to return the influence of each stretch of time instead.

        Raises:
            InputError: the table does not hold the metric.
        """
        table = self.table("stretches" if over_stretches else "runs")
        if self.failure(tracker) or len(table) == 0:
            return None
        rows = table.filter(pc.equal(table["tracker"], tracker))
        if runs is not None:
            rows = rows.filter(pa.array(np.isin(self._column(rows, "run"), runs)))
        interval = metric.of_runs(*(self._column(rows, column) for column in metric.columns))
        if interval is None or over_stretches:
            return interval and interval._replace(of_stretches=True)
        scene = self._column(rows, "scene")
        truth = self.result.summary.truth
        clusters = clustered(interval, scene.astype(np.intp), in_time=truth.log_stretches > 0)
        return clusters._replace(few_decide=truth.few_scenes_decide)

    def _column(self, rows: pa.Table, name: str) -> Array:
        if name not in rows.column_names:
            message = f"its tables have no column {name}: compare by a metric that every result has"
            raise InputError(message, file=self.label)
        values: Array = rows[name].to_numpy().astype(np.float64)
        return values


@dataclass(frozen=True)
class ResultSet:
    """Results of one version of the trackers: one stored result for each scenario, under a common label."""

    label: str
    entries: tuple[Entry, ...]


def results_in(folder: Path, finished: Sequence[Result]) -> ResultSet:
    """Return a set of finished results in memory; each is labelled by the path of its scenario's name in ``folder``."""
    return ResultSet(str(folder), tuple(Entry(str(folder / result.name), result) for result in finished))


def find_sets(paths: Sequence[Path]) -> list[ResultSet]:
    """Load the set of results at each path.

    Raises:
        InputError: a path fails as in :func:`find_results`; or some of several paths hold no results, such as files
            that a shell's ``*`` also matches.
    """
    others = [path for path in paths if path.exists() and not _has_results(path)]
    if others and len(paths) > 1:
        raise InputError(f"leave out what is no result: {', '.join(map(str, others))}")
    return [find_results(path) for path in paths]


def _has_results(path: Path) -> bool:
    if not path.is_dir():
        return path.name == results.SUMMARY
    return (path / results.SUMMARY).is_file() or bool(_folders_of_runs(path))


def _folders_of_runs(folder: Path) -> list[Path]:
    return sorted(file.parent for file in folder.glob(f"[!.]*/{results.SUMMARY}"))


def find_results(path: Path) -> ResultSet:
    """Load the result in the folder of a run, or all results in the subfolders of a folder.

    Raises:
        InputError: there is no result, one cannot be read, or two are of the same scenario.
    """
    folders = [path]
    if path.is_dir() and not (path / results.SUMMARY).is_file():
        folders = _folders_of_runs(path) or [path]
        for file, _ in offered("documents"):
            if (path / file).is_file():
                raise InputError(f"{kind_of_file(file)} is not compared; `trackbench report` shows it", file=path)
    entries = tuple(Entry(str(folder), Result.load(folder)) for folder in folders)
    labels: dict[str, str] = {}
    for entry in entries:
        name = entry.result.name
        if name in labels:
            raise InputError(f"two results of the scenario {name!r}, here and in {labels[name]}", file=entry.label)
        labels[name] = entry.label
    return ResultSet(str(path), entries)
