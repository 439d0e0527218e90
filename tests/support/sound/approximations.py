"""Sigma points, samples and other approximations of the best filter, each with a covariance of its own errors."""

import numpy as np
from scipy.linalg import block_diag, solve_discrete_are, sqrtm
from tests.support.sound.measured import (
    EachScan,
    corrected,
    difference,
    driven,
    expected,
    jacobian,
    position,
    predicted,
    residuals,
    start,
    transition,
    turn,
)


class PointFilter(EachScan):
    """Update by weighted points, which a subclass chooses; the motion is linear and predicted exactly."""

    def points(self, n):
        """Return points of a standard normal distribution (n, m), and weights of the mean and of the covariance."""
        raise NotImplementedError

    def root(self, P):
        return np.linalg.cholesky(P)

    def update(self, x, P, scan):
        U, wm, wc = self.points(4)
        D = self.root(P) @ U
        Z = np.array([expected(x + d, scan) for d in D.T])
        at = expected(x, scan)
        dZ = np.array([difference(z, at, scan) for z in Z]).T
        shift = dZ @ wm
        dZ = dZ - shift[:, None]
        S = (wc * dZ) @ dZ.T + scan.noise_covariance
        K = (wc * D) @ dZ.T @ np.linalg.inv(S)
        x = x + K @ difference(scan.measurement, at + shift, scan)
        return x, P - K @ S @ K.T


class Merwe(PointFilter):
    """Scaled points with alpha 1e-2, beta 2, kappa 0."""

    alpha, beta, kappa = 1e-2, 2.0, 0.0

    def points(self, n):
        lam = self.alpha**2 * (n + self.kappa) - n
        g = np.sqrt(n + lam)
        wm = np.full(2 * n + 1, 0.5 / (n + lam))
        wc = wm.copy()
        wm[0] = lam / (n + lam)
        wc[0] = wm[0] + 1 - self.alpha**2 + self.beta
        return np.hstack([np.zeros((n, 1)), g * np.eye(n), -g * np.eye(n)]), wm, wc


class MerweWide(Merwe):
    """The same with alpha 1 and kappa 3 - n."""

    alpha, beta, kappa, sigma = 1.0, 0.0, -1.0, 2.7


class SymmetricRoot(Merwe):
    """The same with the symmetric root of the covariance."""

    alpha, beta, kappa = 0.5, 2.0, 1.0

    def root(self, P):
        return np.real(sqrtm(P))


class Cubature(PointFilter):
    """Eight points of equal weight."""

    def points(self, n):
        w = np.full(2 * n, 0.5 / n)
        return np.sqrt(n) * np.hstack([np.eye(n), -np.eye(n)]), w, w


class Simplex(PointFilter):
    """The spherical simplex of n + 2 points."""

    def points(self, n):
        w0 = 0.4
        w = np.append(w0, np.full(n + 1, (1 - w0) / (n + 1)))
        X = np.zeros((n, n + 2))
        for i in range(1, n + 1):
            X[i - 1, 1 : i + 1] = -1 / np.sqrt(i * (i + 1) * w[1])
            X[i - 1, i + 1] = i / np.sqrt(i * (i + 1) * w[1])
        return X, w, w


class Particles:
    """A bootstrap filter of 1500 particles about the radial speed, with regularisation."""

    random = True

    def step(self, state, scan):
        if state is None or state[2] < 15:
            n = 0 if state is None else state[2]
            x, P = start(scan) if state is None else predicted(*state[1], scan.time - state[0])
            if n and scan.valid:
                x, P = corrected(x, P, scan)
            return (scan.time, (x, P), n + 1), (x, P)
        t, X, n = state
        rng, N = np.random.default_rng(n), 1500
        if isinstance(X, tuple):
            X = rng.multivariate_normal(*X, N)
        dt = scan.time - t
        a = rng.normal(0, 3.3, (N, 2))
        X = X @ transition(dt).T + np.hstack([dt**2 / 2 * a, dt * a])
        if scan.valid:
            y = residuals(X, scan)
            log_w = -0.5 * np.einsum("ki,ij,kj->k", y, np.linalg.inv(scan.noise_covariance), y)
            w = np.exp(log_w - log_w.max())
            w /= w.sum()
            X = X[np.searchsorted(np.cumsum(w), (np.arange(N) + rng.random()) / N).clip(max=N - 1)]
            C = np.cov(X.T) + 1e-6 * np.eye(4)
            h = 0.3
            X = (
                X.mean(axis=0)
                + np.sqrt(1 - h**2) * (X - X.mean(axis=0))
                + h * rng.multivariate_normal(np.zeros(4), C, N)
            )
        return (scan.time, X, n + 1), (X.mean(axis=0), np.cov(X.T))


class Ensemble:
    """An ensemble Kalman filter of 400 members with perturbed measurements, spread a hundredth wider."""

    random = True

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            X = np.random.default_rng(3).multivariate_normal(x, P, 400)
            return (scan.time, X, 1), (x, P)
        t, X, n = state
        rng, dt = np.random.default_rng(n), scan.time - t
        a = 3.0 * rng.normal(size=(len(X), 2))
        X = X @ transition(dt).T + np.hstack([dt**2 / 2 * a, dt * a])
        if scan.valid:
            noise = rng.multivariate_normal(np.zeros(len(scan.measurement)), scan.noise_covariance, len(X))
            Y = residuals(X, scan)
            dX, dZ = X - X.mean(axis=0), Y.mean(axis=0) - Y
            K = dX.T @ dZ @ np.linalg.inv(dZ.T @ dZ + (len(X) - 1) * scan.noise_covariance)
            X = X + (Y + noise) @ K.T
            X = X.mean(axis=0) + 1.01 * (X - X.mean(axis=0))
        return (scan.time, X, n + 1), (X.mean(axis=0), np.cov(X.T))


class Debiased(EachScan):
    """Converted radar positions without bias, with the covariance of the conversion; the range rate comes after."""

    def convert(self, scan):
        if scan.kind != "radar":
            return position(scan)
        (r, a), R = scan.measurement[:2], scan.noise_covariance
        l1, l2 = np.exp(-R[1, 1] / 2), np.exp(-2 * R[1, 1])
        c, s = np.cos(a), np.sin(a)
        var_in, var_across = r**2 + R[0, 0], r**2 + R[0, 0]
        along = 0.5 * var_in * (1 + l2) - (r * l1) ** 2 if R[1, 1] > 0.01 else R[0, 0] + 0.5 * r**2 * R[1, 1] ** 2
        across = 0.5 * var_across * (1 - l2)
        T = turn(scan.sensor_pose[2]) @ np.array([[c, -s], [s, c]])
        return scan.sensor_pose[:2] + T @ np.array([r / l1, 0]), T @ np.diag([along, across]) @ T.T

    def update(self, x, P, scan):
        z, R = self.convert(scan)
        S = P[:2, :2] + R
        K = P[:, :2] @ np.linalg.inv(S)
        x, P = x + K @ (z - x[:2]), P - K @ S @ K.T
        if scan.kind == "radar":
            h = jacobian(x, scan)[2:]
            s = h @ P @ h.T + scan.noise_covariance[2:, 2:]
            K = P @ h.T / s
            x, P = x + K @ (scan.measurement[2:] - expected(x, scan)[2:]), P - K @ s @ K.T
        return x, P


class SteadyGain:
    """After a second of full gains, those of the steady state for the period; the covariance is that of these gains."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, scan.time, x, P), (x, P)
        born, t, x, P = state
        dt = scan.time - t
        x, P = predicted(x, P, dt)
        if scan.valid:
            H, R, prior = jacobian(x, scan), scan.noise_covariance, P
            if t - born > 1:
                prior = solve_discrete_are(transition(0.05).T, H.T, driven(0.05) + 1e-9 * np.eye(4), R)
            K = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
            A = np.eye(4) - K @ H
            x = x + K @ difference(scan.measurement, expected(x, scan), scan)
            P = A @ P @ A.T + K @ R @ K.T
        return (born, scan.time, x, P), (x, (P + P.T) / 2)


class FadingMemory:
    """The predicted covariance is widened by 2 % for each tenth of a second, besides some process noise."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        t, x, P = state
        dt = scan.time - t
        x, P = predicted(x, P, dt, 2.6)
        P = P * 1.02 ** (dt / 0.1)
        if scan.valid:
            x, P = corrected(x, P, scan)
        return (scan.time, x, P), (x, P)


class Schmidt:
    """A consider filter: an azimuth error of a tenth of a degree is reckoned with and never estimated."""

    BIAS = np.radians(0.1) ** 2

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P, np.zeros(4)), (x, P)
        t, x, P, C = state
        dt = scan.time - t
        x, P = predicted(x, P, dt)
        C = transition(dt) @ C
        if scan.valid:
            H, R = jacobian(x, scan), scan.noise_covariance
            b = np.array([0.0, 1.0, 0.0]) if scan.kind == "radar" else np.zeros(2)
            cross = P @ H.T + np.outer(C, b)
            S = H @ P @ H.T + np.outer(H @ C, b) + np.outer(b, H @ C) + self.BIAS * np.outer(b, b) + R
            K = cross @ np.linalg.inv(S)
            x = x + K @ difference(scan.measurement, expected(x, scan), scan)
            P = P - K @ S @ K.T
            C = C - K @ (H @ C + b * self.BIAS)
            P = (P + P.T) / 2
        return (scan.time, x, P, C), (x, P)


class FixedLag:
    """The state is joined by the position of the scan before, which is smoothed along; the current part is given."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            J = np.vstack([np.eye(4), np.eye(2, 4)])
            return (scan.time, J @ x, J @ P @ J.T + 1e-9 * np.eye(6)), (x, P)
        t, x, P = state
        dt = scan.time - t
        F = np.zeros((6, 6))
        F[:4, :4], F[4:, :2] = transition(dt), np.eye(2)
        x, P = F @ x, F @ P @ F.T + block_diag(driven(dt), 1e-9 * np.eye(2))
        if scan.valid:
            x, P = corrected(x, P, scan)
        return (scan.time, x, P), (x[:4], P[:4, :4])


class AdaptiveNoise:
    """The process noise follows the mean of the last 15 normalised innovations, between 2 and 5 m/s²."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P, [1.0] * 15), (x, P)
        t, x, P, ratios = state
        sigma = np.clip(3.0 * np.mean(ratios), 2.0, 5.0)
        x, P = predicted(x, P, scan.time - t, sigma)
        if scan.valid:
            H = jacobian(x, scan)
            y = difference(scan.measurement, expected(x, scan), scan)
            nis = y @ np.linalg.solve(H @ P @ H.T + scan.noise_covariance, y)
            ratios = [*ratios[1:], nis / len(y)]
            x, P = corrected(x, P, scan)
        return (scan.time, x, P, ratios), (x, P)


class SmoothedVelocity:
    """The velocity that is given is eased towards the last one given; the covariance counts what that puts it off."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P, None), (x, P)
        t, x, P, shown = state
        x, P = predicted(x, P, scan.time - t)
        if scan.valid:
            x, P = corrected(x, P, scan)
        shown = x[2:] if shown is None or scan.time - t > 0.5 else 0.3 * shown + 0.7 * x[2:]
        off = np.append([0.0, 0.0], shown - x[2:])
        return (scan.time, x, P, shown), (x + off, P + np.outer(off, off))


class Replay:
    """All scans of the last 0.6 s are kept in order of their times and worked in anew at each scan."""

    def __init__(self):
        self.base, self.buffer = None, []

    def step(self, state, scan):
        if self.base is None:
            self.base = (scan.time, *start(scan))
            return None, self.base[1:]
        if scan.valid:
            self.buffer.append(scan)
            self.buffer.sort(key=lambda each: each.time)
        while self.buffer and self.buffer[0].time < scan.time - 0.6:
            self.base = self.seen(self.base, self.buffer.pop(0))
        belief = self.base
        for each in self.buffer:
            belief = self.seen(belief, each)
        return None, predicted(*belief[1:], scan.time - belief[0])

    def seen(self, belief, scan):
        t, x, P = belief
        return (scan.time, *corrected(*predicted(x, P, scan.time - t), scan))


class RobustUpdate:
    """A measurement beyond five sigmas is taken with a covariance that is wider in proportion."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return [scan.time, x, P], (x, P)
        t, x, P = state
        x, P = predicted(x, P, scan.time - t)
        if scan.valid:
            H, y = jacobian(x, scan), difference(scan.measurement, expected(x, scan), scan)
            S = H @ P @ H.T + scan.noise_covariance
            wider = max(y @ np.linalg.solve(S, y) / 25, 1.0)
            x, P = corrected(x, P, scan._replace(noise_covariance=scan.noise_covariance * wider))
        return [scan.time, x, P], (x, P)
