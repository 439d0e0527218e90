"""Mean and covariance of a filter where its tracker holds them, and what a step of it does to other ones.

They are looked for by their values in a tracker that runs in this process. The state may be any: the derivative C of
the estimate by it is taken by differences, and a covariance P belongs to it where C P C^T is the one returned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.inside.values import Assigned, HeldAt, Way, formed, held_values, parts, traced
from trackbench.subjects.doctor.session import StepFailed, TrackerSession

#: Sizes of a state that are looked for, and how many pairs of a mean and a covariance are tried.
SIZES, TRIED = range(4, 13), 40
#: Time of an instant, s.
INSTANT = 1e-9
#: Change of a state for a derivative, in its standard deviations.
STEP = 0.01
#: Share of a covariance that is so narrow that the motion and the sensors are linear within it.
NARROW = 0.01
#: Share of the largest singular value of a derivative that is none.
ROUNDING = 1e-9
#: Difference of the returned covariance from that of the state, relative to it.
SAME = 1e-3


class HeldAfter(NamedTuple):
    """Mean and covariance that a tracker holds after some scans, and its estimates."""

    mean: Array
    """``(n,)``"""
    covariance: Array
    """``(n, n)``"""
    at_once: Estimate | None
    """Estimate at the first scan."""
    estimate: Estimate | None
    """Estimate at the last scan."""
    assigned: Sequence[Assigned]
    """Assignments by the lines of the first step, where it is traced."""


@dataclass(frozen=True, eq=False)
class OwnFilter:
    """A tracker after some scans, with the places of its mean and covariance."""

    session: TrackerSession
    mean_at: Way
    covariance_at: Way
    mean: Array
    covariance: Array

    @property
    def time(self) -> float:
        """Of the last scan, s."""
        return self.session.given[-1].time

    @property
    def sigma(self) -> Array:
        """``(n,)`` standard deviations of the state."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 1e-12)))

    def after(
        self,
        scan: Scan,
        *then: Scan,
        mean: Array | None = None,
        covariance: Array | None = None,
        trace: bool = False,
    ) -> HeldAfter | None:
        """Return what is held after some scans, of another mean or covariance; None where they are not there then."""
        copy = self.session.copy()
        for path, value in ((self.mean_at, mean), (self.covariance_at, covariance)):
            if value is not None and not put(copy.inside, path, value):
                return None
        at_once, assigned = traced(lambda: copy.step(scan)) if trace else (copy.step(scan), [])
        estimate = at_once
        for later in then:
            estimate = copy.step(later)
        values = {entry.path: entry.value for entry in held_values(copy.inside)}
        if self.mean_at not in values or self.covariance_at not in values:
            return None
        own, spread = values[self.mean_at].ravel(), values[self.covariance_at]
        if own.shape != self.mean.shape or spread.shape != self.covariance.shape:
            return None
        return HeldAfter(own, spread, at_once, estimate, assigned)

    def derivative(
        self, scan: Scan, of: Callable[[HeldAfter], Array | None], covariance: Array | None = None
    ) -> Array | None:
        """``(k, n)`` of something after a scan by the mean before it."""
        columns = []
        for i, sigma in enumerate(self.sigma):
            step = STEP * sigma * np.eye(len(self.mean))[i]
            sides = [self.after(scan, mean=self.mean + side * step, covariance=covariance) for side in (1, -1)]
            values = [None if side is None else of(side) for side in sides]
            if values[0] is None or values[1] is None:
                return None
            columns.append((values[0] - values[1]) / (2 * STEP * sigma))
        return np.stack(columns, axis=1)

    def outputs(self, scan: Scan) -> Array | None:
        """``(4, n)`` the derivative of the estimate after a scan by the mean that is held then."""
        both = self.derivative(scan, _returned_and_held)
        return None if both is None else np.asarray(both[:4] @ np.linalg.pinv(both[4:], rcond=ROUNDING))


def _returned_and_held(after: HeldAfter) -> Array | None:
    return None if after.estimate is None else np.concatenate([after.estimate.mean, after.mean])


def own_filter(session: TrackerSession) -> OwnFilter | None:
    """Where a tracker holds its mean and covariance; None where it is not found, or cannot be changed."""
    if session.inside is None:
        return None
    try:
        return next(_found(session), None)
    except StepFailed:
        return None


def _found(session: TrackerSession) -> Iterator[OwnFilter]:
    missed = empty_scan(session.given[-1]._replace(time=session.given[-1].time + INSTANT))
    inside = list(held_values(session.inside))
    means = [entry for entry in inside if entry.value.size in SIZES and max(entry.value.shape) == entry.value.size]
    spreads = [entry for entry in inside if _is_covariance(entry.value)]
    pairs = [(mean, spread) for mean in means for spread in spreads if len(spread.value) == mean.value.size]
    # What is held side by side belongs together.
    pairs.sort(key=lambda pair: pair[0].path[:-1] != pair[1].path[:-1])
    for mean, spread in pairs[:TRIED]:
        own = OwnFilter(session, mean.path, spread.path, mean.value.ravel(), spread.value)
        small = NARROW * own.covariance
        usual, wider = own.after(missed, covariance=small), own.after(missed, covariance=2.0 * small)
        if usual is None or wider is None or usual.estimate is None or wider.estimate is None:
            continue
        outputs = own.outputs(missed)
        # A difference is free of the noise that a filter may add in no time.
        held, returned = (
            more.covariance - less.covariance for more, less in ((wider, usual), (wider.estimate, usual.estimate))
        )
        if outputs is None or not np.diag(returned).min() > 0.0:
            continue
        if covariances_apart(outputs @ held @ outputs.T, returned) < SAME:
            yield own


def _is_covariance(value: Array) -> bool:
    if value.ndim != 2 or value.shape[0] != value.shape[1] or len(value) not in SIZES or not np.isfinite(value).all():
        return False
    return float(np.diag(value).min()) > 0.0


def covariances_apart(covariance: Array, right: Array) -> float:
    """The largest difference, in variances of the right one."""
    sigma = np.sqrt(np.maximum(np.abs(np.diag(right)), np.finfo(float).tiny))
    return float(np.abs((covariance - right) / np.outer(sigma, sigma)).max())


def put(root: Any, path: Way, value: Array) -> bool:
    """Hold another value at a place, in the form of what is there; False where that cannot be changed."""
    holder = root
    for key in path[:-1]:
        holder = dict(parts(holder))[key]
    there = dict(parts(holder))[path[-1]]
    if isinstance(there, np.ndarray) and there.dtype.kind == "f" and there.flags.writeable:
        there[...] = value.reshape(there.shape)
        return True
    if isinstance(there, list):
        there[:] = formed(there, value.reshape(np.shape(there)))
        return True
    if isinstance(holder, tuple) or isinstance(there, np.ndarray):
        return False
    HeldAt(holder, path[-1]).put(formed(there, value.reshape(np.shape(there))))
    return True
