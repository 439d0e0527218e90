"""The one loop that takes a tracker through scans, of one object or of several."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from trackbench.base.types import SAME_TIME, Indices, Scan
from trackbench.driving.steppers import Offline, Stepper, Traits
from trackbench.engine.choice import Engine, seconds_on_kernels
from trackbench.engine.equations import EngineUsed

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


class TrackerDrive(Generic[Answer]):
    """A tracker's way through scans; iterating takes the steps, and the tracker ends with the context.

    Whatever the tracker raises is raised by the iteration; ``instant`` and ``sensor`` say where.

    Args:
        start: gives the tracker; called when the context is entered.
        scans: in the order in which they were taken.
        sensors: names of those that the tracker reads; None: all.
        engine: whose making of kernels is left out of the times.
        origins: of each scan ``(2, D, runs)`` the object that each detection stems from and the second one of a
            merged detection, where identities are hidden.
        after: called after each step, with the tracker and its delivery.
        given: makes of a scan the one that the tracker is given, such as one of several copies.
        each_measurement: as of ``deliveries``.
    """

    def __init__(
        self,
        start: Callable[[], Stepper],
        scans: Sequence[Scan],
        sensors: Collection[str] | None = None,
        *,
        engine: Engine = "numpy",
        origins: Sequence[Indices] | None = None,
        after: Callable[[Any, Delivery], None] | None = None,
        given: Callable[[Scan], Scan] | None = None,
        each_measurement: bool = False,
    ) -> None:
        self._start, self._scans, self._sensors, self._engine = start, scans, sensors, engine
        self._origins, self._after, self._given = origins, after, given
        self._each_measurement = each_measurement
        self.stepper: Stepper | None = None
        """The tracker, once the context is entered."""
        self.instant = 0
        """Number of the latest instant."""
        self.sensor: str | None = None
        """Of the latest scan; None before the first step."""
        self.engine_used: EngineUsed | None = None
        """What computed a built-in tracker, once the context is left."""
        self._resumes = 0

    def __enter__(self) -> TrackerDrive[Answer]:
        self.stepper = self._start()
        return self

    def skip(self, instants: int) -> None:
        """Leave out instants before the next step: the tracker was taken through them otherwise."""
        self.instant += instants
        self._resumes = self.instant + 1

    @property
    def traits(self) -> Traits:
        """What the tracker says of itself, once the context is entered."""
        assert self.stepper is not None
        return self.stepper.traits

    def __exit__(self, *_: object) -> None:
        assert self.stepper is not None
        self.engine_used = self.stepper.engine_used
        self.stepper.close()

    def deliveries(self) -> Iterator[list[Delivery]]:
        """What the tracker gets at each instant."""
        scans = [scan.prompt() for scan in self._scans] if isinstance(self.stepper, Offline) else self._scans
        return deliveries(scans, self._sensors, self._each_measurement)

    def __iter__(self) -> Iterator[DriveStep[Answer]]:
        tracker: Any = self.stepper
        offline = isinstance(tracker, Offline)
        for instant, group in enumerate(self.deliveries()):
            if instant < self._resumes:
                continue
            self.instant = instant
            for place, delivery in enumerate(group):
                self.sensor = delivery.scan.sensor
                if self._given is not None:
                    delivery = delivery._replace(scan=self._given(delivery.scan))
                identities = self._identities(delivery)
                begin, making = time.perf_counter(), seconds_on_kernels(self._engine)
                answer = tracker.step(delivery.scan, *identities)
                seconds = time.perf_counter() - begin - (seconds_on_kernels(self._engine) - making)
                if self._after is not None:
                    self._after(tracker, delivery)
                last = place == len(group) - 1
                yield DriveStep(instant, *delivery, answer, math.nan if offline else seconds, last)

    def _identities(self, delivery: Delivery) -> tuple[Indices, ...]:
        """Of the detections of a scan, where they are hidden."""
        if self._origins is None:
            return ()
        if delivery.read and delivery.number is not None:
            return (self._origins[delivery.number],)
        return (self._origins[0][:, :0],)
