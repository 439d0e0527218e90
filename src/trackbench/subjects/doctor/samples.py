"""Are random numbers in a tracker's answers, and how much do they move them?"""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Difference by it from which on a tracker has samples, in standard deviations of its estimate. Filters without samples
#: differ by less, because nearly the same motion is predicted in one step or in two.
SAMPLED = 3e-3
#: Difference of covariances from which on they are of other samples, in variances: 0.04 with several models, 0.13 of
#: 200 samples.
SPREAD = 0.06
#: Difference beyond that of any useful number of samples: an estimate that diverges.
DIVERGED = 0.5


def has_samples(tracker: TrackerUnderTest) -> bool:
    """Whether random numbers are in its answers: it says so, or copies or repetitions with others differ.

    The means of an ensemble with centred samples agree where nothing has noise, and their covariances differ.
    """
    if tracker.random or tracker.repeats > 1 or tracker.once(sampling_noise) > 0.0:
        return True
    found = tracker.once(_with_other_samples)
    if found is None:
        return False
    one, other = found
    scale = np.outer(_sigma(one), _sigma(one))
    return SPREAD < float(np.max(np.abs(one.covariance - other.covariance) / scale)) < 1.0


def sampling_noise(tracker: TrackerUnderTest) -> float:
    """The largest difference between two answers with other samples, in standard deviations; 0 without samples."""
    found = tracker.once(_with_other_samples)
    if found is None:
        return 0.0
    one, other = found
    noise = float(np.max(np.abs(one.mean - other.mean) / _sigma(one)))
    return noise if SAMPLED < noise < DIVERGED else 0.0


def _with_other_samples(tracker: TrackerUnderTest) -> tuple[Estimate, Estimate] | None:
    probe, sensor_set = tracker.probes.general[0], tracker.sensor_sets()[0]
    scan = probe.scan(sensor_set[0], tracker.sensors[sensor_set[0]], 0.0)
    one, other = (
        tracker.predict(tracker.session_at(probe, sensor_set, replica=replica), scan, probe.name)
        for replica in (False, True)
    )
    return None if one is None or other is None or not (finite(one) and finite(other)) else (one, other)


def _sigma(estimate: Estimate) -> Array:
    return np.asarray(np.maximum(np.sqrt(np.abs(np.diag(estimate.covariance))), 1e-12))
