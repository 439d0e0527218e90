"""Two maps of the same axes: the cells in which a tracker does not hold any more (``trackbench envelope diff``)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from trackbench.base.errors import InputError, counted
from trackbench.metrics.intervals import Interval
from trackbench.report.junit import Case, Suite
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

#: ``lost``: from holds to fails, and shown to be worse. ``open``: one of the two maps does not decide it.
Outcome = Literal["same", "lost", "not shown", "gained", "open"]


class CellChange(NamedTuple):
    """A tracker in a cell of both maps."""

    point: Point
    place: str
    tracker: str
    before: State
    after: State
    outcome: Outcome
    paired: bool
    """Whether both have the same measurements, so that runs are held against each other one by one."""
    text: str
    """The values, or why there is none."""


@dataclass(frozen=True)
class EnvelopeDiff:
    """What differs between two maps."""

    before: Claim
    after: Claim
    changes: tuple[CellChange, ...]
    """Of each tracker in each cell of both."""
    left_out: tuple[str, ...]
    """Cells and trackers of one map alone."""
    margins: tuple[str, ...]
    """Those that moved."""

    @property
    def passed(self) -> bool:
        """Whether no cell was lost."""
        return not self.of("lost")

    def of(self, *outcomes: Outcome) -> list[CellChange]:
        """The changes of some kinds."""
        return [item for item in self.changes if item.outcome in outcomes]

    def json(self) -> dict[str, Any]:
        """As ``trackbench envelope diff --json`` prints it."""
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
        """As it is printed."""
        paired = sum(item.paired for item in self.changes)
        yield f"{counted(len(self.changes), 'state')} compared, {paired} of them on the same measurements"
        for item in self.of("lost", "not shown"):
            yield f"{'LOST' if item.outcome == 'lost' else 'NOT SHOWN'}  {item.tracker} at {item.place}: {item.text}"
        for tracker in dict.fromkeys(item.tracker for item in self.changes):
            own = [item for item in self.changes if item.tracker == tracker]
            gained, opened = (sum(item.outcome == kind for item in own) for kind in ("gained", "open"))
            holds = [sum(getattr(item, when) == "holds" for item in own) for when in ("before", "after")]
            more = f"{gained} from fails to holds, {opened} decided in one map alone"
            yield f"{tracker}: holds in {holds[0]} cells before, {holds[1]} after; {more}"
        yield from self.margins
        yield from self.left_out

    def suite(self) -> Suite:
        """A test case for each tracker in each cell."""
        name = f"{self.after.scenario} against {self.before.scenario}"
        words = {"lost": "failed", "not shown": "undecided", "open": "undecided"}
        cases = [
            Case(
                f"{item.tracker} at {item.place} holds as before",
                f"{self.after.scenario}.{item.tracker}",
                words.get(item.outcome, "passed") if item.before == "holds" else "passed",  # type: ignore[arg-type]
                f"{item.before} before, {item.after} after: {item.text}",
            )
            for item in self.changes
        ]
        return Suite(f"envelope {name}", cases)


def diff(before: Envelope, after: Envelope) -> EnvelopeDiff:
    """Hold two maps against each other, cell by cell.

    Raises:
        InputError: they have no axes, requirements or cells in common.
    """
    a, b = before.claim, after.claim
    _require_alike(a, b)
    trackers = [name for name in b.trackers if name in a.trackers]
    numbers = {cell.at: number for number, cell in enumerate(a.cells)}
    common = [(numbers[cell.at], number) for number, cell in enumerate(b.cells) if cell.at in numbers]
    if not common:
        raise InputError("the maps have no cell in common", key="diff")
    level = (1 - max(a.confidence, b.confidence)) / (len(common) * len(trackers))
    changes = [_change(before, after, places, tracker, level) for tracker in trackers for places in common]
    return EnvelopeDiff(a, b, tuple(changes), tuple(_left_out(a, b)), tuple(_moved(a, b, trackers)))


def _require_alike(a: Claim, b: Claim) -> None:
    axes = [[(axis.name, axis.config.key, axis.config.keys, axis.config.form) for axis in item.axes] for item in (a, b)]
    if axes[0] != axes[1]:
        names = [", ".join(axis.name for axis in item.axes) for item in (a, b)]
        raise InputError(f"the maps have other axes: {names[0]} and {names[1]}, or other keys of them", key="diff")
    trackers = [name for name in b.trackers if name in a.trackers]
    if not trackers:
        raise InputError(f"no tracker is in both: {', '.join(a.trackers)} and {', '.join(b.trackers)}", key="diff")
    for name in trackers:
        limits = [" and ".join(limit.text for limit in item.limits_of(name)) for item in (a, b)]
        if limits[0] != limits[1]:
            raise InputError(f"the requirement is another: {limits[0]}, and {limits[1]}", key="diff")


def _change(before: Envelope, after: Envelope, places: tuple[int, int], name: str, level: float) -> CellChange:
    """Of one tracker in one cell, whose numbers in the two maps are ``places``."""
    old_cell, cell = before.claim.cells[places[0]], after.claim.cells[places[1]]
    states = old, new = old_cell.trackers[name], cell.trackers[name]
    was, now = old.state, new.state
    kinds = [(claim.seed, claim.claim) for claim in (before.claim, after.claim)]
    paired = kinds[0] == kinds[1] and _same_runs(old_cell, cell, name)
    outcome: Outcome = "same" if was == now else "open"
    if (was, now) == ("fails", "holds"):
        outcome = "gained"
    limits = after.claim.limits_of(name)
    text = "; ".join(_values(limits, states)) or new.cause
    if (was, now) == ("holds", "fails"):
        worse = (_is_worse(before, after, places, limit, level / len(limits), paired) for limit in limits)
        outcome = "lost" if any(worse) or _is_missing(old, new) else "not shown"
        text = new.cause or text
    return CellChange(cell.at, place_of_cell(after.claim.axes, cell.at), name, was, now, outcome, paired, text)


def _values(limits: Sequence[ClaimedLimit], states: Sequence[TrackerState]) -> Iterator[str]:
    for limit, old, new in zip(limits, *(state.values for state in states), strict=False):
        if old.value is not None and new.value is not None:
            yield f"{limit.metric} {old.value:.4g} -> {new.value:.4g}{limit.after_number}"


def _same_runs(before: ClaimCell, after: ClaimCell, name: str) -> bool:
    """Whether a tracker had the same measurements in as many runs."""
    mine, its = before.trackers[name], after.trackers[name]
    alike = (mine.scenes, mine.runs, mine.looks) == (its.scenes, its.runs, its.looks)
    return alike and before.measurements[: mine.looks] == after.measurements[: its.looks]


def _is_missing(before: TrackerState, after: TrackerState) -> bool:
    """Whether a tracker cannot go on any more, or is shown to give a smaller share of the estimates than before."""
    if after.failed:
        return True
    old, new = before.coverage, after.coverage
    if old is None or new is None or old.low is None or new.high is None:
        return False
    return new.state == "fails" and new.high < old.low


def _is_worse(
    before: Envelope, after: Envelope, places: tuple[int, int], limit: ClaimedLimit, level: float, paired: bool
) -> bool:
    """Whether a requirement that is not met any more is shown to be met worse than before."""
    old, new = _value_with_parts(before, places[0], limit), _value_with_parts(after, places[1], limit)
    if old is None or new is None:
        return False
    change = interval_difference(new[1], old[1], same_runs=paired)
    return (old[0], new[0]) == ("holds", "fails") and decide(change, 0.0, limit.direction, level).state == "fails"


def _value_with_parts(made: Envelope, cell: int, limit: ClaimedLimit) -> tuple[State, Interval] | None:
    """The state of a requirement, and its value with what each of its runs, or scenes, adds."""
    claim = made.claim
    values = claim.cells[cell].trackers[limit.tracker].values
    own = values[claim.limits_of(limit.tracker).index(limit)] if values else None
    parts = made.values(cell, claim.limits.index(limit))
    if own is None or own.value is None or not len(parts):
        return None
    return own.state, Interval(own.value, parts - own.value, scenes=claim.claim == "traffic like these")


def _left_out(a: Claim, b: Claim) -> Iterator[str]:
    for word, mine, other in (("before", a, b), ("after", b, a)):
        cells = len({cell.at for cell in mine.cells} - {cell.at for cell in other.cells})
        if cells:
            yield f"only {word}: {counted(cells, 'cell')}"
        missing = [name for name in mine.trackers if name not in other.trackers]
        if missing:
            yield f"only {word}: {', '.join(missing)}"


def _moved(a: Claim, b: Claim, trackers: Sequence[str]) -> Iterator[str]:
    """A line for each margin that is another one."""
    for name in trackers:
        old = {(item.axis.name, place_of_line(item)): item for item in margins(a, name)}
        for item in margins(b, name):
            was = old.get((item.axis.name, place_of_line(item)))
            if was is not None and holding(was) != holding(item):
                yield f"{name} along {item.axis.name}: {holding(was)} before, {holding(item)} after"
