"""A long sequence of tracks, with its scores and those of TrackEval."""

from __future__ import annotations

from typing import Any

import numpy as np
from trackeval.metrics import CLEAR, HOTA, Identity

from trackbench.base.types import DUE
from trackbench.metrics.traffic import TrackHistory, TruthHistory
from trackbench.metrics.traffic.assignment import nearby, similarity
from trackbench.metrics.traffic.mot_metrics import hota, identity, switches, track_of_each
from trackbench.metrics.traffic.run import LEAST_SIMILARITY, count_by_clear

CUTOFF = 5.0


def sequence(steps: int, objects: int) -> tuple[TruthHistory, TrackHistory]:
    """A motorway of four lanes: tracks with noise, gaps, switches and false ones, one to each ten objects."""
    rng = np.random.default_rng(1)
    moment = np.arange(steps) * 0.05
    x = np.linspace(-140, 140, objects) + rng.uniform(-3, 3, objects) * np.sin(moment / 5)[:, None]
    lane = np.broadcast_to(np.resize([0.0, 4.0, 8.0, 12.0], objects), x.shape)
    state = np.stack([x, lane, np.zeros(x.shape), np.zeros(x.shape)])
    ids = np.broadcast_to(np.arange(objects), x.shape).copy()
    for start in range(100, steps, 100):
        one, other = rng.choice(objects, 2, replace=False)
        ids[start:, [one, other]] = ids[start:, [other, one]]
        ids[start:, rng.integers(objects)] = objects + start
    ids[rng.random(ids.shape) < 0.02] = -1
    false = (np.arange(steps) // 20)[:, None] * (objects // 10) + np.arange(objects // 10)
    places = rng.uniform([-140, -2], [140, 14], (int(false.max()) + 1, 2))[false]
    mean = state + rng.normal(0, 0.3, state.shape)
    wrong = np.concatenate([np.moveaxis(places, 2, 0), np.zeros((2, *false.shape))])
    columns = ids.shape[1] + false.shape[1]
    tracks = TrackHistory(
        np.concatenate([ids, 10 * steps + false], axis=1),
        np.concatenate([mean, wrong], axis=2),
        np.broadcast_to(0.09 * np.eye(4)[:, :, None, None], (4, 4, steps, columns)).copy(),
    )
    return TruthHistory(moment, state, np.full(x.shape, DUE, dtype=np.int8)), tracks


def our_scores(truth: TruthHistory, tracks: TrackHistory) -> list[float]:
    """HOTA, MOTA and IDF1."""
    counted = count_by_clear(nearby(truth, tracks, CUTOFF))
    alike = similarity(counted.pairs.distance, CUTOFF)
    found = hota(counted.pairs, alike, counted.object_counts, counted.track_counts)
    near = counted.pairs.where(alike >= LEAST_SIMILARITY)
    changes = switches(track_of_each(counted.matched, counted.due.shape))
    due, matched = counted.due.sum(), len(counted.matched.instant)
    mota = (2 * matched - counted.present.sum() - len(changes.instant)) / due
    true, missed, false = identity(near, counted.object_counts, counted.track_counts)
    return [float(found.hota.mean()), float(mota), 2 * true / (2 * true + missed + false)]


def their_scores(sequence: dict[str, Any]) -> list[float]:
    """The same from TrackEval."""
    metrics = HOTA(), CLEAR({"PRINT_CONFIG": False}), Identity({"PRINT_CONFIG": False})
    found = [metric.eval_sequence(sequence) for metric in metrics]
    return [float(found[0]["HOTA"].mean()), float(found[1]["MOTA"]), float(found[2]["IDF1"])]


def for_trackeval(truth: TruthHistory, tracks: TrackHistory) -> dict[str, Any]:
    """What TrackEval reads."""
    _, numbers = np.unique(tracks.ids, return_inverse=True)
    there = tracks.ids >= 0
    distance = np.hypot(*(truth.state[:2, :, :, None] - tracks.mean[:2, :, None]))
    return {
        "num_timesteps": len(there),
        "num_gt_ids": truth.status.shape[1],
        "num_tracker_ids": int(numbers.max()),
        "num_gt_dets": truth.status.size,
        "num_tracker_dets": int(there.sum()),
        "gt_ids": [np.arange(truth.status.shape[1])] * len(there),
        "tracker_ids": [row[own] - 1 for row, own in zip(numbers.reshape(there.shape), there, strict=True)],
        "similarity_scores": [
            np.maximum(0, 1 - now[:, own] / CUTOFF) for now, own in zip(distance, there, strict=True)
        ],
    }
