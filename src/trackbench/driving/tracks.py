"""Trackers of several objects as ones that take the scans of many runs at once, their answers checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Indices, Scan, Tracks, scan_of_run
from trackbench.driving.alone import Stateful
from trackbench.driving.faults import fault_of
from trackbench.driving.steppers import InProcessStepper
from trackbench.engine.choice import Engine
from trackbench.engine.equations import EngineUsed
from trackbench.trackers.answers import ASYMMETRY, NOT_DEFINITE, NOT_FINITE, TrackerFault, array_of, described
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.multi import MultiObjectTracker, build_multi
from trackbench.trackers.published import create

NO_TRACK = -1
#: What ``step`` has to return beside the state, in messages.
TRACKS = "Tracks"
OF_ONE = "it gave an estimate of one object; with hidden identities step must return (state, Tracks)"


class TracksStepper(Protocol):
    """A tracker of several objects made ready for some runs."""

    def step(self, scan: Scan, origins: Indices | None = None) -> Tracks:
        """The tracks of all runs after a scan: each array with a last axis of runs, ids padded with -1.

        Args:
            scan: ``measurement`` ``(m, D, runs)`` and ``valid`` ``(D, runs)``.
            origins: ``(D, runs)`` the object that each detection stems from, for the tracker that knows them.
        """
        ...

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computed the steps so far; None of a tracker that is not built in."""
        ...

    def close(self) -> None:
        """It is no longer needed."""


def local_tracks(
    config: FilterConfig | PluginConfig, folder: Path | None, runs: int, engine: Engine = "numpy"
) -> TracksStepper:
    """A fresh tracker in this process, as a scenario names it; a built-in one is computed by the engine.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
    """
    if isinstance(config, FilterConfig):
        return BatchedTracks(replace(build_multi(config), engine=engine))
    make = create(config.use, config.options, folder)
    tracker = make()
    return BatchedTracks(tracker) if getattr(tracker, "batched", False) else LoopedTracks(make, runs)


class BatchedTracks(InProcessStepper):
    """A tracker that takes all runs at once."""

    def __init__(self, tracker: Any) -> None:
        self._tracker = Stateful(tracker, checked_tracks, TRACKS)
        self._wants_origins = bool(getattr(tracker, "wants_origins", False))

    def step(self, scan: Scan, origins: Indices | None = None) -> Tracks:
        """The tracks of all runs."""
        more = (origins,) if self._wants_origins else ()
        return self._tracker.step(scan, *more)

    def predicted(self, time: float, run: int) -> Tracks:
        """The tracks of one run at a later time, of a built-in tracker, which stays as it is."""
        found: Tracks = self._tracker.tracker.predicted(self._tracker.state, time, run)
        return found

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computed the steps so far, of a built-in tracker."""
        tracker = self._tracker.tracker
        return tracker.engine_used if isinstance(tracker, MultiObjectTracker) else None


class LoopedTracks(InProcessStepper):
    """A tracker of one run: an instance for each."""

    def __init__(self, make: Callable[[], Any], runs: int) -> None:
        self._trackers = [Stateful(make(), checked_tracks, TRACKS) for _ in range(runs)]

    def step(self, scan: Scan, origins: Indices | None = None) -> Tracks:
        """The tracks of all runs.

        Raises:
            TrackFault: the tracker of a run raised, or what it gave is no tracks.
        """
        found = []
        for run, tracker in enumerate(self._trackers):
            own = scan_of_run(scan, run)
            try:
                found.append(tracker.step(own))
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                raise fault_of(error, run) from error
        return stacked(found)


def tracks_of_run(tracks: Tracks, run: int) -> Tracks:
    """Those of one run, without padding."""
    there = tracks.ids[:, run] != NO_TRACK
    return Tracks(*(None if part is None else part[..., there, run] for part in tracks))  # type: ignore[arg-type]


def stacked(runs: Sequence[Tracks]) -> Tracks:
    """The tracks of several runs with a last axis of runs, padded."""
    most = max(len(tracks.ids) for tracks in runs)
    shape = (most, len(runs))
    ids = np.full(shape, NO_TRACK, dtype=np.intp)
    mean, covariance = np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan)
    existence = np.full(shape, np.nan) if any(tracks.existence is not None for tracks in runs) else None
    used = np.full(shape, NO_TRACK, dtype=np.intp) if any(tracks.used is not None for tracks in runs) else None
    for run, tracks in enumerate(runs):
        count = len(tracks.ids)
        ids[:count, run], mean[:, :count, run], covariance[:, :, :count, run] = tracks[:3]
        if existence is not None and tracks.existence is not None:
            existence[:count, run] = tracks.existence
        if used is not None and tracks.used is not None:
            used[:count, run] = tracks.used
    return Tracks(ids, mean, covariance, existence, used)


def checked_tracks(answer: Any, scan: Scan) -> Tracks:
    """Tracks of the right shapes, of one run or of many; none where the tracker answered None.

    Raises:
        TrackerFault: they are not; says why.
    """
    runs = np.shape(scan.valid)[1:]
    if answer is None:
        return Tracks(np.zeros((0, *runs), dtype=np.intp), np.zeros((4, 0, *runs)), np.zeros((4, 4, 0, *runs)))
    if isinstance(answer, Estimate) or (isinstance(answer, tuple) and len(answer) == 2):
        raise TrackerFault(OF_ONE)
    if not isinstance(answer, tuple) or not 3 <= len(answer) <= 5:
        wanted = "Tracks(ids, mean, covariance, existence=None, used=None)"
        raise TrackerFault(f"the answer must be {wanted} or None, not {described(answer)}")
    given = Tracks(*answer)
    ids = _whole("ids", given.ids, None)
    if ids.ndim != 1 + len(runs) or ids.shape[1:] != runs:
        raise TrackerFault(f"the ids have the shape {ids.shape}, where {('K', *runs)} is needed".replace("'K'", "K"))
    shape = ids.shape
    _require_as_many(ids, given)
    mean = array_of("mean", given.mean, (4, *shape))
    covariance = array_of("covariance", given.covariance, (4, 4, *shape))
    there = ids != NO_TRACK
    if np.any(ids < NO_TRACK):
        raise TrackerFault(f"an id is {ids.min()}; ids count from 0")
    _require_distinct(ids)
    _require_covariances(ids[there], mean[:, there], covariance[:, :, there])
    existence = None if given.existence is None else array_of("existence", given.existence, shape)
    if existence is not None:
        stated = existence[there]
        wrong = ~((stated >= 0) & (stated <= 1))
        if wrong.any():
            said = f"the existence probability of track {ids[there][wrong][0]} is {stated[wrong][0]:g}"
            raise TrackerFault(f"{said}, which is not between 0 and 1")
    used = None if given.used is None else _whole("used", given.used, shape)
    if used is not None and there.any():
        count = np.broadcast_to(np.count_nonzero(scan.valid, axis=0), shape)
        wrong = there & ((used < NO_TRACK) | (used >= count))
        if wrong.any():
            raise TrackerFault(f"used names detection {used[wrong][0]}, where the scan has {count[wrong][0]}")
    return Tracks(ids, mean, covariance, existence, used)


def _whole(what: str, value: Any, shape: tuple[int, ...] | None) -> Indices:
    array = np.asarray(value)
    if array.size and array.dtype.kind not in "iu":
        raise TrackerFault(f"the {what} are not whole numbers: {described(value)}")
    if shape is not None and array.shape != shape:
        raise TrackerFault(f"the {what} have the shape {array.shape}, where {shape} is needed")
    return array.astype(np.intp)


def _require_distinct(ids: Indices) -> None:
    ordered = np.sort(ids, axis=0)
    twice = (np.diff(ordered, axis=0) == 0) & (ordered[1:] != NO_TRACK)
    if np.any(twice):
        raise TrackerFault(f"two tracks have the id {ordered[1:][twice][0]}")


def _require_as_many(ids: Indices, given: Tracks) -> None:
    """The mean and covariance of as many tracks as there are ids; of parts of other shapes more is said elsewhere."""
    counts = [len(ids)]
    for part, axis in ((given.mean, 1), (given.covariance, 2)):
        shape = getattr(part, "shape", ())
        if len(shape) != axis + ids.ndim:
            return
        counts.append(shape[axis])
    if len(set(counts)) > 1:
        raise TrackerFault(f"the ids are of {counts[0]} tracks, the mean of {counts[1]}, the covariance of {counts[2]}")


def _require_covariances(ids: Indices, mean: Array, covariance: Array) -> None:
    """Finite estimates with symmetric, positive definite covariances: ``(K,)``, ``(4, K)``, ``(4, 4, K)``."""
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
        wrong = int(np.flatnonzero(~np.isfinite(mean.sum(axis=0) + covariance.sum(axis=(0, 1))))[0])
        part, value = ("mean", mean) if not np.isfinite(mean[:, wrong]).all() else ("covariance", covariance)
        raise TrackerFault(f"{NOT_FINITE}: track {ids[wrong]} has the {part} {_numbers(value[..., wrong])}")
    gap = np.abs(covariance - np.swapaxes(covariance, 0, 1)).max(axis=(0, 1), initial=0.0)
    if np.any(gap > ASYMMETRY * np.abs(covariance).max(axis=(0, 1), initial=0.0)):
        raise TrackerFault(f"the covariance is not symmetric: mirrored entries differ by up to {gap.max():.3g}")
    positive = linalg.cholesky(covariance).positive
    if not positive.all():
        wrong = int(np.flatnonzero(~positive)[0])
        smallest = np.linalg.eigvalsh(covariance[..., wrong])[0]
        raise TrackerFault(f"{NOT_DEFINITE}: that of track {ids[wrong]} has the eigenvalue {smallest:.3g}")


def _numbers(values: Array) -> str:
    return np.array2string(values, precision=4, separator=", ").replace("\n", "")
