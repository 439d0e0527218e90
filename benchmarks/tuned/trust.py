"""Whose covariance is believable, and why none is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from trackbench.metrics.verdicts import ABOVE, BELOW, TOLERANCE, verdict

#: Of px, py, vx, vy.
DOF = 4
#: So many means of the nearest tracker are said; what is off over all estimates is off under most conditions.
SHOWN = 2

Scores = Mapping[str, Any]


class Mean(NamedTuple):
    """A mean NEES, and by how much it is beyond what a verdict tolerates, as a logarithm."""

    beyond: float
    condition: str
    """Empty: over all estimates."""
    value: float
    share: float
    """Of the tracker's estimates."""
    verdict: str

    @property
    def shown_off(self) -> bool:
        """Whether its interval lies beyond what is tolerated."""
        return self.verdict not in ("consistent", "undecided")


def means(scores: Scores) -> list[Mean]:
    """Of a tracker over all estimates and under each condition."""
    log = math.log(scores["nees"] / DOF)
    beyond = abs(log) - math.log(1.0 + TOLERANCE)
    found = [Mean(beyond, "", scores["nees"], 1.0, verdict(scores["nees_ci95"], DOF))]
    for name, of in scores["conditions"].items():
        log = math.log(of["mean"] / DOF)
        beyond = max(log - math.log(1.0 + ABOVE), math.log(1.0 - BELOW) - log)
        found.append(Mean(beyond, name, of["mean"], of["share"], of["verdict"]))
    return found


def furthest(scores: Scores) -> Mean:
    """Of those that are shown to be off, where there are any."""
    every = means(scores)
    return max([mean for mean in every if mean.shown_off] or every)


def believable(trackers: Sequence[str], scores: Scores) -> list[str]:
    """The trackers that are shown to be consistent in every condition."""
    return [item for item in trackers if scores[item]["verdict"] == "consistent"]


def undecided(trackers: Sequence[str], scores: Scores) -> list[str]:
    """Those that are neither shown to be so nor to be off anywhere."""
    return [item for item in trackers if scores[item]["verdict"] == "undecided"]


def by_distance(trackers: Sequence[str], scores: Scores) -> list[str]:
    """The trackers, first the one whose furthest mean NEES is the least far off."""
    return sorted(trackers, key=lambda item: max(means(scores[item])).beyond)


def reasons(trackers: Sequence[str], scores: Scores, own: Scores) -> Iterator[str]:
    """Why no tracker is shown to be believable in a scenario: what is open of those that are not decided; else what the
    nearest misses, who does not, and what these miss; and what the nearest are with their ``own`` values."""
    open_of = undecided(trackers, scores)
    yield from (f"not decided of {_with_open(item, scores[item])}" for item in open_of)
    if not open_of:
        yield from _off(trackers, scores)
    if own:
        yield f"of the nearest, with the scenario's own values: {'; '.join(_own(item, own[item]) for item in own)}"


def _off(trackers: Sequence[str], scores: Scores) -> Iterator[str]:
    best = by_distance(trackers, scores)[0]
    off = sorted((mean for mean in means(scores[best]) if mean.shown_off), reverse=True)
    for mean in off[:SHOWN]:
        times = math.sqrt(mean.value / DOF)
        yield f"{best} has {described(mean)}, errors {times:.2f} times as large as it states"
        yield from _others([item for item in trackers if item != best], mean.condition, scores)


def _others(trackers: Sequence[str], condition: str, scores: Scores) -> Iterator[str]:
    right = [
        item
        for item in trackers
        if any(mean.condition == condition and mean.verdict == "consistent" for mean in means(scores[item]))
    ]
    if not right:
        yield "no other tracker is shown to be within the bounds there"
        return
    yield f"within the bounds there: {', '.join(f'{item} (but {described(furthest(scores[item]))})' for item in right)}"


def _own(tracker: str, scores: Scores) -> str:
    if scores["verdict"] == "consistent":
        return f"{tracker} is believable"
    if scores["verdict"] == "undecided":
        return f"not decided of {_with_open(tracker, scores)}"
    return f"{tracker} has {described(furthest(scores))}"


def _with_open(tracker: str, scores: Scores) -> str:
    return f"{tracker} ({', '.join(described(mean) for mean in means(scores) if mean.verdict == 'undecided')})"


def described(mean: Mean) -> str:
    """ "turning 6.3, 2 % of its estimates"."""
    part = f", {100 * mean.share:.0f} % of its estimates" if mean.share < 1.0 else ""
    return f"{mean.condition or 'all'} {mean.value:.1f}{part}"
