"""What the check-ups of trackers share."""

from __future__ import annotations

import numpy as np

NOISE = {
    "radar": np.diag([0.3, np.deg2rad(0.5), 0.1]) ** 2,
    "speed_radar": np.diag([0.3, np.deg2rad(0.5), 0.1]) ** 2,
    "lidar": np.diag([0.15, 0.15]) ** 2,
}
#: A tracker of a target in plain sight that is further off than this has not followed it, m and m/s.
LOST = 5.0


class TrackerCheckError(AssertionError):
    """A tracker does not keep the contract; the text lists every broken rule."""
