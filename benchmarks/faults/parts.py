"""What the sound programs share: geometry of the sensors, motion, update, and a filter of one object.

The state is px, py, vx, vy in the fixed frame, where nothing else is said. The bases take nothing from here: a fault
replaces text of a base, and the lines that it changes must stand in the file of the base.
"""

import numpy as np


def wrapped(angle):
    """Between -pi and pi."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def position(scan, detection=None):
    """The measured position in the fixed frame and its covariance; of several detections, that of the given one."""
    measured = scan.measurement if detection is None else detection
    x, y, yaw = scan.sensor_pose
    radar = scan.kind == "radar"
    r, angle = (measured[0], yaw + measured[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    local = np.array([r, 0.0]) if radar else measured
    return np.array([x, y]) + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T


def linear(scan, detection=None):
    """z, H and R in the fixed frame: the position, and of a radar the speed over ground along the ray."""
    measured = scan.measurement if detection is None else detection
    z, R = position(scan, measured)
    if scan.kind != "radar":
        return z, np.eye(2, 4), R
    angle = scan.sensor_pose[2] + measured[1]
    c, s = np.cos(angle), np.sin(angle)
    speed = measured[2] + np.array([c, s]) @ scan.sensor_velocity
    R = np.pad(R, (0, 1))
    R[2, 2] = scan.noise_covariance[2, 2] + 0.15**2  # the ray is that of the measured azimuth
    return np.append(z, speed), along(c, s), R


def linear_at(scan, velocity):
    """z, H and R as those of :func:`linear`, for an object with about this velocity.

    An error of the azimuth turns the ray, and so changes the speed along it.
    """
    z, R = position(scan)
    if scan.kind != "radar":
        return z, np.eye(2, 4), R
    r, angle = scan.measurement[0], scan.sensor_pose[2] + scan.measurement[1]
    c, s = np.cos(angle), np.sin(angle)
    across = s * (velocity[0] - scan.sensor_velocity[0]) - c * (velocity[1] - scan.sensor_velocity[1])
    J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, across, 1.0]])
    speed = scan.measurement[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
    return np.append(z, speed), along(c, s), J @ scan.noise_covariance @ J.T


def along(c, s):
    """H of the position, and of the speed along a ray with this cosine and sine."""
    return np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])


def expected(x, scan):
    """What the sensor would measure of the state, and its derivative."""
    dx, dy = x[:2] - scan.sensor_pose[:2]
    yaw = scan.sensor_pose[2]
    if scan.kind != "radar":
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        return turn @ np.array([dx, dy]), np.hstack([turn, np.zeros((2, 2))])
    ux, uy = x[2:4] - scan.sensor_velocity
    r = np.hypot(dx, dy)
    swing = (ux * dy - uy * dx) / r**3
    H = [[dx / r, dy / r, 0, 0], [-dy / r**2, dx / r**2, 0, 0], [dy * swing, -dx * swing, dx / r, dy / r]]
    return np.array([r, np.arctan2(dy, dx) - yaw, (dx * ux + dy * uy) / r]), np.array(H)


def difference(z, other, scan):
    """Of two measurements of the scan's sensor."""
    gap = z - other
    if scan.kind == "radar":
        gap[1] = wrapped(gap[1])
    return gap


def in_view(x, scan):
    """Whether the sensor could see an object of this state."""
    dx, dy = x[:2] - scan.sensor_pose[:2]
    off = wrapped(np.arctan2(dy, dx) - scan.sensor_pose[2])
    return bool(np.hypot(dx, dy) < scan.field_of_view.max_range and abs(off) < scan.field_of_view.half_angle)


def first(scan):
    """State and covariance after the first measurement: the velocity is unknown."""
    z, R = position(scan)
    P = np.diag([0.0, 0.0, 400.0, 400.0])
    P[:2, :2] = R
    return np.array([*z, 0.0, 0.0]), P


def transition(dt):
    """Of a constant velocity."""
    return np.eye(4) + dt * np.eye(4, k=2)


def push(dt):
    """What a constant acceleration adds to the state, per m/s^2."""
    return np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])


def constant_velocity(dt, sigma=3.0):
    """Transition and process noise; sigma is that of the acceleration, m/s^2."""
    G = sigma * push(dt)
    return transition(dt), G @ G.T


def moved(x, P, dt, sigma=3.0):
    """State and covariance at the end of an interval."""
    F, Q = constant_velocity(dt, sigma)
    return F @ x, F @ P @ F.T + Q


def with_gain(x, P, K, y, H, R):
    """State and covariance after an update with any gain K and the innovation y: Joseph's form."""
    A = np.eye(len(x)) - K @ H
    return x + K @ y, A @ P @ A.T + K @ R @ K.T


def updated(x, P, z, H, R):
    """State and covariance after an update with Kalman's gain."""
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    return with_gain(x, P, K, z - H @ x, H, R)


class Filter:
    """A Kalman filter of one object, which updates with positions alone.

    A program replaces the methods of what it does otherwise.
    """

    def step(self, state, scan):
        if state is None:
            x, P = self.started(scan)
        else:
            time, x, P = state
            x, P = self.predicted(x, P, scan.time - time)
            if scan.valid:
                x, P = self.corrected(x, P, scan)
        return (scan.time, x, P), self.output(x, P)

    def started(self, scan):
        return first(scan)

    def predicted(self, x, P, dt):
        return moved(x, P, dt)

    def corrected(self, x, P, scan):
        z, R = position(scan)
        return updated(x, P, z, np.eye(2, len(x)), R)

    def output(self, x, P):
        return x, P
