"""The closest pair of track and detection is matched first, then the next one; confirmed by 4 hits, deleted by time."""

import numpy as np
from scipy.stats import chi2


def linear(scan, d):
    """z, H and R of a detection, fixed frame: the position, and of a radar the speed over ground along the ray."""
    radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
    r, angle = (d[0], yaw + d[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else d)
    H, R = np.eye(2, 4), J @ scan.noise_covariance[:2, :2] @ J.T
    if radar:
        z = np.append(z, d[2] + np.array([c, s]) @ scan.sensor_velocity)
        H = np.vstack([H, [0.0, 0.0, c, s]])
        R = np.pad(R, (0, 1))
        R[2, 2] = scan.noise_covariance[2, 2] + 0.15**2  # the ray is that of the measured azimuth
    return z, H, R


def in_view(x, scan):
    dx, dy = x[:2] - scan.sensor_pose[:2]
    off = (np.arctan2(dy, dx) - scan.sensor_pose[2] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.hypot(dx, dy) < scan.field_of_view.max_range and abs(off) < scan.field_of_view.half_angle)


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


def corrected(x, P, z, H, R):
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    A = np.eye(4) - K @ H
    return x + K @ (z - H @ x), A @ P @ A.T + K @ R @ K.T


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        """State: time, next identity, and tracks as (identity, mean, covariance, hits, misses, last seen, used)."""
        time, count, tracks = state or (scan.time, 0, ())
        F, Q = constant_velocity(scan.time - time)
        tracks = [(i, F @ x, F @ P @ F.T + Q, *rest) for i, x, P, *rest in tracks]
        detections = [linear(scan, d) for d in scan.measurement.T]
        pairs = []
        for n, (_, x, P, *_) in enumerate(tracks):
            for j, (z, H, R) in enumerate(detections):
                y, S = z - H @ x, H @ P @ H.T + R
                distance = y @ np.linalg.solve(S, y)
                if distance < chi2.ppf(0.9999, len(y)):
                    pairs.append((distance + np.log(np.linalg.det(S)), n, j))
        match = {}
        for _, n, j in sorted(pairs):
            if n not in match and j not in match.values():
                match[n] = j
        after = []
        for n, (i, x, P, hits, misses, seen, _) in enumerate(tracks):
            if n in match:
                x, P = corrected(x, P, *detections[match[n]])
                after.append((i, x, P, hits + 1, misses, scan.time, match[n]))
            elif scan.time - seen <= 0.9 and (hits >= 4 or misses + in_view(x, scan) <= 1):
                after.append((i, x, P, hits, misses + in_view(x, scan), seen, -1))
        for j in set(range(len(detections))) - set(match.values()):
            z, H, R = detections[j]
            x, P = corrected(np.array([*z[:2], 0, 0]), np.diag([1e4, 1e4, 400.0, 400.0]), z, H, R)
            after.append((count, x, P, 1, 0, scan.time, j))
            count += 1
        shown = [t for t in after if t[3] >= 4]
        return (scan.time, count, tuple(after)), self.output(shown) if shown else None

    def output(self, shown):
        ids, means, covariances = [t[0] for t in shown], [t[1] for t in shown], [t[2] for t in shown]
        return (
            np.array(ids),
            np.stack(means, axis=-1),
            np.stack(covariances, axis=-1),
            None,
            np.array([t[6] for t in shown]),
        )
