"""The straight line from which tracks start: computed once for all trackers that are given the same measurements."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from trackbench.base.types import Mask, Scan
from trackbench.engine.equations import Compute
from trackbench.trackers.batch_fit import BatchPrior
from trackbench.trackers.batch_start import StraightLine, straight_line
from trackbench.trackers.first_measurements import FirstMeasurements, collect, kinds_of


def first_line(
    scans: Sequence[Scan], counted: Sequence[Mask], where: Mask, prior: BatchPrior, compute: Compute
) -> tuple[FirstMeasurements, StraightLine]:
    """The measurements that count, of some of the objects, and the straight line that they say.

    Args:
        scans: in order of time.
        counted: of each scan, which of its measurements count.
        where: the objects, of which the last scan counts.
        prior: what is assumed beside the measurements.
        compute: how equations are computed.
    """
    return _found(_Asked(scans, counted, where, prior, compute))


class _Asked:
    """What is asked for; the same if it is of the same scans."""

    def __init__(
        self, scans: Sequence[Scan], counted: Sequence[Mask], where: Mask, prior: BatchPrior, compute: Compute
    ) -> None:
        self.scans, self.counted, self.where, self.prior, self.compute = scans, counted, where, prior, compute
        masks = tuple(mask.tobytes() for mask in (*counted, where))
        # The scans are kept, so that no others have their id.
        self._key = tuple(map(id, scans)), masks, prior, compute

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Asked) and self._key == other._key


# Trackers take turns; those with a yaw start later than the others.
@lru_cache(maxsize=2)
def _found(asked: _Asked) -> tuple[FirstMeasurements, StraightLine]:
    pairs = zip(asked.scans, asked.counted, strict=True)
    own = [(_part(scan, asked.where), mask[asked.where]) for scan, mask in pairs if mask[asked.where].any()]
    taken = np.stack([mask for _, mask in own])
    measurements = collect([scan for scan, _ in own], taken, kinds_of(asked.scans))
    return measurements, straight_line(measurements, asked.prior, asked.compute)


def _part(scan: Scan, where: Mask) -> Scan:
    noise = scan.noise_covariance if scan.noise_covariance.ndim == 2 else scan.noise_covariance[..., where]
    return scan._replace(measurement=scan.measurement[:, where], valid=scan.valid[where], noise_covariance=noise)
