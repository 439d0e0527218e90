"""A run cut into stretches of time, each with its part of the run's scores."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.metrics.traffic.run import RunScores, TrackedRun
from trackbench.metrics.traffic.set_distances import GospaParts
from trackbench.metrics.traffic.table import DETECTION_METRICS, TRACK_METRICS
from trackbench.metrics.traffic.track_quality import RunSums

#: Metrics that are a mean over runs, of which each has one value.
MEANS = {path for path, metric in (TRACK_METRICS | DETECTION_METRICS).items() if metric.combine == "mean"}


def in_stretches(run: TrackedRun, ends: Sequence[int]) -> list[TrackedRun]:
    """The stretches that end before these instants; their sums add up to those of the run.

    What a stretch adds is by how much the sums of the run up to its end are more than those up to its start. So a
    switch between two stretches counts once, and a track that goes on is the same track. Of a metric that has one value
    in a run, the value up to an instant weighs as much as the time up to it.

    Args:
        run: with the values ``until`` each of the ends.
        ends: instants, the last of them the number of instants.
    """
    parts, start, before = [], 0, RunSums()
    for end, values in zip(ends, run.scores.until, strict=True):
        now = {path: _weighted(path, sums, end / ends[-1]) for path, sums in values.items()}
        zero = 0.0, 0.0
        added: RunSums = {}
        for path in {**before, **now}:
            (total, count), (earlier, fewer) = now.get(path, zero), before.get(path, zero)
            added[path] = total - earlier, count - fewer
        span = slice(start, end)
        parts.append(
            TrackedRun(
                run.truth.within(span),
                run.tracks.within(span),
                run.associations and run.associations.within(span),
                _scores(run.scores, span, added),
                None if run.unscored is None else run.unscored[span],
            )
        )
        start, before = end, now
    return parts


def _weighted(path: str, sums: tuple[float, float], share: float) -> tuple[float, float]:
    return (sums[0] * share, sums[1] * share) if path in MEANS else sums


def _scores(scores: RunScores, span: slice, values: RunSums) -> RunScores:
    events = tuple(
        event._replace(instant=event.instant - span.start)
        for event in scores.events
        if span.start <= event.instant < span.stop
    )
    gospa = GospaParts(*(part[span] for part in scores.gospa))
    return scores._replace(values=values, gospa=gospa, events=events, strips=scores.strips[span], until=())
