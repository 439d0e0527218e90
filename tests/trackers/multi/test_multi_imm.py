"""Trackers of several objects with several motion models."""

import numpy as np
import pytest
from tests.support.scenes import LIDAR_NOISE, NOISE
from tests.support.traffic_scans import traffic, vehicles
from tests.trackers.multi.test_multi_tracker import followed

from trackbench.base.types import Gaussian
from trackbench.filters import ExtendedKalmanFilter, InteractingMultipleModel
from trackbench.models.motion import MOTION_MODELS, InitialSigmas
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.initial import InitialConfig
from trackbench.trackers.multi import build_multi
from trackbench.trackers.multi.association import AssociationInput, soft_association
from trackbench.trackers.multi.gate import GatedPairs, run_detections, with_mode_likelihoods
from trackbench.trackers.multi.intensity import Intensity
from trackbench.trackers.multi.table import PredictedTracks, TrackFilter

CV, CTRV = ({"model": name, **NOISE[name]} for name in ("cv", "ctrv"))
METHODS = ("gnn", "jpda", "jipda", "pmb")


def config(method, filter_name, motion, **associate):
    return FilterConfig.model_validate(
        {"filter": filter_name, "motion": motion, "associate": {"method": method, **associate}}
    )


@pytest.mark.parametrize("method", [*METHODS, "naive"])
@pytest.mark.parametrize(("filter_name", "model"), [("ekf", CV), ("ukf", CTRV)])
def test_equal_models_give_the_tracks_of_one(method, filter_name, model):
    seen = traffic(vehicles(6, spacing=12.0), 8, runs=2, detection=0.9, clutter=4.0, seed=3)
    one = followed(build_multi(config(method, filter_name, model)).tracker, seen)
    two = followed(build_multi(config(method, filter_name, {"imm": [model, model], "stay_s": [3, 2]})).tracker, seen)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.ids, b.ids)
        np.testing.assert_array_equal(a.used, b.used)
        np.testing.assert_allclose(b.mean, a.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(b.covariance, a.covariance, rtol=1e-9, atol=1e-9)
        if a.existence is not None:
            np.testing.assert_allclose(b.existence, a.existence, rtol=1e-9, atol=1e-12)
    assert (one[-1].ids >= 0).sum() > 8


def test_one_track_and_two_detections_are_weighed_by_total_probability():
    """Over no, the first and the second detection, and over the modes: nine Gaussians, counted one by one."""
    motions = tuple(MOTION_MODELS.loaded()[name](**NOISE[name]) for name in ("cv", "ca"))
    filter = InteractingMultipleModel(tuple(map(ExtendedKalmanFilter, motions)), (2.0, 3.0), (0.3, 0.7))
    start = Gaussian(np.array([[30.0], [5.0], [8.0], [1.0]]), np.diag([0.3, 0.2, 1.0, 0.5])[..., None] ** 2)
    belief = filter.predict(filter.begin(lambda motion: motion.from_cartesian(start, InitialSigmas(4.0, 0.2))), 0.5)
    seen = traffic(vehicles(1), 1, detection=1.0, clutter=0.0).scans[0]
    places = np.array([[33.9, 34.6], [5.4, 5.9]])
    scan = seen._replace(
        kind="lidar",
        measurement=places[..., None],
        valid=np.ones((2, 1), dtype=bool),
        noise_covariance=LIDAR_NOISE,
        sensor_pose=np.zeros(3),
        sensor_velocity=np.zeros(2),
    )
    detections = run_detections(scan, as_listed=True)
    predicted, detection_probability, gate, density = filter.predict_measurement(belief, scan), 0.9, 0.999, 0.02
    expected = PredictedTracks(belief, predicted, np.ones(1, dtype=bool))
    tracks = TrackFilter(filter, InitialConfig())
    found, measured = np.array([0.9]), tracks.measured(detections.scan)
    at = AssociationInput(tracks, expected, detections, measured, np.zeros(1, int), found, gate, Intensity(density, 0))
    pairs = GatedPairs(np.zeros(2, int), np.arange(2), np.ones(2), np.zeros(2))
    pairs = with_mode_likelihoods(pairs, predicted, filter.measured(detections.scan), belief.probability)
    found = soft_association(at, pairs, None, density)
    weights, parts = [], []
    for number in (None, 0, 1):
        own = scan._replace(measurement=places[:, [number or 0]], valid=np.array([number is not None]))
        for j, mode in enumerate(belief.modes):
            update = filter.filters[j].update(mode, own)
            missed = 1 - detection_probability * gate
            hit = detection_probability / density * np.exp(update.log_likelihood[0])
            weights.append(belief.probability[j, 0] * (missed if number is None else hit))
            parts.append(motions[j].cartesian_belief(Gaussian(update.belief.mean, update.belief.covariance)))
    weights = np.array(weights) / np.sum(weights)
    mean = sum(w * part.mean[:, 0] for w, part in zip(weights, parts, strict=True))
    away = [part.mean[:, 0] - mean for part in parts]
    spread = sum(
        w * (part.covariance[..., 0] + np.outer(d, d)) for w, part, d in zip(weights, parts, away, strict=True)
    )
    np.testing.assert_allclose(found.belief.probability[:, 0], weights.reshape(3, 2).sum(axis=0), rtol=1e-12)
    mixture = filter.cartesian(found.belief)
    np.testing.assert_allclose(mixture.mean[:, 0], mean, rtol=1e-12)
    np.testing.assert_allclose(mixture.covariance[..., 0], spread, rtol=1e-10)
