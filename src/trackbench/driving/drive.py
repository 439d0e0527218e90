"""What a tracker is given at each instant, scans of one object or of several."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from trackbench.base.types import SAME_TIME, Scan

Answer = TypeVar("Answer")


class Delivery(NamedTuple):
    """What a tracker is given."""

    scan: Scan
    number: int | None
    """Of the scan, in the order in which they were taken; None where an estimate is asked for."""
    read: bool
    """Whether it is a scan as it is, of a sensor that the tracker reads."""


def empty_scan(scan: Scan) -> Scan:
    """The scan of a sensor that the tracker does not read: it tells the time, at which an estimate is asked for.

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
    """For each instant at which a sensor measures, what a tracker gets from the one before until then.

    A tracker is scored at each instant by its answer to the last of them. Where no scan that was taken at the instant
    has arrived, that is an empty one which asks for the estimate. Without latency each scan is given at its instant.

    Args:
        scans: in the order in which they were taken.
        sensors: names of those that the tracker reads; None: all.
        each_measurement: whether each scan is an instant of its own, also where several are taken at one time. Where
            some are late, the first of them is when all that has arrived is given.
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
    """The scans, those of sensors that a tracker does not read empty; ``sensors``: names of those that it reads."""
    return (scan if sensors is None or scan.sensor in sensors else empty_scan(scan) for scan in scans)


class DriveStep(NamedTuple, Generic[Answer]):
    """One step of a tracker."""

    instant: int
    """Number of the instant at which it is taken, from 0."""
    scan: Scan
    number: int | None
    """As of ``Delivery``, as the next."""
    read: bool
    answer: Answer
    seconds: float
    """It took, without the making of kernels; NaN of a smoother, which does not work step by step."""
    last: bool
    """Whether the tracker is scored at this instant by this answer."""
