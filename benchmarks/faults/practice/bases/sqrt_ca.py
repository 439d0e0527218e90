"""Square-root filter with constant acceleration, x = [px, vx, ax, py, vy, ay]; S is lower triangular and P = S S^T."""

import numpy as np

POSITION, VELOCITY = [0, 3], [1, 4]
SHOWN = [0, 3, 1, 4]


def triangle(M):
    """The lower triangular factor of M M^T."""
    r = np.linalg.qr(M.T, mode="r")
    return r.T


class Tracker:
    jerk = 8.0

    def step(self, state, scan):
        if state is None:
            x, S = self.initial(scan)
        else:
            t, x, S = state
            x, S = self.time_update(x, S, scan.time - t)
            if scan.valid:
                x, S = self.measurement_update(x, S, scan)
        P = S @ S.T
        return (scan.time, x, S), (x[SHOWN], P[np.ix_(SHOWN, SHOWN)])

    def initial(self, scan):
        px, py, psi = scan.sensor_pose
        z = scan.measurement
        noise = np.linalg.cholesky(scan.noise_covariance)[:2, :2]
        if scan.kind == "radar":
            bearing = psi + z[1]
            x0, y0 = px + z[0] * np.cos(bearing), py + z[0] * np.sin(bearing)
            T = np.array([[np.cos(bearing), -np.sin(bearing)], [np.sin(bearing), np.cos(bearing)]]) @ np.diag([1, z[0]])
        else:
            T = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
            x0, y0 = np.array([px, py]) + T @ z
        M = np.zeros((6, 6))
        M[np.ix_(POSITION, POSITION)] = T @ noise
        M[[1, 4], [1, 4]] = 20.0
        M[[2, 5], [2, 5]] = 3.0
        return np.array([x0, 0.0, 0.0, y0, 0.0, 0.0]), triangle(M)

    def time_update(self, x, S, dt):
        f = np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
        g = self.jerk * np.array([[dt**3 / 6], [dt**2 / 2], [dt]])
        F, G = np.kron(np.eye(2), f), np.kron(np.eye(2), g)
        return F @ x, triangle(np.hstack([F @ S, G]))

    def measurement_update(self, x, S, scan):
        h, H = self.model(x, scan)
        innovation = scan.measurement - h
        if scan.kind == "radar":
            innovation[1] = (innovation[1] + np.pi) % (2 * np.pi) - np.pi
        m, n = H.shape
        root = np.linalg.cholesky(scan.noise_covariance)
        pre = np.block([[root, H @ S], [np.zeros((n, m)), S]])
        post = triangle(pre)
        root_innovation, corner, S_new = post[:m, :m], post[m:, :m], post[m:, m:]
        x_new = x + corner @ np.linalg.solve(root_innovation, innovation)
        return x_new, S_new

    def model(self, x, scan):
        d = x[POSITION] - scan.sensor_pose[:2]
        psi = scan.sensor_pose[2]
        if scan.kind != "radar":
            T = np.array([[np.cos(psi), np.sin(psi)], [-np.sin(psi), np.cos(psi)]])
            H = np.zeros((2, 6))
            H[:, POSITION] = T
            return T @ d, H
        u = x[VELOCITY] - scan.sensor_velocity
        r = np.linalg.norm(d)
        e = d / r
        across = np.array([-e[1], e[0]])
        H = np.zeros((3, 6))
        H[0, POSITION] = e
        H[1, POSITION] = across / r
        H[2, POSITION] = (u - (u @ e) * e) / r
        H[2, VELOCITY] = e
        return np.array([r, np.arctan2(d[1], d[0]) - psi, u @ e]), H
