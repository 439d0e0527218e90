"""FilterPy's EKF and UKF as trackers: the filter object keeps the estimate, and ``state`` is only a token."""

from __future__ import annotations

from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from .plain import Array, Belief, Track, symmetric, wrap
from .plain_ekf import PlainEkf
from .plain_ukf import SIZE, PlainUkf


class Held:
    """Keeps the track in the instance."""

    track: Track | None = None

    def step(self, state: Any, scan: Any) -> tuple[float, Belief | None]:
        self.track, answer = super().step(self.track, scan)
        return scan.time, answer


class FilterPyEkf(Held, PlainEkf):
    """Constant velocity."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.kalman = ExtendedKalmanFilter(dim_x=4, dim_z=3)

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        kalman = self.kalman
        kalman.x, kalman.P = x, P
        kalman.F, kalman.Q = self.transition_jacobian(dt), self.process_noise(x, dt)
        kalman.predict()
        return kalman.x, symmetric(kalman.P)

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        kalman = self.kalman
        kalman.x, kalman.P = x, P
        kalman.update(
            scan.measurement,
            HJacobian=self.sensor_jacobian,
            Hx=self.predicted_measurement,
            R=self.noise(scan),
            args=(scan,),
            hx_args=(scan,),
            residual=lambda _, predicted: self.innovation(scan, predicted),
        )
        return kalman.x, symmetric(kalman.P)


class FilterPyUkf(Held, PlainUkf):
    """Constant turn rate and velocity."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        points = MerweScaledSigmaPoints(
            SIZE, alpha=np.sqrt(self.spread / SIZE), beta=2.0, kappa=0.0, sqrt_method=self.factor
        )
        self.kalman = UnscentedKalmanFilter(
            dim_x=SIZE,
            dim_z=3,
            dt=0.0,
            hx=self.predicted_measurement,
            fx=self.transition,
            points=points,
            x_mean_fn=self.state_mean,
            residual_x=self.state_residual,
        )
        self.kalman.Wm, self.kalman.Wc = self.mean_weights, self.covariance_weights

    def state_residual(self, a: Array, b: Array) -> Array:
        return self.state_spread(a[None], b)[0]

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        kalman = self.kalman
        kalman.x, kalman.P, kalman.Q = x, P, self.process_noise(x, dt)
        kalman.predict(dt)
        return kalman.x, symmetric(kalman.P)

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        kalman = self.kalman
        kalman.x, kalman.P, kalman.sigmas_f = x, P, self.points_for_update(x, P)
        kalman.residual_z = lambda a, b: self.residual(scan.kind, a, b)
        kalman.z_mean = lambda points, weights: self.measurement_mean(scan.kind, points, weights)
        kalman.update(
            scan.measurement,
            R=self.added_noise(scan),
            hx=lambda point: self.predicted_measurement(self.cartesian(point), scan),
        )
        mean = kalman.x.copy()
        mean[3] = wrap(mean[3])
        return mean, symmetric(kalman.P)
