"""Answers of a tracker in every run: the table ``answers`` of a result, which ``use: tracks`` scores."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.base.types import Estimate, Tracks
from trackbench.results.columns import Record
from trackbench.runner.batches import Batch
from trackbench.runner.recorded import state_columns
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.answers import NO_TRACK


def answer_records(work: Work, batch: Batch, name: str, answers: Sequence[Any]) -> dict[BlockRuns, list[Record]]:
    """Return the records of a tracker's answers by piece of a batch: one record a run.

    Args:
        work: what all blocks share.
        batch: the runs.
        name: of the tracker.
        answers: at each instant, for all members of the batch.
    """
    records, first = dict[BlockRuns, list[Record]](), 0
    for piece in batch.pieces:
        scene = work.scenes[piece.scene]
        time = scene.truth.time[work.scored_steps(scene)]
        records[piece] = []
        for number, run in enumerate(piece.runs, first):
            columns = _of_tracks(answers, number) if work.hidden else _of_objects(answers, number, batch, scene.truth)
            instant = columns.pop("instant")
            records[piece].append(
                {
                    "tracker": name,
                    "scene": np.full(len(instant), piece.scene),
                    "run": np.full(len(instant), run),
                    "fingerprint": batch.measurements.digests[number].hex()[:16],
                    "time_s": time[instant],
                    **columns,
                }
            )
        first += len(piece.runs)
    return records


def _of_tracks(answers: Sequence[Tracks], run: int) -> dict[str, Any]:
    """Return the columns of the tracks of one run."""
    there = [np.flatnonzero(tracks.ids[:, run] != NO_TRACK) for tracks in answers]
    kept = [(tracks, own) for tracks, own in zip(answers, there, strict=True) if len(own)]
    none = np.zeros((4, 4, 0))
    mean = np.concatenate([none[0], *(tracks.mean[:, own, run] for tracks, own in kept)], axis=1)
    covariance = np.concatenate([none, *(tracks.covariance[:, :, own, run] for tracks, own in kept)], axis=2)
    existence = [
        np.full(len(own), np.nan) if tracks.existence is None else tracks.existence[own, run] for tracks, own in kept
    ]
    return {
        "instant": np.repeat(np.arange(len(answers)), [len(own) for own in there]),
        "track": np.concatenate([np.zeros(0, dtype=np.intp), *(tracks.ids[own, run] for tracks, own in kept)]),
        **state_columns(mean, covariance),
        "existence": np.concatenate([np.zeros(0), *existence]),
    }


def _of_objects(answers: Sequence[Estimate | None], run: int, batch: Batch, truth: Any) -> dict[str, Any]:
    """Return the columns of the estimates of known objects in one run."""
    runs = sum(len(piece.runs) for piece in batch.pieces)
    none = np.full((4, 4, len(truth.ids)), np.nan)
    means = [none[0] if answer is None else answer.mean[:, run::runs] for answer in answers]
    covariances = [none if answer is None else answer.covariance[:, :, run::runs] for answer in answers]
    instant, item = np.nonzero(np.isfinite(np.stack(means)[:, 0]))
    return {
        "instant": instant,
        "object": [truth.ids[index] for index in item],
        **state_columns(np.stack(means, axis=1)[:, instant, item], np.stack(covariances, axis=2)[:, :, instant, item]),
    }
