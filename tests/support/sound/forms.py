"""One extended Kalman filter in many algebraic forms; most keep the prediction where nothing was detected."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, qr, solve_triangular
from tests.support.sound.measured import (
    EachScan,
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
)


class Joseph:
    """Joseph form, state returned."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
        else:
            then, x, P = state
            x, P = predicted(x, P, scan.time - then)
            if scan.valid:
                x, P = corrected(x, P, scan)
        return (scan.time, x, P), (x, P)


class Standard:
    """Short form of the covariance update, all on self; the prediction is kept at a miss."""

    sigma = 2.8

    def __init__(self):
        self.x = self.P = self.t = None

    def predict(self, dt):
        F = transition(dt)
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + driven(dt, self.sigma)

    def update(self, y, H, R):
        PHt = self.P @ H.T
        K = PHt @ np.linalg.inv(H @ PHt + R)
        self.x = self.x + K @ y
        self.P = self.P - K @ PHt.T
        self.P = 0.5 * (self.P + self.P.T)

    def step(self, state, scan):
        if self.x is None:
            self.x, self.P = start(scan)
        else:
            self.predict(scan.time - self.t)
            if scan.valid:
                y = difference(scan.measurement, expected(self.x, scan), scan)
                self.update(y, jacobian(self.x, scan), scan.noise_covariance)
        self.t = scan.time
        return None, (self.x, self.P)


class Sequential:
    """One component after the other, all about the predicted state, after the noise was decorrelated."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (x, P, scan.time), (x, P)
        x, P = predicted(*state[:2], scan.time - state[2])
        if scan.valid:
            variances, V = np.linalg.eigh(scan.noise_covariance)
            H = V.T @ jacobian(x, scan)
            y = V.T @ difference(scan.measurement, expected(x, scan), scan)
            prior = x.copy()
            for h, residual, r in zip(H, y, variances, strict=True):
                s = h @ P @ h + r
                k = P @ h / s
                x = x + k * (residual - h @ (x - prior))
                P = P - np.outer(k, k) * s
            P = (P + P.T) / 2
        return (x, P, scan.time), (x, P)


class RelinearisedSequence:
    """Range, azimuth and range rate one by one, each linearised about what the ones before have made of the state."""

    def __init__(self):
        self.track = {}

    def step(self, state, scan):
        track = self.track
        if not track:
            track["x"], track["P"] = start(scan)
        else:
            track["x"], track["P"] = predicted(track["x"], track["P"], scan.time - track["t"])
            if scan.valid:
                for i in range(len(scan.measurement)):
                    x, P = track["x"], track["P"]
                    h, y = jacobian(x, scan)[i], difference(scan.measurement, expected(x, scan), scan)[i]
                    r = scan.noise_covariance[i, i]
                    k = P @ h / (h @ P @ h + r)
                    A = np.eye(4) - np.outer(k, h)
                    track["x"], track["P"] = x + k * y, A @ P @ A.T + r * np.outer(k, k)
        track["t"] = scan.time
        return None, (track["x"], track["P"])


class SquareRoot:
    """A triangular root of the covariance, by orthogonal transformations."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, np.linalg.cholesky(P)), (x, P)
        t, x, S = state
        dt = scan.time - t
        F = transition(dt)
        G = 3.0 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        x, S = F @ x, qr(np.hstack([F @ S, G]).T, mode="r")[0][:4].T
        if scan.valid:
            H, m = jacobian(x, scan), len(scan.measurement)
            array = np.block([[np.linalg.cholesky(scan.noise_covariance), H @ S], [np.zeros((4, m)), S]])
            L = qr(array.T, mode="r")[0].T
            y = difference(scan.measurement, expected(x, scan), scan)
            x = x + L[m:, :m] @ solve_triangular(L[:m, :m], y, lower=True)
            S = L[m:, m : m + 4]
        return (scan.time, x, S), (x, S @ S.T)


class Potter:
    """Potter's square-root update by scalars, with a root that is not triangular."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (x, np.linalg.cholesky(P), scan.time), (x, P)
        x, root, before = state
        x, P = predicted(x, root @ root.T, scan.time - before)
        root = np.linalg.cholesky(P)
        if scan.valid:
            prior, H = x.copy(), jacobian(x, scan)
            y = difference(scan.measurement, expected(x, scan), scan)
            for h, r, v in zip(H, np.diag(scan.noise_covariance), y, strict=True):
                f = root.T @ h
                a = 1 / (f @ f + r)
                k = a * (root @ f)
                x = x + k * (v - h @ (x - prior))
                root = root - np.outer(k, f) / (1 + np.sqrt(a * r))
        return (x, root, scan.time), (x, root @ root.T)


class Information:
    """The information filter: the update adds, the prediction inverts."""

    def __init__(self, accel=3.0):
        self.accel = accel

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            Y = np.linalg.inv(P)
        else:
            t, y, Y = state
            P = np.linalg.inv(Y)
            x, P = predicted(P @ y, P, scan.time - t, self.accel)
            Y = np.linalg.inv(P)
            if scan.valid:
                H, W = jacobian(x, scan), np.linalg.inv(scan.noise_covariance)
                z = difference(scan.measurement, expected(x, scan), scan) + H @ x
                y, Y = Y @ x + H.T @ W @ z, Y + H.T @ W @ H
                P = np.linalg.inv(Y)
                x = P @ y
        return (scan.time, Y @ x, Y), (x, (P + P.T) / 2)


def udu(P):
    """Return U, unit upper triangular, and d with P = U diag(d) U'."""
    n, U, d, P = len(P), np.eye(len(P)), np.zeros(len(P)), P.copy()
    for j in range(n - 1, -1, -1):
        d[j] = P[j, j]
        U[:j, j] = P[:j, j] / d[j]
        P[:j, :j] -= d[j] * np.outer(U[:j, j], U[:j, j])
    return U, d


class Bierman:
    """Factors U and D, with Bierman's update of one component after the other."""

    def observe(self, U, d, h, r):
        f = U.T @ h
        v, a, k, U, d = d * f, r, np.zeros(4), U.copy(), d.copy()
        for j in range(4):
            before, a = a, a + f[j] * v[j]
            d[j] *= before / a
            column = U[:, j].copy()
            U[:, j] = column - f[j] / before * k
            k = k + v[j] * column
        return U, d, k / a

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, *udu(P)), (x, P)
        t, x, U, d = state
        x, P = predicted(x, U * d @ U.T, scan.time - t)
        U, d = udu(P)
        if scan.valid:
            prior, H = x, jacobian(x, scan)
            y = difference(scan.measurement, expected(x, scan), scan)
            for h, r, v in zip(H, np.diag(scan.noise_covariance), y, strict=True):
                U, d, k = self.observe(U, d, h, r)
                x = x + k * (v - h @ (x - prior))
        P = U * d @ U.T
        return (scan.time, x, U, d), (x, (P + P.T) / 2)


class SquareRootInformation:
    """A root of the information matrix, updated by least squares."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
        else:
            t, x, R = state
            inv = solve_triangular(R, np.eye(4))
            x, P = predicted(x, inv @ inv.T, scan.time - t)
        R = np.linalg.cholesky(np.linalg.inv(P)).T
        if state is not None and scan.valid:
            W = np.linalg.inv(np.linalg.cholesky(scan.noise_covariance))
            y = W @ difference(scan.measurement, expected(x, scan), scan)
            A = np.column_stack([np.vstack([R, W @ jacobian(x, scan)]), np.append(np.zeros(4), y)])
            T = qr(A, mode="r")[0]
            R = T[:4, :4]
            x = x + solve_triangular(R, T[:4, 4])
            inv = solve_triangular(R, np.eye(4))
            P = inv @ inv.T
        return (scan.time, x, R), (x, P)


class Iterated:
    """The iterated EKF: Gauss-Newton with at most four steps."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        t, x0, P = state
        x0, P = predicted(x0, P, scan.time - t)
        x = x0
        if scan.valid:
            for _ in range(4):
                H = jacobian(x, scan)
                y = difference(scan.measurement, expected(x, scan), scan)
                K = P @ H.T @ np.linalg.inv(H @ P @ H.T + scan.noise_covariance)
                x = x0 + K @ (y - H @ (x0 - x))
            A = np.eye(4) - K @ H
            P = A @ P @ A.T + K @ scan.noise_covariance @ K.T
        return (scan.time, x, P), (x, P)


class SinglePrecision:
    """All sums in float32, Joseph form, about the place of the first measurement; times stay double."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            origin = np.append(x[:2], [0.0, 0.0])
            return (scan.time, origin, (x - origin).astype("f4"), P.astype("f4")), (x, P)
        t, origin, x, P = state
        dt = scan.time - t
        F = transition(dt).astype("f4")
        x, P = F @ x, F @ P @ F.T + driven(dt).astype("f4")
        if scan.valid:
            there = x.astype(float) + origin
            H, R = jacobian(there, scan).astype("f4"), scan.noise_covariance.astype("f4")
            y = difference(scan.measurement, expected(there, scan), scan).astype("f4")
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            A = np.eye(4, dtype="f4") - K @ H
            x, P = x + K @ y, A @ P @ A.T + K @ R @ K.T
        P = (P + P.T) / 2
        return (scan.time, origin, x, P), (x.astype(float) + origin, P.astype(float))


class ErrorState:
    """A nominal state and the covariance of its error, which is reset after each update."""

    def __init__(self):
        self.nominal, self.cov, self.clock = None, None, None

    def step(self, state, scan):
        if self.nominal is None:
            self.nominal, self.cov = start(scan)
        else:
            self.nominal, self.cov = predicted(self.nominal, self.cov, scan.time - self.clock, 3.3)
            if scan.valid:
                H = jacobian(self.nominal, scan)
                factor = cho_factor(H @ self.cov @ H.T + scan.noise_covariance)
                y = difference(scan.measurement, expected(self.nominal, scan), scan)
                self.nominal = self.nominal + self.cov @ H.T @ cho_solve(factor, y)
                drop = self.cov @ H.T @ cho_solve(factor, H @ self.cov)
                self.cov = self.cov - (drop + drop.T) / 2
        self.clock = scan.time
        return None, (self.nominal, self.cov)


class Interleaved:
    """State order px, vx, py, vy, with block-diagonal matrices of each axis."""

    ORDER = (0, 2, 1, 3)

    def step(self, state, scan):
        ix = np.ix_(self.ORDER, self.ORDER)
        if state is None:
            x, P = start(scan)
            return (scan.time, x[list(self.ORDER)], P[ix]), (x, P)
        t, s, C = state
        dt = scan.time - t
        F = np.kron(np.eye(2), np.array([[1, dt], [0, 1]]))
        Q = 9.0 * np.kron(np.eye(2), np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]]))
        s, C = F @ s, F @ C @ F.T + Q
        x, P = s[list(self.ORDER)], C[ix]
        if scan.valid:
            x, P = corrected(x, P, scan)
        return (scan.time, x[list(self.ORDER)], P[ix]), (x, P)


class Kilometres:
    """State in km and km/h, as from a map; the estimate is converted."""

    UNITS = np.array([1e-3, 1e-3, 3.6, 3.6])

    def step(self, state, scan):
        u = self.UNITS
        if state is None:
            x, P = start(scan)
            return {"t_h": scan.time / 3600, "x": x * u, "P": P * np.outer(u, u)}, (x, P)
        dt_h = scan.time / 3600 - state["t_h"]
        F, kmh2 = np.eye(4) + dt_h * np.eye(4, k=2), 3.0 * 3.6 * 3600
        G = kmh2 * np.vstack([dt_h**2 / 2 * np.eye(2), dt_h * np.eye(2)])
        x, P = F @ state["x"], F @ state["P"] @ F.T + G @ G.T
        if scan.valid:
            H, R = jacobian(x / u, scan) / u, scan.noise_covariance
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x = x + K @ difference(scan.measurement, expected(x / u, scan), scan)
            P = (np.eye(4) - K @ H) @ P @ (np.eye(4) - K @ H).T + K @ R @ K.T
        return {"t_h": scan.time / 3600, "x": x, "P": P}, (x / u, P / np.outer(u, u))


class EigenFactors:
    """Covariance kept as axes and variances; no variance falls below a millionth of the greatest."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
        else:
            t, x, lengths, axes = state
            x, P = predicted(x, axes * lengths @ axes.T, scan.time - t)
            if scan.valid:
                x, P = corrected(x, P, scan)
        lengths, axes = np.linalg.eigh((P + P.T) / 2)
        lengths = np.maximum(lengths, 1e-6 * lengths[-1])
        P = axes * lengths @ axes.T
        return (scan.time, x, lengths, axes), (x, (P + P.T) / 2)


class HandWrittenRadar:
    """Radar Jacobian written out as in the lessons, lidar in the fixed frame."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        x, P = predicted(state[1], state[2], scan.time - state[0], 3.0)
        if scan.valid and scan.kind == "radar":
            sx, sy, yaw = scan.sensor_pose
            px, py, (vx, vy) = x[0] - sx, x[1] - sy, x[2:] - scan.sensor_velocity
            c1 = px * px + py * py
            c2, c3 = np.sqrt(c1), c1 * np.sqrt(c1)
            H = np.array(
                [
                    [px / c2, py / c2, 0, 0],
                    [-py / c1, px / c1, 0, 0],
                    [py * (vx * py - vy * px) / c3, px * (vy * px - vx * py) / c3, px / c2, py / c2],
                ]
            )
            y = scan.measurement - np.array([c2, np.arctan2(py, px) - yaw, (px * vx + py * vy) / c2])
            y[1] = np.arctan2(np.sin(y[1]), np.cos(y[1]))
            R = scan.noise_covariance
        elif scan.valid:
            T = turn(scan.sensor_pose[2])
            y = scan.sensor_pose[:2] + T @ scan.measurement - x[:2]
            H, R = np.eye(2, 4), T @ scan.noise_covariance @ T.T
        if scan.valid:
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            x, P = x + K @ y, (np.eye(4) - K @ H) @ P
            P = (P + P.T) / 2
        return (scan.time, x, P), (x, P)


class NumericalDerivative(EachScan):
    """Derivatives by central differences, of any measurement function."""

    sigma = 2.7

    def update(self, x, P, scan):
        h = 1e-4
        columns = [difference(expected(x + h * e, scan), expected(x - h * e, scan), scan) for e in np.eye(4)]
        H = np.column_stack(columns) / (2 * h)
        S = H @ P @ H.T + scan.noise_covariance
        K = P @ H.T @ np.linalg.pinv(S)
        x, P = x + K @ difference(scan.measurement, expected(x, scan), scan), P - K @ S @ K.T
        return x, P


class Polar(EachScan):
    """State in modified polar coordinates for the radar: converted to and fro at each update, to first order."""

    def update(self, x, P, scan):
        if scan.kind != "radar":
            return corrected(x, P, scan)
        away, speed = x[:2] - scan.sensor_pose[:2], x[2:] - scan.sensor_velocity
        r = np.hypot(*away)
        across = np.array([-away[1], away[0]]) / r
        J = np.vstack([jacobian(x, scan), np.zeros(4)])
        J[3, 2:] = across
        J[3, :2] = -(speed @ away) / r**2 * across
        back = np.linalg.inv(J)
        polar, C = np.append(expected(x, scan), across @ speed), J @ P @ J.T
        S = C[:3, :3] + scan.noise_covariance
        K = C[:, :3] @ np.linalg.inv(S)
        gain = K @ difference(scan.measurement, polar[:3], scan)
        C = C - K @ S @ K.T
        return x + back @ gain, back @ C @ back.T


class ConvertedWithRate(EachScan):
    """The radar's position converted and used linearly, then its range rate by itself."""

    def update(self, x, P, scan):
        z, R = position(scan)
        K = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
        A = np.eye(4) - K @ np.eye(2, 4)
        x, P = x + K @ (z - x[:2]), A @ P @ A.T + K @ R @ K.T
        if scan.kind == "radar":
            h, r = jacobian(x, scan)[2], scan.noise_covariance[2, 2]
            k = P @ h / (h @ P @ h + r)
            A = np.eye(4) - np.outer(k, h)
            x = x + k * (scan.measurement[2] - expected(x, scan)[2])
            P = A @ P @ A.T + r * np.outer(k, k)
        return x, P


class PlainLists:
    """Nothing but lists of numbers: each component corrects the state in turn."""

    def step(self, state, scan):
        if state is None:
            m, C = start(scan)
            return {"t": scan.time, "x": m.tolist(), "P": C.tolist()}, (m, C)
        dt, x, P, n = scan.time - state["t"], state["x"], state["P"], range(4)
        F = [[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]]
        g = [dt * dt / 2, dt * dt / 2, dt, dt]
        x = [sum(F[i][k] * x[k] for k in n) for i in n]
        FP = [[sum(F[i][k] * P[k][j] for k in n) for j in n] for i in n]
        P = [[sum(FP[i][k] * F[j][k] for k in n) + 9 * g[i] * g[j] * ((i - j) % 2 == 0) for j in n] for i in n]
        if scan.valid:
            H, before = jacobian(np.array(x), scan).tolist(), list(x)
            y = difference(scan.measurement, expected(np.array(x), scan), scan).tolist()
            for h, v, r in zip(H, y, np.diag(scan.noise_covariance).tolist(), strict=True):
                Ph = [sum(P[i][k] * h[k] for k in n) for i in n]
                s = sum(h[k] * Ph[k] for k in n) + r
                v -= sum(h[k] * (x[k] - before[k]) for k in n)
                x = [x[i] + Ph[i] * v / s for i in n]
                P = [[P[i][j] - Ph[i] * Ph[j] / s for j in n] for i in n]
        return {"t": scan.time, "x": x, "P": P}, (np.array(x), np.array(P))
