import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter


def F(dt):
    return np.array([[1, dt, 0, 0], [0, 1, 0, 0], [0, 0, 1, dt], [0, 0, 0, 1]])  # px, vx, py, vy


def Q(dt, acceleration_sigma=3.0):
    g = np.array([[dt**2 / 2, 0], [dt, 0], [0, dt**2 / 2], [0, dt]])
    return acceleration_sigma**2 * g @ g.T


def fx(x, dt):
    return F(dt) @ x


def make_kf():
    kf = KalmanFilter(dim_x=4, dim_z=2)
    kf.H = np.array([[1, 0, 0, 0], [0, 0, 1, 0]])
    return kf


ekf = ExtendedKalmanFilter(dim_x=4, dim_z=3)


def make_ukf(kappa=0.0):
    points = MerweScaledSigmaPoints(4, alpha=1.0, beta=2.0, kappa=kappa)
    return UnscentedKalmanFilter(dim_x=4, dim_z=3, dt=0.05, hx=None, fx=fx, points=points)


def radar(x, sensor_pose, sensor_velocity):
    px, vx, py, vy = x.ravel()
    dx, dy, ux, uy = px - sensor_pose[0], py - sensor_pose[1], vx - sensor_velocity[0], vy - sensor_velocity[1]
    r = np.hypot(dx, dy)
    return np.array([[r], [np.arctan2(dy, dx) - sensor_pose[2]], [(dx * ux + dy * uy) / r]])


def radar_jacobian(x, sensor_pose, sensor_velocity):
    px, vx, py, vy = x.ravel()
    dx, dy, ux, uy = px - sensor_pose[0], py - sensor_pose[1], vx - sensor_velocity[0], vy - sensor_velocity[1]
    r = np.hypot(dx, dy)
    turn = (dx * uy - dy * ux) / r**3
    return np.array([[dx / r, 0, dy / r, 0], [-dy / r**2, 0, dx / r**2, 0], [-dy * turn, dx / r, dx * turn, dy / r]])


def radar_residual(a, b):
    y = a - b
    y[1] = (y[1] + np.pi) % (2 * np.pi) - np.pi
    return y
