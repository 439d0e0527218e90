"""Whether a sensor's time offset changes during the log: a clock that drifts, or was set."""

from __future__ import annotations

import numpy as np

from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.joint_fit import JointFit, residual_scale
from trackbench.subjects.log_audit.sensor_log import SensorLog


def clock_drift(log: SensorLog, fit: JointFit) -> BlockInterval | None:
    """The change of the time offset from the start of the log to its end, s; None where the log shows no time offset.

    The slope over time of what the fit leaves, against what a time offset does.
    """
    if "time_offset" not in fit.estimates:
        return None
    inlier, scale = fit.inlier, residual_scale(fit.residual)
    column = fit.derivatives[list(fit.estimates).index("time_offset")][:, inlier] / scale
    rest = fit.residual[:, inlier] / scale
    time = log.log.time[inlier]
    along = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
    # A constant besides, which the other errors have fitted together.
    parts = [column * column, column * column * along, column * column * along**2, column * rest, column * rest * along]
    terms = np.stack([part.sum(axis=0) for part in parts])

    def slope(sums: np.ndarray) -> np.ndarray:
        flat, once, twice, level, rise = sums
        return np.asarray((rise - level * once / flat) / (twice - once * once / flat))[None]

    return fit.blocks.intervals(terms, slope)[0]
