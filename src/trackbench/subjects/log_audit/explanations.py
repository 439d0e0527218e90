"""The errors of a sensor that a log shows, and other errors that would explain the log equally well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.metrics.blocks import BlockInterval
from trackbench.subjects.log_audit.joint_fit import (
    LEAST_INFORMATION,
    ErrorEstimate,
    JointFit,
    block_intervals,
    explained_share,
)
from trackbench.subjects.log_audit.sensor_log import BODY_POINT, SensorLog

#: Smallest effect of an error on a measurement that makes a finding, in standard deviations of its noise.
EFFECT = 0.1


def explanations(log: SensorLog, fit: JointFit, level: float) -> list[ErrorEstimate]:
    """Return the errors that a log shows.

    Errors that differ from zero whatever all other errors are come first. The remaining errors may be so alike that
    each hides the others. As long as one of them alone differs from zero, the one with the largest effect is added. A
    rival explains the measurements in place of an error, which is then no longer significant.

    Args:
        log: measurements of the sensor.
        fit: joint fit of the log.
        level: probability with which an interval holds the true value.
    """
    problem = _Linearised(log, fit, level)
    shown: dict[str, ErrorEstimate] = {}
    for name in problem.names:
        interval = problem.interval([other for other in problem.names if other != name], name)
        if problem.matters(name, interval):
            interval = fit.estimates[name].interval if name in fit.estimates else interval
            shown[name] = ErrorEstimate(name, log.errors[name], interval, problem.effect(name, interval))
    while True:
        hidden = {*shown, *(rival for item in shown.values() for rival in item.rivals)}
        single = {name: problem.interval([*shown], name) for name in problem.names if name not in hidden}
        effects = {name: problem.effect(name, item) for name, item in single.items() if problem.matters(name, item)}
        if not effects:
            return list(shown.values())
        best = max(effects, key=effects.__getitem__)
        rivals = problem.rivals(best, [*shown])
        shown[best] = ErrorEstimate(best, log.errors[best], single[best], effects[best], rivals)


class _Linearised:
    """Linear least-squares problem of all errors of a sensor, around the joint fit."""

    def __init__(self, log: SensorLog, fit: JointFit, level: float) -> None:
        self.names = [name for name in log.errors if fit.unidentified.get(name) != ()]
        columns = (log.derivatives(fit.errors, self.names) / fit.scale)[:, :, fit.inlier]
        known = np.isfinite(columns).all(axis=(0, 1))
        self._columns = np.where(known, columns, 0.0)
        values = np.array([fit.errors.get(name, 0.0) for name in self.names])
        residual = np.where(known, (fit.residual / fit.scale)[:, fit.inlier], 0.0)
        self._target = residual + np.einsum("p,pmr->mr", values, self._columns)
        self._blocks, self._level = fit.blocks, level
        gram = np.einsum("pmr,qmr->pq", self._columns, self._columns)
        size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        self._cosines, self._effects = gram / np.outer(size, size), size / np.sqrt(max(int(known.sum()), 1))
        bodies = [motion.length.max() for motion in log.drive.motions.values() if motion.length is not None]
        self._half_length = 0.5 * float(max([log.truth.length_m, *bodies]))

    def interval(self, others: Sequence[str], name: str) -> BlockInterval:
        """Return an error's interval, estimated together with the errors ``others``; unbounded where these hide it."""
        chosen = [self.names.index(error) for error in (*others, name)]
        if explained_share(self._cosines, chosen[-1], chosen[:-1])[1] < LEAST_INFORMATION:
            return BlockInterval(0.0, np.inf, 1)
        return block_intervals(self._columns[chosen], self._target, self._blocks)[-1]

    def effect(self, name: str, interval: BlockInterval) -> float:
        """Return the RMS change of a measurement by an error, in standard deviations of the measurement's noise."""
        return abs(interval.value) * float(self._effects[self.names.index(name)])

    def matters(self, name: str, interval: BlockInterval) -> bool:
        """Return whether an error is significant, large enough and possible: a measured point must lie on the body."""
        is_possible = name != BODY_POINT or abs(interval.value) <= self._half_length
        return is_possible and self.effect(name, interval) >= EFFECT and interval.excludes(0.0, self._level)

    def rivals(self, name: str, others: Sequence[str]) -> dict[str, float]:
        """Return the errors that explain the log as well in place of ``name``, with their values; ``others`` stay."""
        result = {}
        for rival in self.names:
            if rival == name or rival in others:
                continue
            alone = self.interval(others, rival)
            is_needed = self.interval([*others, rival], name).excludes(0.0, self._level)
            if self.matters(rival, alone) and not is_needed:
                result[rival] = alone.value
        return result
