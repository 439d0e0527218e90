"""A Kalman filter with constant velocity on positions, plain NumPy: radar is converted, its range rate unused."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array, Belief
from .plain_ekf import ConstantVelocity


class PlainKf(ConstantVelocity):
    """Positions of one target from radar and lidar."""

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        z, R = self.position(scan)
        S = P[:2, :2] + R
        K = np.linalg.solve(S, P[:2]).T
        return self.corrected(x, P, K, z - x[:2], S)
