"""The sums of a tracker by parts that are independent of each other, which its intervals rest on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.breakdown import class_sums
from trackbench.metrics.sums import SHORTEST, STRETCHES, BlockScores, Scores, TrackerSet


def scores_of(merged: BlockScores, givers: TrackerSet, scene: Indices) -> Scores:
    """What the metrics of a tracker are made of.

    Runs of one scene share its traffic, so that with several scenes these are what is independent. A single run is cut
    into stretches of time (batch means: Schmeiser 1982, "Batch size effects in the analysis of simulation output").

    Args:
        merged: its sums over all runs.
        givers: the trackers that must all have given an estimate where errors count.
        scene: ``(runs,)`` number of the scene of each run.
    """
    sums, scenes, runs = merged.where(givers), int(scene[-1]) + 1, len(scene)
    per_part, cells, nis = sums.per_run, sums.cells, merged.nis
    if scenes > 1:
        per_part = _added(per_part, scene)
        cells = replace(cells, part=scene[cells.part])
        nis = {name: replace(item, per_run=_added(item.per_run, scene)) for name, item in nis.items()}
    elif runs == 1:
        per_part = _in_stretches(sums.per_step, merged.duration)
        nis = {name: replace(item, per_run=_in_stretches(item.per_step, merged.duration)) for name, item in nis.items()}
    return Scores(
        per_step=sums.per_step,
        per_run=sums.per_run,
        per_part=per_part,
        given=merged.given,
        due=float(merged.due.sum()),
        nis=nis,
        classes=class_sums(cells, per_part.shape[1]),
        spread=merged.spread,
        seconds=merged.seconds,
        steps=merged.steps,
    )


def stretches(instants: int, duration: float) -> Indices:
    """``(instants,)`` number of the stretch of each of the instants of so many seconds."""
    count = min(STRETCHES, max(1, int(duration / SHORTEST)))
    return np.arange(instants) * count // max(instants, 1)


def _in_stretches(per_step: Array, duration: float) -> Array:
    return _added(per_step, stretches(per_step.shape[1], duration))


def _added(sums: Array, part: Indices) -> Array:
    """``(rows, parts)`` sums ``(rows, ...)`` added up within each part."""
    return np.stack([np.bincount(part, row) for row in sums])
