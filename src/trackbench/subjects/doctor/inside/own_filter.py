"""Mean and covariance of a filter where its tracker holds them, and steps of the filter from replaced values.

Mean and covariance are looked for by their values in a tracker that runs in this process. The state can have any
components: the derivative C of the estimate with respect to the state is taken by differences, and a covariance P fits
where C P C^T is the returned covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.inside.values import (
    Assigned,
    HeldAt,
    KeyPath,
    held_values,
    parts,
    reshape,
    trace_step,
)
from trackbench.subjects.doctor.session import StepFailed, TrackerSession

#: Sizes of a state that are looked for, and largest number of pairs of a mean and a covariance that are tried.
SIZES, TRIED = range(4, 13), 40
#: Time of an instant, s.
INSTANT = 1e-9
#: Change of a state for a derivative, in its standard deviations.
STEP = 0.01
#: Factor that makes a covariance so narrow that the motion and the sensors are linear within it.
NARROW = 0.01
#: Singular value of a derivative that counts as zero, relative to the largest.
ROUNDING = 1e-9
#: Largest relative difference of the returned covariance from the one that the state gives.
SAME = 1e-3


class HeldAfter(NamedTuple):
    """Own mean and covariance of a tracker after some scans, and its first and last estimates."""

    mean: Array
    """Mean ``(n,)`` of the tracker's own state."""
    covariance: Array
    """Covariance ``(n, n)`` of the tracker's own state."""
    first_estimate: Estimate | None
    estimate: Estimate | None
    """Estimate at the last scan."""
    assigned: Sequence[Assigned]
    """Values that the tracker's lines assign in the first step; empty unless it is traced."""


@dataclass(frozen=True, eq=False)
class OwnFilter:
    """Tracker after some scans, with the mean and covariance inside it and the attribute paths to both."""

    session: TrackerSession
    mean_at: KeyPath
    covariance_at: KeyPath
    mean: Array
    covariance: Array

    @property
    def time(self) -> float:
        """Time of the last scan, s."""
        return self.session.scans[-1].time

    @property
    def sigma(self) -> Array:
        """Standard deviations ``(n,)`` of the own state, at least 1e-6."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 1e-12)))

    def after(
        self,
        scan: Scan,
        *then: Scan,
        mean: Array | None = None,
        covariance: Array | None = None,
        trace: bool = False,
    ) -> HeldAfter | None:
        """Step a copy, from a replaced mean or covariance if given; return mean and covariance after, or None."""
        copy = self.session.copy()
        for path, value in ((self.mean_at, mean), (self.covariance_at, covariance)):
            if value is not None and not put(copy.inside, path, value):
                return None
        first_estimate, assigned = trace_step(lambda: copy.step(scan)) if trace else (copy.step(scan), [])
        estimate = first_estimate
        for later in then:
            estimate = copy.step(later)
        values = {entry.path: entry.value for entry in held_values(copy.inside)}
        if self.mean_at not in values or self.covariance_at not in values:
            return None
        held_mean, held_covariance = values[self.mean_at].ravel(), values[self.covariance_at]
        if held_mean.shape != self.mean.shape or held_covariance.shape != self.covariance.shape:
            return None
        return HeldAfter(held_mean, held_covariance, first_estimate, estimate, assigned)

    def derivative(
        self, scan: Scan, function: Callable[[HeldAfter], Array | None], covariance: Array | None = None
    ) -> Array | None:
        """Return the derivative ``(k, n)`` of ``function`` after a scan by the mean held before; None on failure."""
        columns = []
        for i, sigma in enumerate(self.sigma):
            step = STEP * sigma * np.eye(len(self.mean))[i]
            sides = [self.after(scan, mean=self.mean + side * step, covariance=covariance) for side in (1, -1)]
            values = [None if side is None else function(side) for side in sides]
            if values[0] is None or values[1] is None:
                return None
            columns.append((values[0] - values[1]) / (2 * STEP * sigma))
        return np.stack(columns, axis=1)

    def outputs(self, scan: Scan) -> Array | None:
        """Return the derivative ``(4, n)`` of the estimate with respect to the filter's own mean, both after a scan.

        None where the mean cannot be set, or an estimate is missing.

        """
        stacked = self.derivative(scan, _returned_and_held)
        return None if stacked is None else np.asarray(stacked[:4] @ np.linalg.pinv(stacked[4:], rcond=ROUNDING))


def _returned_and_held(after: HeldAfter) -> Array | None:
    return None if after.estimate is None else np.concatenate([after.estimate.mean, after.mean])


def own_filter(session: TrackerSession) -> OwnFilter | None:
    """Return where a tracker holds its mean and covariance; None where they are not found, or cannot be changed."""
    if session.inside is None:
        return None
    try:
        return next(_find(session), None)
    except StepFailed:
        return None


def _find(session: TrackerSession) -> Iterator[OwnFilter]:
    missed = empty_scan(session.scans[-1]._replace(time=session.scans[-1].time + INSTANT))
    inside = list(held_values(session.inside))
    means = [entry for entry in inside if entry.value.size in SIZES and max(entry.value.shape) == entry.value.size]
    spreads = [entry for entry in inside if _is_covariance(entry.value)]
    pairs = [(mean, spread) for mean in means for spread in spreads if len(spread.value) == mean.value.size]
    # A mean and a covariance that are held side by side belong together.
    pairs.sort(key=lambda pair: pair[0].path[:-1] != pair[1].path[:-1])
    for mean, spread in pairs[:TRIED]:
        candidate = OwnFilter(session, mean.path, spread.path, mean.value.ravel(), spread.value)
        small = NARROW * candidate.covariance
        usual, wider = candidate.after(missed, covariance=small), candidate.after(missed, covariance=2.0 * small)
        if usual is None or wider is None or usual.estimate is None or wider.estimate is None:
            continue
        outputs = candidate.outputs(missed)
        # A filter may add noise even in no time; a difference of covariances is free of it.
        held, returned = (
            more.covariance - less.covariance for more, less in ((wider, usual), (wider.estimate, usual.estimate))
        )
        if outputs is None or not np.diag(returned).min() > 0.0:
            continue
        if covariance_difference(outputs @ held @ outputs.T, returned) < SAME:
            yield candidate


def _is_covariance(value: Array) -> bool:
    if value.ndim != 2 or value.shape[0] != value.shape[1] or len(value) not in SIZES or not np.isfinite(value).all():
        return False
    return float(np.diag(value).min()) > 0.0


def covariance_difference(covariance: Array, right: Array) -> float:
    """Return the largest difference of two covariances' entries, scaled by the standard deviations of ``right``."""
    sigma = np.sqrt(np.maximum(np.abs(np.diag(right)), np.finfo(float).tiny))
    return float(np.abs((covariance - right) / np.outer(sigma, sigma)).max())


def put(root: Any, path: KeyPath, value: Array) -> bool:
    """Replace the value at a path below ``root``, keeping its type and shape; return False where that is impossible."""
    holder = root
    for key in path[:-1]:
        holder = dict(parts(holder))[key]
    current = dict(parts(holder))[path[-1]]
    if isinstance(current, np.ndarray) and current.dtype.kind == "f" and current.flags.writeable:
        current[...] = value.reshape(current.shape)
        return True
    if isinstance(current, list):
        current[:] = reshape(current, value.reshape(np.shape(current)))
        return True
    if isinstance(holder, tuple) or isinstance(current, np.ndarray):
        return False
    HeldAt(holder, path[-1]).put(reshape(current, value.reshape(np.shape(current))))
    return True
