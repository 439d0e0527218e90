"""What the trackers that run a filter of FilterPy have in common."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.subjects.adaptors.filterpy_kinds import SensorUse, sensing
from trackbench.subjects.adaptors.filterpy_options import FilterPyOptions
from trackbench.subjects.adaptors.options import function, of_sensor, takes_state
from trackbench.subjects.adaptors.tracker import AdaptedTracker, Updated

#: The interval with which a user's function is tried, s.
TRIAL_DT = 0.1


class FilterPyTracker(AdaptedTracker):
    """Runs a copy of the user's filter; every step works on a copy of the one before."""

    def __init__(self, options: FilterPyOptions, kind: type, found: Any) -> None:
        super().__init__(options)
        self._filter = found
        self._sensing = sensing(options, kind, self.layout)
        self._noise = self._matrix("process_noise", options.process_noise)

    def measurement(self, x: Array, scan: Scan) -> Array:
        """``(m,)`` what the filter expects to measure of a state ``(n,)``."""
        return np.reshape(self._hx(self._of(scan), scan)(self._shaped(x)), -1)

    @abstractmethod
    def _move(self, running: Any, dt: float) -> None:
        """Predict in place."""

    @abstractmethod
    def _take(self, running: Any, how: SensorUse, scan: Scan, z: Array, r: Array | None) -> None:
        """Update in place with a measurement; its covariance is None where the filter's own is meant."""

    @abstractmethod
    def _hx(self, how: SensorUse, scan: Scan) -> Callable[[Array], Array]:
        """What is expected to be measured of a state."""

    def _own(self, time: float) -> Any:
        return copy.deepcopy(self._filter)

    def _begun(self, belief: Gaussian, time: float) -> Any:
        running = copy.deepcopy(self._filter)
        placed = self._placed(belief, self._gaussian(running))
        running.x, running.P = self._shaped(placed.mean), placed.covariance
        return running

    def _gaussian(self, belief: Any) -> Gaussian:
        return Gaussian(np.array(belief.x, dtype=float).reshape(-1), np.array(belief.P, dtype=float))

    def _predict(self, belief: Any, elapsed: float) -> Any:
        running = copy.deepcopy(belief)
        for dt in self._intervals(elapsed):
            if self._noise is not None:
                running.Q = self._noise(running.x, dt)
            self._move(running, dt)
        return running

    def _update(self, belief: Any, scan: Scan) -> Updated:
        how = self._of(scan)
        measured = how.reader.measurement(scan)
        noise = measured.covariance if how.states_noise else None
        self._take(belief, how, scan, self._shaped(measured.mean), noise)
        return Updated(belief, np.reshape(belief.y, -1).astype(float), np.array(belief.S, dtype=float))

    def _of(self, scan: Scan) -> SensorUse:
        return self._sensing if isinstance(self._sensing, SensorUse) else of_sensor(self._sensing, scan)

    def _shaped(self, vector: Array) -> Array:
        """A vector as FilterPy has the state: as it is, or as a column."""
        return vector.reshape(-1, 1) if np.ndim(self._filter.x) == 2 else vector.copy()

    def _matrix(self, option: str, reference: str | None) -> Callable[[Array, float], Array] | None:
        """The user's function of dt or of x and dt that gives a square matrix; one of dt is tried once."""
        if reference is None:
            return None
        call = function(option, reference)
        if takes_state(option, reference, call):
            return lambda x, dt: np.asarray(call(x, dt), dtype=float)
        try:
            shape = np.shape(call(self._dt or TRIAL_DT))
        except Exception as error:
            raise InputError(f"{option}: {reference!r} raises {type(error).__name__}: {error}") from error
        if shape != np.shape(self._filter.P):
            raise InputError(f"{option}: {reference!r} gives the shape {shape}, not {np.shape(self._filter.P)}")
        return lambda _, dt: np.asarray(call(dt), dtype=float)
