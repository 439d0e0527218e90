"""A tracker as a node: the detections come with the sensor's odometry, whose twist is in the sensor's own frame."""

from collections import namedtuple

import numpy as np

Stamped = namedtuple("Stamped", "stamp pose covariance")
Odometry = namedtuple("Odometry", "position yaw twist")
Detection = namedtuple("Detection", "position covariance direction range_rate range_rate_variance azimuth_variance")


def rotation(yaw):
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def odometry_from(scan):
    yaw = float(scan.sensor_pose[2])
    twist = rotation(yaw).T @ np.asarray(scan.sensor_velocity)
    return Odometry(np.array(scan.sensor_pose[:2]), yaw, twist)


def detection_from(scan):
    """In the sensor's frame."""
    z, R = np.array(scan.measurement, dtype=float), np.asarray(scan.noise_covariance)
    if scan.kind != "radar":
        return Detection(z, R, None, None, None, None)
    c, s = np.cos(z[1]), np.sin(z[1])
    J = np.array([[c, -z[0] * s], [s, z[0] * c]])
    return Detection(z[0] * J[:, 0], J @ R[:2, :2] @ J.T, J[:, 0], z[2], R[2, 2], R[1, 1])


class ConstantVelocityModel:
    def __init__(self, std_acceleration=3.0):
        self.variance = std_acceleration**2

    def propagate(self, mean, covariance, dt):
        F = np.eye(4)
        F[:2, 2:] = dt * np.eye(2)
        G = np.concatenate([0.5 * dt**2 * np.eye(2), dt * np.eye(2)])
        return F @ mean, F @ covariance @ F.T + self.variance * G @ G.T


class ObjectTracker:
    def __init__(self, track=None):
        self.track = track
        self.model = ConstantVelocityModel()

    def initialise(self, stamp, detection, odometry):
        position, covariance = self.to_map(detection, odometry)
        P = np.zeros((4, 4))
        P[:2, :2] = covariance
        P[2:, 2:] = 20.0**2 * np.eye(2)
        self.track = Stamped(stamp, np.append(position, [0.0, 0.0]), P)

    def to_map(self, detection, odometry):
        turn = rotation(odometry.yaw)
        return odometry.position + turn @ detection.position, turn @ detection.covariance @ turn.T

    def predict_to(self, stamp):
        dt = stamp - self.track.stamp
        self.track = Stamped(stamp, *self.model.propagate(self.track.pose, self.track.covariance, dt))

    def correct(self, detection, odometry):
        position, covariance = self.to_map(detection, odometry)
        self.update(position, covariance, np.eye(2, 4))
        if detection.direction is not None:
            self.correct_speed(detection, odometry)

    def correct_speed(self, detection, odometry):
        """Of the speed over ground along the ray, which an error of the azimuth turns."""
        ground = detection.range_rate + detection.direction @ odometry.twist
        ray = rotation(odometry.yaw) @ detection.direction
        H = np.zeros((1, 4))
        H[0, 2:] = ray
        across = np.array([-ray[1], ray[0]])
        turned = across @ self.track.pose[2:] - across @ (rotation(odometry.yaw) @ odometry.twist)
        variance = detection.range_rate_variance + detection.azimuth_variance * min(turned**2, 900.0)
        self.update(np.array([ground]), np.array([[variance]]), H)

    def update(self, z, R, H):
        stamp, mean, P = self.track
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        rest = np.eye(4) - K @ H
        P = rest @ P @ rest.T + K @ R @ K.T
        self.track = Stamped(stamp, mean + K @ (z - H @ mean), 0.5 * (P + P.T))


class Tracker:
    def step(self, state, scan):
        node = ObjectTracker(state)
        odometry, stamp = odometry_from(scan), float(scan.time)
        if state is None:
            node.initialise(stamp, detection_from(scan), odometry)
            return node.track, (node.track.pose, node.track.covariance)
        if stamp >= state.stamp:
            node.predict_to(stamp)
        if scan.valid:
            node.correct(detection_from(scan), odometry)
        return node.track, (node.track.pose, node.track.covariance)
