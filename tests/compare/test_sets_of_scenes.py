"""Scenarios that share scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from tests.support.scenes import truth

from trackbench.base.types import RecordedDetections
from trackbench.compare.ranking import sets_of_scenes
from trackbench.runner.assemble import scene_fingerprint


def test_a_longer_or_finer_record_of_the_same_traffic_is_the_same_scene() -> None:
    def recorded(duration: float, rate: float, speed: float = 10.0, later: float = np.nan) -> str:
        time = np.arange(round(duration * rate) + 1) / rate
        x = np.stack([speed * time, 40.0 - 3.0 * time, np.where(time > 6.0, later, np.nan)], axis=1)[:, :, None]
        return scene_fingerprint(truth(time, x, 0.0 * x, 0.0 * x, 0.0 * x))

    def sets(*fingerprints: str) -> int:
        return len(sets_of_scenes({str(i): [fingerprint] for i, fingerprint in enumerate(fingerprints)}))

    whole = recorded(20, 10)
    assert whole == recorded(20, 15)
    assert sets(whole, recorded(19.9, 10), recorded(4, 10), recorded(4, 10, later=7.0)) == 1
    assert sets(whole, recorded(20, 10, speed=10.1)) == 2
    # What agrees for six seconds only is no record of the same.
    assert sets(whole, recorded(20, 10, later=7.0)) == 2


def test_logs_without_a_truth_are_told_apart_by_their_measurements() -> None:
    def log(first: float) -> str:
        empty = np.zeros((2, 0, 1))
        unknown = replace(truth(np.arange(2.0), empty, empty, empty, empty), known=False)
        steps, track = np.array([0, 1]), np.array([-1, -1])
        read = RecordedDetections(steps, steps, np.array([[first, 2.0]]), track, ())
        return scene_fingerprint(unknown, {"radar": read})

    assert log(1.0) == log(1.0)
    assert log(1.0) != log(1.5)


def test_sets_join_what_shares_a_scene_by_way_of_others() -> None:
    scenes = {"a": ["1", "2"], "b": ["3"], "c": ["4", "5"], "d": ["26", "4"], "e": [], "f": []}
    assert sets_of_scenes(scenes) == [["a", "c", "d"], ["b"], ["e"], ["f"]]
