"""The check-up of a tracker of several objects on short synthetic drives with unlabelled detections."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from trackbench.base.types import Array, FieldOfView, Scan, Tracks
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.testing.rules import (
    LOST,
    NOISE,
    STATE_KEPT,
    TrackerCheckError,
    batched_scan,
    checked_answers,
    require_state_kept,
)
from trackbench.trackers.answers import TRACKS, checked_tracks, tracks_of_run

Make = Callable[[], Any]
POSE = np.array([4.0, -3.0, 0.4])
#: Two cars in lanes of their own, one of which comes and one of which goes: px, py, vx, vy at time 0.
CARS = np.array([[20.0, 15.0, 12.0, 3.0], [35.0, 40.0, 9.0, -1.0]])
DURATION, STEP = 6.0, 0.05
FIELD = FieldOfView(np.pi, 200.0)


def hidden_drive(
    seed: int = 0, *, clutter: float = 0.0, probability: float = 1.0, order: int | None = None
) -> list[Scan]:
    """Scans of a lidar and a radar in turn, of one run.

    Args:
        seed: of noise, misses and clutter.
        clutter: mean number of false alarms in a scan.
        probability: of detecting a car.
        order: seed of the order of the columns; None: as drawn.
    """
    random = np.random.default_rng(seed)
    shuffled = None if order is None else np.random.default_rng(order)
    still = np.zeros(2)
    scans = []
    for number in range(round(DURATION / STEP)):
        kind, time = ("lidar", "radar")[number % 2], STEP * number
        model, noise = SENSOR_MODELS[kind], NOISE[kind]
        target = CARS.T + np.array([[time], [time], [0.0], [0.0]]) * np.roll(CARS.T, -2, axis=0)
        ideal = model.measure(target, POSE[:, None], still[:, None])
        detected = random.random(len(CARS)) < probability
        result = ideal + np.sqrt(np.diag(noise))[:, None] * random.standard_normal(ideal.shape)
        alarms = random.poisson(clutter)
        anywhere = np.concatenate([random.uniform(-100, 100, (2, alarms)), random.uniform(-20, 20, (2, alarms))])
        false = model.measure(anywhere, POSE[:, None], still[:, None])
        measurement = np.concatenate([result[:, detected], false], axis=1)
        if shuffled is not None:
            measurement = measurement[:, shuffled.permutation(measurement.shape[1])]
        valid = np.ones(measurement.shape[1], dtype=bool)
        for shared in (measurement, valid, noise):
            shared.setflags(write=False)
        scan = Scan(time, kind, kind, measurement, valid, noise, POSE, still, time)
        density = max(clutter, 1e-3) / 200.0**2
        scans.append(scan._replace(detection_probability=probability, clutter_density=density, field_of_view=FIELD))
    return scans


def _answers(make: Make, scans: Sequence[Scan]) -> Iterator[Tracks]:
    """What a fresh tracker says of a drive, each answer of the right form."""
    tracker = make()
    batched = bool(getattr(tracker, "batched", False))
    given = [batched_scan([scan]) if batched else scan for scan in scans]
    for tracks in checked_answers(tracker, given, checked_tracks, TRACKS):
        yield tracks_of_run(tracks, 0) if batched else tracks


def track_reports(make: Make) -> Iterator[bool]:
    """Whether a fresh tracker has tracks after each scan of cars in plain sight."""
    return (len(tracks.ids) > 0 for tracks in _answers(make, hidden_drive()))


def _nearest(tracks: Tracks, time: float, car: int) -> float:
    """Distance of a car from the nearest track, m; infinity where there is none."""
    if not len(tracks.ids):
        return float("inf")
    where = CARS[car, :2] + time * CARS[car, 2:]
    return float(np.hypot(*(tracks.mean[:2] - where[:, None])).min())


def _follows(**changes: Any) -> Callable[[Make], None]:
    def test(make: Make) -> None:
        scans = hidden_drive(**changes)
        *_, last = _answers(make, scans)
        for car in range(len(CARS)):
            error = _nearest(last, scans[-1].time, car)
            if not error < LOST:
                problem = f"after {len(scans)} scans no track is within {LOST:g} m of a car in plain sight"
                raise TrackerCheckError(problem)

    return test


def _predicts_to_empty_scans(make: Make) -> None:
    count = 60
    scans = [_emptied(scan) if number >= count else scan for number, scan in enumerate(hidden_drive()[: count + 4])]
    answers = list(_answers(make, scans))
    last = answers[count - 1]
    if not len(last.ids):
        return
    for scan, tracks in zip(scans[count:], answers[count:], strict=True):
        if not len(tracks.ids):
            raise TrackerCheckError(
                f"after {count} scans with detections of two cars there is no track at an empty one"
            )
        elapsed = scan.time - scans[count - 1].time
        _, before, after = np.intersect1d(last.ids, tracks.ids, return_indices=True)
        way = elapsed * last.mean[2:, before]
        error = np.hypot(*(tracks.mean[:2, after] - last.mean[:2, before] - way))
        behind = error > 0.5 * np.hypot(*way) + 0.01
        if behind.any():
            raise TrackerCheckError(
                f"at an empty scan {elapsed:.2g} s after the last detections a track is {error.max():.2g} m from where "
                "its own velocity takes it"
            )


def _emptied(scan: Scan) -> Scan:
    return scan._replace(measurement=scan.measurement[:, :0], valid=scan.valid[:0])


def _with_gaps(*gaps: range) -> list[Scan]:
    """A drive with false alarms and misses, some scans of which are empty."""
    return [
        _emptied(scan) if any(number in gap for gap in gaps) else scan
        for number, scan in enumerate(hidden_drive(clutter=1.0, probability=0.9))
    ]


def _order_means_nothing(make: Make) -> None:
    orders = (_answers(make, hidden_drive(clutter=2.0, probability=0.9, order=order)) for order in (1, 2))
    for pair in zip(*map(list, orders), strict=True):
        a, b = (np.array(sorted(map(tuple, np.round(tracks.mean.T, 6)))) for tracks in pair)
        if a.shape != b.shape or not np.allclose(a, b, atol=1e-5):
            raise TrackerCheckError("detections in another order give other tracks")


def _never_reuses(make: Make) -> None:
    """A track that was not reported for a while comes back where its velocity takes it."""
    latest: dict[int, tuple[float, Array]] = {}
    before: set[int] = set()
    scans = _with_gaps(range(40, 80))
    for scan, tracks in zip(scans, _answers(make, scans), strict=True):
        reported = dict(zip(tracks.ids.tolist(), tracks.mean.T, strict=True))
        for track in (reported.keys() - before) & latest.keys():
            time, state = latest[track]
            if not np.hypot(*(reported[track] - state)[:2] - (scan.time - time) * state[2:]) < LOST:
                raise TrackerCheckError(f"the id {track} is used again after its track had ended")
        latest |= {track: (scan.time, state) for track, state in reported.items()}
        before = set(reported)


def _is_deterministic(make: Make) -> None:
    runs = [list(_answers(make, hidden_drive(clutter=2.0))) for _ in range(2)]
    for first, second in zip(*runs, strict=True):
        if not (np.array_equal(first.ids, second.ids) and np.array_equal(first.mean, second.mean)):
            raise TrackerCheckError("two fresh trackers give different tracks of the same scans")


def _batch_is_loop(make: Make) -> None:
    if not getattr(make(), "batched", False):
        return
    drives = [hidden_drive(seed, clutter=1.0, probability=0.9) for seed in range(3)]
    alone = [list(_answers(make, drive)) for drive in drives]
    together = map(batched_scan, zip(*drives, strict=True))
    for number, tracks in enumerate(checked_answers(make(), together, checked_tracks, TRACKS)):
        for run, single in enumerate(alone):
            own, other = tracks_of_run(tracks, run), single[number]
            if not (np.array_equal(own.ids, other.ids) and np.allclose(own.mean, other.mean, rtol=1e-9, atol=1e-9)):
                raise TrackerCheckError(f"run {run} of a batch of {len(drives)} has other tracks than alone")


RULES: dict[str, Callable[[Make], object]] = {
    "gives tracks of the right form, and follows two cars in plain sight": _follows(),
    "follows them through missed detections and false alarms": _follows(clutter=1.0, probability=0.9),
    "takes scans without a detection": lambda make: list(_answers(make, _with_gaps(range(10), range(60, 80)))),
    "predicts its tracks to scans without a detection": _predicts_to_empty_scans,
    "uses no id again": _never_reuses,
}
#: Those that compare two answers to the same.
REPEATING: dict[str, Callable[[Make], object]] = {
    "gives the same tracks whatever the order of the detections": _order_means_nothing,
    "gives the same tracks every time": _is_deterministic,
    STATE_KEPT: lambda make: require_state_kept(make(), hidden_drive()[:40], checked_tracks, TRACKS, "other tracks"),
    "gives a batch the same tracks as single runs (if batched)": _batch_is_loop,
}
