"""Result of a run: its summary, tables and trackers, and the paired differences between the trackers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.base.errors import InputError, counted, nearest_choices, similar_path_hint
from trackbench.results.columns import table_of
from trackbench.results.folder import EXAMINATION, SUMMARY, json_text, save_files, sha256, write_file
from trackbench.results.metric_value import Json, MetricValue, ResultModel, data_frame, read_model
from trackbench.results.stored_tables import Tables
from trackbench.results.summary import SCHEMA_VERSION, Summary
from trackbench.results.tracker_result import BEATS_BOUND, TrackerResult

if TYPE_CHECKING:
    import pyarrow as pa


class Difference(ResultModel):
    """Metric value of tracker ``a`` minus that of tracker ``b``, paired over the runs."""

    a: str
    b: str
    metric: str
    unit: str
    value: float
    ci95: tuple[float, float] | None
    margin: float
    """Largest difference that does not matter, in the unit of the metric."""
    p_value: float | None
    """P-value of the hypothesis that the difference is within the margin, corrected for the number of tests. None for a
    difference outside the tests that are corrected together, which has no verdict."""
    better: str | None
    """Name of the tracker that is shown to be better by more than the margin; None where neither is shown to be
    better."""
    verdict: str | None
    """Name of the better tracker, ``equivalent`` or ``undecided``; ``larger`` or ``smaller`` (value of ``a``) where
    neither direction is better. None where the p-value is None."""
    without_charged: float | None = None
    """Difference over the given estimates alone. None unless over a tenth of either squared error is charged for
    missing estimates. If its sign differs from that of ``value``, neither tracker is called better."""

    @property
    def turned(self) -> bool:
        """Whether neither tracker is better although the difference is shown: ``without_charged`` has another sign."""
        shown = self.verdict in ("larger", "smaller")
        return shown and self.without_charged is not None and self.without_charged * self.value < 0


def difference_table(differences: Iterable[Difference]) -> pa.Table:
    """Return the table ``differences`` with one row for each difference; without columns if there are none."""
    rows = [{**vars(item), **dict(zip(_ENDS, item.ci95 or (None, None), strict=True))} for item in differences]
    words: dict[str, Any] = {name: [row[name] for row in rows] for name in _WORDS}
    numbers = {name: np.array([row[name] for row in rows], dtype=float) for name in _NUMBERS}
    return table_of([words | numbers] if rows else [])


def differences_from_table(table: pa.Table) -> list[Difference]:
    """Return the differences that the rows of the table ``differences`` hold."""
    rows = table.to_pylist()
    ends = [tuple(row.pop(name) for name in _ENDS) for row in rows]
    return [Difference(**row, ci95=None if None in ci95 else ci95) for row, ci95 in zip(rows, ends, strict=True)]


#: Columns of the table ``differences``: ends of the interval, words, and numbers.
_ENDS = ("ci95_low", "ci95_high")
_WORDS = ("a", "b", "metric", "unit", "better", "verdict")
_NUMBERS = ("value", *_ENDS, "margin", "p_value", "without_charged")
#: Tables that have only the recorded scene.
OF_RECORDED_RUN = ("measurements", "estimates", "recorded_nis", "recorded_modes", "taken", "gates", "objects", "due")
#: Largest number of trackers in one picture, and largest number of trackers listed on one page.
MOST_DRAWN, MOST_LISTED = 12, 1000


@dataclass(frozen=True)
class Result:
    """Result of a run: everything that a report, a recording or a comparison reads.

    ``result["ekf_cv"].position_rmse.value`` is a metric of a tracker.
    """

    summary: Summary
    tables: Tables

    def __repr__(self) -> str:
        summary = self.summary
        best = f", best {self.contenders[0].name}" if self.scored else ""
        return (
            f"<result {self.name}: {counted(summary.runs, 'run')}, {counted(len(summary.trackers), 'tracker')}{best}>"
        )

    def __getitem__(self, tracker: str) -> TrackerResult:
        """Return the metrics, failure and description of the tracker with this name.

        Raises:
            InputError: there is no tracker of this name.
        """
        if tracker not in self._by_name:
            raise InputError(f"no tracker {tracker!r} in this result; {nearest_choices(str(tracker), self)}")
        return self._by_name[tracker]

    @cached_property
    def _by_name(self) -> dict[str, TrackerResult]:
        return {tracker.name: tracker for tracker in self.summary.trackers}

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the trackers, in the order of the scenario."""
        return (entry.name for entry in self.summary.trackers)

    @cached_property
    def places(self) -> dict[str, int]:
        """Index from 0 of each tracker in the scenario file, by name, which selects the tracker's colour."""
        return {tracker.name: tracker.place for tracker in self.summary.trackers}

    @property
    def name(self) -> str:
        return self.summary.scenario.name

    @cached_property
    def differences(self) -> list[Difference]:
        """Paired differences of the ranked trackers: of every pair, or of each to ``summary.score.against``."""
        return differences_from_table(self.tables.if_there("differences"))

    @cached_property
    def scored(self) -> list[TrackerResult]:
        """Trackers whose errors can be compared (not failed, enough estimates), best first."""
        ranked = [self[name] for name in self.summary.ranking]
        return [tracker for tracker in ranked if not self.why_unscored(tracker)]

    @cached_property
    def contenders(self) -> list[TrackerResult]:
        """Scored trackers that know neither origins nor later measurements; all scored trackers if each knows them."""
        return [tracker for tracker in self.scored if not tracker.is_reference] or self.scored

    @property
    def filtering(self) -> list[TrackerResult]:
        """``contenders`` without the baselines that filter nothing; all contenders if all are such baselines."""
        return [tracker for tracker in self.contenders if not tracker.baseline] or self.contenders

    @property
    def drawn(self) -> list[TrackerResult]:
        """The best scored trackers, at most ``MOST_DRAWN``, which figures and recordings show."""
        return self.scored[:MOST_DRAWN]

    @cached_property
    def listed(self) -> Result:
        """Result that pages show, with no more than the first ``MOST_LISTED`` trackers of the ranking."""
        if len(self.summary.ranking) <= MOST_LISTED:
            return self
        names = self.summary.ranking[:MOST_LISTED]
        kept = {"ranking": names, "trackers": [self[name] for name in names]}
        listed = replace(self, summary=self.summary.model_copy(update=kept))
        inside = {*names}
        object.__setattr__(listed, "differences", [item for item in self.differences if {item.a, item.b} <= inside])
        return listed

    @property
    def unscored(self) -> list[TrackerResult]:
        """Trackers that failed, gave nothing to score or too few estimates, or are too good to be true."""
        return [tracker for tracker in self.summary.trackers if self.why_unscored(tracker)]

    def why_unscored(self, tracker: TrackerResult) -> str:
        """Return why a tracker is not compared with other trackers, such as a failure; empty where it is compared."""
        if tracker.failed is not None:
            return str(tracker.failed)
        headline = tracker.metrics.get(self.summary.headline)
        if headline is None or headline.value is None:
            return (headline and headline.reason) or "nothing to score"
        share = tracker.metrics["coverage"].value if "coverage" in tracker.metrics else None
        if share is not None and share < self.summary.score.min_coverage:
            least = 100 * self.summary.score.min_coverage
            given = math.floor(1000 * share) / 10
            return f"it gave {given:g} % of the estimates due, {least:g} % are needed (score.min_coverage)"
        return self.why_suspect(tracker)

    def why_suspect(self, tracker: TrackerResult) -> str:
        """Return why a tracker's estimates cannot come from measurements alone; empty where nothing suggests it."""
        return f"it {BEATS_BOUND}" if tracker.beats_bound(self.summary.reference) else ""

    def json(self) -> dict[str, Any]:
        """Return the summary as JSON values, without the sha256 digests of the tables."""
        return self.summary.model_dump(mode="json", exclude={"tables"})

    @property
    def rows(self) -> Iterator[Json]:
        """Rows with one metric value each: one tracker, one scene or all, one condition or all estimates.

        ``n`` is the number of runs, or of errors under a condition. ``reason`` says why a value or interval is missing.
        """
        summary = self.summary

        def row(scene: str, tracker: str, metric: str, condition: str, value: MetricValue, n: int) -> Json:
            keys = {"scenario": self.name, "scene": scene, "tracker": tracker, "metric": metric, "condition": condition}
            low, high = value.ci95 or (None, None)
            named = {"value": value.value, "low": low, "high": high, "n": n}
            return {**keys, **named, "unit": value.unit, "reason": value.reason}

        for tracker in summary.trackers:
            parts = [("", tracker.metrics, summary.runs)]
            parts += [(name, scores.metrics, scores.count) for name, scores in tracker.conditions.items() if name]
            for condition, metrics, n in parts:
                yield from (row("", tracker.name, path, condition, value, n) for path, value in metrics.items())
            for scene in (scene for scene in summary.truth.scenes if tracker.name in scene.error):
                value, n = MetricValue(value=scene.error[tracker.name], unit="m"), len(summary.truth.scenes)
                yield row(scene.name, tracker.name, summary.headline, "", value, summary.runs // n)

    def to_pandas(self, table: str | None = None) -> Any:
        """Return a table as a pandas data frame.

        Args:
            table: one of ``result.tables``; by default :attr:`rows`. With several scenes, ``truth`` and ``tracks`` have
                every scene, other tables of the recorded run the recorded scene; the column ``scene`` says which.

        Raises:
            InputError: there is no table of this name.
        """
        if table is None:
            return data_frame(self.rows)
        if table not in self.tables:
            raise InputError(f"no table {table!r} in this result; {nearest_choices(table, self.tables)}")
        rows, others = self.tables[table], self.tables.if_there(f"other_{table}")
        if len(self.summary.truth.motion) > 1 and (len(others) or table in OF_RECORDED_RUN):
            import pyarrow as pa

            rows = rows.append_column("scene", pa.array([float(self.summary.recorded_scene)] * len(rows)))
            rows = pa.concat_tables([rows, *([others] if len(others) else [])], promote_options="default")
            rows = rows.sort_by("scene")
        return rows.to_pandas()

    def save(self, folder: Path | str, artifacts: Mapping[str, Callable[[Path], None]] | None = None) -> None:
        """Write the run's folder under a temporary name beside it, and rename it when it is complete.

        Args:
            folder: final name; an earlier result under it is replaced.
            artifacts: function that writes each further file (report, recording), by file name.

        Raises:
            OutputError: the folder cannot be written or is something else, or the disk is full; nothing is left under
                the final name.
        """
        save_files({**self.files(), **(artifacts or {})}, Path(folder), SUMMARY)

    def files(self) -> dict[str, Callable[[Path], object]]:
        """Return the function that writes each file of numbers in the run's folder, by file name."""
        import pyarrow.parquet as pq

        tables = {
            f"{name}.parquet": partial(pq.write_table, table, compression="zstd") for name, table in self.tables.items()
        }
        # The summary comes last, as it has the digests of the tables.
        return {**tables, SUMMARY: self._write_summary}

    def _write_summary(self, file: Path) -> None:
        digests = {name: sha256(file.with_name(f"{name}.parquet")) for name in self.tables}
        write_file(json_text({**self.json(), "tables": digests}), file)

    def updated(self, **fields: Any) -> Result:
        """Return a copy of the result with other values for some fields of its summary."""
        return replace(self, summary=self.summary.model_copy(update=fields))

    @classmethod
    def from_json(cls, summary: Mapping[str, Any], tables: Mapping[str, pa.Table]) -> Result:
        """Return a result from the JSON values of its summary and from tables in memory.

        Raises:
            pydantic.ValidationError: the values are not those of a summary.
        """
        return cls(Summary.model_validate(summary), tables if isinstance(tables, Tables) else Tables(tables))

    @classmethod
    def load(cls, folder: Path | str) -> Result:
        """Load the result in a run's folder; ``folder`` is the folder or its ``result.json``.

        Raises:
            InputError: there is no result, it cannot be read, or it is of another version.
        """
        path = Path(folder)
        file = path if path.name == SUMMARY and not path.is_dir() else path / SUMMARY
        if not file.parent.is_dir():
            other = f"not the folder of a run, nor its {SUMMARY}"
            there = other if path.exists() else f"there is no such folder{similar_path_hint(path)}"
            hint = "; a scenario is run first: `trackbench run`" if path.suffix in (".yaml", ".yml") else ""
            raise InputError(there + hint, file=path)
        if not file.is_file():
            raise InputError(f"no {SUMMARY} in this folder: {_instead(file.parent)}", file=path)
        summary = read_model(Summary, file, "result", SCHEMA_VERSION)
        return cls(summary, Tables(summary.tables, file.parent))


def merged_places(results: Iterable[Result]) -> dict[str, int]:
    """Return each tracker's index in the scenario file of the first result that has the tracker."""
    places: dict[str, int] = {}
    for result in results:
        places |= {name: place for name, place in result.places.items() if name not in places}
    return places


def _instead(folder: Path) -> str:
    if (folder / EXAMINATION).is_file():
        return "it is the folder of an examination: open its report.html; `trackbench view` shows its recording"
    inside = sorted(file.parent.name for file in folder.glob(f"[!.]*/{SUMMARY}"))
    if inside:
        return f"it holds the folders of runs; name one of them: {', '.join(inside)}"
    return "it is not the folder of a run"
