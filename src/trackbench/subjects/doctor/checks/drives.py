"""Does the tracker keep its target on noisy drives, as near as the reference and as near as it states?"""

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

#: Time at the start of a drive that is not judged, s. A track with a state of speed and yaw that started from one
#: measurement needs it to find its course. Where a course becomes unknown in a gap, the velocity is not judged.
SETTLE = 3.0
#: Time after an interval without measurements in which the position is not judged, s.
RECOVERED = 1.0
#: Largest RMS position error, relative to the reference's. In these drives the last measurement alone, unfiltered, has
#: 3 to 6.5; other motion models and fixed gains have up to 4.
FAR = 7.0
#: RMS position error below which no target is far off, m: a third of a car's width.
NEAR = 0.6
#: Bounds of the mean NEES of two components, relative to its expectation of 2. A drive has some 30 independent
#: instants, for which chi-square allows 0.6 to 1.6 (99.9 %). The rest is for motion models other than the target's:
#: constant turn rates at rest have 0.13, nearly constant accelerations on a straight path 8.
NEES = (0.03, 15.0)
#: Ratio of the position errors to those of a filter with the same measurements from which on a gain is harmful, and
#: ratio of the NEES, either way.
HARM, STATED = 1.5, 4.0
#: Length of the interval for which an error is reported, s.
SHOWN = 1.0
PARTS = {"position": slice(0, 2), "velocity": slice(2, 4)}


class Errors(NamedTuple):
    """Errors of a tracker after each scan of a test drive, ``(scans, runs)``; NaN where there is no estimate."""

    distance: Array
    """Distance of the estimated position from the true one, m."""
    nees: dict[str, Array]
    """NEES ``(scans, runs)`` under each of the keys ``position`` and ``velocity``."""


class JudgedDrive(NamedTuple):
    """A test drive with the errors of the tracker and of the reference tracker, and masks of the scans that count."""

    drive: TestDrive
    errors: Errors
    reference: Errors
    scored: Mask
    """Whether the covariance is judged at each scan ``(scans,)``."""
    measured: Mask
    """Whether the position is judged at each scan ``(scans,)``."""

    @property
    def rms(self) -> tuple[float, float]:
        """RMS position errors of the tracker and of the reference, m."""
        return _rms(self.errors.distance[self.measured]), _rms(self.reference.distance[self.measured])

    @property
    def far(self) -> float:
        """RMS position error divided by the largest allowed one; above 1 the tracker is too far off."""
        error, reference_error = self.rms
        return error / max(FAR * reference_error, NEAR)

    def nees(self, part: str) -> float:
        """Return the tracker's mean NEES of the position or velocity where the covariance is judged."""
        return _mean(self.errors.nees[part][self.scored])

    def nees_of_reference(self, part: str) -> float:
        """Return the reference's mean NEES of the position or velocity where the covariance is judged."""
        return _mean(self.reference.nees[part][self.scored])

    @property
    def believable(self) -> bool:
        """Whether the RMS position error and the NEES of position and velocity are within their bounds."""
        return self.far <= 1.0 and not any(self.unbelievable(part) > 1.0 for part in PARTS)

    def unbelievable(self, part: str) -> float:
        """Return the factor by which the NEES of position or velocity is outside its bounds; at most 1 if inside."""
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
            "First at the other checks that failed; then in the named drive at the named time.",
            "Run that drive (the report shows it), and compare the predicted with the measured values at that time.",
            Role("driven", rank=49, drive="manoeuvre"),
        ),
        "covariance_unbelievable": KnownFault(
            "the stated covariance does not fit the errors",
            "At Q and R, and at what happens to the covariance in the named drive at the named time.",
            "Compare the variance that is stated with the squared errors; whatever is not predicted must add its "
            "share to that variance.",
            Role("driven", drive="long_gap"),
        ),
    },
)
def drives(tracker: TrackerUnderTest) -> PartResult:
    """Judge the tracker's errors on every test drive, beside those of a reference tracker on the same measurements."""
    result = PartResult()
    judged = []
    for drive, outcome in tracker.once(judge_drives):
        if isinstance(outcome, StepFailed):
            tracker.failures.append((drive.name, outcome))
            text = f"the tracker failed at {outcome.scan.time:g} s: {outcome}"
            result.add(drive.name, False, text)
        elif not np.isfinite(outcome.rms[0]):
            result.add(drive.name, None, "there is no estimate to judge")
        else:
            judged.append(outcome)
    for judged_drive in judged:
        result.add(judged_drive.drive.name, judged_drive.believable, _text(judged_drive))
    findings = (_too_far_off(judged), _covariance_unbelievable(judged))
    result.findings += [finding for finding in findings if finding is not None]
    return result


def judge_drives(tracker: TrackerUnderTest) -> list[tuple[TestDrive, JudgedDrive | StepFailed]]:
    """Step the tracker through every test drive; return each with its judgement or the step that failed in it."""
    outcomes: list[tuple[TestDrive, JudgedDrive | StepFailed]] = []
    for drive, reference in tracker.drives:
        try:
            estimates = rollout(tracker.make, drive.scans, tracker.output_checks, drive.name)
        except StepFailed as failure:
            outcomes.append((drive, failure))
            continue
        outcomes.append((drive, _judge(drive, estimates, reference)))
    return outcomes


def harmless(tracker: TrackerUnderTest) -> str | None:
    """Return a sentence with numbers if the drives show no harm; None if they show harm, or nothing was driven.

    A gain that does not follow from the returned covariance is a fault only with harm. Harm is a position error above
    1.5 times the one of a Kalman filter with the same measured components. Harm is also a NEES that differs from the
    reference's by a factor of 4 or more.
    """
    outcomes = [outcome for _, outcome in tracker.once(judge_drives)]
    judged = [outcome for outcome in outcomes if isinstance(outcome, JudgedDrive) and outcome.believable]
    if not judged or len(judged) < len(outcomes):
        return None
    references = _with_position_reference(judged) if _uses_positions_alone(tracker) else judged
    ratios = [drive.rms[0] / reference.rms[1] for drive, reference in zip(judged, references, strict=True)]
    error = float(np.exp(np.mean([np.log(ratio) for ratio in ratios])))
    nees_ratios = [
        float(np.exp(np.nanmean([np.log(drive.nees(part) / drive.nees_of_reference(part)) for drive in judged])))
        for part in PARTS
    ]
    nees = max(nees_ratios, key=lambda ratio: abs(np.log(ratio)))
    if error > HARM or not 1.0 / STATED < nees < STATED:
        return None
    return (
        f"in {len(judged)} drives its position errors are {error:.3g} times those of a Kalman filter with the same "
        f"measurements, and its NEES {nees:.3g} times"
    )


def _uses_positions_alone(tracker: TrackerUnderTest) -> bool:
    """Return whether no measurement component that depends on the velocity moves the estimate."""
    updates = [trial.linear_update() for trials in tracker.trials.values() for trial in trials]
    return not any(
        np.any(update.used & np.any(update.trial.jacobian[:, 2:], axis=1)) for update in updates if update is not None
    )


def _with_position_reference(judged: Sequence[JudgedDrive]) -> list[JudgedDrive]:
    make = partial(kf, motion="cv", acceleration_sigma_mps2=3.0, late="drop")
    return [item._replace(reference=_errors(rollout(make, item.drive.scans), item.drive)) for item in judged]


def _judge(drive: TestDrive, estimates: Rollout, reference: Rollout) -> JudgedDrive:
    scored = np.asarray(drive.time > min(SETTLE, 0.5 * drive.config.truth.duration_s))
    measured, errors = scored.copy(), _errors(estimates, drive)
    if drive.config.silent_s is not None:
        begin, end = drive.config.silent_s
        measured &= (drive.time < begin) | (drive.time > end + RECOVERED)
        errors.nees["velocity"][:, _course_unknown(estimates, int(np.searchsorted(drive.time, end)))] = np.nan
    return JudgedDrive(drive, errors, _errors(reference, drive), scored, measured)


def _course_unknown(estimates: Rollout, scan: int) -> Mask:
    """Return in which runs ``(runs,)`` the stated variance of the velocity before a scan exceeds the squared speed."""
    variance = np.einsum("ii...->...", estimates.covariance[2:, 2:, scan - 1])
    return np.asarray(variance > np.sum(estimates.mean[2:, scan - 1] ** 2, axis=0))


def _text(judged: JudgedDrive) -> str:
    error, reference = judged.rms
    nees = {part: judged.nees_of_reference(part) for part in PARTS}
    return (
        f"position RMSE {error:.3g} m, reference {reference:.3g} m; NEES of position {judged.nees('position'):.3g} and "
        f"of velocity {judged.nees('velocity'):.3g} (expected: 2), reference {nees['position']:.3g} and "
        f"{nees['velocity']:.3g}"
    )


def _too_far_off(judged: list[JudgedDrive]) -> Finding | None:
    far_drives = [drive for drive in judged if drive.far > 1.0]
    if not far_drives:
        return None
    worst = max(far_drives, key=lambda drive: drive.far)
    error, reference_error = worst.rms
    begin, within = _interval(worst, worst.errors.distance, worst.measured, largest=True)
    run = int(np.argmax(within.any(axis=0)))
    text = (
        f"in {worst.drive.name} ({worst.drive.config.description}) the position is {error:.3g} m off (RMS of what is "
        f"judged), the reference's {reference_error:.3g} m; most from {begin:.1f} to {begin + SHOWN:.1f} s: "
        f"{_rms(worst.errors.distance[within]):.3g} m against {_rms(worst.reference.distance[within]):.3g} m"
        f" ({len(far_drives)} of {len(judged)} drives)"
    )
    still = [item for item in judged if not item.drive.config.carrier.moves]
    if still and all(item.drive.config.carrier.moves for item in far_drives):
        text += f"; and in none of {len(still)} with an observer that stands still"
        return Finding("ego_motion_wrong", 0.82, text, shown_by=worst.drive.name, run=run)
    return Finding("too_far_off", 0.85, text, factor=error / reference_error, shown_by=worst.drive.name, run=run)


def _covariance_unbelievable(judged: list[JudgedDrive]) -> Finding | None:
    wrong = [(drive, part) for drive in judged for part in PARTS if drive.unbelievable(part) > 1.0]
    if not wrong:
        return None
    worst, part = max(wrong, key=lambda pair: pair[0].unbelievable(pair[1]))
    nees = worst.nees(part)
    begin, within = _interval(worst, worst.errors.nees[part], worst.scored, largest=nees > 2.0)
    run = int(np.argmax(within.any(axis=0)))
    text = (
        f"in {worst.drive.name} ({worst.drive.config.description}) the NEES of the {part} is {nees:.3g} (2 expected), "
        f"the reference's {worst.nees_of_reference(part):.3g}: {_compare_with_errors(nees)}; most from "
        f"{begin:.1f} to {begin + SHOWN:.1f} s: NEES {_mean(worst.errors.nees[part][within]):.3g}"
        f" ({len({drive.drive.name for drive, _ in wrong})} of {len(judged)} drives)"
    )
    fault, name = "covariance_unbelievable", worst.drive.name
    factor = 2.0 / max(nees, 1e-12)
    return Finding(fault, 0.85, text, factor=factor, shown_by=name, run=run)


def _compare_with_errors(nees: float) -> str:
    if nees <= 0.0:
        return "as if the covariance were not positive definite"
    ratio, words = (np.sqrt(nees / 2.0), "smaller") if nees > 2.0 else (np.sqrt(2.0 / nees), "larger")
    return f"the stated standard deviations are {ratio:.3g} times {words} than the errors"


def _interval(judged: JudgedDrive, values: Array, where: Mask, *, largest: bool) -> tuple[float, Mask]:
    """Find the 1 s of a run with the largest or least mean value; return its start, s, and mask ``(scans, runs)``."""
    time = judged.drive.time
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
    finite = values[np.isfinite(values)]
    return float(np.mean(finite)) if finite.size else np.nan


def _rms(distance: Array) -> float:
    return float(np.sqrt(_mean(distance**2)))


def _errors(estimates: Rollout, drive: TestDrive) -> Errors:
    error = estimates.mean - drive.target
    covariance = np.moveaxis(estimates.covariance, (0, 1), (-2, -1))
    finite = np.isfinite(error).all(axis=0) & np.isfinite(covariance).all(axis=(-2, -1))
    nees = {}
    for part, components in PARTS.items():
        e, p = error[components, finite].T, covariance[finite][:, components, components]
        nees[part] = np.full(finite.shape, np.nan)
        nees[part][finite] = np.einsum("ni,nij,nj->n", e, np.linalg.pinv(p), e)
    return Errors(np.where(finite, np.hypot(error[0], error[1]), np.nan), nees)
