"""Which estimates and innovations there are of a tracker as it is: those that count in every trial."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Mask

Bytes = npt.NDArray[np.uint8]


class Availability(NamedTuple):
    """Of which objects and runs of one scene there is an estimate at an instant, and an innovation of a scan.

    Whether a filter gives an innovation is settled before the measurement comes, so that a likelihood of these alone is
    a partial likelihood (Cox 1975, "Partial likelihood", Biometrika 62(2)): its expectation is largest at the true
    values.
    """

    estimates: Mask
    """``(instants, objects, runs)``"""
    innovations: Mask
    """``(scans, objects, runs)``, the scans in the order in which they were taken."""

    @classmethod
    def none(cls, instants: int, scans: int, objects: int, runs: int) -> Availability:
        """Of no object; to be filled in."""
        return cls(*(np.zeros((number, objects, runs), dtype=bool) for number in (instants, scans)))


class PackedGiven(NamedTuple):
    """The same in an eighth of the memory, as it is kept of all runs and sent to other processes."""

    estimates: Bytes
    """``(instants / 8, objects, runs)`` of bytes."""
    innovations: Bytes
    """``(scans / 8, objects, runs)`` of bytes."""
    instants: int
    scans: int

    @classmethod
    def of(cls, given: Availability) -> PackedGiven:
        """The packed masks."""
        estimates, innovations = (np.packbits(mask, axis=0) for mask in given)
        return cls(estimates, innovations, len(given.estimates), len(given.innovations))

    @classmethod
    def joined(cls, parts: Sequence[PackedGiven]) -> PackedGiven:
        """Those of consecutive runs of a scene as one."""
        estimates, innovations = (np.concatenate([part[field] for part in parts], axis=-1) for field in (0, 1))
        return cls(estimates, innovations, parts[0].instants, parts[0].scans)

    def of_runs(self, runs: range) -> PackedGiven:
        """Of some runs alone."""
        here = slice(runs.start, runs.stop)
        return self._replace(estimates=self.estimates[..., here], innovations=self.innovations[..., here])

    def unpacked(self) -> Availability:
        """The masks."""
        sizes = (self.estimates, self.instants), (self.innovations, self.scans)
        return Availability(*(np.unpackbits(packed, axis=0, count=number).view(bool) for packed, number in sizes))
