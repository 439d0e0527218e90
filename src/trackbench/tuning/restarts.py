"""How often the tracks of a built-in filter start again."""

from __future__ import annotations

import numpy as np

from trackbench.types import Array, Estimate, Mask, Scan


class Restarts:
    """Counts where a track that has given innovations for a sensor has an estimate, and none for a measurement of it.

    Args:
        shape: ``(trials, objects, runs)``.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.count = np.zeros(shape)
        """``(trials, objects, runs)``"""
        self._shape = shape
        self._spoke: dict[str, Mask] = {}
        self._silent: Mask = np.zeros(shape, dtype=bool)
        self._latest = -np.inf

    def add(self, scan: Scan, estimate: Estimate, log_density: Array | None) -> None:
        """Take in what the tracker said of a scan; of one that is older than another before it, it may be silent."""
        if scan.time < self._latest:
            return
        self._latest = scan.time
        valid = scan.valid.reshape(self._shape)
        says = np.zeros_like(valid) if log_density is None else valid & ~np.isnan(log_density.reshape(self._shape))
        spoke = self._spoke.get(scan.sensor, np.zeros_like(valid))
        there = np.isfinite(estimate.mean).all(axis=0).reshape(self._shape)
        silent = valid & ~says & spoke & there
        self.count += silent & ~self._silent
        self._silent = (self._silent | silent) & ~says
        self._spoke[scan.sensor] = spoke | says
