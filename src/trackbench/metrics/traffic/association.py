"""Whether the tracks took the detections of their own objects."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import FALSE_ALARM, Indices
from trackbench.metrics.traffic.assignment import Counted
from trackbench.metrics.traffic.clear import object_of_each
from trackbench.metrics.traffic.histories import NO_DETECTION, Associations
from trackbench.metrics.traffic.instants import last_instant_before


class AssociationCounts(NamedTuple):
    """Tracks on due objects, over all scans, in which the track took a detection or its object was detected."""

    right: int
    """It took a detection of its own object, alone or merged with another's."""
    wrong_object: int
    """It took another object's."""
    clutter: int
    """It took a false alarm."""
    missed: int
    """It took none although its object was detected."""


def association_counts(counted: Counted, taken: Associations) -> AssociationCounts:
    """A track's own object is the one that it was last matched with at an earlier instant, else at that of the scan.

    What the scan itself does to the track so says nothing about which object is its own.
    """
    number = np.minimum(np.searchsorted(counted.ids, taken.ids), max(len(counted.ids) - 1, 0))
    known = counted.ids[number] == taken.ids if len(counted.ids) else np.zeros(taken.ids.shape, dtype=bool)
    scan, column = np.nonzero(known)
    own = _own_objects(counted)[taken.instant[scan], number[scan, column]]
    due = (own >= 0) & counted.due[taken.instant[scan], own]
    scan, column, own = scan[due], column[due], own[due]
    origin = taken.origin[scan, column]
    right = origin == own
    if taken.merged is not None:
        right |= (origin >= 0) & (taken.merged[scan, column] == own)
    none = origin == NO_DETECTION
    return AssociationCounts(
        right=int(right.sum()),
        wrong_object=int(((origin >= 0) & ~right).sum()),
        clutter=int((origin == FALSE_ALARM).sum()),
        missed=int((none & taken.detected[scan, own]).sum()),
    )


def _own_objects(counted: Counted) -> Indices:
    """``(T, tracks)``, -1 where a track has none yet."""
    object_of = object_of_each(counted.matched, len(counted.due), len(counted.ids))
    before = last_instant_before(object_of >= 0)
    earlier = np.take_along_axis(object_of, np.maximum(before, 0), axis=0)
    return np.where(before >= 0, earlier, object_of)
