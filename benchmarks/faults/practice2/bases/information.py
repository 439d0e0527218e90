"""An extended information filter: what the sensors say is added up; state of a target in a named tuple."""

from collections import namedtuple

import numpy as np

Target = namedtuple("Target", "stamp mean info")


def heading_matrix(yaw):
    return np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])


class Motion:
    """Constant velocity with random accelerations."""

    def __init__(self, accel_std):
        self.accel_std = accel_std

    def add_noise(self, P, dt):
        half = 0.5 * dt * dt
        G = np.vstack([half * np.eye(2), dt * np.eye(2)])
        P += self.accel_std**2 * G @ G.T

    def propagate(self, target, stamp):
        dt = stamp - target.stamp
        F = np.eye(4) + dt * np.eye(4, k=2)
        P = F @ np.linalg.inv(target.info) @ F.T
        self.add_noise(P, dt)
        return Target(stamp, F @ target.mean, np.linalg.inv(P))


class Radar:
    def weights(self, scan):
        """The inverse of the covariance of the noise."""
        var_range, var_azimuth, var_rate = np.diag(scan.noise_covariance)
        return np.diag([1.0 / var_range, 1.0 / var_azimuth, 1.0 / var_rate])

    def innovation(self, scan, mean):
        rel = mean[:2] - scan.sensor_pose[:2]
        vel = mean[2:] - scan.sensor_velocity
        rho = np.linalg.norm(rel)
        los = rel / rho
        across = np.array([-los[1], los[0]])
        rate = los @ vel
        y = scan.measurement - np.array([rho, np.arctan2(rel[1], rel[0]) - scan.sensor_pose[2], rate])
        y[1] = np.angle(np.exp(1j * y[1]))
        H = np.zeros((3, 4))
        H[0, :2] = los
        H[1, :2] = across / rho
        H[2, :2] = across * (across @ vel) / rho
        H[2, 2:] = los
        return y, H

    def first(self, scan):
        rho, azimuth = scan.measurement[:2]
        M = heading_matrix(scan.sensor_pose[2] + azimuth).T
        spread = M @ np.diag([1.0, rho])
        return scan.sensor_pose[:2] + M[:, 0] * rho, spread @ scan.noise_covariance[:2, :2] @ spread.T


class Lidar:
    def weights(self, scan):
        var_x, var_y = np.diag(scan.noise_covariance)
        return np.diag([1.0 / var_x, 1.0 / var_y])

    def innovation(self, scan, mean):
        M = heading_matrix(scan.sensor_pose[2])
        H = np.hstack([M, np.zeros((2, 2))])
        return scan.measurement - M @ (mean[:2] - scan.sensor_pose[:2]), H

    def first(self, scan):
        M = heading_matrix(scan.sensor_pose[2]).T
        return scan.sensor_pose[:2] + M @ scan.measurement, M @ scan.noise_covariance @ M.T


SENSORS = {"radar": Radar(), "lidar": Lidar()}


class Tracker:
    def __init__(self, accel_std=3.0, speed_std=15.0):
        self.motion = Motion(accel_std)
        self.speed_std = speed_std

    def step(self, state, scan):
        sensor = SENSORS[scan.kind]
        if state is None:
            place, R = sensor.first(scan)
            info = np.zeros((4, 4))
            info[:2, :2] = np.linalg.inv(R)
            info[2:, 2:] = np.eye(2) / self.speed_std**2
            target = Target(scan.time, np.append(place, [0.0, 0.0]), info)
        else:
            target = self.motion.propagate(state, scan.time)
            if scan.valid:
                target = self.fuse(target, scan, sensor)
        P = np.linalg.inv(target.info)
        return target, (target.mean, (P + P.T) / 2)

    def fuse(self, target, scan, sensor):
        y, H = sensor.innovation(scan, target.mean)
        W = sensor.weights(scan)
        info = target.info + H.T @ W @ H
        mean = target.mean + np.linalg.solve(info, H.T @ W @ y)
        return target._replace(mean=mean, info=info)
