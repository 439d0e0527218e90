"""A filter object of a commercial toolbox, carried over: x; vx; y; vy, azimuth in degrees and first, structs."""

import numpy as np


class struct(dict):
    __getattr__ = dict.__getitem__


def wrapTo180(angle):
    return (angle + 180.0) % 360.0 - 180.0


def constvel(state, dt):
    return constveljac(dt) @ state


def constveljac(dt):
    return np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]])


def axesOf(parameters):
    c, s = np.cos(np.deg2rad(parameters.Yaw)), np.sin(np.deg2rad(parameters.Yaw))
    return np.array([[c, s], [-s, c]])


def cvmeas(state, parameters):
    """Spherical: azimuth in degrees, range, range rate. Rectangular: x, y."""
    axes = axesOf(parameters)
    p = axes @ (state[[0, 2]] - parameters.OriginPosition)
    if parameters.Frame == "rectangular":
        return p
    v = axes @ (state[[1, 3]] - parameters.OriginVelocity)
    r = max(np.hypot(p[0], p[1]), 0.1)
    return np.array([np.rad2deg(np.arctan2(p[1], p[0])), r, p @ v / r])


def cvmeasjac(state, parameters):
    axes = axesOf(parameters)
    p = axes @ (state[[0, 2]] - parameters.OriginPosition)
    if parameters.Frame == "rectangular":
        jac = np.zeros((2, 4))
        jac[:, [0, 2]] = axes
        return jac
    v = axes @ (state[[1, 3]] - parameters.OriginVelocity)
    r = max(np.hypot(p[0], p[1]), 0.1)
    rate = p @ v / r
    jac = np.zeros((3, 4))
    jac[0, [0, 2]] = np.rad2deg(np.array([-p[1], p[0]]) / r**2) @ axes
    jac[1, [0, 2]] = p / r @ axes
    jac[2, [0, 2]] = (v / r - rate * p / r**2) @ axes
    jac[2, [1, 3]] = p / r @ axes
    return jac


class trackingEKF:
    def __init__(self, State, StateCovariance, AccelerationVariance=9.0, MaxNumIterations=3):
        self.State = State
        self.StateCovariance = StateCovariance
        self.AccelerationVariance = AccelerationVariance
        self.MaxNumIterations = MaxNumIterations

    def predict(self, dt):
        F = constveljac(dt)
        G = np.kron(np.eye(2), [[dt**2 / 2], [dt]])
        self.State = constvel(self.State, dt)
        self.StateCovariance = F @ self.StateCovariance @ F.T + self.AccelerationVariance * G @ G.T

    def residual(self, z, parameters):
        zEstimated = cvmeas(self.State, parameters)
        res = z - zEstimated
        if parameters.Frame == "spherical":
            res[0] = wrapTo180(z[0] - zEstimated[0])
        return res

    def correct(self, z, parameters):
        prior, P = self.State, self.StateCovariance
        for _ in range(self.MaxNumIterations):
            H = cvmeasjac(self.State, parameters)
            S = H @ P @ H.T + parameters.MeasurementNoise
            K = P @ H.T @ np.linalg.inv(S)
            self.State = prior + K @ (self.residual(z, parameters) - H @ (prior - self.State))
        P = P - K @ S @ K.T
        self.StateCovariance = (P + P.T) / 2


def objectDetection(scan):
    z, noise = np.array(scan.measurement, dtype=float), np.array(scan.noise_covariance, dtype=float)
    parameters = struct(
        Frame="rectangular",
        OriginPosition=np.array(scan.sensor_pose[:2]),
        OriginVelocity=np.array(scan.sensor_velocity),
        Yaw=np.rad2deg(scan.sensor_pose[2]),
        MeasurementNoise=noise,
    )
    if scan.kind == "radar":
        order = [1, 0, 2]
        scale = np.array([np.rad2deg(1.0), 1.0, 1.0])
        z = wrapTo180(np.rad2deg(z[1])), z[0], z[2]
        noise = noise[np.ix_(order, order)] * np.outer(scale, scale)
        parameters.update(Frame="spherical", MeasurementNoise=noise)
    return struct(Time=float(scan.time), Measurement=np.array(z), MeasurementParameters=parameters)


def initcvekf(detection):
    z, parameters = detection.Measurement, detection.MeasurementParameters
    noise, axes = parameters.MeasurementNoise, axesOf(parameters)
    if parameters.Frame == "spherical":
        az = np.deg2rad(z[0])
        u, w = np.array([np.cos(az), np.sin(az)]), np.array([-np.sin(az), np.cos(az)])
        J = np.column_stack([np.deg2rad(z[1] * w), u])
        z, noise = z[1] * u, J @ noise[:2, :2] @ J.T
    position = parameters.OriginPosition + axes.T @ z
    P = np.diag([0.0, 400.0, 0.0, 400.0])
    P[np.ix_([0, 2], [0, 2])] = axes.T @ noise @ axes
    return trackingEKF(np.array([position[0], 0.0, position[1], 0.0]), P)


def toOutput(ekf):
    """px, py, vx, vy."""
    order = [0, 2, 1, 3]
    covariance = ekf.StateCovariance[np.ix_(order, order)]
    return ekf.State[order], covariance


class Tracker:
    def step(self, state, scan):
        detection = objectDetection(scan)
        if state is None:
            ekf = initcvekf(detection)
        else:
            time, x, P = state
            ekf = trackingEKF(x, P)
            ekf.predict(detection.Time - time)
            if scan.valid:
                ekf.correct(detection.Measurement, detection.MeasurementParameters)
        estimate = toOutput(ekf)
        return (detection.Time, ekf.State, ekf.StateCovariance), estimate
