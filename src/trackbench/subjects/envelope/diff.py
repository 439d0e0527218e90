"""Difference between two maps with the same axes: cells in which a tracker no longer meets its requirement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from trackbench.base.errors import InputError, counted
from trackbench.metrics.intervals import Interval
from trackbench.report.junit import Case, Suite
from trackbench.report.pairs import difference_word
from trackbench.subjects.envelope.axes import Point
from trackbench.subjects.envelope.bounds import interval_difference
from trackbench.subjects.envelope.cells import decide
from trackbench.subjects.envelope.claim import (
    Claim,
    ClaimCell,
    ClaimedLimit,
    Envelope,
    State,
    TrackerState,
    place_of_cell,
)
from trackbench.subjects.envelope.margins import holding, margins, place_of_line

#: ``lost``: from holds to fails, and shown to be worse. ``not shown``: from holds to fails, within the error.
#: ``gained``: from fails to holds. ``open``: undecided in one of the two maps.
Outcome = Literal["same", "lost", "not shown", "gained", "open"]


class CellChange(NamedTuple):
    """Change of a tracker's state (holds, fails or undecided) in a cell that two maps have in common."""

    point: Point
    place: str
    tracker: str
    before: State
    after: State
    outcome: Outcome
    paired: bool
    """Whether both maps have the same measurements in the cell, so that values are compared run by run."""
    text: str
    """Metric values before and after; the cause instead if values are missing, or if no limit explains the failure."""


@dataclass(frozen=True)
class EnvelopeDiff:
    """Differences between two maps: changed states of cells, and borders that moved."""

    before: Claim
    after: Claim
    changes: tuple[CellChange, ...]
    """One item for each tracker in each cell that both maps have, also where the state is the same."""
    left_out: tuple[str, ...]
    """Sentences on cells and trackers that are in one map alone."""
    margins: tuple[str, ...]
    """Sentences on the axis values at which a requirement ceases to hold, where they changed."""

    @property
    def passed(self) -> bool:
        """Whether no cell was lost: a lost cell held before, fails now, and is shown to be worse."""
        return not self.of("lost")

    def of(self, *outcomes: Outcome) -> list[CellChange]:
        """Return the changes whose outcome is among ``outcomes``, such as ``lost``."""
        return [item for item in self.changes if item.outcome in outcomes]

    def json(self) -> dict[str, Any]:
        """Return the differences as ``trackbench envelope diff --json`` prints them."""
        return {
            "passed": self.passed,
            "compared": len(self.changes),
            "paired": sum(item.paired for item in self.changes),
            "changes": [
                {**item._asdict(), "point": list(item.point)} for item in self.changes if item.outcome != "same"
            ],
            "left_out": list(self.left_out),
            "margins": list(self.margins),
        }

    def lines(self) -> Iterator[str]:
        """Yield the lines that ``trackbench envelope diff`` prints."""
        paired = sum(item.paired for item in self.changes)
        yield f"{counted(len(self.changes), 'state')} compared, {paired} of them on the same measurements"
        for item in self.of("lost", "not shown"):
            yield f"{'LOST' if item.outcome == 'lost' else 'NOT SHOWN'}  {item.tracker} at {item.place}: {item.text}"
        for tracker in dict.fromkeys(item.tracker for item in self.changes):
            items = [item for item in self.changes if item.tracker == tracker]
            gained, opened = (sum(item.outcome == kind for item in items) for kind in ("gained", "open"))
            holds = [sum(getattr(item, when) == "holds" for item in items) for when in ("before", "after")]
            more = f"{gained} from fails to holds, {opened} decided in only one map"
            yield f"{tracker}: holds in {holds[0]} cells before, {holds[1]} after; {more}"
        yield from self.margins
        yield from self.left_out

    def suite(self) -> Suite:
        """Return a test case for each tracker in each cell that both maps have."""
        name = f"{self.after.scenario} against {self.before.scenario}"
        words = {"lost": "failed", "not shown": "undecided", "open": "undecided"}
        cases = [
            Case(
                f"{item.tracker} at {item.place} holds as before",
                f"{self.after.scenario}.{item.tracker}",
                words.get(item.outcome, "passed") if item.before == "holds" else "passed",  # type: ignore[arg-type]
                f"{difference_word(item.before)} before, {difference_word(item.after)} after: {item.text}",
            )
            for item in self.changes
        ]
        return Suite(f"envelope {name}", cases)


def diff(before: Envelope, after: Envelope) -> EnvelopeDiff:
    """Compare two maps cell by cell.

    Raises:
        InputError: the maps differ in their axes or requirements, or have no cell in common.
    """
    a, b = before.claim, after.claim
    _require_alike(a, b)
    trackers = [name for name in b.trackers if name in a.trackers]
    numbers = {cell.at: number for number, cell in enumerate(a.cells)}
    common = [(numbers[cell.at], number) for number, cell in enumerate(b.cells) if cell.at in numbers]
    if not common:
        raise InputError("the maps have no cell in common", key="diff")
    level = (1 - max(a.confidence, b.confidence)) / (len(common) * len(trackers))
    changes = [_change(before, after, cells, tracker, level) for tracker in trackers for cells in common]
    return EnvelopeDiff(a, b, tuple(changes), tuple(_unmatched(a, b)), tuple(_moved_margins(a, b, trackers)))


def _require_alike(a: Claim, b: Claim) -> None:
    axes = [[(axis.name, axis.config.key, axis.config.keys, axis.config.form) for axis in item.axes] for item in (a, b)]
    if axes[0] != axes[1]:
        names = [", ".join(axis.name for axis in item.axes) for item in (a, b)]
        raise InputError(f"the maps have different axes or keys: {names[0]} and {names[1]}", key="diff")
    trackers = [name for name in b.trackers if name in a.trackers]
    if not trackers:
        raise InputError(f"no tracker is in both: {', '.join(a.trackers)} and {', '.join(b.trackers)}", key="diff")
    for name in trackers:
        limits = [" and ".join(limit.text for limit in item.limits_of(name)) for item in (a, b)]
        if limits[0] != limits[1]:
            raise InputError(f"the requirements differ: {limits[0]}, and {limits[1]}", key="diff")


def _change(before: Envelope, after: Envelope, cells: tuple[int, int], name: str, level: float) -> CellChange:
    """Compare one tracker in one cell; ``cells`` has the cell's index in each of the two maps."""
    old_cell, cell = before.claim.cells[cells[0]], after.claim.cells[cells[1]]
    states = old, new = old_cell.trackers[name], cell.trackers[name]
    was, now = old.state, new.state
    kinds = [(claim.seed, claim.claim) for claim in (before.claim, after.claim)]
    paired = kinds[0] == kinds[1] and _same_runs(old_cell, cell, name)
    outcome: Outcome = "same" if was == now else "open"
    if (was, now) == ("fails", "holds"):
        outcome = "gained"
    limits = after.claim.limits_of(name)
    text = "; ".join(_value_texts(limits, states)) or new.cause
    if (was, now) == ("holds", "fails"):
        worse = (_is_worse(before, after, cells, limit, level / len(limits), paired) for limit in limits)
        outcome = "lost" if any(worse) or _is_missing(old, new) else "not shown"
        text = new.cause or text
    return CellChange(cell.at, place_of_cell(after.claim.axes, cell.at), name, was, now, outcome, paired, text)


def _value_texts(limits: Sequence[ClaimedLimit], states: Sequence[TrackerState]) -> Iterator[str]:
    for limit, old, new in zip(limits, *(state.values for state in states), strict=False):
        if old.value is not None and new.value is not None:
            yield f"{limit.metric} {old.value:.4g} -> {new.value:.4g}{limit.after_number}"


def _same_runs(before: ClaimCell, after: ClaimCell, name: str) -> bool:
    """Return whether a tracker had the same measurements in both maps, in equally many runs."""
    first, second = before.trackers[name], after.trackers[name]
    same_number = (first.scenes, first.runs, first.looks) == (second.scenes, second.runs, second.looks)
    return same_number and before.measurements[: first.looks] == after.measurements[: second.looks]


def _is_missing(before: TrackerState, after: TrackerState) -> bool:
    """Return whether a tracker breaks down, or is shown to give a smaller share of estimates than before."""
    if after.failed:
        return True
    old, new = before.coverage, after.coverage
    if old is None or new is None or old.low is None or new.high is None:
        return False
    return new.state == "fails" and new.high < old.low


def _is_worse(
    before: Envelope, after: Envelope, cells: tuple[int, int], limit: ClaimedLimit, level: float, paired: bool
) -> bool:
    """Return whether a requirement went from holds to fails, and its value is shown to be worse than before."""
    old, new = _value_with_parts(before, cells[0], limit), _value_with_parts(after, cells[1], limit)
    if old is None or new is None:
        return False
    change = interval_difference(new[1], old[1], same_runs=paired)
    return (old[0], new[0]) == ("holds", "fails") and decide(change, 0.0, limit.direction, level).state == "fails"


def _value_with_parts(envelope: Envelope, cell: int, limit: ClaimedLimit) -> tuple[State, Interval] | None:
    """Return the state of a requirement, and its value with what each run or scene adds; None without a value."""
    claim = envelope.claim
    values = claim.cells[cell].trackers[limit.tracker].values
    value = values[claim.limits_of(limit.tracker).index(limit)] if values else None
    parts = envelope.values(cell, claim.limits.index(limit))
    if value is None or value.value is None or not len(parts):
        return None
    return value.state, Interval(value.value, parts - value.value, scenes=claim.claim == "traffic like these")


def _unmatched(a: Claim, b: Claim) -> Iterator[str]:
    for word, first, other in (("before", a, b), ("after", b, a)):
        cells = len({cell.at for cell in first.cells} - {cell.at for cell in other.cells})
        if cells:
            yield f"only {word}: {counted(cells, 'cell')}"
        missing = [name for name in first.trackers if name not in other.trackers]
        if missing:
            yield f"only {word}: {', '.join(missing)}"


def _moved_margins(a: Claim, b: Claim, trackers: Sequence[str]) -> Iterator[str]:
    for name in trackers:
        old = {(item.axis.name, place_of_line(item)): item for item in margins(a, name)}
        for item in margins(b, name):
            previous = old.get((item.axis.name, place_of_line(item)))
            if previous is not None and holding(previous) != holding(item):
                yield f"{name} along {item.axis.name}: {holding(previous)} before, {holding(item)} after"
