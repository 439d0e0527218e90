"""The closest pair of track and detection is matched first, then the next one; confirmed by 4 hits, deleted by time."""

import numpy as np
from benchmarks.faults.parts import in_view, linear, moved, updated
from scipy.stats import chi2


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        """State: time, next identity, and tracks as (identity, mean, covariance, hits, misses, last seen, used)."""
        time, count, tracks = state or (scan.time, 0, ())
        tracks = [(i, *moved(x, P, scan.time - time), *rest) for i, x, P, *rest in tracks]
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
                x, P = updated(x, P, *detections[match[n]])
                after.append((i, x, P, hits + 1, misses, scan.time, match[n]))
            elif scan.time - seen <= 0.9 and (hits >= 4 or misses + in_view(x, scan) <= 1):
                after.append((i, x, P, hits, misses + in_view(x, scan), seen, -1))
        for j in set(range(len(detections))) - set(match.values()):
            z, H, R = detections[j]
            x, P = updated(np.array([*z[:2], 0, 0]), np.diag([1e4, 1e4, 400.0, 400.0]), z, H, R)
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
