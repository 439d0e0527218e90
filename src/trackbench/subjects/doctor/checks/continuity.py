"""Does the next prediction start from the estimate that was returned?

A moment after a measurement a filter states what it returned at it, but for the process noise of a moment. What is the
same with the measurement as at a missed one was not changed by it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import finite, position_sigma
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, after_gap
from trackbench.subjects.doctor.trial import Trial

#: Time without a measurement before the one that is tried, after which it clearly reduces the covariance, s.
GAP = 1.0
#: Time after it, s.
MOMENT = 1e-3
#: Distance of the tried measurement from the predicted one, in standard deviations.
OFFSET = 2.0
#: Change by a measurement that is clear: of the mean in standard deviations, of the covariance in predicted variances.
CLEAR = 0.1
#: Share of that change which is left a moment later; below it, it is lost. A correct filter has 1.
LEFT = 0.5
#: Share of the trials in which it is lost, and least number of them.
MOST, LEAST = 0.7, 3


class KeptChange(NamedTuple):
    """A measurement, and what is left of its change a moment later."""

    trial: Trial
    updated: Estimate
    later: Estimate
    mean: float
    """Share of the change of the mean that is left; NaN where the measurement makes no clear one."""
    covariance: float
    """Share of the change of the covariance that is left; NaN where the measurement makes no clear one."""


@doctor_check(
    Question(
        "continuity",
        "Does the next prediction start from the estimate that was returned?",
        "Does the prediction after a measurement of {sensor} start from the estimate that was returned?",
        each_sensor=True,
        misses=True,
    ),
    place=45,
    of_filters=True,
    asks_at_misses=True,
    faults={
        "update_not_kept": KnownFault(
            "the next prediction does not start from the returned estimate",
            "Where the updated mean and covariance are stored.",
            "Store what is returned: a local x or P, or a copy that is changed, is not the tracker's.",
            Role(rank=14, drive="own_model"),
        )
    },
)
def continuity(tracker: TrackerUnderTest) -> PartResult:
    """Compare the prediction a moment after a measurement with that a moment after a missed one."""
    result, findings = PartResult(), list[Finding]()
    for name in tracker.sensors:
        kept = [one for probe in tracker.probes.general if (one := _kept_change(tracker, probe, name)) is not None]
        finding = _lost(name, kept, "mean") or _lost(name, kept, "covariance")
        shares = [float(np.median(known)) for of in ("mean", "covariance") if len(known := _known(kept, of)) >= LEAST]
        if not shares:
            result.add(f"continuity.{name}", None, "too few measurements change the estimate clearly")
            continue
        left = " and ".join(f"{share:.0%}" for share in shares)
        text = f"{MOMENT:g} s after a measurement {left} of its change of the estimate is left (medians)"
        result.add(f"continuity.{name}", finding is None, text)
        findings += [finding] if finding else []
    # What is lost after every sensor's measurements is stored in one place.
    everywhere = len(findings) == len(tracker.sensors)
    result.findings += [replace(findings[0], sensor=None)] if everywhere else findings
    return result


def _kept_change(tracker: TrackerUnderTest, probe: Probe, name: str) -> KeptChange | None:
    """A measurement off the predicted one, some time after the last."""
    session = tracker.session_of_most(probe)
    trial = None if session is None else after_gap(tracker, probe, name, session, GAP)
    if session is None or trial is None or not trial.usable:
        return None
    measured = trial.scan._replace(measurement=trial.predicted_measurement + OFFSET * trial.sigma)
    with tracker.recording_failures(probe.name):
        updated, later = session.step_and_predict(measured, MOMENT)
        missed, without = session.step_and_predict(empty_scan(measured), MOMENT)
        if updated and later and missed and without and all(map(finite, (updated, later, missed, without))):
            sigma = np.sqrt(np.maximum(np.diag(updated.covariance), np.finfo(float).tiny))
            mean = _share(updated.mean - missed.mean, later.mean - without.mean, sigma)
            covariances = updated.covariance - missed.covariance, later.covariance - without.covariance
            return KeptChange(trial, updated, later, mean, _share(*covariances, trial.variance_scale))
    return None


def _share(change: Array, left: Array, scale: Array) -> float:
    """How much of a change is left: its projection, with both in standard deviations; NaN without a clear change."""
    change, left = change / scale, left / scale
    return float(np.sum(left * change) / np.sum(change**2)) if np.abs(change).max() > CLEAR else np.nan


def _known(kept: list[KeptChange], part: str) -> Array:
    """The shares of the trials with a clear change."""
    return np.array([share for one in kept if np.isfinite(share := getattr(one, part))])


def _lost(name: str, kept: list[KeptChange], part: str) -> Finding | None:
    shares = _known(kept, part)
    if len(shares) < LEAST or np.mean(np.abs(shares) < LEFT) < MOST:
        return None
    one = min(kept, key=lambda one: np.inf if np.isnan(share := getattr(one, part)) else share)
    before, after = map(position_sigma, (one.updated, one.later))
    moved = np.hypot(*(one.later.mean - one.updated.mean)[:2])
    text = (
        f"{MOMENT:g} s after a measurement of {name} {np.median(shares):.0%} of its change of the {part} is left "
        f"(median of {len(shares)} trials, 100 % is right): the position moves by {moved:.2g} m in that time, and its "
        f"standard deviation goes from {before:.3g} to {after:.3g} m ({one.trial.description})"
    )
    return Finding("update_not_kept", 0.95, text, sensor=name, shown_by="own_model")
