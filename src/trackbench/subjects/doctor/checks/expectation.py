"""Does the tracker predict the right measurement of the target that it estimates?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackbench.base.types import Array
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.kind_of_filter import sampling_noise
from trackbench.subjects.doctor.right_answers import measurement_shown, update_shown
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import ZERO, Trial
from trackbench.subjects.doctor.wrong_models import WrongModel, systematic_error, wrong_models

#: Standard errors of a tracker's own samples by which it is larger.
ERRORS = 3.0
#: Distance from its prediction of the measurement that is drawn where none has an effect, in standard deviations.
ASIDE = 2.0
#: Share of the trials in which the innovation of the right model must be zero.
MOST = 0.85


def expectation(tracker: TrackerUnderTest) -> PartResult:
    """Try the measurements that the right and the wrong models predict, to find the one that has no innovation."""
    result = PartResult()
    for sensor, trials in tracker.trials.items():
        if not trials:
            result.add(f"expectation.{sensor}", None, "there was no estimate")
            continue
        _examine(sensor, trials, ZERO + ERRORS * tracker.once(sampling_noise), result)
    ego_motion = [finding for finding in result.findings if finding.fault == "ego_motion_ignored"]
    if tracker.assumptions.still:
        # Of a sensor that stands still the pose alone can be left out.
        result.findings = [
            replace(finding, fault="sensor_pose_ignored") if finding in ego_motion else finding
            for finding in result.findings
        ]
        return result
    moving = {probe.name for probe in tracker.probes.regular if probe.observer.moves}
    trials = [trial for of in tracker.trials.values() for trial in of if trial.name in moving]
    if not trials:
        return result.add("ego_motion", None, "there was no estimate")
    largest = max(_innovation(trial, trial.predicted_measurement) for trial in trials)
    text = f"from moving observers the largest innovation of the predicted measurement is {largest:.2f} sigma"
    return result.add("ego_motion", not ego_motion, text)


def _examine(sensor: str, trials: Sequence[Trial], zero: float, result: PartResult) -> None:
    kind, name = trials[0].scan.kind, f"expectation.{sensor}"
    answered = [trial for trial in trials if _answers(trial)]
    if not answered:
        text = f"no measurement of {sensor} gives an estimate, in any of {len(trials)} trials"
        result.add(name, None, text)
        return
    if not any(_moves(trial, kind) for trial in answered):
        text = f"no measurement of {sensor} moves the estimate, in any of {len(answered)} trials"
        exhibit = update_shown(answered[0], answered[0].predicted_measurement + ASIDE * answered[0].sigma)
        result.add(name, False, text, Finding("measurement_ignored", 0.99, text, sensor=sensor, exhibit=exhibit))
        return
    innovations = np.array([_innovation(trial, trial.predicted_measurement) for trial in trials])
    if float(np.mean(innovations < zero)) >= MOST:
        text = f"the largest innovation of the predicted measurement is {np.nanmax(innovations):.2f} sigma"
        result.add(name, True, text)
        return
    finding = _wrong_model(sensor, kind, trials, zero) or systematic_error(sensor, trials, zero)
    worst = trials[int(np.nanargmax(np.where(np.isfinite(innovations), innovations, -1.0)))]
    text = (
        f"in {np.sum(~(innovations < zero))} of {len(trials)} trials the predicted measurement has an innovation, of "
        f"{np.nanmedian(innovations):.3g} sigma in the median (largest: {worst.description})"
    )
    result.add(name, False, text, finding)


def _wrong_model(sensor: str, kind: str, trials: Sequence[Trial], zero: float) -> Finding | None:
    best: tuple[float, WrongModel] | None = None
    for model in wrong_models(kind):
        quiet = float(np.mean([_innovation(trial, _measured(trial, model)) < zero for trial in trials]))
        if best is None or quiet > best[0] + 1e-9:
            best = (quiet, model)
    assert best is not None
    share, model = best
    if share < MOST:
        return None
    clearest = max(trials, key=lambda trial: float(np.max(_deviation(trial, model))))
    used, right = _measured(clearest, model), clearest.predicted_measurement
    names = SENSOR_MODELS[kind].components
    differing = np.flatnonzero(_deviation(clearest, model) > 0.5)
    numbers = ", ".join(
        f"{names[i].replace('_', ' ')} {used[i]:.4g} is predicted and {right[i]:.4g} is right"
        for i in (differing if len(differing) else [0])
    )
    text = (
        f"{model.description}: of {clearest.description}, {numbers}; the former has no innovation in {share:.0%} of "
        f"{len(trials)} trials, the latter has one"
    )
    exhibit = measurement_shown(clearest, used, 0.5)
    return Finding(model.fault, 0.6 + 0.39 * share, text, sensor=sensor, shown_by=clearest.name, exhibit=exhibit)


def _innovation(trial: Trial, measurement: Array) -> float:
    """The largest component of the innovation that is applied to a measurement, in sigma; infinite where unknown."""
    update = trial.update(measurement)
    if update is None or not update.used.any():
        return np.inf
    size = float(np.nanmax(np.abs(update.innovation)))
    return size if np.isfinite(size) else np.inf


def _measured(trial: Trial, model: WrongModel) -> Array:
    return model.measure(trial.prediction.mean, trial.scan)


def _deviation(trial: Trial, model: WrongModel) -> Array:
    """``(m,)`` of a wrong model's prediction from the right one, in sigma."""
    return np.asarray(np.abs(_measured(trial, model) - trial.predicted_measurement) / trial.sigma)


def _answers(trial: Trial) -> bool:
    """Whether there is an estimate after a measurement: a step that fails says nothing of what it would do."""
    return any(trial.posterior(one) is not None for one in (trial.predicted_measurement, trial.scan.measurement))


def _moves(trial: Trial, kind: str) -> bool:
    tried = [trial.predicted_measurement, trial.scan.measurement]
    tried += [_measured(trial, model) for model in wrong_models(kind)]
    updates = (trial.update(measurement) for measurement in tried)
    return any(
        update is not None and update.used.any() and np.abs(update.relative_gain).max() > 1e-9 for update in updates
    )


EXPECTATION_CHECK = DoctorCheck(
    expectation,
    place=130,
    questions=(
        Question(
            "expectation",
            "Is the right measurement predicted for the own estimate?",
            "Does the tracker predict the right measurement of {sensor} for its own estimate?",
            each_sensor=True,
        ),
        Question(
            "ego_motion",
            "Do the measurements of a moving observer count for where it is and how it moves?",
            motion=True,
            finds=("ego_motion_ignored",),
        ),
    ),
    of_filters=True,
    faults={
        "doppler_sign": KnownFault(
            "the range rate has the wrong sign",
            "Where the range rate is predicted, and where the measurement is read.",
            "The range rate is positive if the target moves away: (p . v) / |p|, with p and v relative to the sensor.",
            Role("exact", rank=13, causes="measured", drive="radial_approach"),
        ),
        "speed_for_range_rate": KnownFault(
            "the range rate is predicted as the speed",
            "Where the third component of a radar's measurement is predicted.",
            "Predict the component of the relative velocity along the line of sight, (p . v) / |p|, not its length.",
            Role("exact", rank=14, causes="measured", drive="tangential_pass"),
        ),
        "degrees_for_radians": KnownFault(
            "degrees and radians are mixed up",
            "Where azimuths, yaws and their standard deviations are read.",
            "Measurements, poses and noise are in radians here; convert once, where they enter the tracker, if at all.",
            Role("exact", rank=9, causes="measured noise angle arctan_quadrant", drive="azimuth_crossing"),
        ),
        "ego_motion_ignored": KnownFault(
            "the sensor's own pose or velocity is left out",
            "Where measurements are converted to the fixed frame, and where the range rate is predicted.",
            "Use scan.sensor_pose (position and yaw) for positions, and subtract scan.sensor_velocity from the "
            "target's velocity.",
            Role("exact ego", rank=10, causes="measured noise arctan_quadrant", drive="moving_observer"),
        ),
        "sensor_pose_ignored": KnownFault(
            "the pose of a sensor that stands still is left out",
            "Where measurements are converted to the fixed frame, and where they are predicted.",
            "Turn by the sensor's yaw and add its position: scan.sensor_pose has both, of the observer and the "
            "mounting together.",
            Role("exact ego", rank=11, causes="measured noise angle polar_start arctan_quadrant", drive="stationary"),
        ),
        "measurement_ignored": KnownFault(
            "the measurements of a sensor are never used",
            "Where the tracker chooses its update by the sensor's name or kind.",
            "Check that scan.kind is compared with the right word, that the gain is not zero, and that no gate rejects "
            "all.",
            Role("exact", rank=44, causes="nonfinite", drive="manoeuvre"),
        ),
        "sensor_bias": KnownFault(
            "the measurements of a sensor have a constant bias",
            "Where the measurements of this sensor are read, and where its mounting is applied.",
            "Look for an offset that is added or missing (calibration, mounting), and correct it.",
            Role("offset", rank=31, causes="numerical gain overconfident_start", drive="own_model"),
        ),
        "scale_error": KnownFault(
            "the measurements of a sensor are scaled by a constant",
            "Where the measurements of this sensor are read, and where units are converted.",
            "Look for a factor that is applied or missing (a unit, a calibration), and correct it.",
            Role("offset", rank=32, causes="numerical gain overconfident_start", drive="radial_approach"),
        ),
    },
)
