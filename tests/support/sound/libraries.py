"""Filters of FilterPy, with a thin frame around them."""

import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from tests.support.sound.measured import difference, driven, expected, jacobian, position, start, transition


class FilterPyKf:
    """A linear filter of converted positions that lives on self."""

    def __init__(self):
        self.kf, self.t = KalmanFilter(dim_x=4, dim_z=2), None
        self.kf.H = np.eye(2, 4)

    def step(self, state, scan):
        kf = self.kf
        if self.t is None:
            mean, kf.P = start(scan)
            kf.x = mean[:, None]
        else:
            dt = scan.time - self.t
            Q = Q_discrete_white_noise(2, dt, 9.0, block_size=2, order_by_dim=False)
            kf.predict(F=transition(dt), Q=Q)
            if scan.valid:
                z, R = position(scan)
                kf.update(z[:, None], R=R)
        self.t = scan.time
        return None, (kf.x[:, 0].copy(), (kf.P + kf.P.T) / 2)


class FilterPyEkf:
    """An extended filter made anew at each scan from the returned state."""

    def step(self, state, scan):
        ekf = ExtendedKalmanFilter(dim_x=4, dim_z=len(scan.noise_covariance))
        if state is None:
            ekf.x, ekf.P = start(scan)
        else:
            before, ekf.x, ekf.P = state
            ekf.F, ekf.Q = transition(scan.time - before), driven(scan.time - before, 2.8)
            ekf.predict()
            if scan.valid:
                residual = lambda a, b: difference(a, b, scan)  # noqa: E731
                arguments = {"args": (scan,), "hx_args": (scan,), "residual": residual}
                ekf.update(scan.measurement, jacobian, expected, scan.noise_covariance, **arguments)
        return (scan.time, ekf.x, ekf.P), (ekf.x, (ekf.P + ekf.P.T) / 2)


class FilterPyUkf:
    """An unscented filter whose points are drawn again after the process noise was added."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        points = MerweScaledSigmaPoints(4, alpha=0.3, beta=2.0, kappa=0.0)
        dt = scan.time - state[0]
        ukf = UnscentedKalmanFilter(4, len(scan.noise_covariance), dt, None, lambda x, dt: transition(dt) @ x, points)
        ukf.x, ukf.P, ukf.Q, ukf.R = state[1], state[2] + 1e-9 * np.eye(4), driven(dt), scan.noise_covariance
        ukf.predict()
        if scan.valid:
            ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
            centre = expected(ukf.x, scan)
            ukf.hx = lambda x: difference(expected(x, scan), centre, scan)
            ukf.update(difference(scan.measurement, centre, scan))
        P = (ukf.P + ukf.P.T) / 2
        return (scan.time, ukf.x, P), (ukf.x, P)
