"""The results of one scenario in some folders, in the order in which they were made."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackbench.base.errors import InputError, counted, nearest_choices
from trackbench.compare.comparability import compared_metrics
from trackbench.compare.entries import Entry
from trackbench.metrics import Interval, Metric
from trackbench.results import SUMMARY, Result


class PastResult(Entry):
    """A result whose intervals are read once, though it is compared with many."""

    @cached_property
    def _intervals(self) -> dict[Any, Interval | None]:
        return {}

    def interval(
        self, tracker: str, metric: Metric, runs: NDArray[Any] | None = None, *, over_stretches: bool = False
    ) -> Interval | None:
        key = tracker, metric.path, None if runs is None else runs.tobytes(), over_stretches
        if key not in self._intervals:
            self._intervals[key] = super().interval(tracker, metric, runs, over_stretches=over_stretches)
        return self._intervals[key]

    @cached_property
    def metrics(self) -> dict[str, Metric]:
        """Those that it has a value of in each run, by path."""
        summary = self.result.summary
        return compared_metrics(summary.score.metrics, built_in=summary.identities == "known")

    @cached_property
    def fingerprints(self) -> frozenset[str]:
        """Of the measurements of its runs."""
        return frozenset(self.result.summary.fingerprints)

    @property
    def time(self) -> datetime:
        """When it was made; before all others where it does not say."""
        made = self.result.summary.provenance
        return datetime.min.replace(tzinfo=UTC) if made is None else made.time


@dataclass(frozen=True)
class PooledResults(Entry):
    """Results with noise of their own as one sample of all their runs; its label and summary are those of the first."""

    members: tuple[PastResult, ...] = ()

    @classmethod
    def of(cls, results: Sequence[PastResult]) -> PooledResults:
        """Those of some results of which no run has the measurements of one before."""
        members: list[PastResult] = []
        for result in results:
            if all(result.fingerprints.isdisjoint(other.fingerprints) for other in members):
                members.append(result)
        return cls(members[0].label, members[0].result, tuple(members))

    def interval(self, tracker: str, metric: Metric, *runs: Any, **options: Any) -> Interval | None:
        """Of all runs; scenes are the same in each result, and do not become more."""
        intervals = (member.interval(tracker, metric, *runs, **options) for member in self.members)
        if not (every := [interval for interval in intervals if interval is not None]):
            return None
        each = [interval.value + interval.influence for interval in every]
        alike = every[0].scenes and len({*map(len, each)}) == 1
        pooled = np.mean(each, axis=0) if alike else np.concatenate(each)
        return every[0]._replace(value=float(pooled.mean()), influence=pooled - pooled.mean(), weight=None)


class PastResults(NamedTuple):
    """The results of one scenario, the earliest first."""

    scenario: str
    entries: list[PastResult]
    notes: list[str]
    """What of the folders is left out."""


def results_of_scenario(folders: Sequence[Path], scenario: str | None = None) -> PastResults:
    """The results of a scenario under some folders: of the one that most results are of unless named.

    Raises:
        InputError: a folder holds none, one cannot be read, or there is none of the scenario.
    """
    files = {file.resolve(): file for folder in folders for file in _files(folder)}
    entries = [PastResult(str(file.parent), Result.load(file)) for file in files.values()]
    numbers = Counter(entry.result.name for entry in entries)
    if scenario is not None and scenario not in numbers:
        raise InputError(
            f"no result of the scenario {scenario!r}; {nearest_choices(scenario, numbers)}", key="--scenario"
        )
    chosen = scenario or max(numbers, key=numbers.__getitem__)
    own = sorted((entry for entry in entries if entry.result.name == chosen), key=lambda entry: entry.time)
    return PastResults(chosen, own, list(_notes(chosen, own, numbers)))


def _files(folder: Path) -> Iterator[Path]:
    """Every result.json in a folder and those in it; the folder of a run has its own alone."""
    if not folder.is_dir() or (folder / SUMMARY).is_file():
        yield folder / SUMMARY if folder.is_dir() else folder
        return
    inside = sorted(file for file in folder.rglob(SUMMARY) if not _hidden(file.relative_to(folder)))
    if not inside:
        raise InputError(f"no {SUMMARY} in this folder, nor in the folders in it", file=folder)
    yield from inside


def _hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _notes(chosen: str, own: Sequence[PastResult], numbers: Counter[str]) -> Iterator[str]:
    others = {name: number for name, number in numbers.items() if name != chosen}
    if others:
        names = ", ".join(f"{name} ({number})" for name, number in others.items())
        left_out = counted(sum(others.values()), "result")
        yield f"{left_out} of other scenarios left out: {names}; --scenario NAME shows those of another"
    timeless = sum(entry.result.summary.provenance is None for entry in own)
    if timeless:
        yield f"{counted(timeless, 'result')} of an earlier version, without a time: placed first, in the order found"
