"""A tracker that takes a batch is asked several questions in one step, with the answers of one by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from benchmarks.doctor.builtin import ekf_cv, ukf_ctrv
from numpy.testing import assert_allclose
from tests.support.doctor import scans_of, under_test

from trackbench.base.types import Estimate, Scan
from trackbench.subjects.doctor.checks.start import first_estimates
from trackbench.subjects.doctor.output_checks import OutputChecks
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.session import Examined, StepFailed, TrackerSession
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial

PROBE = GENERAL[0]
*FOLLOWED, NEXT = scans_of(PROBE)


class OneByOne:
    """A tracker without batches around one with."""

    def __init__(self, make: Callable[[], Any] = ekf_cv) -> None:
        self.inner = make()

    def step(self, state: Any, scan: Scan) -> Any:
        wide = scan._replace(measurement=scan.measurement[:, None], valid=scan.valid[None])
        state, estimate = self.inner.step(state, wide)
        if np.isnan(estimate.mean).all():
            return state, None
        return state, (estimate.mean[..., 0], estimate.covariance[..., 0])


class Refusing:
    """Raises at a measurement that is far to the left."""

    batched = True

    def __init__(self) -> None:
        self.inner = ekf_cv()

    def step(self, state: Any, scan: Scan) -> Any:
        if np.any(scan.measurement[1] > 45.0):
            raise ValueError("far to the left")
        return self.inner.step(state, scan)


@dataclass
class Drawing:
    """Adds a random number of its own to each column."""

    batched = True
    seed: int = 3

    def __post_init__(self) -> None:
        self.inner, self.random = ekf_cv(), np.random.default_rng(self.seed)

    def step(self, state: Any, scan: Scan) -> Any:
        state, estimate = self.inner.step(state, scan)
        return state, (estimate.mean + self.random.standard_normal(estimate.mean.shape), estimate.covariance)


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
    assert wide.at_once == 3
    wide.step_each(tried)
    assert wide.at_once == 1
    assert [float(wide.given_to(i)[-1].measurement[0]) for i in range(3)] == [float(s.measurement[0]) for s in tried]


def test_a_tracker_without_batches_has_one_column() -> None:
    session = TrackerSession(OneByOne, 7)
    assert session.columns == 1
    same(followed(OneByOne, 7).step(NEXT), followed(ekf_cv).step(NEXT))


def gain_and_steps(make: Callable[[], Any], columns: int) -> tuple[Any, int]:
    steps: list[None] = []
    session = followed(Examined(make, on_step=lambda: steps.append(None)), columns)
    prediction = session.predict(NEXT)
    assert prediction is not None
    trial = Trial("probe", "a probe", NEXT, prediction, session)
    steps.clear()
    update = trial.update(NEXT.measurement)
    assert update is not None
    return update.gain, len(steps)


def test_a_gain_takes_one_step_in_columns() -> None:
    alone, steps = gain_and_steps(ekf_cv, 1)
    together, one = gain_and_steps(ekf_cv, 7)
    assert (steps, one) == (7, 1)
    assert_allclose(together, alone, rtol=1e-6, atol=1e-12)


def test_columns_with_other_random_numbers_are_not_held_against_each_other() -> None:
    gain, steps = gain_and_steps(Drawing, 7)
    assert steps == 7
    assert_allclose(gain, gain_and_steps(ekf_cv, 1)[0], rtol=1e-6, atol=1e-9)


def test_a_step_that_fails_in_one_column_is_taken_one_by_one() -> None:
    class AtOneSide(Refusing):
        """Raises on one side of the measurement."""

        def step(self, state: Any, scan: Scan) -> Any:
            if scan.time == NEXT.time and np.any(scan.measurement[0] > NEXT.measurement[0]):
                raise ValueError("too far")
            return self.inner.step(state, scan)

    session = followed(AtOneSide, 7)
    prediction = session.predict(NEXT)
    assert prediction is not None
    trial = Trial("probe", "a probe", NEXT, prediction, session)
    with pytest.raises(StepFailed):
        session.peek(NEXT._replace(measurement=NEXT.measurement + 1.0))
    assert trial.update(NEXT.measurement) is None
    assert trial.posterior(NEXT.measurement) is not None


def started(make: Callable[[], Any], name: str) -> tuple[list[Any], TrackerUnderTest]:
    tracker = under_test(make)
    return first_estimates(tracker, GENERAL, name, np.random.default_rng(1)), tracker


@pytest.mark.parametrize("name", SENSORS)
def test_tracks_start_together_as_one_by_one(name: str) -> None:
    (together, _), (apart, _) = started(ekf_cv, name), started(OneByOne, name)
    for one, other in zip(together, apart, strict=True):
        same(one.estimate, other.estimate)
        assert one.probe is other.probe
        assert one.scan.time == other.scan.time
        assert len(one.given) == len(other.given)
        assert_allclose(one.truth, other.truth)


def test_one_that_fails_to_start_leaves_the_others() -> None:
    far = GENERAL[0]._replace(name="far", target=(10.0, 60.0, 1.0, 1.0))
    tracker = under_test(Refusing)
    found = first_estimates(tracker, (*GENERAL, far), "lidar")
    assert [one is None for one in found] == [False] * len(GENERAL) + [True]
    ((where, failure),) = tracker.failures
    assert where == "far"
    assert "far to the left" in str(failure)


def test_a_track_is_checked_as_its_estimates_are() -> None:
    session, estimates = TrackerSession(ekf_cv), []
    for scan in FOLLOWED:
        estimates.append(session.step(scan))
    estimates[3] = None
    one, other = OutputChecks(), OutputChecks()
    one.add_track(estimates, FOLLOWED, "probe")
    for k, estimate in enumerate(estimates):
        other.add(estimate, FOLLOWED[k], "probe", FOLLOWED[: k + 1])
    assert one.estimates == other.estimates == len(FOLLOWED) - 1
    for mine, theirs in ((one.asymmetry, other.asymmetry), (one.indefinite, other.indefinite)):
        assert mine is not None
        assert theirs is not None
        assert_allclose(mine.size, theirs.size, rtol=1e-9, atol=1e-15)
        assert mine.time == theirs.time
        assert len(mine.given()) == len(theirs.given())
