"""Filters with different process noise that never mix; their weights forget old measurements (MMAE).

Each of them follows any target, since none has too little noise to come back.
"""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, updated

SIGMAS = (2.2, 4.0, 7.0)
MEMORY = 0.8  # s


class Tracker:
    def step(self, state, scan):
        if state is None:
            logs, bank = np.zeros(len(SIGMAS)), [first(scan)] * len(SIGMAS)
        else:
            time, logs, bank = state
            dt = scan.time - time
            logs = logs * np.exp(-dt / MEMORY)
            bank = [moved(x, P, dt, sigma) for (x, P), sigma in zip(bank, SIGMAS, strict=True)]
            if scan.valid:
                logs, bank = self.weighed(logs, bank, scan)
        w = np.exp(logs)
        w /= w.sum()
        x = sum(v * m for v, (m, _) in zip(w, bank, strict=True))
        P = sum(v * (C + np.outer(m - x, m - x)) for v, (m, C) in zip(w, bank, strict=True))
        return (scan.time, logs, bank), (x, (P + P.T) / 2)

    def weighed(self, logs, bank, scan):
        logs, result = logs.copy(), []
        for k, (x, P) in enumerate(bank):
            z, H, R = linear_at(scan, x[2:])
            y, S = z - H @ x, H @ P @ H.T + R
            logs[k] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
            result.append(updated(x, P, z, H, R))
        return np.maximum(logs - logs.max(), -12.0), result
