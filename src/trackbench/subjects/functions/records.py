"""Tables of driver assistance functions: decisions in the recorded (drawn) run, and events in all runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.results.columns import Record
from trackbench.results.folder import NO_OBJECT
from trackbench.runner.evaluated import Evaluated
from trackbench.runner.recorded import RecordedEstimates
from trackbench.runner.work import Work
from trackbench.subjects.functions.metrics import functions_among
from trackbench.subjects.functions.protocol import NO_OBJECT as NO_COLUMN
from trackbench.subjects.functions.protocol import Function
from trackbench.subjects.functions.sums import (
    Decisions,
    FunctionScores,
    decisions_of_estimates,
    decisions_of_run,
    while_driving,
)

#: Largest number of events of each tracker, function and outcome, in addition to the recorded run's.
MOST_EVENTS = 100


def function_records(
    work: Work, evaluated: Evaluated, recorded: Mapping[str, RecordedEstimates | RecordedTracks]
) -> Iterator[tuple[str, list[Record]]]:
    """Yield name and rows of the tables of decisions and events of assistance functions; nothing without functions."""
    functions = functions_among(work.metrics)
    if not functions:
        return
    scene = work.scenes[work.recorded_scene]
    time = scene.truth.time[scene.instants()]
    yield (
        "decisions",
        [
            _decisions_record(tracker, label, _decisions(function, work, item), time, scene.truth.ids)
            for tracker, item in recorded.items()
            for label, function in functions.items()
        ],
    )
    yield (
        "function_events",
        [
            _events_record(tracker, label, evaluation.sums[f"function {label}"], work)
            for tracker, evaluation in evaluated.evaluations.items()
            for label in functions
        ],
    )


def _decisions(function: Function, work: Work, recorded: RecordedEstimates | RecordedTracks) -> Decisions:
    """Return the decisions of a driver assistance function in the recorded run, on a tracker's estimates or tracks."""
    if not isinstance(recorded, RecordedEstimates):
        assert recorded.tracked is not None
        return decisions_of_run(function, recorded.tracked)
    scene = work.scenes[work.recorded_scene]
    truth, instants = scene.truth, scene.instants()
    state = truth.state_of_run(work.recorded_run)[:, instants]
    mean, covariance = (np.swapaxes(part, -1, -2)[..., None] for part in (recorded.mean, recorded.covariance))
    states = np.swapaxes(state, 1, 2)[..., None], truth.alive[instants].T[..., None]
    bodies = EgoScene.of(truth, instants)
    return decisions_of_estimates(function, bodies, *states, mean, covariance, np.isfinite(mean[0]))


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
    """Return the events of the recorded run, and the worst events of each outcome in all runs."""
    events, false, nothing = scores.events, scores.false, np.full(len(scores.false.run), np.nan)
    run, start, stop, column = (np.concatenate(parts) for parts in zip(events, false, strict=True))
    delay = np.concatenate([scores.delay, nothing])
    outcome = np.concatenate([np.where(scores.missing, "missed", "answered"), np.full(len(nothing), "false")])
    # A false activity is worse the longer it lasts.
    size = np.where(np.isnan(delay), stop - start, np.abs(delay))
    is_kept = run == work.number(work.recorded_scene, work.recorded_run)
    for word in ("answered", "missed", "false"):
        group = np.flatnonzero(outcome == word)
        is_kept[group[np.argsort(-size[group], kind="stable")[:MOST_EVENTS]]] = True
    rows = np.flatnonzero(is_kept)[np.lexsort((start[is_kept], run[is_kept]))]
    scenes = [work.scenes[work.scene_of_run[number] // max(work.stretches, 1)] for number in run[rows]]
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
    return [NO_OBJECT if column == NO_COLUMN else names[column] for column, names in zip(columns, ids, strict=True)]
