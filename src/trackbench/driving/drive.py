"""What a tracker is given at each instant, scans of one object or of several."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from trackbench.base.types import SAME_TIME, Scan

Answer = TypeVar("Answer")


class Delivery(NamedTuple):
    """Scan that a tracker is given."""

    scan: Scan
    number: int | None
    """Index of the scan in acquisition order; None if only an estimate is asked for."""
    read: bool
    """Whether the scan is of a sensor that the tracker reads."""


def empty_scan(scan: Scan) -> Scan:
    """Return a scan without detections, for a sensor that the tracker does not read: it asks for an estimate.

    With hidden identities it has no columns, and states that the sensor could have detected nothing.
    """
    if scan.detection_probability is None:
        return scan._replace(measurement=np.full_like(scan.measurement, np.nan), valid=np.zeros_like(scan.valid))
    return scan._replace(
        measurement=scan.measurement[:, :0], valid=scan.valid[:0], detection_probability=0.0, clutter_density=0.0
    )


def deliveries(
    scans: Sequence[Scan], sensors: Collection[str] | None = None, each_measurement: bool = False
) -> Iterator[list[Delivery]]:
    """Yield the scans that arrive by each instant at which a sensor measures, and after the instant before it.

    A tracker is scored at each instant by its answer to the last of these scans. Where no scan that was taken at the
    instant has arrived, an empty one asks for the estimate. Without latency each scan arrives at its instant.

    Args:
        scans: in the order in which they were taken.
        sensors: names of the sensors that the tracker reads; None for all.
        each_measurement: whether each scan is an instant of its own, also where several are taken at one time. Where
            some are late, all that has arrived is given at the first of them.
    """
    late = any(scan.arrival_time > scan.time for scan in scans)
    # Stable: what arrives together stays in the order in which it was taken.
    on_its_way = sorted(range(len(scans)), key=lambda number: (scans[number].arrival_time, scans[number].time))
    on_its_way.reverse()
    most = 1 if each_measurement and not late else len(scans)
    for _, group in groupby(scans, key=id if each_measurement else lambda scan: scan.time):
        latest = list(group)[-1]
        instant = latest.time
        delivered: list[Delivery] = []
        while on_its_way and len(delivered) < most and scans[on_its_way[-1]].arrival_time <= instant + SAME_TIME:
            number = on_its_way.pop()
            scan = scans[number]
            read = sensors is None or scan.sensor in sensors
            if read or not late:
                delivered.append(Delivery(scan if read else empty_scan(scan), number, read))
        if late and (not delivered or delivered[-1].scan.time != instant):
            delivered.append(Delivery(empty_scan(latest)._replace(arrival_time=instant, asked=True), None, False))
        yield delivered


def scans_read(scans: Iterable[Scan], sensors: Collection[str] | None) -> Iterator[Scan]:
    """Return the scans, without detections those of sensors that a tracker does not read.

    Args:
        scans: in the order in which they were taken.
        sensors: names of the sensors that the tracker reads; None for all.
    """
    return (scan if sensors is None or scan.sensor in sensors else empty_scan(scan) for scan in scans)


class DriveStep(NamedTuple, Generic[Answer]):
    """Step of a tracker."""

    instant: int
    """Index of the instant at which the step is taken."""
    scan: Scan
    number: int | None
    """Index of the scan in acquisition order; None if only an estimate is asked for."""
    read: bool
    """Whether the scan is of a sensor that the tracker reads."""
    answer: Answer
    seconds: float
    """Duration without the making of kernels, s; NaN of a smoother, which does not work step by step."""
    last: bool
    """Whether the tracker is scored at this instant by this answer."""
