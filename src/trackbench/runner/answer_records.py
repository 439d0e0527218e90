"""Records of the table ``answers``, a tracker's answers in every run, which ``use: tracks`` can score."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.base.types import Estimate, Tracks
from trackbench.results.columns import Record
from trackbench.runner.batches import Batch
from trackbench.runner.recorded import state_columns
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.scans import fingerprint_of
from trackbench.trackers.answers import NO_TRACK


def answer_records(work: Work, batch: Batch, name: str, answers: Sequence[Any]) -> dict[BlockRuns, list[Record]]:
    """Return a tracker's answers at each instant, one record per run, by block of runs."""
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
                    "fingerprint": fingerprint_of(batch.measurements.digests[number]),
                    "time_s": time[instant],
                    **columns,
                }
            )
        first += len(piece.runs)
    return records


def _of_tracks(answers: Sequence[Tracks], run: int) -> dict[str, Any]:
    columns = [np.flatnonzero(tracks.ids[:, run] != NO_TRACK) for tracks in answers]
    pairs = [(tracks, column) for tracks, column in zip(answers, columns, strict=True) if len(column)]
    none = np.zeros((4, 4, 0))
    mean = np.concatenate([none[0], *(tracks.mean[:, column, run] for tracks, column in pairs)], axis=1)
    covariance = np.concatenate([none, *(tracks.covariance[:, :, column, run] for tracks, column in pairs)], axis=2)
    existence = [
        np.full(len(column), np.nan) if tracks.existence is None else tracks.existence[column, run]
        for tracks, column in pairs
    ]
    return {
        "instant": np.repeat(np.arange(len(answers)), [len(column) for column in columns]),
        "track": np.concatenate([np.zeros(0, dtype=np.intp), *(tracks.ids[column, run] for tracks, column in pairs)]),
        **state_columns(mean, covariance),
        "existence": np.concatenate([np.zeros(0), *existence]),
    }


def _of_objects(answers: Sequence[Estimate | None], run: int, batch: Batch, truth: Any) -> dict[str, Any]:
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
