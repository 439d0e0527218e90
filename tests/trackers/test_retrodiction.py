"""A late scan that corrects the present state without going back."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.late_scans import FIRST, WhiteAcceleration, lidar_scans, linear, swapped, taken
from tests.support.scenes import scan

from trackbench.base.types import Scan
from trackbench.filters import KalmanFilter
from trackbench.models.motion import MOTION_MODELS, MotionModel
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.initial import InitialConfig

MODELS = {"white": WhiteAcceleration(a=4, b=4, c=4, d=4), "cv": MOTION_MODELS["cv"](acceleration_sigma_mps2=3)}


def test_retrodiction_over_one_step_is_exact_for_a_linear_problem() -> None:
    """Algorithm A1, with process noise, scans late again and again."""
    scans = lidar_scans(14, batch=1)
    scans = [one._replace(valid=np.array([True]), measurement=np.nan_to_num(one.measurement, nan=42)) for one in scans]
    for late in ([5], [3, 6, 9], [2, 11]):
        one, other = taken(linear("replay"), scans), taken(linear("retrodiction"), swapped(scans, *late))
        for number in late:
            np.testing.assert_allclose(other[number + 1].mean, one[number + 1].mean, rtol=1e-10)
            np.testing.assert_allclose(other[number + 1].covariance, one[number + 1].covariance, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(other[-1].mean, one[-1].mean, rtol=1e-10)


def test_retrodiction_over_several_steps_is_nearly_exact() -> None:
    """Algorithm Al1: the measurements since count as one, with noise that is taken to be independent."""
    scans = lidar_scans(14, batch=1)
    scans = [one._replace(valid=np.array([True]), measurement=np.nan_to_num(one.measurement, nan=42)) for one in scans]
    late = [*scans[:4], *scans[5:9], scans[4]]
    exact, found, dropped = (taken(linear(method), late)[-1] for method in ("replay", "retrodiction", "drop"))
    np.testing.assert_allclose(found.covariance[..., 0], exact.covariance[..., 0], rtol=0.02, atol=1e-12)
    far, near = (np.abs(one.mean - exact.mean).max() for one in (dropped, found))
    assert near < 0.5 * far


def with_late_ones(model: MotionModel, latency: float, batch: int = 200) -> list[Scan]:
    """Coarse scans of the model's own motion, and fine ones of the same instants that come later, as they arrive."""
    random, period = np.random.default_rng(4), 0.05
    truth = np.array([40.0, 30.0, 12.0, -5.0])[:, None] + np.zeros((4, batch))
    arrived: list[tuple[float, Scan]] = []
    for k in range(60):
        time = period * k
        if k:
            gain = model.noise_gain(truth, period) * np.array(model.noise_sigma)
            noise = random.normal(size=(gain.shape[1], batch))
            truth = model.transition(truth, period) + gain @ noise
        for sigma, after in ((0.5, 0.0), (0.05, latency)):
            measurement = truth[:2] + sigma * random.normal(size=(2, batch))
            arrived.append((time + after, scan("lidar", time, measurement, noise=sigma**2 * np.eye(2))))
    return [one for _, one in sorted(arrived, key=lambda entry: entry[0])]


def of_model(model: MotionModel, late: str, lag: float = 1.0) -> FilterTracker:
    return FilterTracker(KalmanFilter(model), InitialConfig.model_validate(FIRST), late=late, lag_s=lag)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize(("latency", "share"), [(0.3, 0.02), (0.9, 0.15)])
def test_scans_that_are_all_late_by_several_steps_are_taken_in_nearly_exactly(
    model: MotionModel, latency: float, share: float
) -> None:
    """The difference from the exact estimate adds less than a share of its NEES of 4; the variances are within it."""
    scans = with_late_ones(model, latency)
    exact, found = (taken(of_model(model, late), scans)[-1] for late in ("replay", "retrodiction"))
    p = exact.covariance[..., 0]
    error = found.mean - exact.mean
    assert np.einsum("ib,ij,jb->b", error, np.linalg.inv(p), error).mean() < share * 4
    np.testing.assert_allclose(np.diag(found.covariance[..., 0]), np.diag(p), rtol=share)


def test_what_falls_out_of_the_lag_has_taken_its_late_scans_in() -> None:
    """The history begins among scans that came before a late one: as if it reached back to the start."""
    scans = with_late_ones(MODELS["white"], 0.3, batch=2)
    fine = [one for one in scans if one.noise_covariance[0, 0] < 0.1]
    silent = {id(one) for one in fine if 1.0 < one.time < 1.3}
    scans = [one for one in scans if id(one) not in silent]
    short, long = (taken(of_model(MODELS["white"], "retrodiction", lag), scans)[-1] for lag in (0.5, 60))
    np.testing.assert_allclose(short.mean, long.mean, rtol=1e-12)
    np.testing.assert_allclose(short.covariance, long.covariance, rtol=1e-12)
