"""Trackers that take a batch, and those that cannot be copied, are asked as others are."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from numpy.testing import assert_allclose
from tests.support.doctor import scans_of, under_test

from trackbench.base.types import Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.checks.start import first_estimates
from trackbench.subjects.doctor.checks.steps import failure_findings
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.trackers.builtin import ekf, ukf

ekf_cv = partial(ekf, motion="cv", acceleration_sigma_mps2=3.0)
ukf_ctrv = partial(
    ukf, motion="ctrv", acceleration_sigma_mps2=3.0, yaw_acceleration_sigma_radps2=0.5, initial="two_measurements"
)
PROBE = GENERAL[0]
*FOLLOWED, NEXT = scans_of(PROBE)


class Refusing:
    """Raises at a measurement that is far to the left."""

    batched = True

    def __init__(self) -> None:
        self.inner = ekf_cv()

    def step(self, state: Any, scan: Scan) -> Any:
        if np.any(scan.measurement[1] > 45.0):
            raise ValueError("far to the left")
        return self.inner.step(state, scan)


def followed(make: Callable[[], Any], columns: int = 1) -> TrackerSession:
    session = TrackerSession(make, columns)
    for scan in FOLLOWED:
        session.step(scan)
    return session


def same(one: Estimate | None, other: Estimate | None) -> None:
    assert one is not None
    assert other is not None
    assert_allclose(one.mean, other.mean, rtol=1e-9)
    assert_allclose(one.covariance, other.covariance, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("make", [ekf_cv, ukf_ctrv])
def test_each_column_is_answered_as_alone_and_the_session_stays(make: Callable[[], Any]) -> None:
    wide, alone = followed(make, 3), followed(make)
    tried = [NEXT._replace(measurement=NEXT.measurement + size) for size in (0.0, 0.2, -0.3)]
    for answer, scan in zip(wide.peek_each(tried), tried, strict=True):
        same(answer, alone.peek(scan))
    same(wide.step(NEXT), alone.step(NEXT))
    assert wide.peek_limit == 3
    wide.step_each(tried)
    assert wide.peek_limit == 1
    assert [float(wide.scans_of(i)[-1].measurement[0]) for i in range(3)] == [float(s.measurement[0]) for s in tried]


def test_one_that_fails_to_start_leaves_the_others() -> None:
    far = GENERAL[0]._replace(name="far", target=(10.0, 60.0, 1.0, 1.0))
    tracker = under_test(Refusing)
    found = first_estimates(tracker, (*GENERAL, far), "lidar")
    assert [one is None for one in found] == [False] * len(GENERAL) + [True]
    ((where, failure),) = tracker.failures
    assert where == "far"
    assert "far to the left" in str(failure)


class Locked(PlainEkf):
    """With a lock, of which there is no copy."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.lock = threading.Lock()


class Generating(PlainEkf):
    """Keeps its track in a generator."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.steps = self.run()
        next(self.steps)

    def run(self) -> Iterator[Any]:
        state, scan = None, (yield None)
        while True:
            state, answer = super().step(state, scan)
            scan = yield answer

    def step(self, state: Any, scan: Any) -> tuple[Any, Any]:
        return None, self.steps.send(scan)


class Counting(Locked):
    """Estimates by how many of its kind there have been."""

    made = 0

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        type(self).made += 1

    def output(self, x: Any, P: Any) -> Any:
        return x + self.made, P


@pytest.mark.parametrize("kind", [Locked, Generating])
def test_what_cannot_be_copied_is_repeated(kind: type) -> None:
    repeated, copied = TrackerSession(kind), TrackerSession(PlainEkf)
    *first, last = scans_of(GENERAL[0])
    for scan in first:
        repeated.step(scan)
        copied.step(scan)
    for tried in (empty_scan(last), last, last._replace(measurement=last.measurement + 0.5), last):
        one, other = repeated.peek(tried), copied.peek(tried)
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.mean, other.mean)
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert copied.not_copied is None
    assert repeated.not_copied is not None
    assert repeated.not_copied.startswith("TypeError: cannot pickle")


def test_an_unrepeatable_tracker_without_a_copy_has_one_finding() -> None:
    tracker = under_test(Counting)
    assert tracker.trial(GENERAL[0], "radar", ("radar",)) is None
    (finding,) = failure_findings(tracker)
    assert finding.fault == "not_deterministic"
    assert finding.evidence.startswith("it cannot be copied (TypeError: cannot pickle")


class Handled(PlainEkf):
    """Its tracks are behind a handle, as those of a library in C are."""

    tracks: ClassVar[list[Any]] = []

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.handle = len(self.tracks)
        self.tracks.append(None)

    def step(self, state: Any, scan: Any) -> tuple[Any, Any]:
        self.tracks[self.handle], answer = super().step(self.tracks[self.handle], scan)
        return None, answer


class Freeing(Handled):
    """Its destructor frees the track."""

    def __del__(self) -> None:
        self.tracks[self.handle] = "freed"


@pytest.mark.parametrize("kind", [Handled, Freeing])
def test_a_state_behind_a_handle_is_not_taken_for_a_copy(kind: type) -> None:
    handled, plain = TrackerSession(kind), TrackerSession(PlainEkf)
    *first, last = scans_of(GENERAL[0])
    for scan in first:
        one, other = handled.step(scan), plain.step(scan)
        assert (one is None) == (other is None)
    assert plain.not_copied is None
    for tried in (empty_scan(last), last._replace(measurement=last.measurement + 0.5), last):
        one, other = handled.peek(tried), plain.peek(tried)
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.mean, other.mean)
        assert plain.not_copied is None
        assert handled.not_copied
    one, other = handled.step(last), plain.step(last)
    assert one is not None
    assert other is not None
    np.testing.assert_array_equal(one.mean, other.mean)
