"""Order in which scans reach a tracker, for single-object and multi-object trackers."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from trackbench.base.types import SAME_TIME, Scan


class Delivery(NamedTuple):
    """Scan to give to a tracker, with its index and whether the tracker uses its sensor."""

    instant: int
    """Index of the instant at which the answer is asked for."""
    scan: Scan
    number: int | None
    """Index of the scan in acquisition order; None if the scan only asks for an estimate."""
    read: bool
    """Whether the tracker uses the scan's sensor."""
    last: bool = False
    """Whether the answer is the last one of its instant, which is scored."""


def empty_scan(scan: Scan) -> Scan:
    """Return a scan without detections, which asks a tracker for an estimate.

    With hidden identities it has no columns of detections, and states a P_D and clutter density of 0.
    """
    if scan.detection_probability is None:
        return scan._replace(measurement=np.full_like(scan.measurement, np.nan), valid=np.zeros_like(scan.valid))
    return scan._replace(
        measurement=scan.measurement[:, :0], valid=scan.valid[:0], detection_probability=0.0, clutter_density=0.0
    )


def deliveries(
    scans: Sequence[Scan], sensors: Collection[str] | None = None, each_measurement: bool = False
) -> Iterator[list[Delivery]]:
    """Yield for each instant the scans to give to a tracker: those that have arrived since the previous instant.

    A tracker is scored at each instant by its answer to the last of these scans. If no scan taken at the instant has
    arrived, an empty scan asks for the estimate. Without latency each scan arrives at its instant.

    Args:
        scans: scans in acquisition order.
        sensors: names of the sensors that the tracker uses; None for all.
        each_measurement: whether each scan is an instant of its own, even if several share a time. With late scans, the
            first of them then delivers all that has arrived.
    """
    has_late_scans = any(scan.arrival_time > scan.time for scan in scans)
    # Stable: scans that arrive together stay in acquisition order.
    on_its_way = sorted(range(len(scans)), key=lambda number: (scans[number].arrival_time, scans[number].time))
    on_its_way.reverse()
    limit = 1 if each_measurement and not has_late_scans else len(scans)
    for instant, (_, group) in enumerate(groupby(scans, key=id if each_measurement else lambda scan: scan.time)):
        latest = list(group)[-1]
        delivered: list[Delivery] = []
        while on_its_way and len(delivered) < limit and scans[on_its_way[-1]].arrival_time <= latest.time + SAME_TIME:
            number = on_its_way.pop()
            scan = scans[number]
            is_read = sensors is None or scan.sensor in sensors
            if is_read or not has_late_scans:
                delivered.append(Delivery(instant, scan if is_read else empty_scan(scan), number, is_read))
        if has_late_scans and (not delivered or delivered[-1].scan.time != latest.time):
            asking = empty_scan(latest)._replace(arrival_time=latest.time, asked=True)
            delivered.append(Delivery(instant, asking, None, False))
        delivered[-1] = delivered[-1]._replace(last=True)
        yield delivered


def scans_read(scans: Iterable[Scan], sensors: Collection[str] | None) -> Iterator[Scan]:
    """Yield the scans, without detections if their sensor is not among ``sensors``; None stands for all sensors."""
    return (scan if sensors is None or scan.sensor in sensors else empty_scan(scan) for scan in scans)
