"""A discrete mode and a continuous state are eliminated in turn: conditionals, factors and tables of logarithms."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular

SPECTRAL = (0.15, 2.0, 25.0)  # (m/s^2)^2 s: cruising, manoeuvring, in an emergency
LASTS = (4.0, 1.5, 0.7)  # s
GOES_TO = np.array([[0.0, 0.8, 0.2], [0.6, 0.0, 0.4], [0.4, 0.6, 0.0]])
SMALLEST = -25.0


@dataclass(frozen=True)
class GaussianConditional:
    mean: np.ndarray
    cov: np.ndarray

    @property
    def log_normalization_constant(self):
        return -0.5 * np.linalg.slogdet(2 * np.pi * self.cov)[1]


@dataclass(frozen=True)
class LinearFactor:
    """|A x - b|^2 / 2, whitened."""

    A: np.ndarray
    b: np.ndarray


@dataclass(frozen=True)
class HybridDensity:
    log_table: np.ndarray
    conditionals: tuple


def normalized(log_table):
    log_table = log_table - log_table.max()
    log_table = np.maximum(log_table - np.log(np.sum(np.exp(log_table))), SMALLEST)
    return log_table - np.log(np.sum(np.exp(log_table)))


def moment_matched(weights, conditionals):
    means = np.array([g.mean for g in conditionals])
    mean = np.sum(weights[:, None] * means, axis=0)
    d = means - mean
    cov = np.einsum("i,ijk->jk", weights, np.array([g.cov for g in conditionals])) + (weights[:, None] * d).T @ d
    return GaussianConditional(mean, (cov + cov.T) / 2)


def mode_transition(dt):
    """From the row to the column."""
    leaves = 1.0 - np.exp(-dt / np.array(LASTS))
    return np.diag(1.0 - leaves) + leaves[:, None] * GOES_TO


def process_noises(dt):
    unit = np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
    return [q * unit for q in SPECTRAL]


def previous_mode_eliminated(density, dt):
    joint = np.exp(density.log_table)[:, None] * mode_transition(dt)
    marginal = joint.sum(axis=0)
    mixed = [moment_matched(joint[:, m] / marginal[m], density.conditionals) for m in range(len(marginal))]
    return HybridDensity(normalized(np.log(marginal)), tuple(mixed))


def moved(density, dt, noises):
    F = np.eye(4) + dt * np.eye(4, k=2)
    after = [
        GaussianConditional(F @ g.mean, F @ g.cov @ F.T + Q) for g, Q in zip(density.conditionals, noises, strict=True)
    ]
    return HybridDensity(density.log_table, tuple(after))


def eliminated(conditional, factor):
    """The posterior, and the logarithm of what is left for the mode."""
    L = np.linalg.cholesky(conditional.cov)
    A = np.vstack([solve_triangular(L, np.eye(4), lower=True), factor.A])
    b = np.concatenate([np.zeros(4), factor.b - factor.A @ conditional.mean])
    Q, R = qr(A, mode="economic")
    dx = solve_triangular(R, Q.T @ b)
    root = solve_triangular(R, np.eye(4))
    posterior = GaussianConditional(conditional.mean + dx, root @ root.T)
    error = 0.5 * np.sum((A @ dx - b) ** 2)
    log = conditional.log_normalization_constant - error - posterior.log_normalization_constant
    return posterior, log


def conditioned(density, factor):
    pairs = [eliminated(g, factor) for g in density.conditionals]
    logs = np.array([log for _, log in pairs])
    return HybridDensity(normalized(density.log_table + logs), tuple(g for g, _ in pairs))


def factor_of(scan):
    """In the plane, with the range rate as a third row for a radar; also the place and its covariance."""
    z, yaw = scan.measurement, scan.sensor_pose[2]
    if scan.kind == "radar":
        e = np.array([np.cos(yaw + z[1]), np.sin(yaw + z[1])])
        J = np.column_stack([e, z[0] * np.array([-e[1], e[0]])])
        local = np.array([z[0], 0.0])
    else:
        J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        local = z
    place, cov = scan.sensor_pose[:2] + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T
    H, b, noise = np.eye(2, 4), place, cov
    if scan.kind == "radar":
        H = np.vstack([H, [0.0, 0.0, *e]])
        b = np.append(place, z[2] + e @ scan.sensor_velocity)
        noise = np.zeros((3, 3))
        noise[:2, :2], noise[2, 2] = cov, scan.noise_covariance[2, 2] + 0.15**2
    L = np.linalg.cholesky(noise)
    return LinearFactor(solve_triangular(L, H, lower=True), solve_triangular(L, b, lower=True)), place, cov


class Tracker:
    def __init__(self):
        self.density = None
        self.noises = None
        self.time = None

    def step(self, state, scan):
        if self.density is None:
            _, place, cov = factor_of(scan)
            P = np.diag([0.0, 0.0, 380.0, 380.0])
            P[:2, :2] = cov
            start = GaussianConditional(np.append(place, [0.0, 0.0]), P)
            self.density = HybridDensity(np.log([0.5, 0.4, 0.1]), (start, start, start))
        else:
            dt = scan.time - self.time
            self.noises = process_noises(dt)
            self.density = moved(previous_mode_eliminated(self.density, dt), dt, self.noises)
            if scan.valid:
                self.density = conditioned(self.density, factor_of(scan)[0])
        self.time = scan.time
        best = moment_matched(np.exp(self.density.log_table), self.density.conditionals)
        return None, (best.mean, best.cov)
