"""A filter of another library as a tracker: when to start, predict and update."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import TrackbenchError
from trackbench.base.types import Array, Estimate, Gaussian, Scan
from trackbench.subjects.adaptors.layout import Layout
from trackbench.subjects.adaptors.options import AdaptorOptions
from trackbench.trackers import initial
from trackbench.trackers.initial import TentativeTrack

#: An interval is a whole number of ``dt_s`` if it differs from one by no more than this share of ``dt_s``.
TOLERANCE = 1e-3


class Track(NamedTuple):
    """What an adapted tracker knows after a scan."""

    time: float
    belief: Any
    """In the library's own form; None while there is no track."""
    waiting: TentativeTrack | None


class Updated(NamedTuple):
    """A belief after a measurement."""

    belief: Any
    innovation: Array | None
    """``(m,)``; None where no measurement was taken in."""
    innovation_covariance: Array | None
    """``(m, m)``"""


class AdaptedTracker(ABC):
    """Follows one object with a filter of another library.

    Beside ``step`` it shows the filter's models, as far as it has them, each of a state ``(n,)`` in the filter's own
    order: ``transition(x, dt)``, ``transition_jacobian(x, dt)``, ``measurement(x, scan)`` and
    ``measurement_jacobian(x, scan)``.
    """

    def __init__(self, options: AdaptorOptions) -> None:
        self.layout = Layout(options.state)
        self._initial = options.initial
        self._dt = options.dt_s

    def step(self, state: Track | None, scan: Scan) -> tuple[Track, Estimate | None]:
        """Predict to the scan's time and take its measurement in; a scan that is older than the state is dropped.

        Raises:
            TrackbenchError: the scan's interval or sensor does not fit the options.
        """
        track = state or Track(-math.inf, None, None)
        if scan.asked or scan.time < track.time:
            if track.belief is None:
                return track, None
            return track, self._estimate(self._predict(track.belief, max(scan.time, track.time) - track.time))
        if track.belief is None and (self._initial is not None or not scan.valid):
            return self._wait(track, scan)
        belief = self._own(scan.time) if track.belief is None else self._predict(track.belief, scan.time - track.time)
        updated = self._update(belief, scan) if scan.valid else Updated(belief, None, None)
        answer = self._estimate(updated.belief)
        return Track(scan.time, updated.belief, None), answer._replace(
            innovation=updated.innovation, innovation_covariance=updated.innovation_covariance
        )

    def transition(self, x: Array, dt: float) -> Array:
        """``(n,)`` the state after ``dt``."""
        for interval in self._intervals(dt):
            x = self._moved(x, interval)
        return x

    def _product_of_slopes(self, x: Array, dt: float) -> Array:
        """``(n, n)`` derivative of the transition, out of those of its intervals."""
        slope = np.eye(len(x))
        for interval in self._intervals(dt):
            slope = self._slope(x, interval) @ slope
            x = self._moved(x, interval)
        return slope

    @abstractmethod
    def _moved(self, x: Array, dt: float) -> Array:
        """``(n,)`` the state after one interval."""

    def _slope(self, x: Array, dt: float) -> Array:
        """``(n, n)`` derivative of ``_moved``, where the filter has one."""
        raise NotImplementedError

    @abstractmethod
    def _own(self, time: float) -> Any:
        """The belief that the filter itself starts from."""

    @abstractmethod
    def _begun(self, belief: Gaussian, time: float) -> Any:
        """A belief in the library's form from one of ``layout.motion``'s state."""

    @abstractmethod
    def _predict(self, belief: Any, elapsed: float) -> Any:
        """A new belief after zero or more seconds."""

    @abstractmethod
    def _update(self, belief: Any, scan: Scan) -> Updated:
        """The belief after a measurement."""

    @abstractmethod
    def _gaussian(self, belief: Any) -> Gaussian:
        """Mean ``(n,)`` and covariance ``(n, n)``."""

    def _intervals(self, elapsed: float) -> list[float]:
        """The steps of a prediction: one, or as many of ``dt_s`` as the options say.

        Raises:
            TrackbenchError: no whole number of them fits.
        """
        if elapsed == 0.0:
            return []
        if self._dt is None:
            return [elapsed]
        count = round(elapsed / self._dt)
        if count == 0 or abs(elapsed / self._dt - count) > TOLERANCE:
            raise TrackbenchError(
                f"{elapsed:g} s after the last scan is no whole number of dt_s = {self._dt:g} s, for which alone the "
                "filter's own matrices hold; give functions of dt in their place"
            )
        return [self._dt] * count

    def _wait(self, track: Track, scan: Scan) -> tuple[Track, Estimate | None]:
        config = self._initial
        if config is None or (config.sensors is not None and scan.sensor not in config.sensors):
            return track._replace(time=scan.time), None
        # A stated covariance is in the order of the filter's state, and is put in its place there.
        without = config.model_copy(update={"covariance_diag": None})
        begin = initial.start_tracks(without, scan, track.waiting)
        if not begin.ready:
            before = Estimate(*initial.at_rest(begin.waiting, config)) if config.waiting == "at_rest" else None
            return Track(scan.time, None, begin.waiting), before
        belief = self._begun(begin.state_of(self.layout.motion), scan.time)
        return Track(scan.time, belief, None), self._estimate(belief)

    def _placed(self, belief: Gaussian, own: Gaussian) -> Gaussian:
        """A first belief in the filter's order, with the covariance that the options state, if they do."""
        begun = self.layout.begun(belief, own)
        diagonal = None if self._initial is None else self._initial.covariance_diag
        return begun if diagonal is None else Gaussian(begun.mean, np.diag(diagonal))

    def _estimate(self, belief: Any) -> Estimate:
        own = self._gaussian(belief)
        return Estimate(*self.layout.cartesian_belief(own), own.mean, own.covariance)
