"""Whose covariance is believable, and why none is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from trackbench.metrics.verdicts import ABOVE, BELOW, TOLERANCE

#: Of px, py, vx, vy.
DOF = 4
#: So many means of the nearest tracker are said; what is off over all estimates is off under most conditions.
SHOWN = 2

Scores = Mapping[str, Any]


class Off(NamedTuple):
    """A mean NEES, and by how much it is beyond what a verdict tolerates, as a logarithm."""

    beyond: float
    condition: str
    """Empty: over all estimates."""
    mean: float
    share: float
    """Of the tracker's estimates."""


def means(scores: Scores) -> list[Off]:
    """Of a tracker over all estimates and under each condition."""
    log = math.log(scores["nees"] / DOF)
    found = [Off(abs(log) - math.log(1.0 + TOLERANCE), "", scores["nees"], 1.0)]
    for name, of in scores["conditions"].items():
        log = math.log(of["mean"] / DOF)
        beyond = max(log - math.log(1.0 + ABOVE), math.log(1.0 - BELOW) - log)
        found.append(Off(beyond, name, of["mean"], of["share"]))
    return found


def believable(trackers: Sequence[str], scores: Scores) -> list[str]:
    """The trackers that are shown to be consistent in every condition."""
    return [item for item in trackers if scores[item]["verdict"] == "consistent"]


def by_distance(trackers: Sequence[str], scores: Scores) -> list[str]:
    """The trackers, first the one whose furthest mean NEES is the least far off."""
    return sorted(trackers, key=lambda item: max(means(scores[item])).beyond)


def nearest(trackers: Sequence[str], scores: Scores) -> tuple[str, Off]:
    """The first of them, and that mean."""
    best = by_distance(trackers, scores)[0]
    return best, max(means(scores[best]))


def reasons(trackers: Sequence[str], scores: Scores, own: Scores) -> Iterator[str]:
    """Why no tracker is believable in a scenario: what the nearest misses, who does not, and what these miss; and
    what the nearest are with their ``own`` values."""
    yield from _of_family(trackers, scores)
    right = believable(list(own), own)
    if right:
        yield f"believable with the scenario's own values: {', '.join(right)}"
    elif own:
        best, furthest = nearest(list(own), own)
        off = described(furthest) if furthest.beyond > 0.0 else f"{_open(own[best])} not decided"
        yield f"nearest with the scenario's own values: {best}, {off}"


def _of_family(trackers: Sequence[str], scores: Scores) -> Iterator[str]:
    best, furthest = nearest(trackers, scores)
    if furthest.beyond <= 0.0:
        within = "its means are within the bounds, the 95 % interval"
        yield f"not decided of {best}: {within} of {_open(scores[best])} is not"
        return
    beyond = sorted((off for off in means(scores[best]) if off.beyond > 0.0), reverse=True)
    for off in beyond[:SHOWN]:
        yield f"{best} has {described(off)}, errors of {math.sqrt(off.mean / DOF):.2f} times what it states"
        yield from _others([item for item in trackers if item != best], off.condition, scores)


def _others(trackers: Sequence[str], condition: str, scores: Scores) -> Iterator[str]:
    right = {}
    for item in trackers:
        found = {off.condition: off for off in means(scores[item])}
        if condition in found and found[condition].beyond <= 0.0:
            right[item] = max(found.values())
    if not right:
        yield "no other tracker is within the bounds there"
        return
    missed = (f"{item} (but {described(off)})" for item, off in right.items())
    yield f"within the bounds there: {', '.join(missed)}"


def described(off: Off) -> str:
    """ "turning 6.3, 2 % of its estimates"."""
    part = f", {100 * off.share:.0f} % of its estimates" if off.share < 1.0 else ""
    return f"{off.condition or 'all'} {off.mean:.1f}{part}"


def _open(scores: Scores) -> str:
    names = [name for name, of in scores["conditions"].items() if of["verdict"] != "consistent"]
    return " and ".join(names) or "all"
