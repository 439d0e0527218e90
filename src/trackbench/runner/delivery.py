"""In which order a tracker gets scans, and when it is asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

from trackbench.base.types import Scan

#: Two times that differ by less are the same, s: times are sums of periods, which are not exact.
SAME_TIME = 1e-9


class Delivery(NamedTuple):
    """What a tracker is given."""

    scan: Scan
    number: int | None
    """Of the scan, in the order in which they were taken; None where an estimate is asked for."""
    read: bool
    """Whether it is a scan as it is, of a sensor that the tracker reads."""


def deliveries(
    scans: Sequence[Scan], reads: Callable[[str], bool], emptied: Callable[[Scan], Scan]
) -> Iterator[list[Delivery]]:
    """For each instant at which a sensor measures, what a tracker gets from the one before until then.

    A tracker is scored at each instant by its answer to the last of them. Where no scan that was taken at the instant
    has arrived, that is an empty one which asks for the estimate. Without latency each scan is given at its instant.

    Args:
        scans: in the order in which they were taken.
        reads: whether the tracker reads a sensor, by its name.
        emptied: a scan without its measurements, in place of one of a sensor that the tracker does not read.
    """
    late = any(scan.arrival_time > scan.time for scan in scans)
    # Stable: what arrives together stays in the order in which it was taken.
    on_its_way = sorted(range(len(scans)), key=lambda number: (scans[number].arrival_time, scans[number].time))
    on_its_way.reverse()
    for time, group in groupby(scans, key=lambda scan: scan.time):
        given: list[Delivery] = []
        while on_its_way and scans[on_its_way[-1]].arrival_time <= time + SAME_TIME:
            number = on_its_way.pop()
            scan, read = scans[number], reads(scans[number].sensor)
            if read or not late:
                given.append(Delivery(scan if read else emptied(scan), number, read))
        if late and (not given or given[-1].scan.time != time):
            latest = list(group)[-1]
            given.append(Delivery(emptied(latest)._replace(arrival_time=time, asked=True), None, False))
        yield given
