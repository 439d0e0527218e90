"""A run cut into stretches of time, each with its part of the run's scores."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.traffic.run import TrackedRun
from trackbench.metrics.traffic.set_distances import GospaParts
from trackbench.metrics.traffic.table import DETECTION_METRICS, TRACK_METRICS
from trackbench.metrics.traffic.track_quality import RunSums

METRICS = TRACK_METRICS | DETECTION_METRICS


def in_stretches(run: TrackedRun, ends: Sequence[int]) -> list[TrackedRun]:
    """The stretches that end before these instants; their sums add up to those of the run.

    What a stretch adds is by how much the sums of the run up to its end are more than those up to its start. So a
    switch between two stretches counts once, and a track that goes on is the same track. What a later stretch takes
    back, such as that an object is never tracked, none adds. Of a metric that has one value in a run, the value up to
    an instant weighs as much as the time up to it.

    Args:
        run: with the values ``until`` each of the ends.
        ends: instants, the last of them the number of instants.
    """
    added = {path: _added(path, run.scores.until, np.array(ends) / ends[-1]) for path in run.scores.values}
    parts, starts = [], [0, *ends[:-1]]
    for number, span in enumerate(map(slice, starts, ends)):
        scores = run.scores._replace(
            values={path: (float(sums[0, number]), float(sums[1, number])) for path, sums in added.items()},
            gospa=GospaParts(*(part[span] for part in run.scores.gospa)),
            events=tuple(
                event._replace(instant=event.instant - span.start)
                for event in run.scores.events
                if span.start <= event.instant < span.stop
            ),
            strips=run.scores.strips[span],
        )
        taken, outside = run.associations and run.associations.within(span), run.unscored
        outside = None if outside is None else outside[span]
        parts.append(TrackedRun(run.truth.within(span), run.tracks.within(span), taken, scores, outside))
    return parts


def _added(path: str, until: Sequence[RunSums], share: Array) -> Array:
    """``(2, stretches)`` what each adds to the total and the count; ``share`` of the time that is up to its end."""
    sums = np.array([values.get(path, (0.0, 0.0)) for values in until]).T
    metric = METRICS[path]
    if metric.combine == "mean":
        sums *= share
    elif metric.at_least == 0:
        sums[0] = np.minimum.accumulate(sums[0, ::-1])[::-1]
    return np.diff(sums, prepend=0.0)
