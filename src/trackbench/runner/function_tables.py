"""The records of the tables of functions: what they decide in the recorded run, and their events in all runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.functions.protocol import NO_OBJECT as NO_COLUMN
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.functions import functions_among, functions_at_work
from trackbench.metrics.functions.sums import (
    Decisions,
    FunctionScores,
    FunctionSums,
    decisions_of_estimates,
    while_driving,
)
from trackbench.results.columns import Record
from trackbench.results.folder import NO_OBJECT
from trackbench.runner.evaluated import Evaluated
from trackbench.runner.recorded import RecordedEstimates
from trackbench.runner.work import Work

#: Events of each tracker, function and outcome that are kept beside those of the recorded run.
MOST_EVENTS = 100
#: By function, what it decides in one run.
Decided = Mapping[str, Decisions]


def function_records(work: Work, evaluated: Evaluated, decided: Mapping[str, Decided]) -> dict[str, list[Record]]:
    """The records of both tables; none where there is no function.

    Args:
        work: of the run.
        evaluated: its trackers.
        decided: by tracker, of the recorded run.
    """
    functions = functions_among(work.metrics)
    if not functions:
        return {}
    scene = work.scenes[work.recorded_scene]
    time = scene.truth.time[work.scored_steps(scene)]
    sums = {
        (tracker, label): item.sums[FunctionSums(label, function).name]
        for tracker, item in evaluated.evaluations.items()
        for label, function in functions_at_work(work.metrics, item.sums).items()
    }
    return {
        "decisions": [
            _decisions_record(tracker, label, item, time, scene.truth.ids)
            for tracker, own in decided.items()
            for label, item in own.items()
        ],
        "function_events": [_events_record(*key, scores, work) for key, scores in sums.items()],
    }


def decisions_on_estimates(work: Work, recorded: RecordedEstimates, sums: MetricSums) -> Decided:
    """With known identities, what each function decides in the recorded run on a tracker's estimates. ``sums``: of
    its metrics."""
    scene = work.scenes[work.recorded_scene]
    truth, instants = scene.truth, scene.instants()
    state = truth.state_of_run(work.recorded_run)[:, instants]
    mean, covariance = (np.swapaxes(part, -1, -2)[..., None] for part in (recorded.mean, recorded.covariance))
    states = np.swapaxes(state, 1, 2)[..., None], truth.alive[instants].T[..., None]
    return {
        label: decisions_of_estimates(function, scene.bodies(instants), *states, mean, covariance, np.isfinite(mean[0]))
        for label, function in functions_at_work(work.metrics, sums).items()
    }


def _decisions_record(tracker: str, label: str, decisions: Decisions, time: Array, ids: Sequence[str]) -> Record:
    truth, tracks = (while_driving(item, decisions.driving) for item in (decisions.truth, decisions.tracks))
    return {
        "tracker": tracker,
        "function": label,
        "object": _names(tracks.object[:, 0], [ids] * len(time)),
        "true_object": _names(truth.object[:, 0], [ids] * len(time)),
        "time_s": time,
        "active": tracks.active[:, 0].astype(float),
        "true_active": truth.active[:, 0].astype(float),
        "impact": decisions.overlap[:, 0].astype(float),
        "quantity": tracks.quantity[:, 0],
        "true_quantity": truth.quantity[:, 0],
    }


def _events_record(tracker: str, label: str, scores: FunctionScores, work: Work) -> Record:
    """All events of the recorded run, and of those of the others that have one outcome the worst."""
    events, false, nothing = scores.events, scores.false, np.full(len(scores.false.run), np.nan)
    run, start, stop, column = (np.concatenate(parts) for parts in zip(events, false, strict=True))
    delay = np.concatenate([scores.delay, nothing])
    outcome = np.concatenate([np.where(scores.missing, "missed", "answered"), np.full(len(nothing), "false")])
    # What is false is the worse the longer it lasts.
    size = np.where(np.isnan(delay), stop - start, np.abs(delay))
    kept = run == work.number(work.recorded_scene, work.recorded_run)
    for word in ("answered", "missed", "false"):
        own = np.flatnonzero(outcome == word)
        kept[own[np.argsort(-size[own], kind="stable")[:MOST_EVENTS]]] = True
    rows = np.flatnonzero(kept)[np.lexsort((start[kept], run[kept]))]
    scenes = [work.scenes[work.scene_of_run[each] // max(work.stretches, 1)] for each in run[rows]]
    return {
        "tracker": tracker,
        "function": label,
        "object": _names(column[rows], [scene.truth.ids for scene in scenes]),
        "outcome": outcome[rows].tolist(),
        "run": run[rows].astype(float),
        "time_s": start[rows],
        "until_s": stop[rows],
        "delay_s": delay[rows],
    }


def _names(columns: Indices, ids: Sequence[Sequence[str]]) -> list[str]:
    """The objects of these columns of scenes that have these."""
    return [NO_OBJECT if column == NO_COLUMN else own[column] for column, own in zip(columns, ids, strict=True)]
