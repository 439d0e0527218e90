"""Pure functions over stacked models: quiet, pushed along the course, pushed across it; switches in continuous time."""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

PUSHES = np.array([[0.6, 0.6], [4.0, 1.0], [1.0, 5.0]])  # m/s^2 along the course and across it
RATES = np.array([[-0.8, 0.4, 0.4], [0.8, -1.0, 0.2], [0.8, 0.2, -1.0]])  # 1/s, from the row to the column
SPEEDS, SHAPES = np.linalg.eig(RATES)
LEAST = -30.0


class Bank(NamedTuple):
    logw: np.ndarray  # (m,)
    mean: np.ndarray  # (m, 4)
    cov: np.ndarray  # (m, 4, 4)


class Obs(NamedTuple):
    z: np.ndarray
    R: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray
    polar: bool


def moments(w, mean, cov):
    """Of mixtures; w has a row for each of them."""
    mixed = w @ mean
    d = mean[None] - mixed[:, None]
    spread = np.einsum("ji,jia,jib->jab", w, d, d)
    return mixed, np.einsum("ji,iab->jab", w, cov) + spread


def switches(dt):
    """The exponential of the rates over an interval."""
    return np.maximum(SHAPES * np.exp(SPEEDS * dt) @ np.linalg.inv(SHAPES), 0.0)


def interact(bank, dt):
    joint = np.exp(bank.logw)[:, None] * switches(dt)
    total = joint.sum(axis=0)
    mean, cov = moments((joint / total).T, bank.mean, bank.cov)
    return Bank(np.log(total), mean, cov)


def axes(v):
    """Along and across the course, as columns."""
    speed = np.hypot(v[0], v[1])
    if speed < 0.5:
        return np.eye(2)
    e = v / speed
    return np.array([[e[0], -e[1]], [e[1], e[0]]])


def advance(bank, dt):
    F = np.eye(4) + dt * np.eye(4, k=2)
    shape = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    turns = np.stack([axes(v) for v in bank.mean[:, 2:]])
    A = np.einsum("jab,jb,jcb->jac", turns, 0.5 * PUSHES**2, turns)
    Q = np.stack([np.kron(shape, a) for a in A])
    return Bank(bank.logw, bank.mean @ F.T, F @ bank.cov @ F.T + Q)


def observe(x, obs):
    d = x[:2] - obs.pose[:2]
    yaw = obs.pose[2]
    if not obs.polar:
        T = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        return T @ d, np.hstack([T, np.zeros((2, 2))])
    r = max(np.hypot(*d), 0.3)
    u, n = d / r, np.array([-d[1], d[0]]) / r
    v = x[2:] - obs.velocity
    H = np.zeros((3, 4))
    H[0, :2], H[1, :2] = u, n / r
    H[2] = np.concatenate([n * (n @ v) / r, u])
    return np.array([r, np.arctan2(d[1], d[0]) - yaw, u @ v]), H


def gaussian(y, S):
    """The logarithm of the density."""
    L = np.linalg.cholesky(S)
    a = np.linalg.solve(L, y)
    return -0.5 * (a @ a) - np.sum(np.log(np.diag(L))) - 0.5 * len(y) * np.log(2 * np.pi)


def corrected(x, P, obs):
    h, H = observe(x, obs)
    y = obs.z - h
    if obs.polar:
        y = y.copy()
        y[1] = np.angle(np.exp(1j * y[1]))
    S = H @ P @ H.T + obs.R
    K = np.linalg.solve(S, H @ P).T
    B = np.eye(4) - K @ H
    return x + K @ y, B @ P @ B.T + K @ obs.R @ K.T, gaussian(y, S)


def assimilate(bank, obs):
    parts = [corrected(x, P, obs) for x, P in zip(bank.mean, bank.cov, strict=True)]
    mean, cov, loglik = (np.stack(part) for part in zip(*parts, strict=True))
    logw = bank.logw + loglik
    logw = np.maximum(logw - logsumexp(logw), LEAST)
    return Bank(logw - logsumexp(logw), mean, cov)


def begin(obs):
    yaw = obs.pose[2]
    r, a = (obs.z[0], yaw + obs.z[1]) if obs.polar else (1.0, yaw)
    c, s = np.cos(a), np.sin(a)
    J = np.array([[c, -r * s], [s, r * c]])
    mean = np.append(obs.pose[:2] + J @ (np.array([r, 0.0]) if obs.polar else obs.z), [0.0, 0.0])
    cov = np.diag([0.0, 0.0, 350.0, 350.0])
    cov[:2, :2] = J @ obs.R[:2, :2] @ J.T
    m = len(PUSHES)
    return Bank(np.full(m, -np.log(m)), np.tile(mean, (m, 1)), np.tile(cov, (m, 1, 1)))


def collapse(bank):
    mean, cov = moments(np.exp(bank.logw)[None], bank.mean, bank.cov)
    return mean[0], (cov[0] + cov[0].T) / 2


class Tracker:
    def step(self, state, scan):
        obs = Obs(scan.measurement, scan.noise_covariance, scan.sensor_pose, scan.sensor_velocity, scan.kind == "radar")
        if state is None:
            bank = begin(obs)
        else:
            dt = scan.time - state[0]
            bank = advance(interact(state[1], dt), dt)
            if scan.valid:
                bank = assimilate(bank, obs)
        return (scan.time, bank), collapse(bank)
