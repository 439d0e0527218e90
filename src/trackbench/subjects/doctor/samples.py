"""Random samples in a tracker's answers: whether it draws any, and how far they move its estimates."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Least difference between two predictions, with and without an additional step before, that shows random samples, in
#: standard deviations. Filters without samples differ less: nearly the same motion is predicted in one step or in two.
SAMPLED = 3e-3
#: Least difference of two covariances that shows random samples, in variances: several models reach 0.04, 200 samples
#: reach 0.13.
SPREAD = 0.06
#: Difference of two predictions above which the estimate diverges; any useful number of samples stays below.
DIVERGED = 0.5


def has_samples(tracker: TrackerUnderTest) -> bool:
    """Return whether a tracker draws random samples: it says so, or its answers differ when repeated or redrawn.

    Covariances are compared too: centred samples give equal means in every draw as long as nothing has noise.
    """
    if tracker.random or tracker.repeats > 1 or tracker.once(sampling_noise) > 0.0:
        return True
    answers = tracker.once(_predict_with_redrawn_samples)
    if answers is None:
        return False
    usual, redrawn = answers
    scale = np.outer(_sigma(usual), _sigma(usual))
    return SPREAD < float(np.max(np.abs(usual.covariance - redrawn.covariance) / scale)) < 1.0


def sampling_noise(tracker: TrackerUnderTest) -> float:
    """Return the largest change of a predicted mean by redrawn samples, in standard deviations; 0 without samples."""
    answers = tracker.once(_predict_with_redrawn_samples)
    if answers is None:
        return 0.0
    usual, redrawn = answers
    noise = float(np.max(np.abs(usual.mean - redrawn.mean) / _sigma(usual)))
    return noise if SAMPLED < noise < DIVERGED else 0.0


def _predict_with_redrawn_samples(tracker: TrackerUnderTest) -> tuple[Estimate, Estimate] | None:
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
