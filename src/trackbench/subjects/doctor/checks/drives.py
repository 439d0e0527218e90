"""Does the tracker keep its target on drives with noise, as near as the reference and as near as it states?"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.subjects.doctor.drives import Rollout, TestDrive, drive_configs, rollout
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.session import StepFailed
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.builtin import kf

#: Time at the start of a drive that is not judged, s: with a state of speed and yaw a track that started from one
#: measurement needs it to find its course. Where a course becomes unknown in a gap, the velocity is not judged.
SETTLE = 3.0
#: Time after an interval without measurements in which the position is not judged, s.
RECOVERED = 1.0
#: RMS position error over the reference's. The last measurement alone, unfiltered, has 3 to 6.5 in these drives; other
#: motion models and fixed gains have up to 4.
FAR = 7.0
#: RMS position error below which no target is far off, m: a third of a car's width.
NEAR = 0.6
#: Bounds of the mean NEES of two components over its expectation, 2. The errors of a drive are those of some 30
#: independent instants, of which chi-square allows 0.6 to 1.6 (99.9 %); the rest is for motion models that are not
#: those of the target: constant turn rates at rest have 0.13, nearly constant accelerations on a straight path 8.
NEES = (0.03, 15.0)
#: Ratio of the position errors to those of a filter with the same measurements, and of the NEES either way, from which
#: on a gain is harmful.
HARM, STATED = 1.5, 4.0
#: Length of the interval of which an error is told, s.
SHOWN = 1.0
PARTS = {"position": slice(0, 2), "velocity": slice(2, 4)}


class Errors(NamedTuple):
    """Of each estimate of a drive, ``(scans, runs)``; NaN where there is none."""

    distance: Array
    """Of the estimated position from the true one, m."""
    nees: dict[str, Array]
    """Of the position and of the velocity."""


class JudgedDrive(NamedTuple):
    """A drive that is judged."""

    drive: TestDrive
    errors: Errors
    reference: Errors
    scored: Mask
    """``(scans,)`` where the covariance is judged."""
    measured: Mask
    """``(scans,)`` where the position is."""

    @property
    def rms(self) -> tuple[float, float]:
        """Of the position error of the tracker and of the reference, m."""
        return _rms(self.errors.distance[self.measured]), _rms(self.reference.distance[self.measured])

    @property
    def far(self) -> float:
        """How many times too far off; below 1 where it is not."""
        own, other = self.rms
        return own / max(FAR * other, NEAR)

    def nees(self, part: str) -> float:
        """The mean where the covariance is judged."""
        return _mean(self.errors.nees[part][self.scored])

    def nees_of_reference(self, part: str) -> float:
        """The same of the reference."""
        return _mean(self.reference.nees[part][self.scored])

    @property
    def believable(self) -> bool:
        """Whether the position is not too far off, and both covariances fit the errors."""
        return self.far <= 1.0 and not any(self.unbelievable(part) > 1.0 for part in PARTS)

    def unbelievable(self, part: str) -> float:
        """How many times beyond a bound of the NEES; below 1 where it is within."""
        share = self.nees(part) / 2.0
        return max(NEES[0] / max(share, 1e-12), share / (NEES[1] * self.drive.config.mismatch))


@doctor_check(
    *(
        Question(
            name,
            f"Is the tracker as near to its target as it states ({drive.description})?",
            motion=drive.carrier.moves,
        )
        for name, drive in drive_configs().items()
    ),
    place=230,
    every_drive=True,
    faults={
        "too_far_off": KnownFault(
            "the estimate is too far off",
            "In the named drive at the named time; first at the checks that fail besides.",
            "Run that drive (the report shows it), and compare the predicted with the measured values at that time.",
            Role("driven", rank=49, drive="manoeuvre"),
        ),
        "covariance_unbelievable": KnownFault(
            "the stated covariance does not fit the errors",
            "At Q and R, and at what happens to the covariance in the named drive at the named time.",
            "Compare the variance that is stated with the squared errors; what is not predicted has to add its share "
            "to it.",
            Role("driven", drive="long_gap"),
        ),
    },
)
def drives(tracker: TrackerUnderTest) -> PartResult:
    """Run every test drive, with the measurements that the reference had."""
    result = PartResult()
    judged = []
    for drive, outcome in tracker.once(driven):
        if isinstance(outcome, StepFailed):
            tracker.failures.append((drive.name, outcome))
            text = f"the tracker failed at {outcome.scan.time:g} s: {outcome}"
            result.add(drive.name, False, text)
        elif not np.isfinite(outcome.rms[0]):
            result.add(drive.name, None, "there is no estimate to judge")
        else:
            judged.append(outcome)
    for one in judged:
        result.add(one.drive.name, one.believable, _text(one))
    findings = (_too_far_off(judged), _covariance_unbelievable(judged))
    result.findings += [finding for finding in findings if finding is not None]
    return result


def driven(tracker: TrackerUnderTest) -> list[tuple[TestDrive, JudgedDrive | StepFailed]]:
    """Every test drive, judged, or with the step that failed in it."""
    outcomes: list[tuple[TestDrive, JudgedDrive | StepFailed]] = []
    for drive, reference in tracker.drives:
        try:
            estimates = rollout(tracker.make, drive.scans, tracker.output_checks, drive.name)
        except StepFailed as failure:
            outcomes.append((drive, failure))
            continue
        outcomes.append((drive, _judged(drive, estimates, reference)))
    return outcomes


def harmless(tracker: TrackerUnderTest) -> str | None:
    """That the drives show no harm, with its numbers; None where they do, or nothing was driven.

    A gain that does not follow from the returned covariance is no fault without harm: a position error of `HARM` times
    that of a Kalman filter which uses the same components of the measurements, or a covariance that does not fit the
    errors.
    """
    outcomes = [outcome for _, outcome in tracker.once(driven)]
    judged = [outcome for outcome in outcomes if isinstance(outcome, JudgedDrive) and outcome.believable]
    if not judged or len(judged) < len(outcomes):
        return None
    twins = _of_positions(judged) if _positions_alone(tracker) else judged
    error = float(np.exp(np.mean([np.log(own.rms[0] / twin.rms[1]) for own, twin in zip(judged, twins, strict=True)])))
    of_parts = [
        float(np.exp(np.nanmean([np.log(own.nees(part) / own.nees_of_reference(part)) for own in judged])))
        for part in PARTS
    ]
    nees = max(of_parts, key=lambda ratio: abs(np.log(ratio)))
    if error > HARM or not 1.0 / STATED < nees < STATED:
        return None
    return (
        f"in {len(judged)} drives its position errors are {error:.3g} times those of a Kalman filter with the same "
        f"measurements, and its NEES {nees:.3g} times"
    )


def _positions_alone(tracker: TrackerUnderTest) -> bool:
    """Whether no component that depends on the velocity moves the estimate."""
    updates = [trial.linear_update() for trials in tracker.trials.values() for trial in trials]
    return not any(
        np.any(update.used & np.any(update.trial.jacobian[:, 2:], axis=1)) for update in updates if update is not None
    )


def _of_positions(judged: Sequence[JudgedDrive]) -> list[JudgedDrive]:
    """The drives, with a reference that uses positions alone."""
    twins = [
        rollout(partial(kf, motion="cv", acceleration_sigma_mps2=3.0, late="drop"), own.drive.scans) for own in judged
    ]
    return [own._replace(reference=_errors(twin, own.drive)) for own, twin in zip(judged, twins, strict=True)]


def _judged(drive: TestDrive, estimates: Rollout, reference: Rollout) -> JudgedDrive:
    scored = np.asarray(drive.time > min(SETTLE, 0.5 * drive.config.truth.duration_s))
    measured, errors = scored.copy(), _errors(estimates, drive)
    if drive.config.silent_s is not None:
        begin, end = drive.config.silent_s
        measured &= (drive.time < begin) | (drive.time > end + RECOVERED)
        errors.nees["velocity"][:, _course_unknown(estimates, int(np.searchsorted(drive.time, end)))] = np.nan
    return JudgedDrive(drive, errors, _errors(reference, drive), scored, measured)


def _course_unknown(estimates: Rollout, scan: int) -> Mask:
    """``(runs,)`` whether the velocity before a scan is stated to be less certain than it is large."""
    variance = np.einsum("ii...->...", estimates.covariance[2:, 2:, scan - 1])
    return np.asarray(variance > np.sum(estimates.mean[2:, scan - 1] ** 2, axis=0))


def _text(one: JudgedDrive) -> str:
    own, other = one.rms
    theirs = {part: one.nees_of_reference(part) for part in PARTS}
    return (
        f"position RMSE {own:.3g} m, reference {other:.3g} m; NEES of position {one.nees('position'):.3g} and of "
        f"velocity {one.nees('velocity'):.3g} (expected: 2), reference {theirs['position']:.3g} and "
        f"{theirs['velocity']:.3g}"
    )


def _too_far_off(judged: list[JudgedDrive]) -> Finding | None:
    """The drive in which the position is the farthest beyond the bound."""
    off = [one for one in judged if one.far > 1.0]
    if not off:
        return None
    worst = max(off, key=lambda one: one.far)
    own, other = worst.rms
    begin, within = _interval(worst, worst.errors.distance, worst.measured, largest=True)
    run = int(np.argmax(within.any(axis=0)))
    text = (
        f"in {worst.drive.name} ({worst.drive.config.description}) the position is {own:.3g} m off (RMS of what is "
        f"judged), the reference's {other:.3g} m; most from {begin:.1f} to {begin + SHOWN:.1f} s: "
        f"{_rms(worst.errors.distance[within]):.3g} m against {_rms(worst.reference.distance[within]):.3g} m"
        f" ({len(off)} of {len(judged)} drives)"
    )
    still = [own_drive for own_drive in judged if not own_drive.drive.config.carrier.moves]
    if still and all(own_drive.drive.config.carrier.moves for own_drive in off):
        text += f"; and in none of {len(still)} with an observer that stands still"
        return Finding("ego_motion_wrong", 0.82, text, shown_by=worst.drive.name, run=run)
    return Finding("too_far_off", 0.85, text, factor=own / other, shown_by=worst.drive.name, run=run)


def _covariance_unbelievable(judged: list[JudgedDrive]) -> Finding | None:
    """The drive in which the NEES is the farthest beyond a bound."""
    off = [(one, part) for one in judged for part in PARTS if one.unbelievable(part) > 1.0]
    if not off:
        return None
    worst, part = max(off, key=lambda pair: pair[0].unbelievable(pair[1]))
    nees = worst.nees(part)
    begin, within = _interval(worst, worst.errors.nees[part], worst.scored, largest=nees > 2.0)
    run = int(np.argmax(within.any(axis=0)))
    text = (
        f"in {worst.drive.name} ({worst.drive.config.description}) the NEES of the {part} is {nees:.3g} (2 expected), "
        f"the reference's {worst.nees_of_reference(part):.3g}: {_compared(nees)}; most from "
        f"{begin:.1f} to {begin + SHOWN:.1f} s: NEES {_mean(worst.errors.nees[part][within]):.3g}"
        f" ({len({one.drive.name for one, _ in off})} of {len(judged)} drives)"
    )
    fault, drive = "covariance_unbelievable", worst.drive.name
    factor = 2.0 / max(nees, 1e-12)
    return Finding(fault, 0.85, text, factor=factor, shown_by=drive, run=run)


def _compared(nees: float) -> str:
    """The stated standard deviations, held against the errors."""
    if nees <= 0.0:
        return "as of no positive definite covariance"
    ratio, words = (np.sqrt(nees / 2.0), "smaller") if nees > 2.0 else (np.sqrt(2.0 / nees), "larger")
    return f"the stated standard deviations are {ratio:.3g} times {words} than the errors"


def _interval(one: JudgedDrive, values: Array, where: Mask, *, largest: bool) -> tuple[float, Mask]:
    """The second of a run with the largest or least values: where it begins, s, and its estimates ``(scans, runs)``."""
    time = one.drive.time
    best: tuple[float, float, Mask, int] | None = None
    for begin in np.arange(np.floor(time[where].min()), time[where].max() + 1e-9, SHOWN):
        scans = where & (time >= begin) & (time < begin + SHOWN)
        for run in range(values.shape[1]):
            mean = _mean(values[scans, run])
            if np.isfinite(mean) and (best is None or (mean > best[0]) == largest):
                best = (mean, float(begin), scans, run)
    assert best is not None
    within = np.zeros(values.shape, dtype=bool)
    within[best[2], best[3]] = True
    return best[1], within


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else np.nan


def _rms(distance: Array) -> float:
    return float(np.sqrt(_mean(distance**2)))


def _errors(estimates: Rollout, drive: TestDrive) -> Errors:
    error = estimates.mean - drive.target
    covariance = np.moveaxis(estimates.covariance, (0, 1), (-2, -1))
    known = np.isfinite(error).all(axis=0) & np.isfinite(covariance).all(axis=(-2, -1))
    nees = {}
    for part, components in PARTS.items():
        e, p = error[components, known].T, covariance[known][:, components, components]
        nees[part] = np.full(known.shape, np.nan)
        nees[part][known] = np.einsum("ni,nij,nj->n", e, np.linalg.pinv(p), e)
    return Errors(np.where(known, np.hypot(error[0], error[1]), np.nan), nees)
