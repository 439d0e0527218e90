"""Speed of the scores of tracking in traffic beside Stone Soup and TrackEval, on the same sequences.

Nothing is timed before the scores agree.
"""

from __future__ import annotations

import os

# Before NumPy is imported: its linear algebra would take every core.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import datetime
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
from stonesoup.types.state import State
from trackeval.metrics import CLEAR, HOTA, Identity

from trackbench.base.types import DUE
from trackbench.metrics.traffic import TrackHistory, TruthHistory, score_run
from trackbench.metrics.traffic.assignment import nearby, similarity
from trackbench.metrics.traffic.mot_metrics import hota, identity, switches, track_of_each
from trackbench.metrics.traffic.run import LEAST_SIMILARITY, count_by_clear
from trackbench.metrics.traffic.set_distances import gospa_of_sets
from trackbench.metrics.traffic.set_distances import ospa as ospa_of_parts

CUTOFF = 5.0
#: Steps of the long sequence, and those that Stone Soup takes.
LONG, PEER_STEPS = 30_000, 40
LONG_OBJECTS = 40
STEPS, OBJECTS = 400, 20
REPETITIONS = 7
AGREEMENT = {"Stone Soup": 1e-9, "TrackEval": 1e-12}
#: s for the long sequence; s for the three scores of TrackEval; s for all scores of a run.
REQUIRED_GOSPA, REQUIRED_IDENTITIES, REQUIRED_RUN = 2.0, 0.03, 0.15


def measure() -> list[dict[str, Any]]:
    """For each score: seconds of trackbench, seconds of the peer for as much, and what is asked."""
    return [_gospa_and_ospa(), *_identities()]


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


def _gospa_and_ospa() -> dict[str, Any]:
    truth, tracks = sequence(LONG, LONG_OBJECTS)
    objects, estimates = truth.state[:2], np.where(tracks.ids >= 0, tracks.mean[:2], np.nan)
    parts = gospa_of_sets(objects, estimates, CUTOFF, 1.0)
    numbers = [np.isfinite(positions[0]).sum(axis=1) for positions in (objects, estimates)]
    distances = parts.total, ospa_of_parts(parts, *numbers)
    now = datetime.datetime(2000, 1, 1)
    sets = [
        [
            [State(each[:, None], timestamp=now) for each in positions[:, k].T if np.isfinite(each[0])]
            for k in range(PEER_STEPS)
        ]
        for positions in (objects, estimates)
    ]
    gospa, ospa = GOSPAMetric(p=1, c=CUTOFF), OSPAMetric(p=1, c=CUTOFF)
    pairs = list(zip(sets[1], sets[0], strict=True))
    theirs = [gospa.compute_gospa_metric(*pair)[0].value["distance"] for pair in pairs]
    their_ospa = [ospa.compute_OSPA_distance(*pair).value for pair in pairs]
    difference = max(
        float(np.max(np.abs(ours[:PEER_STEPS] / np.array(peer) - 1)))
        for ours, peer in zip(distances, (theirs, their_ospa), strict=True)
    )
    _agreed("Stone Soup", difference)
    peer = _best(lambda: [gospa.compute_gospa_metric(*pair) for pair in pairs], 2) / PEER_STEPS * LONG
    return {
        "what": f"GOSPA of {LONG_OBJECTS} objects over {LONG} steps",
        "seconds": _best(lambda: gospa_of_sets(objects, estimates, CUTOFF), 3),
        "peer": "Stone Soup",
        "peer_seconds": peer,
        "largest_difference": difference,
        "required_seconds": REQUIRED_GOSPA,
    }


def _identities() -> list[dict[str, Any]]:
    truth, tracks = sequence(STEPS, OBJECTS)
    theirs = for_trackeval(truth, tracks)
    difference = float(np.max(np.abs(np.subtract(our_scores(truth, tracks), their_scores(theirs)))))
    _agreed("TrackEval", difference)
    return [
        {
            "what": f"HOTA, CLEAR and identity of {OBJECTS} objects over {STEPS} steps, from positions",
            "seconds": _best(lambda: our_scores(truth, tracks), REPETITIONS),
            "peer": "TrackEval, from similarities",
            "peer_seconds": _best(lambda: their_scores(theirs), REPETITIONS),
            "largest_difference": difference,
            "required_seconds": REQUIRED_IDENTITIES,
        },
        {
            "what": f"all scores and events of {OBJECTS} objects over {STEPS} steps",
            "seconds": _best(lambda: score_run(truth, tracks), REPETITIONS),
            "peer": None,
            "peer_seconds": None,
            "largest_difference": None,
            "required_seconds": REQUIRED_RUN,
        },
    ]


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


def _agreed(peer: str, difference: float) -> None:
    if not difference <= AGREEMENT[peer]:
        raise SystemExit(f"the scores differ from those of {peer} by {difference:.1e}")


def _best(call: Callable[[], object], repetitions: int) -> float:
    """s of CPU time."""
    found = []
    for _ in range(repetitions):
        begin = time.process_time()
        call()
        found.append(time.process_time() - begin)
    return min(found)


if __name__ == "__main__":
    for row in measure():
        print(row)
