"""Do the gains and the updated covariances of a filter follow from the covariance that its tracker holds?

Measurements about the predicted one are given to a filter with chosen covariances. K is the derivative of the mean by
the measurement. ``K = P H^T (H P H^T + R)^-1`` and ``P = (I - K H) P (I - K H)^T + K R K^T`` have to hold (Bar-Shalom,
Li and Kirubarajan 2001, section 5.2.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.checks.implied_noise import IN_DEGREES, NOISE_BAND
from trackbench.subjects.doctor.findings import PROVEN, Finding
from trackbench.subjects.doctor.inside.own_filter import INSTANT, NARROW, HeldAfter, OwnFilter, covariance_difference
from trackbench.subjects.doctor.inside.values import Assigned
from trackbench.subjects.doctor.inside.written import last_values, same_matrix, wrong_entry
from trackbench.subjects.doctor.matrices import best_multiple
from trackbench.subjects.doctor.session import StepFailed

#: Least error of a gain, relative to the right one, that is a fault: with a narrow covariance, where Jacobians that are
#: cut off or taken elsewhere have 0.03; and with one as wide as the tracker's own, where sigma points differ.
WRONG, WRONG_WIDE = 0.1, 0.3
#: Least error of the covariance after a measurement, relative to its right change; correct filters have up to 0.005.
WRONG_AFTER = 0.08
#: Largest error with which another matrix explains a gain.
USED = 0.01
#: Time after which a gain is compared with the gain at once, s.
LATER = 0.5
#: Change of a measurement for a derivative, and largest innovation that counts as zero, in standard deviations.
STEP, NONE = 0.1, 0.01
#: Gain that counts as zero, relative to the largest; and share of a change by a measurement below which it is lost.
NO_GAIN, LOST = 1e-6, 0.5
#: Largest ratio of a noise to the stated one that is no fault where the drives show no harm.
CAUTIOUS = 3.0
#: Largest error of the logarithm of a factor that a confusion of units explains.
NEAR = 0.1
#: Largest factor of the gain, either way, that is a tuning.
TUNING = 1.4
#: Numbers of times that a noise may be added by mistake.
TIMES_ADDED = (2, 3)


class UpdateAnswers(NamedTuple):
    """Answers of a filter with n states to measurements near the predicted one; m components move the estimate."""

    covariance: Array
    """Predicted covariance P ``(n, n)``."""
    after: tuple[Array, Array]
    """Updated covariances ``(n, n)``: as held an instant after the update, and without that instant's growth."""
    gain: Array
    """Derivative ``(n, m)`` by the measurement of the mean that is held an instant later."""
    jacobian: Array
    """Correct Jacobian H ``(m, n)`` of the measurement with respect to the state."""
    noise: Array
    """Stated noise covariance R ``(m, m)``."""
    kept: dict[str, float]
    """Shares of the updates of ``mean`` and ``covariance``, by these names, still returned an instant later."""
    whole: bool
    """Whether all components of a measurement move the estimate."""
    assigned: Sequence[Assigned]

    def right_gain(
        self, *, jacobian: Array | None = None, noise: Array | None = None, covariance: Array | None = None
    ) -> Array:
        """Return the Kalman gain ``(n, m)``; by default of the right Jacobian, stated noise and held covariance."""
        h, r = self.jacobian if jacobian is None else jacobian, self.noise if noise is None else noise
        p = self.covariance if covariance is None else covariance
        return np.asarray(np.linalg.solve(h @ p @ h.T + r, h @ p).T)

    def gain_error(self, gain: Array) -> float:
        """Return the largest difference of ``gain`` from the applied gain, relative to the latter's largest entry.

        Entries are scaled by the standard deviations of state and measurement.
        """
        scale = np.sqrt(np.diag(self.noise)) / np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))[:, None]
        return float(np.abs((gain - self.gain) * scale).max() / np.abs(self.gain * scale).max())


def update_finding(held: OwnFilter, scan: Scan) -> tuple[Finding | None, bool]:
    """Return the fault of a sensor's updates, or None, and whether the sensor's gains are right."""
    with suppress(StepFailed):
        narrow, wide = (_answers(held, scan, share * held.covariance) for share in (NARROW, 1.0))
        if narrow is not None and wide is not None:
            finding = _not_kept(scan.sensor, wide)
            if finding is not None or not np.abs(narrow.gain).max() > 0.0:
                return finding, False
            is_right = narrow.gain_error(narrow.right_gain()) < WRONG
            is_right = is_right and wide.gain_error(wide.right_gain()) < WRONG_WIDE
            if is_right:
                finding = _covariance_fault(scan.sensor, wide) or _not_redrawn(held, scan)
            else:
                finding = _gain_fault(scan.sensor, scan.kind, narrow, wide)
            return finding, is_right and finding is None
    return None, False


def _answers(held: OwnFilter, scan: Scan, covariance: Array, after_s: float = INSTANT) -> UpdateAnswers | None:
    """Try measurements ``after_s`` later, from ``covariance``; None if the predicted measurement moves the mean."""
    scan = scan._replace(time=held.time + after_s)
    missed, later = empty_scan(scan), empty_scan(scan._replace(time=scan.time + INSTANT))
    before, outputs = held.after(missed, covariance=covariance), held.outputs(missed)
    unmeasured = held.after(missed, later, covariance=covariance)
    if before is None or before.estimate is None or outputs is None:
        return None
    if unmeasured is None or unmeasured.estimate is None:
        return None
    model, where = SENSOR_MODELS[scan.kind], (before.estimate.mean, scan.sensor_pose, scan.sensor_velocity)
    expected, sigma = model.measure(*where), np.sqrt(np.diag(scan.noise_covariance))

    def answer(measurement: Array, *then: Scan, trace: bool = False) -> HeldAfter | None:
        return held.after(scan._replace(measurement=measurement), *then, covariance=covariance, trace=trace)

    centre = answer(expected, later, trace=True)
    sides = [[answer(expected + side * step, later) for side in (1, -1)] for step in np.diag(STEP * sigma)]
    gain = _derivative(sides, lambda after: after.mean)
    returned = _derivative(sides, lambda after: None if after.first_estimate is None else after.first_estimate.mean)
    remaining = _derivative(sides, lambda after: None if after.estimate is None else after.estimate.mean)
    if gain is None or returned is None or remaining is None or centre is None:
        return None
    if centre.first_estimate is None or centre.estimate is None:
        return None
    size = np.abs(returned).max(axis=0)
    used = size > NO_GAIN * size.max()
    # A wrong predicted measurement is another fault.
    if not used.any() or np.abs(centre.first_estimate.mean - before.estimate.mean).max() > NONE * size.max():
        return None
    sigma_before = np.sqrt(np.diag(before.estimate.covariance))
    pairs = ((before.estimate, centre.first_estimate), (unmeasured.estimate, centre.estimate))
    changes = [(p.covariance - q.covariance) / np.outer(sigma_before, sigma_before) for p, q in pairs]
    return UpdateAnswers(
        linalg.symmetrise(before.covariance),
        (
            linalg.symmetrise(centre.covariance),
            linalg.symmetrise(centre.covariance - unmeasured.covariance + before.covariance),
        ),
        (gain / sigma)[:, used],
        (model.jacobian(*where) @ outputs)[used],
        scan.noise_covariance[np.ix_(used, used)],
        {"mean": _remaining_share(returned, remaining), "covariance": _remaining_share(*changes)},
        bool(used.all()),
        centre.assigned,
    )


def _derivative(
    sides: Sequence[Sequence[HeldAfter | None]], function: Callable[[HeldAfter], Array | None]
) -> Array | None:
    """Return the derivative of ``function`` with respect to the measurement, in units of its standard deviation.

    ``sides`` are the updates with each component of the measurement moved up and down. None where a value is missing.
    """
    columns = []
    for ahead, behind in sides:
        values = [None if side is None else function(side) for side in (ahead, behind)]
        if values[0] is None or values[1] is None:
            return None
        columns.append((values[0] - values[1]) / (2 * STEP))
    return np.stack(columns, axis=1)


def _remaining_share(change: Array, remaining: Array) -> float:
    return best_multiple(remaining, change) if np.any(change) else 1.0


def _not_kept(sensor: str, wide: UpdateAnswers) -> Finding | None:
    """Report a mean or covariance whose change by a measurement is returned, and lost an instant later."""
    part, share = min(wide.kept.items(), key=lambda entry: abs(entry[1]))
    if abs(share) > LOST:
        return None
    text = f"an instant after a measurement of {sensor} {share:.0%} of its change of the {part} is left"
    return Finding("update_not_kept", 0.96, text, sensor=sensor)


def _gain_fault(sensor: str, kind: str, narrow: UpdateAnswers, wide: UpdateAnswers) -> Finding | None:
    if not narrow.whole:
        # A component may be left out on purpose; otherwise that is another fault.
        return None
    for matrix in last_values(narrow.assigned, narrow.jacobian.shape):
        explained = narrow.gain_error(narrow.right_gain(jacobian=matrix.value)) < USED
        if explained and not same_matrix(matrix.value, narrow.jacobian):
            by = f"differences of what {sensor} measures"
            return wrong_entry(narrow.assigned, matrix, narrow.jacobian, sensor, by)

    # A noise does not depend on the covariance; an innovation covariance does.
    wide_values = {(entry.file, entry.name): entry.value for entry in last_values(wide.assigned, narrow.noise.shape)}
    noises = [
        entry
        for entry in last_values(narrow.assigned, narrow.noise.shape)
        if (key := (entry.file, entry.name)) in wide_values and same_matrix(wide_values[key], entry.value)
    ]
    is_stated = any(same_matrix(entry.value, narrow.noise) for entry in noises)
    for entry in noises:
        errors = [answers.gain_error(answers.right_gain(noise=entry.value)) for answers in (narrow, wide)]
        if max(errors) < USED and not same_matrix(entry.value, narrow.noise):
            return _written_noise_fault(sensor, kind, entry, narrow.noise)
    right = narrow.right_gain()
    factor = best_multiple(narrow.gain, right)
    if narrow.gain_error(factor * right) < USED and abs(np.log(max(factor, 1e-9))) > np.log(TUNING):
        # The covariance after an update with the best gain for some noise is (I - K H) P.
        best = narrow.covariance - narrow.gain @ narrow.jacobian @ narrow.covariance
        is_noise = _covariance_error(narrow, best) < WRONG
        return _multiple_gain_finding(sensor, factor, is_noise=is_noise, is_stated=is_stated)
    if narrow.gain_error(wide.gain) < USED and covariance_difference(narrow.covariance, wide.covariance) > LOST:
        text = f"the gain of {sensor} is the same for a covariance that is {1 / NARROW:g} times smaller"
        return Finding("gain_inconsistent", 0.96, text, sensor=sensor)
    if narrow.gain_error(right) < WRONG:
        error = wide.gain_error(wide.right_gain())
        text = f"the gain of {sensor} is off by {error:.0%} from that of the covariance that is kept"
        return Finding("gain_inconsistent", 0.94, text, sensor=sensor)
    return None


def _written_noise_fault(sensor: str, kind: str, noise: Assigned, stated: Array) -> Finding | None:
    """Report a line that assigns a measurement noise other than the stated one."""
    sigmas, ratios = np.sqrt(np.diag(noise.value)), np.diag(noise.value) / np.diag(stated)
    if np.abs(np.log(ratios)).max() < np.log(NOISE_BAND):
        return None
    fault = "r_too_large" if ratios.max() > 1.0 / ratios.min() else "r_too_small"
    factor = float(ratios.max() if fault == "r_too_large" else ratios.min())
    for i in SENSOR_MODELS[kind].angular:
        if any(abs(np.log(ratios[i] / exact)) < NEAR for exact in IN_DEGREES):
            fault, factor = "degrees_for_radians", float(ratios[i])
    text = (
        f"{noise.where}: {noise.name} has the standard deviations {', '.join(f'{value:.3g}' for value in sigmas)}, and "
        f"{sensor} states {', '.join(f'{value:.3g}' for value in np.sqrt(np.diag(stated)))}"
    )
    return _noise_finding(text, fault, sensor, factor)


def _noise_finding(text: str, fault: str, sensor: str, factor: float) -> Finding:
    """Report a measurement noise that is wrong by a factor; a slightly too large one is less certain to be a fault."""
    confidence = 0.9 if fault == "r_too_large" and factor < CAUTIOUS else PROVEN
    return Finding(fault, confidence, text, sensor=sensor, factor=factor)


def _multiple_gain_finding(sensor: str, factor: float, *, is_noise: bool, is_stated: bool) -> Finding:
    """Report a gain that is ``factor`` times the right one, or the right gain for a multiple of the stated noise."""
    text = f"measurements of {sensor} move the mean by {factor:.4g} times the gain of the covariance that is kept"
    if not is_noise:
        return Finding("gain_inconsistent", 0.96, text, sensor=sensor, factor=factor)
    times, fault = 1.0 / factor, "r_too_large" if factor < 1.0 else "r_too_small"
    count = next((count for count in TIMES_ADDED if abs(times / count - 1.0) < USED), None)
    if count is not None and is_stated:
        text = f"a line has the R that {sensor} states, and the gains are those of {count} times it: R is added "
        return Finding(fault, PROVEN, f"{text}{count} times", sensor=sensor, factor=float(count))
    text = f"the gains of {sensor} are those of {times:.4g} times the variances that it states"
    return _noise_finding(text, fault, sensor, times)


def _covariance_fault(sensor: str, wide: UpdateAnswers) -> Finding | None:
    error = _covariance_error(wide, _joseph(wide))
    if error < WRONG_AFTER:
        return None
    text = (
        f"measurements of {sensor} move the mean by the right gain of the covariance that is kept, and the covariance "
        f"after them is off by {error:.0%} of its right change"
    )
    return Finding("covariance_update_wrong", 0.95, text, sensor=sensor)


def _covariance_error(answers: UpdateAnswers, right: Array) -> float:
    """Return the error of the covariance after a measurement, relative to the right change by the measurement."""
    spread = np.sqrt(np.outer(np.diag(answers.covariance), np.diag(answers.covariance)))
    change = float(np.abs((right - answers.covariance) / spread).max())
    # A filter with a fading memory adds to the covariance on purpose.
    faded = [max(1.0, best_multiple(after, right)) * right for after in answers.after]
    errors = [np.abs((expected - after) / spread).max() for expected, after in zip(faded, answers.after, strict=True)]
    return float(min(errors)) / change if change > 0.0 else 0.0


def _not_redrawn(held: OwnFilter, scan: Scan) -> Finding | None:
    """Report a gain that is right an instant after a scan, and lacks the process noise after a longer prediction."""
    exact, narrow = np.finfo(float).eps * held.covariance, NARROW * held.covariance
    noise = held.after(empty_scan(scan._replace(time=held.time + LATER)), covariance=exact)
    answers = _answers(held, scan, narrow, LATER)
    if noise is None or answers is None or answers.gain_error(answers.right_gain()) < WRONG:
        return None
    without_noise = answers.covariance - linalg.symmetrise(noise.covariance)
    if answers.gain_error(answers.right_gain(covariance=without_noise)) > WRONG:
        return None
    text = (
        f"{LATER:g} s after a measurement the gain of {scan.sensor} is that of a predicted covariance without the "
        "process noise, and right at once: the update goes on with points in which the noise is missing"
    )
    return Finding("sigma_points_not_redrawn", 0.96, text, sensor=scan.sensor)


def _joseph(answers: UpdateAnswers) -> Array:
    factor = np.eye(len(answers.gain)) - answers.gain @ answers.jacobian
    return np.asarray(factor @ answers.covariance @ factor.T + answers.gain @ answers.noise @ answers.gain.T)
