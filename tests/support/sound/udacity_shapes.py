"""Trackers that keep their belief at an earlier time and predict on demand: where nothing was detected, the prediction
is given as the estimate and thrown away."""

from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag
from tests.support.sound.measured import (
    corrected,
    difference,
    driven,
    expected,
    jacobian,
    position,
    predicted,
    start,
    transition,
    turn,
    wrap,
)


class FusionEKF:
    """Belief, time and matrices on self, as in the course; changed at an update alone."""

    def __init__(self):
        self.is_initialized_ = False
        self.previous_timestamp_ = 0.0
        self.F_ = np.eye(4)
        self.noise_ax = self.noise_ay = 9.0

    def step(self, state, scan):
        if not self.is_initialized_:
            self.x_, self.P_ = start(scan)
            self.previous_timestamp_, self.is_initialized_ = scan.time, True
            return None, (self.x_.copy(), self.P_.copy())
        dt = scan.time - self.previous_timestamp_
        self.F_[0, 2] = self.F_[1, 3] = dt
        a, b, c = dt**4 / 4, dt**3 / 2, dt**2
        ax, ay = self.noise_ax, self.noise_ay
        Q = np.array([[a * ax, 0, b * ax, 0], [0, a * ay, 0, b * ay], [b * ax, 0, c * ax, 0], [0, b * ay, 0, c * ay]])
        x, P = self.F_ @ self.x_, self.F_ @ self.P_ @ self.F_.T + Q
        if not scan.valid:
            return None, (x, P)
        H = jacobian(x, scan)
        S = H @ P @ H.T + scan.noise_covariance
        K = P @ H.T @ np.linalg.inv(S)
        self.x_ = x + K @ difference(scan.measurement, expected(x, scan), scan)
        self.P_ = (np.eye(4) - K @ H) @ P
        self.P_ = (self.P_ + self.P_.T) / 2
        self.previous_timestamp_ = scan.time
        return None, (self.x_.copy(), self.P_.copy())


class LastUpdate:
    """The same belief in the returned state: a tuple that a miss hands back as it was."""

    def step(self, state, scan):
        if state is None:
            state = (scan.time, *start(scan))
            return state, state[1:]
        t, x, P = state
        estimate = predicted(x, P, scan.time - t, 2.6)
        if scan.valid:
            estimate = corrected(*estimate, scan)
            state = (scan.time, *estimate)
        return state, estimate


class LinearLastUpdate:
    """A linear filter of converted positions, two axes at once, that ignores the range rate."""

    H = np.eye(2, 4)

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return {"x": x, "P": P, "at": scan.time}, (x, P)
        F = transition(scan.time - state["at"])
        x = F @ state["x"]
        P = F @ state["P"] @ F.T + driven(scan.time - state["at"])
        if scan.valid:
            z, R = position(scan)
            S = P[:2, :2] + R
            K = P[:, :2] @ np.linalg.inv(S)
            x, P = x + K @ (z - x[:2]), P - K @ S @ K.T
            P = (P + P.T) / 2
            state = {"x": x, "P": P, "at": scan.time}
        return state, (x, P)


@dataclass(frozen=True)
class Belief:
    """A normal distribution at a time."""

    time: float
    mean: np.ndarray
    covariance: np.ndarray

    def at(self, time, sigma=3.0):
        """Return the belief at a later time."""
        return Belief(time, *predicted(self.mean, self.covariance, time - self.time, sigma))

    def seeing(self, scan):
        """Return the belief after a measurement taken at its time."""
        return Belief(self.time, *corrected(self.mean, self.covariance, scan))

    @property
    def moments(self):
        """Mean and covariance."""
        return self.mean, self.covariance


class PureBelief:
    """A frozen belief with `at` and `seeing`; asking it for a later time leaves it as it is."""

    def step(self, state, scan):
        if state is None:
            state = Belief(scan.time, *start(scan))
            return state, state.moments
        then = state.at(scan.time)
        if not scan.valid:
            return state, then.moments
        then = then.seeing(scan)
        return then, then.moments


def sigma_points(x, P, spread=3.0):
    """Return the 2n + 1 points of Julier and their weights; `spread` is n + kappa."""
    L = np.linalg.cholesky(spread * P)
    points = np.column_stack([x, x[:, None] + L, x[:, None] - L])
    weights = np.full(points.shape[1], 0.5 / spread)
    weights[0] = 1 - len(x) / spread
    return points, weights


def seen_by_points(points, weights, n, scan):
    """Return mean and covariance of the first n components after an update with points that were predicted."""
    X = points[:n]
    x = X @ weights
    Z = np.array([expected(point, scan) for point in X.T]).T
    from_first = np.array([difference(z, Z[:, 0], scan) for z in Z.T]).T
    z = Z[:, 0] + from_first @ weights
    dX, dZ = X - x[:, None], np.array([difference(each, z, scan) for each in Z.T]).T
    S = (weights * dZ) @ dZ.T + scan.noise_covariance
    K = np.linalg.solve(S, (weights * dZ) @ dX.T).T
    P = (weights * dX) @ dX.T - K @ S @ K.T
    return x + K @ difference(scan.measurement, z, scan), (P + P.T) / 2


class UkfLastUpdate:
    """An unscented filter of constant velocity with noise added after the transform."""

    def __init__(self):
        self.t = None

    def step(self, state, scan):
        if self.t is None:
            self.t, (self.x, self.P) = scan.time, start(scan)
            return None, (self.x, self.P)
        x, P = predicted(self.x, self.P, scan.time - self.t)
        if scan.valid:
            x, P = seen_by_points(*sigma_points(x, P, 4.0), 4, scan)
            self.t, self.x, self.P = scan.time, x, P
        return None, (x, P)


class UkfAugmented:
    """An unscented filter with the acceleration in an augmented state, as in the course."""

    std_a = 3.0

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        t, x, P = state
        dt = scan.time - t
        points, w = sigma_points(np.append(x, [0.0, 0.0]), block_diag(P, np.eye(2) * self.std_a**2), 6.0)
        X = points[:4].copy()
        X[:2] += dt * points[2:4] + dt**2 / 2 * points[4:]
        X[2:] += dt * points[4:]
        mean = X @ w
        cov = (w * (X - mean[:, None])) @ (X - mean[:, None]).T
        if not scan.valid:
            return state, (mean, cov + 1e-12 * np.eye(4))
        mean, cov = seen_by_points(X, w, 4, scan)
        return (scan.time, mean, cov), (mean, cov)


def turned(x, dt):
    """Return the state px, py, vx, vy, w after a turn at constant rate w, and its derivative by the state."""
    px, py, vx, vy, w = x
    a = w * dt
    s, c = np.sin(a), np.cos(a)
    if abs(a) < 1e-4:
        S, C, dS, dC = dt, a * dt / 2, -(dt**2) * a / 3, dt**2 / 2
    else:
        S, C = s / w, (1 - c) / w
        dS, dC = (dt * c - S) / w, (dt * s - C) / w
    F = np.array(
        [
            [1, 0, S, -C, vx * dS - vy * dC],
            [0, 1, C, S, vx * dC + vy * dS],
            [0, 0, c, -s, -dt * (s * vx + c * vy)],
            [0, 0, s, c, dt * (c * vx - s * vy)],
            [0, 0, 0, 0, 1.0],
        ]
    )
    return np.array([px + S * vx - C * vy, py + C * vx + S * vy, c * vx - s * vy, s * vx + c * vy, w]), F


class TurnLastUpdate:
    """An EKF of a coordinated turn in Cartesian velocity."""

    def __init__(self, sigma=2.5, turn_sigma=0.3):
        self.sigma, self.turn_sigma = sigma, turn_sigma

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, np.append(x, 0.0), block_diag(P, 0.01)), (x, P)
        t, x, P = state
        dt = scan.time - t
        x, F = turned(x, dt)
        P = F @ P @ F.T + block_diag(driven(dt, self.sigma), (self.turn_sigma * dt) ** 2)
        if scan.valid:
            x, P = corrected(x, P, scan)
            state = (scan.time, x, P)
        return state, (x[:4], P[:4, :4])


def ctrv(x, dt):
    """Return px, py, speed, course, turn rate after a step of constant turn rate and velocity."""
    px, py, v, course, rate = x
    later = course + rate * dt
    if abs(rate) < 1e-4:
        return np.array([px + v * dt * np.cos(course), py + v * dt * np.sin(course), v, later, rate])
    dx, dy = np.sin(later) - np.sin(course), np.cos(course) - np.cos(later)
    return np.array([px + v / rate * dx, py + v / rate * dy, v, later, rate])


def ctrv_noise(x, dt, sigma_a=3.0, sigma_turn=0.6):
    """Return the process noise of constant accelerations along the course and of the turn."""
    c, s = np.cos(x[3]), np.sin(x[3])
    G = np.array([[dt**2 / 2 * c, 0], [dt**2 / 2 * s, 0], [dt, 0], [0, dt**2 / 2], [0, dt]])
    return G @ np.diag([sigma_a**2, sigma_turn**2]) @ G.T + 1e-9 * np.eye(5)


def to_cartesian(x, P):
    """Return px, py, vx, vy of a CTRV state, with its covariance to first order."""
    c, s, v = np.cos(x[3]), np.sin(x[3]), x[2]
    J = np.array([[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, c, -v * s, 0], [0, 0, s, v * c, 0]])
    return np.array([x[0], x[1], v * c, v * s]), J @ P @ J.T, J


def to_ctrv(x, P):
    """Return the CTRV state of a belief in px, py, vx, vy whose course is known well enough."""
    v = np.hypot(x[2], x[3])
    c, s = x[2] / v, x[3] / v
    J = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s], [0, 0, -s / v, c / v]])
    return np.array([x[0], x[1], v, np.arctan2(s, c), 0.0]), block_diag(J @ P @ J.T, 0.1)


class CtrvEkf:
    """An EKF of CTRV with a numerical derivative; it starts in Cartesian velocity, until the course is known."""

    def _derivative(self, x, dt):
        h = 1e-5
        return np.column_stack([(ctrv(x + h * e, dt) - ctrv(x - h * e, dt)) / (2 * h) for e in np.eye(5)])

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        t, x, P = state
        dt = scan.time - t
        if len(x) == 4:
            x, P = predicted(x, P, dt)
            if scan.valid:
                x, P = corrected(x, P, scan)
                surely = np.hypot(x[2], x[3]) > 8 * np.sqrt(max(P[2, 2], P[3, 3]))
                state = (scan.time, *(to_ctrv(x, P) if surely else (x, P)))
            return state, (x, P)
        A = self._derivative(x, dt)
        x, P = ctrv(x, dt), A @ P @ A.T + ctrv_noise(x, dt)
        if scan.valid:
            flat, _, J = to_cartesian(x, P)
            H = jacobian(flat, scan) @ J
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + scan.noise_covariance)
            x = x + K @ difference(scan.measurement, expected(flat, scan), scan)
            I_KH = np.eye(5) - K @ H
            P = I_KH @ P @ I_KH.T + K @ scan.noise_covariance @ K.T
            state = (scan.time, x, P)
        return state, to_cartesian(x, P)[:2]


class CtrvUkf:
    """The same by sigma points over seven dimensions, as in the course; on self."""

    def __init__(self):
        self.time_us_ = self.x_ = None

    def step(self, state, scan):
        if self.x_ is None:
            self.x_, self.P_ = start(scan)
            self.time_us_ = scan.time
            return None, (self.x_, self.P_)
        dt = scan.time - self.time_us_
        if len(self.x_) == 4:
            x, P = predicted(self.x_, self.P_, dt)
            if scan.valid:
                x, P = corrected(x, P, scan)
                known = np.hypot(x[2], x[3]) > 8 * np.sqrt(max(P[2, 2], P[3, 3]))
                self.time_us_, (self.x_, self.P_) = scan.time, to_ctrv(x, P) if known else (x, P)
            return None, (x, P)
        P_aug = block_diag(self.P_, 3.0**2, 0.6**2)
        points, w = sigma_points(np.append(self.x_, [0, 0]), P_aug, 7.0)
        X = np.array([ctrv(p[:5], dt) for p in points.T]).T
        (a, b), course = points[5:], points[3]
        X += np.array([dt**2 / 2 * np.cos(course) * a, dt**2 / 2 * np.sin(course) * a, dt * a, dt**2 / 2 * b, dt * b])
        x = X @ w
        P = (w * (X - x[:, None])) @ (X - x[:, None]).T + 1e-9 * np.eye(5)
        flat = np.array([X[0], X[1], X[2] * np.cos(X[3]), X[2] * np.sin(X[3])])
        if scan.valid:
            zs = np.array([expected(p, scan) for p in flat.T])
            dz = np.array([difference(z, zs[0], scan) for z in zs]).T
            shift = dz @ w
            dz = dz - shift[:, None]
            S = (w * dz) @ dz.T + scan.noise_covariance
            K = ((w * (X - x[:, None])) @ dz.T) @ np.linalg.inv(S)
            x = x + K @ difference(scan.measurement, zs[0] + shift, scan)
            P = P - K @ S @ K.T
            x[3] = wrap(x[3])
            self.time_us_, self.x_, self.P_ = scan.time, x, (P + P.T) / 2
        return None, to_cartesian(x, P)[:2]


class Pending(NamedTuple):
    """A belief at an earlier time and the scan that was seen after it."""

    time: float
    x: Any
    P: Any
    scan: Any = None


class LazyByOne:
    """The belief before the last measurement and that measurement, which is worked in anew at each scan."""

    def step(self, state, scan):
        if state is None:
            state = Pending(scan.time, *start(scan))
            return state, (state.x, state.P)
        t, x, P, waiting = state
        if waiting is not None:
            x, P = corrected(*predicted(x, P, waiting.time - t), waiting)
            t = waiting.time
        now = predicted(x, P, scan.time - t)
        if not scan.valid:
            return state, now
        return Pending(t, x, P, scan), corrected(*now, scan)


class Substeps:
    """The prediction from the last update goes in steps of at most 40 ms, each with noise of its own."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return [scan.time, x, P], (x, P)
        last, x, P = state
        span = scan.time - last
        parts = max(int(np.ceil(span / 0.04)), 1)
        for _ in range(parts):
            x, P = predicted(x, P, span / parts, 3.5)
        if scan.valid:
            x, P = corrected(x, P, scan)
            state = [scan.time, x, P]
        return state, (x, P)


@dataclass
class Anchor:
    """A belief that moves on every half second, and the scans since."""

    time: float
    x: np.ndarray
    P: np.ndarray
    since: deque = field(default_factory=deque)


class HalfSecondAnchor:
    """An anchor, from which all measurements since are worked in again at each scan."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return Anchor(scan.time, x, P), (x, P)
        since = deque(state.since)
        if scan.valid:
            since.append(scan)
        time, x, P = state.time, state.x, state.P
        while since and since[0].time < scan.time - 0.5:
            first = since.popleft()
            x, P = corrected(*predicted(x, P, first.time - time), first)
            time = first.time
        kept = Anchor(time, x, P, since)
        for each in since:
            x, P = corrected(*predicted(x, P, each.time - time), each)
            time = each.time
        return kept, predicted(x, P, scan.time - time)


class InformationLastUpdate:
    """Information matrix and vector at the last update."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            Y = np.linalg.inv(P)
            return (scan.time, Y @ x, Y), (x, P)
        last, y, Y = state
        P = np.linalg.inv(Y)
        x, P = predicted(P @ y, P, scan.time - last)
        if scan.valid:
            H, W = jacobian(x, scan), np.linalg.inv(scan.noise_covariance)
            Y = np.linalg.inv(P) + H.T @ W @ H
            P = np.linalg.inv(Y)
            x = x + P @ H.T @ W @ difference(scan.measurement, expected(x, scan), scan)
            state = (scan.time, Y @ x, Y)
        return state, (x, (P + P.T) / 2)


class RadarBetweenLidars:
    """The belief is kept at the last lidar update; radar scans since then are listed and worked in on demand."""

    def __init__(self):
        self.time, self.radar = None, []

    def step(self, state, scan):
        if self.time is None:
            self.time, (self.x, self.P) = scan.time, start(scan)
            return None, (self.x, self.P)
        if scan.valid and scan.kind == "radar":
            self.radar.append(scan)
        t, x, P = self.time, self.x, self.P
        for old in self.radar:
            x, P = corrected(*predicted(x, P, old.time - t), old)
            t = old.time
        x, P = predicted(x, P, scan.time - t)
        if scan.valid and scan.kind != "radar":
            self.x, self.P = corrected(x, P, scan)
            self.time, self.radar, x, P = scan.time, [], self.x, self.P
        elif len(self.radar) > 40:
            self.time, self.x, self.P, self.radar = scan.time, x, P, []
        return None, (x, P)


class SeenInSensorFrame:
    """A filter of converted positions that turns its own state into the sensor's axes for the update."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (x, P, scan.time), (x, P)
        x, P, last = state
        x, P = predicted(x, P, scan.time - last, 3.2)
        if not scan.valid:
            return state, (x, P)
        yaw, mount = scan.sensor_pose[2], np.concatenate([scan.sensor_pose[:2], scan.sensor_velocity])
        T = block_diag(turn(yaw), turn(yaw))
        local = scan._replace(sensor_pose=np.zeros(3), sensor_velocity=np.zeros(2))
        x, P = corrected(T.T @ (x - mount), T.T @ P @ T, local)
        x, P = T @ x + mount, T @ P @ T.T
        return (x, P, scan.time), (x, (P + P.T) / 2)
