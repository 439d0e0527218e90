"""The rules of the trackers' contract, each a test of fresh trackers on synthetic drives."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import dropwhile, islice
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array, Scan, Tracks
from trackbench.testing.drives import STEP, batched_scan, cars_at, drive, hidden_drive, target_at, usual_drive
from trackbench.trackers.answers import (
    GIVEN_UP,
    NOT_DEFINITE,
    NOT_FINITE,
    TRACKS,
    Tracker,
    TrackerFault,
    checked_estimate,
    checked_tracks,
    tracks_of_run,
    unpack,
)

Identities = Literal["known", "hidden"]
Make = Callable[[], Tracker]
Rule = Callable[[Make], object]
#: Number of scans that show whether a tracker is of one object or of several.
TRIED = 20
#: Error above which a tracker has lost a target in plain sight, m and m/s.
LOST = 5.0
#: Rule for trackers whose state is passed to them, which programs keep themselves.
STATE_KEPT = "leaves the state that it is given as it is"
OF_OTHER_KIND: Mapping[Identities, str] = {
    "known": 'it follows several objects: say identities="hidden"',
    "hidden": 'it follows one object: leave identities="hidden" out',
}


class TrackerCheckError(AssertionError):
    """Breach of the trackers' contract; the text lists every broken rule."""


def require_identities(identities: str) -> None:
    if identities not in OF_OTHER_KIND:
        raise InputError(f"{identities!r} is not known; {nearest_choices(identities, OF_OTHER_KIND)}", key="identities")


def gives_reports(reports: Callable[[], Iterable[bool]]) -> bool:
    """Return whether a tracker survives some scans and ever reports; ``reports`` yields whether it reports at each."""
    try:
        return any(list(islice(reports(), TRIED)))
    except (Exception, SystemExit):
        return False


class Kind(NamedTuple):
    """Functions to make test scans, true states and checked tracks, for trackers of one object or of several."""

    noun: str
    """Word for a tracker's answer in error messages, such as "estimate"."""
    drive: Callable[..., list[Scan]]
    """Function that makes the scans of one run from a seed."""
    truth: Callable[[float], Array]
    """Function that returns the true states of seed 0 at a time, ``(4, objects)``."""
    tracks: Callable[[Any, Scan], list[Tracks]]
    """Function that checks an answer and returns the tracks of each run."""


def _estimates_as_tracks(answer: Any, scan: Scan) -> list[Tracks]:
    """Return the estimate of each run as track 0; no track for a run without an estimate, which is NaN in a batch."""
    estimate, runs = checked_estimate(answer, scan), scan.valid.size
    if estimate is None:
        return [_track(np.zeros((4, 0)), np.zeros((4, 4, 0)))] * runs
    mean, covariance = estimate.mean.reshape(4, runs), estimate.covariance.reshape(4, 4, runs)
    has_estimate = np.atleast_1d(~np.isnan(mean).any(axis=0) | (np.ndim(scan.valid) == 0))
    if not np.isfinite(mean[:, has_estimate].sum() + covariance[:, :, has_estimate].sum()):
        raise TrackerFault(f"{NOT_FINITE} at {scan.time:g} s")
    if not np.all(linalg.cholesky(covariance[:, :, has_estimate]).positive):
        raise TrackerFault(f"{NOT_DEFINITE} at {scan.time:g} s")
    slices = [slice(run, run + int(has_estimate[run])) for run in range(runs)]
    return [_track(mean[:, run], covariance[:, :, run]) for run in slices]


def _track(mean: Array, covariance: Array) -> Tracks:
    return Tracks(np.zeros(mean.shape[1], dtype=int), mean, covariance)


def _tracks_of_runs(answer: Any, scan: Scan) -> list[Tracks]:
    tracks = checked_tracks(answer, scan)
    return [tracks] if scan.valid.ndim == 1 else [tracks_of_run(tracks, run) for run in range(scan.valid.shape[1])]


ONE = Kind("estimate", usual_drive, lambda time: target_at(time)[:, None], _estimates_as_tracks)
SEVERAL = Kind(TRACKS, hidden_drive, cars_at, _tracks_of_runs)


def reports(kind: Kind, make: Make, *drives: Sequence[Scan]) -> Iterator[list[Tracks]]:
    """Yield the tracks of each run that a fresh tracker reports at each instant; several ``drives`` are one batch."""
    tracker, state, before = make(), None, [0] * len(drives)
    for scans in zip(*drives, strict=True):
        state, tracks = _step(kind, tracker, state, scans)
        numbers = [len(run.ids) for run in tracks]
        if kind is ONE and any(np.less(numbers, before)):
            raise TrackerFault(f"{GIVEN_UP} ({scans[0].time:g} s)")
        yield tracks
        before = numbers


def _step(kind: Kind, tracker: Tracker, state: Any, scans: Sequence[Scan]) -> tuple[Any, list[Tracks]]:
    scan = batched_scan(scans) if getattr(tracker, "batched", False) else scans[0]
    state, answer = unpack(tracker.step(state, scan), kind.noun)
    return state, kind.tracks(answer, scan)


def answers(kind: Kind, make: Make, scans: Sequence[Scan]) -> Iterator[Tracks]:
    """Yield the tracks that a fresh tracker reports at each scan of one run."""
    return (tracks for [tracks] in reports(kind, make, scans))


def _is_same(a: Tracks, b: Tracks) -> bool:
    return np.array_equal(a.ids, b.ids) and np.array_equal(a.mean, b.mean, equal_nan=True)


def _survives(kind: Kind, scans: Callable[[], list[Scan]]) -> Rule:
    return lambda make: list(answers(kind, make, scans()))


def _gives_estimates(make: Make) -> None:
    if not any(len(tracks.ids) for tracks in answers(ONE, make, usual_drive())):
        raise TrackerCheckError("120 measurements of one target give no estimate")


def _follows(kind: Kind, **changes: Any) -> Rule:
    def test(make: Make) -> None:
        scans = kind.drive(**changes)
        pairs = [pair for pair in zip(scans, answers(kind, make, scans), strict=True) if len(pair[1].ids)]
        if not pairs:
            raise TrackerCheckError(f"{len(scans)} scans of targets in plain sight give no {kind.noun}")
        # (instants, 4, objects): error of the track nearest to each object.
        errors = np.array([_nearest_errors(tracks, kind.truth(scan.time)) for scan, tracks in pairs])
        error = float(np.hypot(*errors[-1, :2]).max())
        if not error < LOST or pairs[-1][0] is not scans[-1]:
            raise TrackerCheckError(f"after {len(scans)} scans it is {error:.1f} m off a target in plain sight")
        # A mean, since the velocity of a tracker without a filter is a noisy but unbiased difference of measurements.
        bias = float(np.hypot(*errors[len(errors) // 2 :, 2:].mean(axis=0)).max())
        if not bias < LOST:
            raise TrackerCheckError(f"the velocity is {bias:.1f} m/s off that of a target in plain sight, on average")

    return test


def _nearest_errors(tracks: Tracks, truth: Array) -> Array:
    """Return the error of the track nearest to each object, ``(4, objects)``."""
    errors = tracks.mean[:, :, None] - truth[:, None, :]
    nearest = np.hypot(*errors[:2]).argmin(axis=0)
    return errors[:, nearest, np.arange(truth.shape[1])]


def _is_deterministic(kind: Kind) -> Rule:
    def test(make: Make) -> None:
        runs = [list(answers(kind, make, kind.drive())) for _ in range(2)]
        if not all(_is_same(first, second) for first, second in zip(*runs, strict=True)):
            raise TrackerCheckError(f"two fresh trackers give different {kind.noun}s of the same measurements")

    return test


def _keeps_state(kind: Kind) -> Rule:
    def test(make: Make) -> None:
        tracker, state = make(), None
        for scan in kind.drive()[:40]:
            after, first = _step(kind, tracker, state, [scan])
            _, second = _step(kind, tracker, state, [scan])
            if not _is_same(first[0], second[0]):
                raise TrackerCheckError(
                    f"at {scan.time:g} s the same state and scan give another answer the second time: "
                    "the state was changed in place, or the tracker remembers something beside it"
                )
            state = after

    return test


def _stands_alone(kind: Kind) -> Rule:
    def test(make: Make) -> None:
        alone = answers(kind, make, kind.drive(1))
        beside = zip(answers(kind, make, kind.drive()), answers(kind, make, kind.drive(1)), strict=True)
        if not all(_is_same(tracks, shared) for tracks, (_, shared) in zip(list(alone), beside, strict=True)):
            raise TrackerCheckError("a second tracker at work at the same time changes its answers")

    return test


def _batch_is_loop(kind: Kind, drives: Callable[[], list[list[Scan]]]) -> Rule:
    def test(make: Make) -> None:
        if not getattr(make(), "batched", False):
            return
        together = list(reports(kind, make, *drives()))
        for run, scans in enumerate(drives()):
            # Alone, a tracker of one object begins with its first detection.
            alone = list(answers(kind, make, list(dropwhile(lambda scan: not scan.valid.any(), scans))))
            for batch, b in zip(together[-len(alone) :], alone, strict=True):
                a = batch[run]
                if not (np.array_equal(a.ids, b.ids) and np.allclose(a.mean, b.mean, rtol=1e-9, atol=1e-9)):
                    raise TrackerCheckError(f"run {run} of a batch of {len(batch)} has another answer than alone")

    return test


def _emptied(scan: Scan) -> Scan:
    return scan._replace(measurement=scan.measurement[:, :0], valid=scan.valid[:0])


def _with_gaps(*gaps: range) -> list[Scan]:
    """Return a drive with false alarms and misses; scans whose indices are in ``gaps`` are empty."""
    return [
        _emptied(scan) if any(number in gap for gap in gaps) else scan
        for number, scan in enumerate(hidden_drive(clutter=1.0, probability=0.9))
    ]


def _predicts_to_empty_scans(make: Make) -> None:
    *scans, latest = hidden_drive()[:61]
    *_, last, tracks = answers(SEVERAL, make, [*scans, _emptied(latest)])
    if len(last.ids) and not len(tracks.ids):
        raise TrackerCheckError(f"after {len(scans)} scans of two cars there is no track at an empty one")
    _, before, after = np.intersect1d(last.ids, tracks.ids, return_indices=True)
    way = STEP * last.mean[2:, before]
    error = np.hypot(*(tracks.mean[:2, after] - last.mean[:2, before] - way))
    if np.any(error > 0.5 * np.hypot(*way) + 0.01):
        raise TrackerCheckError(
            f"at an empty scan {STEP:g} s after the last detections a track is {error.max():.2g} m from where its own "
            "velocity takes it"
        )


def _order_means_nothing(make: Make) -> None:
    scans, random = hidden_drive(clutter=2.0, probability=0.9), np.random.default_rng(1)
    orders = [random.permutation(scan.measurement.shape[1]) for scan in scans]
    turned = [scan._replace(measurement=scan.measurement[:, order]) for scan, order in zip(scans, orders, strict=True)]
    for pair in zip(answers(SEVERAL, make, scans), answers(SEVERAL, make, turned), strict=True):
        a, b = (np.array(sorted(map(tuple, np.round(tracks.mean.T, 6)))) for tracks in pair)
        if a.shape != b.shape or not np.allclose(a, b, atol=1e-5):
            raise TrackerCheckError("detections in another order give other tracks")


def _never_reuses(make: Make) -> None:
    """Refuse an id that returns at a position that its track cannot have reached."""
    latest: dict[int, tuple[float, Array]] = {}
    before: set[int] = set()
    scans = _with_gaps(range(40, 80))
    for scan, tracks in zip(scans, answers(SEVERAL, make, scans), strict=True):
        reported = dict(zip(tracks.ids.tolist(), tracks.mean.T, strict=True))
        for track in (reported.keys() - before) & latest.keys():
            time, state = latest[track]
            if not np.hypot(*(reported[track] - state)[:2] - (scan.time - time) * state[2:]) < LOST:
                raise TrackerCheckError(f"the id {track} is used again after its track had ended")
        latest |= {track: (scan.time, state) for track, state in reported.items()}
        before = set(reported)


#: Rules of each kind of trackers; the second group compares two answers to equal scans, which random trackers skip.
RULES: Mapping[Identities, tuple[dict[str, Rule], dict[str, Rule]]] = {
    "known": (
        {
            "gives estimates of the right shape, finite, with a positive definite covariance": _gives_estimates,
            "follows a target in plain sight": _follows(ONE),
            "follows it from a sensor that moves": _follows(ONE, velocity=(-10.0, -8.0)),
            "goes on through missed measurements": _survives(
                ONE, lambda: usual_drive(missed=[1, 5, 6, 30, *range(60, 90)])
            ),
            "takes two sensors at the same instant": _survives(
                ONE, lambda: drive(["lidar", "radar"] * 40, [0.1 * (i // 2) for i in range(80)])
            ),
            "takes uneven time steps": _survives(
                ONE, lambda: drive(["radar", "lidar"] * 20, [0.01 * i**1.7 for i in range(40)])
            ),
            "works with lidar alone": _survives(ONE, lambda: drive(["lidar"] * 60, [0.05 * i for i in range(60)])),
            "works with radar alone": _survives(ONE, lambda: drive(["radar"] * 60, [0.05 * i for i in range(60)])),
        },
        {
            "gives the same estimates every time": _is_deterministic(ONE),
            STATE_KEPT: _keeps_state(ONE),
            "does not disturb another tracker": _stands_alone(ONE),
            "gives a batch the same estimates as single targets (if batched)": _batch_is_loop(
                ONE, lambda: [usual_drive(i, missed) for i, missed in enumerate(([0], [0, 9, 10], range(15)))]
            ),
        },
    ),
    "hidden": (
        {
            "gives tracks of the right form, and follows two cars in plain sight": _follows(SEVERAL),
            "follows them through missed detections and false alarms": _follows(SEVERAL, clutter=1.0, probability=0.9),
            "takes scans without a detection": _survives(SEVERAL, lambda: _with_gaps(range(10), range(60, 80))),
            "predicts its tracks to scans without a detection": _predicts_to_empty_scans,
            "uses no id again": _never_reuses,
        },
        {
            "gives the same tracks whatever the order of the detections": _order_means_nothing,
            "gives the same tracks every time": _is_deterministic(SEVERAL),
            STATE_KEPT: _keeps_state(SEVERAL),
            "does not disturb another tracker": _stands_alone(SEVERAL),
            "gives a batch the same tracks as single runs (if batched)": _batch_is_loop(
                SEVERAL, lambda: [hidden_drive(seed, clutter=1.0, probability=0.9) for seed in range(3)]
            ),
        },
    ),
}
