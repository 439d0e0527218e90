"""A tracker that ``copy.deepcopy`` cannot copy is asked through fresh ones that are given the same scans again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from benchmarks.doctor.plain_ekf import PlainEkf
from tests.support.doctor import scans_of, under_test

from trackbench.driving.alone import Alone, CannotCopy
from trackbench.driving.drive import empty_scan
from trackbench.driving.isolation import Isolation
from trackbench.driving.remote import fresh
from trackbench.subjects.doctor.checks.steps import failure_findings
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.trackers.config import PluginConfig


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


def test_what_can_neither_be_copied_nor_repeated_says_so() -> None:
    alone = Alone(Counting)
    for scan in scans_of(GENERAL[0])[:6]:
        alone.step(scan)
    with pytest.raises(
        CannotCopy, match=r"^it cannot be copied \(TypeError: .*same 6 scans differs by up to 1 m or m/s$"
    ):
        alone.copy()


def test_in_its_own_process_too(tmp_path: Path, write_module: Callable[[Path, str], str]) -> None:
    code = (
        "import threading\nimport numpy as np\n\n\nclass T:\n    def __init__(self):\n"
        "        self.lock, self.total = threading.Lock(), 0.0\n\n    def step(self, state, scan):\n"
        "        self.total += np.nansum(scan.measurement)\n        return None, (np.full(4, self.total), np.eye(4))\n"
    )
    make = fresh(PluginConfig(use=f"{write_module(tmp_path, code)}:T"), tmp_path, Isolation(timeout=30))
    session = TrackerSession(make)
    one, two, three = scans_of(GENERAL[0], ("lidar",))[:3]
    session.step(one)
    session.step(two)
    total = float(one.measurement.sum() + two.measurement.sum())
    for tried, more in ((empty_scan(three), 0.0), (three, float(three.measurement.sum())), (empty_scan(three), 0.0)):
        estimate = session.peek(tried)
        assert estimate is not None
        np.testing.assert_allclose(estimate.mean, total + more, rtol=1e-15)
    assert session.not_copied is not None
    assert "cannot pickle" in session.not_copied


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
