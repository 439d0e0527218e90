"""After sketches for microcontrollers: two filters of one axis each, every covariance a scalar of its own, no matrices.

The noise of a position is turned to the axes; what couples them is left out, and the larger one is taken for both.
"""

import copy
import math

import numpy as np


class KalmanFilter:
    """Position z, velocity v and acceleration a along one axis."""

    def Configure(self, zVariance, aVariance, zInitial, vVariance):
        self.jerkVariance_ = aVariance
        self.z_, self.v_, self.a_ = zInitial, 0.0, 0.0
        self.Pzz_, self.Pzv_, self.Pza_ = zVariance, 0.0, 0.0
        self.Pvz_, self.Pvv_, self.Pva_ = 0.0, vVariance, 0.0
        self.Paz_, self.Pav_, self.Paa_ = 0.0, 0.0, 4.0

    def Predict(self, dt):
        half = dt * dt / 2
        self.z_ += self.v_ * dt + self.a_ * half
        self.v_ += self.a_ * dt
        t00 = self.Pzz_ + dt * self.Pvz_ + half * self.Paz_
        t01 = self.Pzv_ + dt * self.Pvv_ + half * self.Pav_
        t02 = self.Pza_ + dt * self.Pva_ + half * self.Paa_
        t10 = self.Pvz_ + dt * self.Paz_
        t11 = self.Pvv_ + dt * self.Pav_
        t12 = self.Pva_ + dt * self.Paa_
        t20, t21, t22 = self.Paz_, self.Pav_, self.Paa_
        self.Pzz_ = t00 + dt * t01 + half * t02
        self.Pzv_ = t01 + dt * t02
        self.Pza_ = t02
        self.Pvz_ = t10 + dt * t11 + half * t12
        self.Pvv_ = t11 + dt * t12
        self.Pva_ = t12
        self.Paz_ = t20 + dt * t21 + half * t22
        self.Pav_ = t21 + dt * t22
        self.Paa_ = t22
        jerk, dt2, dt3 = self.jerkVariance_ * dt, dt * dt, dt * dt * dt
        self.Pzz_ += dt2 * dt2 / 20 * jerk
        self.Pzv_ += dt3 / 8 * jerk
        self.Pvz_ += dt3 / 8 * jerk
        self.Pza_ += dt2 / 6 * jerk
        self.Paz_ += dt2 / 6 * jerk
        self.Pvv_ += dt2 / 3 * jerk
        self.Pva_ += dt / 2 * jerk
        self.Pav_ += dt / 2 * jerk
        self.Paa_ += jerk

    def Update(self, z, zVariance):
        innov = z - self.z_
        sInv = 1.0 / (self.Pzz_ + zVariance)
        kz = self.Pzz_ * sInv
        kv = self.Pvz_ * sInv
        ka = self.Paz_ * sInv
        self.z_ += kz * innov
        self.v_ += kv * innov
        self.a_ += ka * innov
        self.Paz_ -= ka * self.Pzz_
        self.Pav_ -= ka * self.Pzv_
        self.Paa_ -= ka * self.Pza_
        self.Pvz_ -= kv * self.Pzz_
        self.Pvv_ -= kv * self.Pzv_
        self.Pva_ -= kv * self.Pza_
        self.Pzz_ -= kz * self.Pzz_
        self.Pzv_ -= kz * self.Pzv_
        self.Pza_ -= kz * self.Pza_


class Tracker:
    def step(self, state, scan):
        if state is None:
            position, variance = self.position(scan)
            kfx, kfy = KalmanFilter(), KalmanFilter()
            kfx.Configure(variance, 6.0, position[0], 400.0)
            kfy.Configure(variance, 6.0, position[1], 400.0)
        else:
            time, kfx, kfy = copy.deepcopy(state)
            kfx.Predict(scan.time - time)
            kfy.Predict(scan.time - time)
            if scan.valid:
                position, variance = self.position(scan)
                kfx.Update(position[0], variance)
                kfy.Update(position[1], variance)
        P = np.zeros((4, 4))
        for i, kf in enumerate((kfx, kfy)):
            P[np.ix_([i, i + 2], [i, i + 2])] = [[kf.Pzz_, kf.Pzv_], [kf.Pvz_, kf.Pvv_]]
        return (scan.time, kfx, kfy), (np.array([kfx.z_, kfy.z_, kfx.v_, kfy.v_]), P)

    def position(self, scan):
        x, y, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, azimuth = scan.measurement[0], yaw + scan.measurement[1]
            along, across = scan.noise_covariance[0, 0], r * r * scan.noise_covariance[1, 1]
            return (x + r * math.cos(azimuth), y + r * math.sin(azimuth)), max(along, across)
        forward, left = scan.measurement
        return (
            (
                x + forward * math.cos(yaw) - left * math.sin(yaw),
                y + forward * math.sin(yaw) + left * math.cos(yaw),
            ),
            max(scan.noise_covariance[0, 0], scan.noise_covariance[1, 1]),
        )
