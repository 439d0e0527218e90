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
    answers = tracker.once(_with_other_samples)
    if answers is None:
        return False
    usual, redrawn = answers
    scale = np.outer(_sigma(usual), _sigma(usual))
    return SPREAD < float(np.max(np.abs(usual.covariance - redrawn.covariance) / scale)) < 1.0


def sampling_noise(tracker: TrackerUnderTest) -> float:
    """The largest difference between two answers with other samples, in standard deviations; 0 without samples."""
    answers = tracker.once(_with_other_samples)
    if answers is None:
        return 0.0
    usual, redrawn = answers
    noise = float(np.max(np.abs(usual.mean - redrawn.mean) / _sigma(usual)))
    return noise if SAMPLED < noise < DIVERGED else 0.0


def _with_other_samples(tracker: TrackerUnderTest) -> tuple[Estimate, Estimate] | None:
    probe, sensor_set = tracker.probes.general[0], tracker.sensor_sets()[0]
    scan = tracker.scan(probe, sensor_set[0], 0.0)
    usual, redrawn = (
        tracker.predict(tracker.session_at(probe, sensor_set, replica=replica), scan, probe.name)
        for replica in (False, True)
    )
    if usual is None or redrawn is None or not (finite(usual) and finite(redrawn)):
        return None
    return usual, redrawn


def _sigma(estimate: Estimate) -> Array:
    return np.asarray(np.maximum(np.sqrt(np.abs(np.diag(estimate.covariance))), 1e-12))
