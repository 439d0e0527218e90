"""Do the tracker's gains and covariances imply the right Jacobian and measurement noise?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.checks.equations import equation_answers
from trackbench.subjects.doctor.checks.implied_noise import DIRECTION, ERRORS, noise_factors, wrong_noise
from trackbench.subjects.doctor.expected_gain import ImpliedModel, SamplingErrors, average, gain_error, implied_model
from trackbench.subjects.doctor.findings import CERTAIN, Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.samples import sampling_noise
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, learned_offsets, linearises
from trackbench.subjects.doctor.trial import Trial

#: Relative spread of the noise factors of all sensors up to which they are one factor.
SAME_FACTOR = 0.1


def merge_wrong_gains(result: PartResult, tracker: TrackerUnderTest) -> PartResult:
    """Replace ``jacobian_wrong`` findings by one ``gain_inconsistent`` if each of several sensors has one."""
    wrong = [finding for finding in result.findings if finding.fault == "jacobian_wrong"]
    if len(wrong) < 2 or len(wrong) < len(tracker.sensors):
        return result
    text = f"the gains of all sensors are wrong, as with a wrong Jacobian: {wrong[0].evidence}"
    of_sensors = replace(wrong[0], fault="gain_inconsistent", sensor=None, evidence=text)
    return PartResult(result.checks, [of_sensors, *(finding for finding in result.findings if finding not in wrong)])


def excuse_inflation(tracker: TrackerUnderTest, result: PartResult) -> PartResult:
    """Drop findings that all sensors' noise is too large by one factor, if the test drives show no harm.

    The gains are then those of the stated noise, and follow from a smaller covariance than the returned one.
    """
    large = [finding for finding in result.findings if finding.fault == "r_too_large"]
    factors = [finding.factor for finding in large]
    sizes = np.array([factor for factor in factors if factor is not None])
    everywhere = len(sizes) == len(result.findings) == len(tracker.sensors) > 1
    if not everywhere or np.ptp(sizes) > SAME_FACTOR * sizes.min() or (harm := tracker.once(harmless)) is None:
        return result
    text = f"the returned covariance is {np.median(sizes):.3g} times the one used for the gains, and harmless: {harm}"
    return PartResult([replace(check, passed=True, result=text) for check in result.checks])


#: Largest ratio of a row's length to the right length, either way. Sigma points reach 1.25.
SIZE = 1.7
#: Ratio of the implied noises of the trials up to which they are one noise: 1.00 with constant velocity and any
#: Jacobian, 1.14 in a turning model's EKF.
SAME_NOISE = 1.15
#: Least number of predictions at which the measurement is nearly linear.
LEAST_LINEAR = 3
#: Largest error of a gain that counts as right.
RIGHT = 0.005
#: Largest ratio of the implied to the stated variance that is no fault where the drives show no harm.
CAUTIOUS = 3.0
STATES = ("px", "py", "vx", "vy")
#: Faults of a gain that is no Kalman gain.
GAIN_FAULTS = ("jacobian_wrong", "gain_inconsistent")
#: Where a wrong measurement noise is set, and how to fix it.
OWN_NOISE = (
    "Where R of this sensor is set.",
    "Use the covariance of the scan (scan.noise_covariance): variances, not standard deviations, in m, rad and m/s.",
)


@doctor_check(
    Question(
        "gain",
        "Do the gains fit the geometry and the stated noise?",
        "Do the gains for {sensor} fit its geometry and its stated noise?",
        each_sensor=True,
        misses=True,
    ),
    place=150,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "jacobian_wrong": KnownFault(
            "a Jacobian is wrong",
            "Where the derivative of the measurement model or of the motion model is written out.",
            "Derive the named entry again, and compare the whole matrix with finite differences in a test.",
            Role(rank=42, drive="tangential_pass"),
        ),
        "r_too_small": KnownFault(
            "the measurement noise is too small",
            *OWN_NOISE,
            Role(rank=46, drive="own_model"),
        ),
        "r_too_large": KnownFault(
            "the measurement noise is too large",
            *OWN_NOISE,
            Role(rank=47, drive="own_model"),
        ),
        "measurement_noise_omitted": KnownFault(
            "the measurement noise is missing from the innovation covariance",
            "Where the innovation covariance S is computed.",
            "S = H P H^T + R, or the sum over the sigma points plus R.",
            Role(rank=15, drive="own_model"),
        ),
    },
)
def gain(tracker: TrackerUnderTest) -> PartResult:
    """Compute the Jacobian and the noise that gains imply at the regular probes, and compare with the right ones."""
    result = PartResult()
    for sensor, trials in tracker.trials.items():
        name = f"gain.{sensor}"
        answers = tracker.once(equation_answers)
        if sensor in {finding.sensor for finding in answers.findings}:
            result.add(name, None, "the equations of its updates do not hold, so they imply no measurement model")
            continue
        if sensor in answers.right:
            result.add(name, True, "they are those of the covariance that the tracker keeps, and of the stated noise")
            continue
        linear = [trial for trial in trials if trial.nearly_linear]
        if trials and len(linear) < LEAST_LINEAR:
            # The target is measured without noise, so that a sound filter is certain of it.
            text = f"after seconds of exact measurements {len(trials) - len(linear)} of {len(trials)} predictions are "
            result.add(name, False, f"{text}still too uncertain for {sensor} to be linear")
            continue
        rows, errors = _implied_models(tracker, sensor, linear)
        if len(rows) < LEAST_LINEAR or len(rows) < 0.5 * len(linear):
            result.add(name, None, "the gains are not those of a Kalman filter" if trials else "there was no estimate")
            continue
        noise = wrong_noise(sensor, rows, errors)
        sure = any(finding.confidence > CERTAIN for finding in noise)
        # With so much noise the gain is small, and tells little of the rows of the Jacobian.
        jacobian_findings = _jacobian_findings(tracker, sensor, rows, errors)
        findings = [finding for finding in jacobian_findings if not sure or finding.confidence > CERTAIN]
        findings += noise
        passed: bool | None = not findings
        text = _summary(rows)
        if findings and (learned := learned_offsets(tracker, sensor)):
            passed, findings = None, []
            text = f"the tracker estimates a constant error of {', '.join(learned)}, which its gains depend on"
        elif findings and _excusable(tracker, rows, findings) and (harm := tracker.once(harmless)) is not None:
            passed, findings = True, []
            text = f"not the Kalman gain of the returned covariance, which does no harm: {harm}; {text}"
        elif passed and ERRORS * np.nanmax(errors.direction) > DIRECTION:
            passed = None
            turned = f"the tracker's own samples turn a row by {np.nanmax(errors.direction):.1%}"
            text = f"{turned} (standard error of two answers): a smaller error of a row cannot be told apart; {text}"
        result.add(name, passed, text, *findings)
    return merge_wrong_gains(excuse_inflation(tracker, result), tracker)


def _excusable(tracker: TrackerUnderTest, rows: Sequence[ImpliedModel], findings: Sequence[Finding]) -> bool:
    """Return whether the findings are no fault as long as the test drives show no harm.

    These are a noise somewhat larger than stated, and a gain that is neither a Kalman gain nor of a wrong Jacobian.
    """
    if all(finding.fault == "r_too_large" for finding in findings):
        return all(finding.factor is not None and finding.factor < CAUTIOUS for finding in findings)
    if all(finding.fault not in GAIN_FAULTS for finding in findings):
        return False
    answers = tracker.once(equation_answers)
    is_no_jacobian = not _fits_another_jacobian(rows) or (answers.targets > 0 and not answers.findings)
    return _mixes(rows) or (is_no_jacobian and findings[0].fault == "jacobian_wrong")


def _mixes(rows: Sequence[ImpliedModel]) -> bool:
    """Return whether the tracker states probabilities of several models: its gains are not of a single filter."""
    probabilities = rows[0].trial.prediction.mode_probabilities
    return probabilities is not None and len(probabilities) > 1


def _fits_another_jacobian(rows: Sequence[ImpliedModel]) -> bool:
    """Return whether a Kalman filter with a wrong Jacobian, and one noise in all trials, explains the gains.

    Hidden states or weights would need another noise in each trial. If the gains are right for targets that one sensor
    alone has measured, the Jacobian is right: it does not depend on other sensors.
    """
    single = [row for row in rows if len(row.trial.sensor_set) == 1]
    if len(single) < len(rows) and single and all(_is_right(row) for row in single):
        return False
    noise = np.array([row.own_noise for row in rows])
    low, high = (np.nanquantile(noise, share, axis=0) for share in (0.1, 0.9))
    return bool(np.nanmin(low) > 0.0 and np.nanmax(high / low) < SAME_NOISE)


def _implied_models(
    tracker: TrackerUnderTest, sensor: str, linear: Sequence[Trial]
) -> tuple[list[ImpliedModel], SamplingErrors]:
    """Return the Jacobian and noise implied by each trial; with a tracker's random samples, a mean of two draws."""
    rows = [implied_model(trial) for trial in linear]
    if tracker.once(sampling_noise) == 0.0:
        models = [row for row in rows if row is not None]
        return models, SamplingErrors(*np.zeros((3, len(SENSOR_MODELS[tracker.sensors[sensor].type].components))))
    replicas = {(trial.name, trial.sensor_set): trial for trial in tracker.replicas[sensor]}
    paired = [replicas.get((trial.name, trial.sensor_set)) for trial in linear]
    return average(rows, [None if replica is None else implied_model(replica) for replica in paired])


def _jacobian_findings(
    tracker: TrackerUnderTest, sensor: str, rows: Sequence[ImpliedModel], errors: SamplingErrors
) -> list[Finding]:
    model = SENSOR_MODELS[rows[0].trial.scan.kind]
    wrong_rows = []
    wrong_gains = [not _is_right(row) for row in rows]
    for i, component in enumerate(model.components):
        used_rows = [row for row in rows if row.used[i]]
        if len(used_rows) < 3:
            continue
        direction = np.array([row.direction[i] for row in used_rows])
        size = np.array([row.size[i] for row in used_rows])
        # Second-order terms of sigma points have a larger share where the variance is far from the stated one.
        noise = float(np.nanmedian([row.noise[i] for row in used_rows]))
        tolerance = max(noise, 1.0 / noise) ** 0.5 if noise > 0.0 else 1.0
        turned = direction > DIRECTION * tolerance + ERRORS * errors.direction[i]
        band = SIZE * tolerance * np.exp(ERRORS * errors.size[i])
        scaled = (size > band) | (size < 1 / band)
        wrong = np.array([is_wrong for row, is_wrong in zip(rows, wrong_gains, strict=True) if row.used[i]])
        turned, scaled = turned & wrong, scaled & wrong
        if np.mean(turned) < 0.12 and np.mean(scaled) < 0.4:
            continue
        worst = max(used_rows, key=lambda row: _row_error(row, i))
        share = max(float(np.mean(turned)), float(np.mean(scaled)))
        text = f"the row of {component.replace('_', ' ')} {_describe_row(direction, size, turned, scaled)} "
        text += f"(medians of the {np.sum(turned | scaled)} of {len(used_rows)} trials in which it is off)"
        wrong_rows.append((share, worst, i, text))
    if not wrong_rows:
        return []
    share, worst, i, text = max(wrong_rows, key=lambda row: row[0])
    confidence, shown_by = 0.8 + 0.15 * share, worst.trial.name
    if tracker.once(linearises) is False:
        return [_inconsistent(sensor, rows, text, confidence)]
    j = int(np.argmax(np.abs(worst.jacobian[i] - worst.trial.jacobian[i]) * worst.trial.state_sigma))
    state = ", ".join(f"{value:.1f}" for value in worst.trial.prediction.mean)
    implied_entry, right_entry = worst.jacobian[i, j], worst.trial.jacobian[i, j]
    entry = f"the gain implies d {model.components[i]} / d {STATES[j]} = {implied_entry:.4g}, where {right_entry:.4g} "
    entry += f"is right (px, py, vx, vy = {state}); {text}"
    return [Finding("jacobian_wrong", confidence, entry, sensor=sensor, shown_by=shown_by)]


def _is_right(row: ImpliedModel) -> bool:
    """Return whether the gain is within 0.5 % of the right one: errors of the implied model are rounding then."""
    update = row.trial.update(row.trial.predicted_measurement)
    return update is not None and gain_error(row.trial, update.gain)[0] < RIGHT


def _describe_row(direction: Array, size: Array, turned: Mask, scaled: Mask) -> str:
    """Describe the error of a Jacobian row in direction and length, by medians over the trials in which it is wrong."""
    turn, lengths = float(np.median(direction[turned])) if turned.any() else 0.0, size[turned | scaled]
    length = float(np.median(lengths))
    parts = [f"is off by {turn:.0%} in direction"] if turned.any() and length > 0.0 else []
    parts += ["points the opposite way"] if length < 0.0 else []
    ratio = f"{abs(length):.3g}"
    parts += [f"has {ratio} times the right length"] if ratio != "1" else []
    return " and ".join(parts)


def _inconsistent(sensor: str, rows: Sequence[ImpliedModel], text: str, confidence: float) -> Finding:
    """Report the gain that is farthest from the right gain for the tracker's own predicted covariance."""
    worst: tuple[float, ImpliedModel, Array, Array] | None = None
    for row in rows:
        update = row.trial.update(row.trial.predicted_measurement)
        assert update is not None
        error, right = gain_error(row.trial, update.gain)
        if worst is None or error > worst[0]:
            worst = (error, row, update.gain, right)
    assert worst is not None
    error, row, applied, right = worst
    scale = row.trial.gain_scale
    components = SENSOR_MODELS[row.trial.scan.kind].components
    numbers = []
    for i, component in enumerate(components):
        j = int(np.argmax(np.abs((applied - right) * scale)[:, i]))
        numbers.append(f"{STATES[j]} by {component.replace('_', ' ')} {applied[j, i]:.3g} instead of {right[j, i]:.3g}")
    state = ", ".join(f"{value:.1f}" for value in row.trial.prediction.mean)
    words = (
        f"the gain is off by {error:.0%} from the one that the tracker's own predicted covariance, the geometry and "
        f"the stated noise give, linearised or by the moments of the Gaussian, whichever is nearer: "
        f"{', '.join(numbers)} (px, py, vx, vy = {state}); as a Jacobian, {text}"
    )
    return Finding("gain_inconsistent", confidence, words, sensor=sensor, shown_by=row.trial.name)


def _row_error(row: ImpliedModel, i: int) -> float:
    gap = (row.jacobian[i] - row.trial.jacobian[i]) * row.trial.state_sigma
    return float(np.max(np.abs(gap)) / np.linalg.norm(row.trial.jacobian[i] * row.trial.state_sigma))


def _summary(rows: Sequence[ImpliedModel]) -> str:
    names = SENSOR_MODELS[rows[0].trial.scan.kind].components
    parts = [
        f"{name.replace('_', ' ')} {factor:.3g}"
        for name, factor in zip(names, noise_factors(rows), strict=True)
        if np.isfinite(factor)
    ]
    direction = np.nanmax([np.nanmax(row.direction[row.used]) for row in rows])
    rows_of = "rows of the implied Jacobian"
    sizes = np.array([np.where(row.used, row.size, np.nan) for row in rows])
    length = np.nanmax(np.nanmedian(sizes[:, np.isfinite(sizes).any(axis=0)], axis=0))
    text = f"directions of the {rows_of} within {direction:.1%}" if direction < 1.0 else f"{rows_of} point elsewhere"
    if length > SIZE:
        text += f", one {length:.3g} times as long as the right one"
    return f"implied over stated variance: {', '.join(parts) or 'n/a'}; {text}"
