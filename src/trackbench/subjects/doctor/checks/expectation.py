"""Does the tracker predict the right measurement of the target that it estimates?

Measurement models with a known fault explain wrong innovations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackbench.base.types import Array
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.expected_gain import linearised_gain
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.samples import sampling_noise
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import ZERO, Trial
from trackbench.subjects.doctor.wrong_models import WrongModel, wrong_models

#: Standard errors by which random samples of a tracker raise the limit of an innovation.
ERRORS = 3.0
#: Least share of the trials in which the innovation of a model must be zero.
MOST = 0.85
#: Least singular value of a gain, relative to the largest, below which a direction moves nothing; value that the right
#: gain must have; and least number of trials.
NO_GAIN, CLEAR_GAIN, LEAST = 1e-6, 1e-3, 3
EGO_MOTION = ("ego_motion_ignored", "ego_motion_wrong")


@doctor_check(
    Question(
        "expectation",
        "Is the right measurement predicted for the tracker's own estimate?",
        "Does the tracker predict the right measurement of {sensor} for its own estimate?",
        each_sensor=True,
    ),
    Question(
        "ego_motion",
        "Do the measurements of a moving observer count for where it is and how it moves?",
        motion=True,
        finds=EGO_MOTION,
    ),
    place=130,
    of_filters=True,
    faults={
        "axis_swapped": KnownFault(
            "two axes are swapped",
            "Where measurements are read and where the estimate is returned (px, py, vx, vy).",
            "x is along the boresight and y to its left; the azimuth starts at x; the estimate's order is px, py, vx, "
            "vy.",
            Role("exact", rank=7, drive="tangential_pass"),
        ),
        "axis_mirrored": KnownFault(
            "an axis points the wrong way",
            "Where the measurements of this sensor are read.",
            "y is to the left of the boresight, and azimuths are counter-clockwise.",
            Role("exact", rank=8, drive="azimuth_crossing"),
        ),
        "arctan_quadrant": KnownFault(
            "arctan is used instead of arctan2",
            "Where an angle is computed from two components, such as the predicted azimuth or the course of a new "
            "track.",
            "Use arctan2(y, x); arctan(y / x) gives the same angle for a target ahead and for the opposite one behind.",
            Role("exact", rank=12, drive="azimuth_crossing"),
        ),
        "doppler_sign": KnownFault(
            "the range rate has the wrong sign",
            "Where the range rate is predicted, and where the measurement is read.",
            "The range rate is positive if the target moves away: (p . v) / |p|, with p and v relative to the sensor.",
            Role("exact", rank=13, drive="radial_approach"),
        ),
        "speed_for_range_rate": KnownFault(
            "the range rate is not predicted as the velocity along the line of sight",
            "Where the third component of a radar's measurement is predicted.",
            "Predict the component of the relative velocity along the line of sight, (p . v) / |p|, not its length.",
            Role("exact", rank=14, drive="tangential_pass"),
        ),
        "degrees_for_radians": KnownFault(
            "degrees and radians are mixed up",
            "Where azimuths, yaws and their standard deviations are read.",
            "Measurements, poses and noise are in radians here; convert once, where they enter the tracker, if at all.",
            Role("exact", rank=9, drive="azimuth_crossing"),
        ),
        "ego_motion_ignored": KnownFault(
            "the sensor's own pose or velocity is left out",
            "Where measurements are converted to the fixed frame, and where the range rate is predicted.",
            "Use scan.sensor_pose (position and yaw) for positions, and subtract scan.sensor_velocity from the "
            "target's velocity. A velocity that is kept or returned in the sensor's frame gives the same symptom.",
            Role("ego", rank=10, drive="moving_observer"),
        ),
        "ego_motion_wrong": KnownFault(
            "the sensor's own pose or velocity is applied wrongly",
            "Where measurements are converted to the fixed frame, and where the range rate is predicted.",
            "Subtract scan.sensor_velocity from the target's velocity, both in the fixed frame, and take the component "
            "along the line of sight: u @ (v - scan.sensor_velocity); turn positions by scan.sensor_pose[2].",
            Role("exact ego", rank=10, drive="moving_observer"),
        ),
        "sensor_pose_ignored": KnownFault(
            "the pose of a sensor that stands still is left out",
            "Where measurements are converted to the fixed frame, and where they are predicted.",
            "Turn by the sensor's yaw and add its position: scan.sensor_pose has both, observer and mounting combined.",
            Role("exact ego", rank=11, drive="stationary"),
        ),
        "measurement_ignored": KnownFault(
            "measurements of a sensor, or one of their components, do not move the estimate",
            "For all measurements: where the tracker chooses its update by the sensor's name or kind, and gates. For "
            "one component: where the gain is computed.",
            "Compare scan.kind with the right word, and let no column of the gain be zero.",
            Role("exact", rank=28, drive="manoeuvre"),
        ),
    },
)
def expectation(tracker: TrackerUnderTest) -> PartResult:
    """Try measurements predicted by right and wrong models, to find the model that the tracker itself predicts with."""
    result = PartResult()
    for sensor, trials in tracker.trials.items():
        zero = ZERO + ERRORS * tracker.once(sampling_noise) if trials else ZERO
        result.add(f"expectation.{sensor}", *_examine_sensor(tracker, sensor, trials, zero))
    ego_motion = [finding for finding in result.findings if finding.fault in EGO_MOTION]
    if tracker.assumptions.rest_reason:
        # A tracker can leave out only the pose of a sensor that stands still.
        for finding in (item for item in ego_motion if item.fault == "ego_motion_ignored"):
            result.findings[result.findings.index(finding)] = replace(finding, fault="sensor_pose_ignored")
        return result
    moving = _moving_probes(tracker)
    trials = [trial for of_sensor in tracker.trials.values() for trial in of_sensor if trial.name in moving]
    if not trials:
        return result.add("ego_motion", None, "there was no estimate")
    largest = max(_innovation(trial, trial.predicted_measurement) for trial in trials)
    text = f"from moving observers the largest innovation of the predicted measurement is {largest:.2f} sigma"
    return result.add("ego_motion", not ego_motion, text)


def _moving_probes(tracker: TrackerUnderTest) -> set[str]:
    return {probe.name for probe in tracker.probes.regular if probe.observer.moves}


def _examine_sensor(
    tracker: TrackerUnderTest, sensor: str, trials: Sequence[Trial], zero: float
) -> tuple[bool | None, str, Finding | None]:
    if not trials:
        return None, "there was no estimate", None
    kind = trials[0].scan.kind
    # A step that fails does not say what its update would be.
    answered = [
        trial
        for trial in trials
        if any(trial.posterior(z) is not None for z in (trial.predicted_measurement, trial.scan.measurement))
    ]
    if not answered:
        return None, f"no measurement of {sensor} gives an estimate, in any of {len(trials)} trials", None
    # A trial in which no measurement moves the estimate is left out, unless none does in any trial.
    moved = [trial for trial in answered if _moves(trial, kind)]
    if not moved:
        text = f"no measurement of {sensor} moves the estimate, in any of {len(answered)} trials"
        return False, text, Finding("measurement_ignored", 0.99, text, sensor=sensor)
    if (unused := _unused_direction(sensor, moved)) is not None:
        return False, unused.evidence, unused
    innovations = np.array([_innovation(trial, trial.predicted_measurement) for trial in moved])
    right, moving = innovations < zero, np.array([trial.name in _moving_probes(tracker) for trial in moved])
    groups = [group for group in (right, right[moving]) if len(group)]
    if min(float(np.mean(group)) for group in groups) >= MOST:
        return True, f"the largest innovation of the predicted measurement is {np.nanmax(innovations):.2f} sigma", None
    worst = moved[int(np.nanargmax(np.where(np.isfinite(innovations), innovations, -1.0)))]
    text = (
        f"in {np.sum(~right)} of {len(moved)} trials the predicted measurement has an innovation, of "
        f"{np.nanmedian(innovations[~right]):.3g} sigma in their median (largest: {worst.description})"
    )
    finding = _wrong_model(sensor, kind, moved, zero)
    return False, text, finding


def _unused_direction(sensor: str, trials: Sequence[Trial]) -> Finding | None:
    """Report that one direction of the measured position does not move the estimate."""
    lost = []
    for trial in trials:
        update, of_position = trial.update(trial.predicted_measurement), ~np.any(trial.jacobian[:, 2:], axis=1)
        if update is not None and update.used.any() and np.sum(of_position) == 2:
            expected = (linearised_gain(trial) * trial.gain_scale)[:, of_position]
            shares = [_singular_ratio(gain) for gain in (update.relative_gain[:, of_position], expected)]
            lost.append((shares[0] < NO_GAIN and shares[1] > CLEAR_GAIN, trial, update))
    if len(lost) < LEAST or np.mean([unused for unused, *_ in lost]) < MOST:
        return None
    trial, update = next((trial, update) for unused, trial, update in lost if unused)
    of_position = ~np.any(trial.jacobian[:, 2:], axis=1)
    # The measured direction that moves nothing, in the fixed frame.
    direction = np.linalg.svd(update.gain[:, of_position])[2][-1]
    unit = np.linalg.solve(trial.jacobian[of_position, :2], direction)
    unit = unit / np.linalg.norm(unit)
    text = (
        f"one component of the position from {sensor} moves nothing, the one along ({unit[0]:.3g}, "
        f"{unit[1]:.3g}) for {trial.description}: the gain has one direction only ({len(lost)} trials)"
    )
    return Finding("measurement_ignored", 0.96, text, sensor=sensor, shown_by=trial.name)


def _singular_ratio(gain: Array) -> float:
    values = np.linalg.svd(gain, compute_uv=False)
    return float(values[-1] / max(values[0], np.finfo(float).tiny))


def _wrong_model(sensor: str, kind: str, trials: Sequence[Trial], zero: float) -> Finding | None:
    shares = [(_share_without_innovation(trials, model, zero), model) for model in wrong_models(kind)]
    share, model = shares[0]
    for better, simplest in shares[1:]:
        if better > share + 1e-9:
            share, model = better, simplest
    if share < MOST:
        return None
    clearest = max(trials, key=lambda trial: float(np.max(_deviation(trial, model))))
    used, right = _measured(clearest, model), clearest.predicted_measurement
    differing = np.flatnonzero(_deviation(clearest, model) > 0.5)
    numbers = ", ".join(
        f"{SENSOR_MODELS[kind].components[i].replace('_', ' ')} {used[i]:.4g} is predicted and {right[i]:.4g} is right"
        for i in (differing if len(differing) else [0])
    )
    text = (
        f"{model.description}: of {clearest.description}, {numbers}; the former has no innovation in {share:.0%} of "
        f"{len(trials)} trials, the latter has one"
    )
    return Finding(model.fault, 0.6 + 0.39 * share, text, sensor=sensor, shown_by=clearest.name)


def _share_without_innovation(trials: Sequence[Trial], model: WrongModel, zero: float) -> float:
    """Return the share of trials in which a model's prediction has no innovation; 0 if the share is below 85 %."""
    remaining = len(trials)
    for trial in trials:
        remaining -= _innovation(trial, _measured(trial, model)) >= zero
        if remaining / len(trials) < MOST:
            return 0.0
    return remaining / len(trials)


def _innovation(trial: Trial, measurement: Array) -> float:
    """Return the largest component of the innovation that an update applied, in sigma; infinite where unknown."""
    update = trial.update(measurement)
    if update is None or not update.used.any():
        return np.inf
    size = float(np.nanmax(np.abs(update.innovation)))
    return size if np.isfinite(size) else np.inf


def _measured(trial: Trial, model: WrongModel) -> Array:
    return model.measure(trial.prediction.mean, trial.scan)


def _deviation(trial: Trial, model: WrongModel) -> Array:
    """Return the magnitudes ``(m,)`` of a wrong model's predicted measurement minus the right one, in sigma."""
    return np.asarray(np.abs(_measured(trial, model) - trial.predicted_measurement) / trial.sigma)


def _moves(trial: Trial, kind: str) -> bool:
    measurements = [trial.predicted_measurement, trial.scan.measurement]
    measurements += [_measured(trial, model) for model in wrong_models(kind)]
    updates = (trial.update(measurement) for measurement in measurements)
    return any(
        update is not None and update.used.any() and np.abs(update.relative_gain).max() > 1e-9 for update in updates
    )
