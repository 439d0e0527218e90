"""Whether the first scans of tracks contradict the velocity that the tracks are said to start with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.models.motion import ConstantVelocity
from trackbench.results.tracker_result import FirstVelocity
from trackbench.scenario.keys import TrackerEntry
from trackbench.sensing.detections import HiddenMeasurements
from trackbench.sensing.scans import Measurements
from trackbench.trackers.assume import AssumedSensors
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.initial import TentativeTrack, first_measurement, start_tracks, two_measurements

#: Standard deviations within which a velocity is expected, and the share of tracks of which more are a contradiction.
MOST_SIGMAS, MOST_TRACKS = 4.0, 2 / 3
#: Of how many scans and runs it is asked, and the least time between two positions, s.
SCANS, RUNS, LEAST_TIME = 40, 20, 0.19
#: Any noise will do: nothing is predicted.
CARTESIAN = ConstantVelocity(acceleration_sigma_mps2=1.0)


def first_velocities(
    trackers: Mapping[str, TrackerEntry], measurements: Measurements | HiddenMeasurements, objects: int
) -> dict[str, Array]:
    """For each tracker that starts from one measurement, what the first few of each object say of the velocity.

    Args:
        trackers: by name.
        measurements: of a block of runs.
        objects: how many there are.

    Returns:
        ``(2, tracks)``: how many of its standard deviations the velocity between two positions is from the one that a
        track starts with, and how far, m/s.
    """
    computed: dict[object, Array] = {}
    result = {}
    for name, config in trackers.items():
        if not isinstance(config, FilterConfig):
            continue
        if config.initial.source != "first_measurement" or config.initial.covariance_diag is not None:
            continue
        key = repr((config.initial, config.sensors, config.scan_options["assumed"]))
        if key not in computed:
            computed[key] = _distances(config, _first(config, measurements, objects))
        result[name] = computed[key]
    return result


def _first(config: FilterConfig, measurements: Measurements | HiddenMeasurements, objects: int) -> Iterator[Scan]:
    """The first scans of the sensors from which tracks start, as the tracker takes them; see ``_of_objects``."""
    starting = config.initial.sensors or config.sensors
    assumed: AssumedSensors = config.scan_options["assumed"]
    read = (k for k, scan in enumerate(measurements.scans) if starting is None or scan.sensor in starting)
    return (assumed.read(_of_objects(measurements, number, objects)) for number in islice(read, SCANS))


def _of_objects(measurements: Measurements | HiddenMeasurements, number: int, objects: int) -> Scan:
    """A scan of the first runs, with one measurement for each object, objects slowest."""
    scan = measurements.scans[number]
    if isinstance(measurements, Measurements):
        members = np.arange(scan.valid.size).reshape(objects, -1)[:, :RUNS].ravel()
        return scan._replace(measurement=scan.measurement[:, members], valid=scan.valid[members])
    origins = measurements.origins[number][:, :RUNS]
    column, run = np.nonzero((origins >= 0) & (origins < objects))
    measured = np.full((len(scan.measurement), objects, origins.shape[1]), np.nan)
    measured[:, origins[column, run], run] = scan.measurement[:, column, run]
    flat = measured.reshape(len(measured), -1)
    return scan._replace(measurement=flat, valid=~np.isnan(flat[0]))


def _distances(config: FilterConfig, scans: Iterable[Scan]) -> Array:
    """For each track the first velocity between two positions that is as certain as the one it is held against."""
    # What is certain of the range rate is no matter of the stated standard deviation.
    velocity = "zero" if config.initial.velocity == "zero" else "radial"
    initial = config.initial.model_copy(update={"velocity": velocity})
    waiting: TentativeTrack | None = None
    prior: Gaussian | None = None
    apart, done = np.empty((2, 0)), np.empty(0, dtype=bool)
    for part in scans:
        if waiting is None:
            apart, done = np.full((2, part.valid.size), np.nan), np.zeros(part.valid.size, dtype=bool)
        belief = first_measurement(CARTESIAN, initial, part)
        prior = belief if prior is None or waiting is None else belief.where(np.isnan(waiting.time), prior)
        waiting = start_tracks(initial, part, waiting).waiting
        elapsed = part.time - waiting.time
        later = part.valid & (elapsed > LEAST_TIME) & ~done
        if not np.any(later):
            continue
        second = two_measurements(waiting.position, waiting.latest, np.where(later, elapsed, 1.0))
        spread = second.covariance[2:, 2:]
        fresh = later & (spread[0, 0] + spread[1, 1] <= 2 * config.initial.velocity_sigma_mps**2)
        away = second.mean[2:] - prior.mean[2:]
        sigmas = np.sqrt((linalg.cholesky(spread + prior.covariance[2:, 2:]).whiten(away) ** 2).sum(axis=0))
        apart = np.where(fresh, np.stack([sigmas, np.hypot(*away)]), apart)
        done |= fresh
        if np.all(done):
            break
    return apart[:, done]


def contradiction(config: TrackerEntry, velocities: Sequence[Array]) -> FirstVelocity | None:
    """What to say of a tracker's first velocity; None where most of its tracks do not contradict it."""
    sigmas, speed = np.concatenate(velocities, axis=1) if velocities else np.empty((2, 0))
    if not len(sigmas) or not isinstance(config, FilterConfig):
        return None
    share = float(np.mean(sigmas > MOST_SIGMAS))
    if share <= MOST_TRACKS:
        return None
    return FirstVelocity(sigma_mps=config.initial.velocity_sigma_mps, share=share, typical_mps=float(np.median(speed)))
