"""Results to be compared, as they are named on the command line: folders of runs, or of many runs."""

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

#: What a comparison does not read of a scenario, and may be code that is not here.
LEFT_OUT = ("score.metrics=[]", "expect=[]", "recording.scene=0")
#: Trackers that any scenario may have, also one without sensors, by whether identities are known.
ANY = {"known": "trackers={raw: {use: raw}}", "hidden": "trackers={one: {use: tracks, path: none.csv}}"}


@dataclass(frozen=True)
class Entry:
    """One result that takes part."""

    label: str
    """Its folder, as the user named it."""
    result: Result

    @property
    def trackers(self) -> list[str]:
        """Best first."""
        return self.result.summary.ranking

    @cached_property
    def scenario(self) -> ScenarioConfig:
        """The scenario as it was run, but for its trackers, its own metrics and what it expects.

        Raises:
            InputError: this version does not read it, or its truth or a sensor is a plug-in that is not there.
        """
        summary = self.result.summary
        kept, trackers = summary.scenario, ANY[summary.identities]
        try:
            return scenario_of(kept.text, Path(kept.name), [*kept.overrides, trackers, *LEFT_OUT]).config
        except InputError as error:
            problem = "its scenario is not one that this version reads"
            if error.message.startswith("cannot import "):
                problem = "a plug-in of its truth and sensors must be importable here"
            raise InputError(f"{problem}: {error.message}", file=self.label, key=error.key) from None

    def table(self, name: str) -> pa.Table:
        """A table of the result.

        Raises:
            InputError: it is missing or damaged.
        """
        if name not in self.result.tables:
            raise InputError(f"no {name}.parquet beside {results.SUMMARY}, which a comparison reads", file=self.label)
        return self.result.tables[name]

    def failure(self, tracker: str) -> str | None:
        """Why a tracker is not held against others, if it is not."""
        return self.result.why_unscored(self.result[tracker]) or None

    def coverage(self, tracker: str) -> float:
        """Share of the estimates that a tracker should give that it gave; 0 where it has none."""
        metric = self.result[tracker].metrics.get("coverage")
        return (metric.value if metric else None) or 0.0

    @cached_property
    def stretches(self) -> int:
        """Number of stretches of time on which intervals rest; 0 where they rest on runs or scenes."""
        table = self.result.tables.if_there("stretches")
        return len(pc.unique(table["stretch"])) if len(table) else 0

    def over_stretches(self, metric: Metric) -> bool:
        """Whether the interval of a metric rests on stretches of time."""
        return {*metric.columns} <= {*self.result.tables.if_there("stretches").column_names}

    @cached_property
    def repeatable(self) -> bool:
        """Whether nothing is drawn: a tracker that stays the same has the same values however often it is run."""
        return same_every_run(self.scenario)

    def without_interval(self, metric: Metric) -> str:
        """Why no regression of a metric can be shown here, and what would show one; empty where one can be.

        It takes an interval, or recorded data in which nothing is drawn.
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
            return f"a single run gives no interval of {metric.path}, which has one value in a run: pool several logs"
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
        """A metric of a tracker with what each run adds to it; None where there is nothing to compare.

        With runs of several scenes it is what each scene adds.

        Args:
            tracker: its name.
            metric: what to read.
            runs: the numbers of the runs to take; all unless given.
            over_stretches: whether it is what each stretch of time adds instead.

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
    """The results of one version of the trackers, one for each scenario."""

    label: str
    entries: tuple[Entry, ...]


def results_in(folder: Path, finished: Sequence[Result]) -> ResultSet:
    """Results that are at hand, each with a folder of the scenario's name in a folder."""
    return ResultSet(str(folder), tuple(Entry(str(folder / result.name), result) for result in finished))


def find_results(path: Path) -> ResultSet:
    """The result in the folder of a run (or in its ``result.json``), or those in the folders of a folder.

    Raises:
        InputError: there is none, one is no result, or two are of the same scenario.
    """
    folders = [path]
    if path.is_dir() and not (path / results.SUMMARY).is_file():
        folders = sorted(file.parent for file in path.glob(f"[!.]*/{results.SUMMARY}")) or [path]
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
