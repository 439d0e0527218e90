"""Sequences of objects and tracks with given similarities, for trackbench's scores and for TrackEval's."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.metrics.traffic.assignment import NearPairs


class Similarities(NamedTuple):
    """T instants of N objects and K tracks."""

    similarity: Array
    """``(T, N, K)``."""
    objects: Mask
    """``(T, N)``."""
    tracks: Mask
    """``(T, K)``."""

    def pairs(self, least: float) -> tuple[NearPairs, Array]:
        """Those of at least this similarity, with their similarities; the distance says nothing."""
        near = (self.similarity >= least) & self.objects[:, :, None] & self.tracks[:, None]
        instant, item, track = np.nonzero(near)
        return NearPairs(instant, item, track, track, np.zeros(len(instant))), self.similarity[near]

    def counts(self) -> tuple[Any, Any]:
        return self.objects.sum(axis=0), self.tracks.sum(axis=0)

    def for_trackeval(self) -> dict[str, Any]:
        objects = [np.flatnonzero(now) for now in self.objects]
        tracks = [np.flatnonzero(now) for now in self.tracks]
        return {
            "num_timesteps": len(objects),
            "num_gt_ids": self.objects.shape[1],
            "num_tracker_ids": self.tracks.shape[1],
            "num_gt_dets": int(self.objects.sum()),
            "num_tracker_dets": int(self.tracks.sum()),
            "gt_ids": objects,
            "tracker_ids": tracks,
            "similarity_scores": [
                now[np.ix_(i, j)] for now, i, j in zip(self.similarity, objects, tracks, strict=True)
            ],
        }


def random_sequence(seed: int) -> Similarities:
    """Objects that tracks follow and leave, with other pairs that are alike now and then."""
    rng = np.random.default_rng(seed)
    steps, objects, tracks = rng.integers(1, 25), rng.integers(1, 7), rng.integers(1, 9)
    similarity = rng.random((steps, objects, tracks)) * (rng.random((steps, objects, tracks)) < rng.random())
    followed = rng.integers(0, tracks, objects)
    for item in range(objects):
        until = rng.integers(0, steps + 1)
        similarity[:until, item, followed[item]] = rng.uniform(0.3, 1.0, until)
    there = rng.uniform(0.3, 1.0, 2)
    present = [rng.random((steps, count)) < share for count, share in zip((objects, tracks), there, strict=True)]
    for some in present:
        some[0, 0] = True
    return Similarities(similarity, *present)
