"""The differences between trackers of one run, or of several comparable ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

from trackbench.compare.grounds import Grounds, grounds
from trackbench.compare.stored import StoredRun
from trackbench.errors import InputError, nearest
from trackbench.metrics.intervals import ROUNDING, holm, paired, unpaired
from trackbench.metrics.stored import ROOT_MEAN_SQUARES as COMPARED

BETTER, WORSE, NO_DIFFERENCE = "better", "worse", "no difference shown"
#: Level at which a difference is real, after the correction.
LEVEL = 0.05
#: Shares of steps with an estimate that differ by more than this belong to errors of different moments.
COVERAGE = 0.01


class Entrant(NamedTuple):
    """One tracker in one run."""

    run: int
    """Number of the run, in the order in which they were named."""
    tracker: str


@dataclass(frozen=True)
class Difference:
    """The error of one entrant minus that of another."""

    metric: str
    unit: str
    entrant: Entrant
    against: Entrant
    value: float
    """Of the entrant."""
    reference: float
    """Of the one that it is held against."""
    ci95: tuple[float, float] | None
    """Of the difference; None with fewer than two runs."""
    p_value: float
    """Corrected for the number of differences of this metric."""
    paired: bool

    @property
    def difference(self) -> float:
        return self.value - self.reference

    @property
    def percent(self) -> float | None:
        """The difference in percent of the reference."""
        return 100.0 * self.difference / self.reference if self.reference > 0 else None

    @property
    def identical(self) -> bool:
        """Whether the two had the same error in every run, but for rounding."""
        reach = max(self.value, self.reference) * ROUNDING
        return self.paired and self.ci95 is not None and max(map(abs, self.ci95)) <= reach

    @property
    def verdict(self) -> str:
        if self.p_value >= LEVEL:
            return NO_DIFFERENCE
        return BETTER if self.difference < 0 else WORSE


@dataclass(frozen=True)
class Missing:
    """A pair that could not be compared."""

    metric: str
    entrant: Entrant
    against: Entrant
    reason: str
    of_entrant: bool
    """Whether it is the entrant that has no value, and the other one has."""


@dataclass(frozen=True)
class Outcome:
    """Everything that was found."""

    runs: tuple[StoredRun, ...]
    grounds: tuple[Grounds, ...]
    """Of each later run against the first."""
    differences: tuple[Difference, ...]
    missing: tuple[Missing, ...]
    notes: tuple[str, ...]


def compare(runs: Sequence[StoredRun], metrics: Sequence[str], trackers: Sequence[str] | None = None) -> Outcome:
    """Compare the trackers of one run with each other, or the same tracker over runs, each with that of the first.

    Where each run has a single tracker, those are compared whatever their names.

    Args:
        runs: at least one; the first is the baseline.
        metrics: what to compare by.
        trackers: names of those to compare; all unless given.

    Raises:
        InputError: runs that cannot be compared, a name that is not there, nothing to compare.
    """
    for metric in metrics:
        if metric not in COMPARED:
            raise InputError(f"{metric!r} is not compared run by run; {nearest(metric, COMPARED)}", key="--metric")
    found = tuple(grounds(runs[0], later) for later in runs[1:])
    chosen = [_chosen(run, trackers, several=len(runs) > 1) for run in runs]
    _require_known(runs, trackers)
    pairs = list(_pairs(chosen))
    if not pairs:
        what = "no tracker of the same name in the first run and a later one" if len(runs) > 1 else "only one tracker"
        raise InputError(f"nothing to compare: {what}", file=runs[-1].label)
    outcomes = [_compare(runs, found, metric, pair) for metric in metrics for pair in pairs]
    differences = [item for item in outcomes if isinstance(item, Difference)]
    return Outcome(
        runs=tuple(runs),
        grounds=found,
        differences=tuple(item for metric in metrics for item in _corrected(differences, metric)),
        missing=tuple(item for item in outcomes if isinstance(item, Missing)),
        notes=tuple(_notes(runs, chosen, pairs)),
    )


def _chosen(run: StoredRun, trackers: Sequence[str] | None, several: bool) -> list[str]:
    if trackers is None:
        return run.trackers
    if not several:
        for name in trackers:
            if name not in run.trackers:
                raise InputError(f"no tracker {name!r} in this run; {nearest(name, run.trackers)}", file=run.label)
    return [name for name in run.trackers if name in trackers]


def _require_known(runs: Sequence[StoredRun], trackers: Sequence[str] | None) -> None:
    known = {name for run in runs for name in run.trackers}
    for name in trackers or ():
        if name not in known:
            raise InputError(f"no tracker {name!r} in these runs; {nearest(name, known)}", key="--trackers")


def _pairs(chosen: Sequence[Sequence[str]]) -> Iterator[tuple[Entrant, Entrant]]:
    """Each entrant with the one that it is held against."""
    first = chosen[0]
    if len(chosen) == 1:
        yield from ((Entrant(0, a), Entrant(0, b)) for a, b in combinations(first, 2))
    for number, names in enumerate(chosen[1:], 1):
        if len(first) == len(names) == 1:
            yield Entrant(number, names[0]), Entrant(0, first[0])
        else:
            yield from ((Entrant(number, name), Entrant(0, name)) for name in first if name in names)


def _compare(
    runs: Sequence[StoredRun], found: Sequence[Grounds], metric: str, pair: tuple[Entrant, Entrant]
) -> Difference | Missing:
    """One difference, its p-value still as it is alone."""
    entrant, against = pair
    own, other = (runs[item.run].interval(item.tracker, metric) for item in pair)
    if own is None or other is None:
        without = entrant if own is None else against
        reason = runs[without.run].failure(without.tracker) or "there is nothing to score"
        return Missing(
            metric, entrant, against, f"{without.tracker} in {runs[without.run].label}: {reason}", other is not None
        )
    is_paired = entrant.run == against.run or found[entrant.run - 1].paired
    result = paired(own, other) if is_paired else unpaired(own, other)
    return Difference(
        metric,
        COMPARED[metric].unit,
        entrant,
        against,
        own.value,
        other.value,
        result.ci95,
        result.p_value,
        is_paired,
    )


def _corrected(differences: Sequence[Difference], metric: str) -> list[Difference]:
    """Those of one metric, their p-values corrected for their number."""
    own = [item for item in differences if item.metric == metric]
    return [replace(item, p_value=p) for item, p in zip(own, holm([item.p_value for item in own]), strict=True)]


def _notes(
    runs: Sequence[StoredRun], chosen: Sequence[Sequence[str]], pairs: Sequence[tuple[Entrant, Entrant]]
) -> Iterator[str]:
    """What a reader must know beside the differences."""
    if any(run.summary.runs == 1 for run in runs):
        yield "one run gives no interval and shows no difference"
    compared = {entrant for pair in pairs for entrant in pair}
    for number, names in enumerate(chosen):
        alone = [name for name in names if Entrant(number, name) not in compared]
        if alone:
            yield f"in {runs[number].label} alone, so not compared: {', '.join(alone)}"
    for entrant, against in pairs:
        own, other = (runs[item.run].coverage(item.tracker) for item in (entrant, against))
        if own is not None and other is not None and abs(own - other) > COVERAGE:
            yield (
                f"{entrant.tracker} gave an estimate at {100 * own:.0f} % of the steps, "
                f"{against.tracker} at {100 * other:.0f} %: their errors are of different moments"
            )
