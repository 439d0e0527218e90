"""The check-up of trackers of several objects: a sound one passes, and each rule finds its fault."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trackbench.base.errors import InputError
from trackbench.base.types import Scan, Tracks
from trackbench.testing import TrackerCheckError, check_tracker
from trackbench.testing.rules import RULES

#: A detection further than this from a track is not its own, m; a track without one for so many scans ends.
GATE, PATIENCE = 6.0, 6


class Nearest:
    """Each track takes the nearest detection; alpha-beta on positions. Greedy, in the order of distance."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        tracks, last, time = state or ((), -1, scan.time)
        detections = positions(scan)
        dt = scan.time - time
        moved = [(number, place + dt * speed, speed, missed, hits) for number, place, speed, missed, hits in tracks]
        pairs = [
            (np.hypot(*(place - z)), i, j) for i, (_, place, *_) in enumerate(moved) for j, z in enumerate(detections)
        ]
        taken: dict[int, int] = {}
        for distance, i, j in sorted(pairs):
            if distance < GATE and i not in taken and j not in taken.values():
                taken[i] = j
        after = []
        for i, (number, place, speed, missed, hits) in enumerate(moved):
            if i in taken:
                gap = detections[taken[i]] - place
                after.append((number, place + 0.5 * gap, speed + (0.2 * gap / dt if dt else 0), 0, hits + 1))
            elif missed < PATIENCE:
                after.append((number, place, speed, missed + 1, hits))
        for z in sorted((tuple(z) for j, z in enumerate(detections) if j not in taken.values())):
            last += 1
            after.append((last, np.array(z), np.zeros(2), 0, 1))
        return (tuple(after), last, scan.time), self.reported(after)

    def reported(self, tracks: Any) -> Tracks:
        shown = [track for track in tracks if track[4] > 3]
        ids = np.array([track[0] for track in shown], dtype=int)
        mean = np.array([[*place, *speed] for _, place, speed, _, _ in shown]).reshape(-1, 4).T
        return Tracks(ids, mean, np.tile(np.eye(4)[:, :, None], len(ids)))


class Forgetful(Nearest):
    """Numbers its tracks anew at every scan."""

    def reported(self, tracks: Any) -> Tracks:
        reported = super().reported(tracks)
        return reported._replace(ids=np.arange(len(reported.ids)))


class ByColumn:
    """Takes the column of a detection for its object."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        detections = positions(scan)
        mean = np.concatenate([detections, np.tile([10.5, 1.0], (len(detections), 1))], axis=1).T
        before = state if state is not None and state.shape == mean.shape else mean
        mean = 0.5 * (mean + before)
        return mean, Tracks(np.arange(len(detections)), mean, np.tile(np.eye(4)[:, :, None], len(detections)))


class NeedsDetections(Nearest):
    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        scan.measurement.max()
        return super().step(state, scan)


class Twice(Nearest):
    def reported(self, tracks: Any) -> Tracks:
        reported = super().reported(tracks)
        return reported._replace(ids=np.zeros(len(reported.ids), dtype=int))


class Waits(Nearest):
    """Says at an empty scan what it said last."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        if state is not None and not scan.measurement.size:
            return state, self.reported(state[0])
        return super().step(state, scan)


class Indefinite(Nearest):
    def reported(self, tracks: Any) -> Tracks:
        reported = super().reported(tracks)
        return reported._replace(covariance=-reported.covariance)


class OfOne:
    """A tracker of a single object."""

    def step(self, state: Any, scan: Scan) -> Any:
        place = positions(scan._replace(measurement=scan.measurement[:, None]))[0] if scan.valid else state
        assert scan.measurement.shape in ((2,), (3,))
        return place, (np.array([*place, 0.0, 0.0]), np.eye(4))


class Remembers(Nearest):
    """Keeps its tracks beside the state."""

    own: Any = None

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        self.own, tracks = super().step(self.own, scan)
        return 0, tracks


def positions(scan: Scan) -> np.ndarray:
    """``(D, 2)`` in the fixed frame."""
    first, second = scan.measurement[:2]
    x, y = (first * np.cos(second), first * np.sin(second)) if scan.kind == "radar" else (first, second)
    sx, sy, yaw = scan.sensor_pose
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([sx + c * x - s * y, sy + s * x + c * y], axis=-1)


def test_a_sound_tracker_passes() -> None:
    assert check_tracker(Nearest, identities="hidden") == [rule for rules in RULES["hidden"] for rule in rules]


@pytest.mark.parametrize(
    ("tracker", "problem"),
    [
        (ByColumn, "detections in another order give other tracks"),
        (NeedsDetections, "takes scans without a detection"),
        (Forgetful, "is used again after its track had ended"),
        (Twice, "two tracks have the id 0"),
        (Waits, "predicts its tracks to scans without a detection: at an empty scan 0.05 s after"),
        (Indefinite, "not positive definite"),
        (OfOne, 'it follows one object: leave identities="hidden" out'),
        (Remembers, "leaves the state that it is given as it is"),
        (lambda: None, "'NoneType' object has no attribute 'step'"),
    ],
)
def test_a_fault_is_named(tracker: Any, problem: str) -> None:
    with pytest.raises(TrackerCheckError, match=problem):
        check_tracker(tracker, identities="hidden")


def test_a_tracker_of_several_objects_is_known_as_one() -> None:
    with pytest.raises(TrackerCheckError, match='it follows several objects: say identities="hidden"'):
        check_tracker(Nearest)


def test_identities_are_one_of_two_words() -> None:
    with pytest.raises(InputError, match="'hiden' is not known; did you mean 'hidden'"):
        check_tracker(Nearest, identities="hiden")  # type: ignore[arg-type]
