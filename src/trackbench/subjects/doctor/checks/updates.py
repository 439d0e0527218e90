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
from trackbench.subjects.doctor.inside.own_filter import INSTANT, NARROW, HeldAfter, OwnFilter, covariances_apart
from trackbench.subjects.doctor.inside.values import Assigned
from trackbench.subjects.doctor.inside.written import last_values, same_matrix, wrong_entry
from trackbench.subjects.doctor.matrices import best_multiple
from trackbench.subjects.doctor.session import StepFailed

#: Error of a gain relative to the right one from which on it is wrong: Jacobians that are taken elsewhere than at the
#: mean, or cut off, have 0.03. Where the covariance is as wide as the tracker's own, sigma points differ.
WRONG, WRONG_WIDE = 0.1, 0.3
#: Error of the covariance after a measurement, relative to its right change: correct filters have up to 0.005.
WRONG_AFTER = 0.08
#: Error up to which a gain is that of another matrix.
USED = 0.01
#: Time after which a gain is held against that at once, s.
LATER = 0.5
#: Change of a measurement for a derivative, and innovation that is none, in its standard deviations.
STEP, NONE = 0.1, 0.01
#: Share of the largest gain that is none, and share of a change by a measurement below which it is lost.
NO_GAIN, LOST = 1e-6, 0.5
#: Ratio of a noise to the stated one up to which a larger one does no harm where the drives show none.
CAUTIOUS = 3.0
#: Difference of the logarithm of a factor from that of a unit which is none.
NEAR = 0.1
#: A factor of the gain that is a tuning.
TUNING = 1.4
#: How often a noise may be added.
TIMES_ADDED = (2, 3)


class UpdateAnswers(NamedTuple):
    """Changes of a belief by measurements near the predicted one, m components of which change the estimate."""

    covariance: Array
    """``(n, n)`` P, predicted."""
    after: tuple[Array, Array]
    """``(n, n)`` held an instant after the predicted measurement; second, less the growth over that instant."""
    gain: Array
    """``(n, m)`` derivative of the mean that is held an instant after a measurement by it."""
    jacobian: Array
    """``(m, n)`` H, right."""
    noise: Array
    """``(m, m)`` R, stated."""
    kept: dict[str, float]
    """Shares of the changes of the returned mean and covariance that are left an instant later."""
    whole: bool
    """Whether all components of a measurement move the estimate."""
    assigned: Sequence[Assigned]

    def right_gain(
        self, *, jacobian: Array | None = None, noise: Array | None = None, covariance: Array | None = None
    ) -> Array:
        """Return the gain with the right Jacobian, the stated noise and the predicted covariance, or with others."""
        h, r = self.jacobian if jacobian is None else jacobian, self.noise if noise is None else noise
        p = self.covariance if covariance is None else covariance
        return np.asarray(np.linalg.solve(h @ p @ h.T + r, h @ p).T)

    def apart(self, gain: Array) -> float:
        """Return the largest difference of a gain from the applied one, relative to the largest entry of that."""
        scale = np.sqrt(np.diag(self.noise)) / np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))[:, None]
        return float(np.abs((gain - self.gain) * scale).max() / np.abs(self.gain * scale).max())


def update_finding(own: OwnFilter, scan: Scan) -> tuple[Finding | None, bool]:
    """Return what is wrong with the updates by a sensor, and whether its gains are right."""
    with suppress(StepFailed):
        narrow, wide = (_answers(own, scan, share * own.covariance) for share in (NARROW, 1.0))
        if narrow is not None and wide is not None:
            finding = _not_kept(scan.sensor, wide)
            if finding is not None or not np.abs(narrow.gain).max() > 0.0:
                return finding, False
            is_right = narrow.apart(narrow.right_gain()) < WRONG and wide.apart(wide.right_gain()) < WRONG_WIDE
            if is_right:
                finding = _of_covariance(scan.sensor, wide) or _not_redrawn(own, scan)
            else:
                finding = _of_gain(scan.sensor, scan.kind, narrow, wide)
            return finding, is_right and finding is None
    return None, False


def _answers(own: OwnFilter, scan: Scan, covariance: Array, after_s: float = INSTANT) -> UpdateAnswers | None:
    """Return the answers to measurements of a sensor after a time; None where the predicted one has an innovation."""
    scan = scan._replace(time=own.time + after_s)
    missed, later = empty_scan(scan), empty_scan(scan._replace(time=scan.time + INSTANT))
    before, outputs = own.after(missed, covariance=covariance), own.outputs(missed)
    unmeasured = own.after(missed, later, covariance=covariance)
    if before is None or before.estimate is None or outputs is None:
        return None
    if unmeasured is None or unmeasured.estimate is None:
        return None
    model, where = SENSOR_MODELS[scan.kind], (before.estimate.mean, scan.sensor_pose, scan.sensor_velocity)
    expected, sigma = model.measure(*where), np.sqrt(np.diag(scan.noise_covariance))

    def answer(measurement: Array, *then: Scan, trace: bool = False) -> HeldAfter | None:
        return own.after(scan._replace(measurement=measurement), *then, covariance=covariance, trace=trace)

    centre = answer(expected, later, trace=True)
    sides = [[answer(expected + side * step, later) for side in (1, -1)] for step in np.diag(STEP * sigma)]
    gain = _gain(sides, lambda one: one.mean)
    returned = _gain(sides, lambda one: None if one.at_once is None else one.at_once.mean)
    left = _gain(sides, lambda one: None if one.estimate is None else one.estimate.mean)
    if gain is None or returned is None or left is None or centre is None:
        return None
    if centre.at_once is None or centre.estimate is None:
        return None
    size = np.abs(returned).max(axis=0)
    used = size > NO_GAIN * size.max()
    # What is predicted otherwise than measured has another name.
    if not used.any() or np.abs(centre.at_once.mean - before.estimate.mean).max() > NONE * size.max():
        return None
    sigma_before = np.sqrt(np.diag(before.estimate.covariance))
    pairs = ((before.estimate, centre.at_once), (unmeasured.estimate, centre.estimate))
    changes = [(one.covariance - other.covariance) / np.outer(sigma_before, sigma_before) for one, other in pairs]
    return UpdateAnswers(
        linalg.symmetrise(before.covariance),
        (
            linalg.symmetrise(centre.covariance),
            linalg.symmetrise(centre.covariance - unmeasured.covariance + before.covariance),
        ),
        (gain / sigma)[:, used],
        (model.jacobian(*where) @ outputs)[used],
        scan.noise_covariance[np.ix_(used, used)],
        {"mean": _share(returned, left), "covariance": _share(*changes)},
        bool(used.all()),
        centre.assigned,
    )


def _gain(sides: Sequence[Sequence[HeldAfter | None]], of: Callable[[HeldAfter], Array | None]) -> Array | None:
    """Return the derivative of something by a measurement in its standard deviations; None where it is not there."""
    columns = []
    for ahead, behind in sides:
        values = [None if side is None else of(side) for side in (ahead, behind)]
        if values[0] is None or values[1] is None:
            return None
        columns.append((values[0] - values[1]) / (2 * STEP))
    return np.stack(columns, axis=1)


def _share(change: Array, left: Array) -> float:
    """Return how much of a change is left; 1 where there is none."""
    return best_multiple(left, change) if np.any(change) else 1.0


def _not_kept(sensor: str, wide: UpdateAnswers) -> Finding | None:
    """Report a mean or covariance that a measurement changes where it is returned, and not where it is kept."""
    part, share = min(wide.kept.items(), key=lambda entry: abs(entry[1]))
    if abs(share) > LOST:
        return None
    text = f"an instant after a measurement of {sensor} {share:.0%} of its change of the {part} is left"
    return Finding("update_not_kept", 0.96, text, sensor=sensor)


def _of_gain(sensor: str, kind: str, narrow: UpdateAnswers, wide: UpdateAnswers) -> Finding | None:
    """Report a gain that does not follow from the covariance that is held."""
    if not narrow.whole:
        # A component may be left out on purpose, and one that is not has another name.
        return None
    for at in last_values(narrow.assigned, narrow.jacobian.shape):
        if narrow.apart(narrow.right_gain(jacobian=at.value)) < USED and not same_matrix(at.value, narrow.jacobian):
            return wrong_entry(narrow.assigned, at, narrow.jacobian, sensor, f"differences of what {sensor} measures")

    # A noise does not depend on the covariance, as an innovation covariance does.
    of_wide = {(at.file, at.name): at.value for at in last_values(wide.assigned, narrow.noise.shape)}
    noises = [
        at
        for at in last_values(narrow.assigned, narrow.noise.shape)
        if (at.file, at.name) in of_wide and same_matrix(of_wide[at.file, at.name], at.value)
    ]
    is_stated = any(same_matrix(at.value, narrow.noise) for at in noises)
    for at in noises:
        errors = [answers.apart(answers.right_gain(noise=at.value)) for answers in (narrow, wide)]
        if max(errors) < USED and not same_matrix(at.value, narrow.noise):
            return _of_own_noise(sensor, kind, at, narrow.noise)
    right = narrow.right_gain()
    factor = best_multiple(narrow.gain, right)
    if narrow.apart(factor * right) < USED and abs(np.log(max(factor, 1e-9))) > np.log(TUNING):
        # The covariance after an update with the best gain for some noise is (I - K H) P.
        best = narrow.covariance - narrow.gain @ narrow.jacobian @ narrow.covariance
        is_noise = _covariance_error(narrow, best) < WRONG
        return _of_multiple(sensor, factor, is_noise=is_noise, is_stated=is_stated)
    if narrow.apart(wide.gain) < USED and covariances_apart(narrow.covariance, wide.covariance) > LOST:
        text = f"the gain of {sensor} is the same for a covariance that is {1 / NARROW:g} times smaller"
        return Finding("gain_inconsistent", 0.96, text, sensor=sensor)
    if narrow.apart(right) < WRONG:
        off = wide.apart(wide.right_gain())
        text = f"the gain of {sensor} is off by {off:.0%} from that of the covariance that is kept"
        return Finding("gain_inconsistent", 0.94, text, sensor=sensor)
    return None


def _of_own_noise(sensor: str, kind: str, at: Assigned, stated: Array) -> Finding | None:
    """Report that a line has another noise than the stated one."""
    own, ratios = np.sqrt(np.diag(at.value)), np.diag(at.value) / np.diag(stated)
    if np.abs(np.log(ratios)).max() < np.log(NOISE_BAND):
        return None
    fault = "r_too_large" if ratios.max() > 1.0 / ratios.min() else "r_too_small"
    factor = float(ratios.max() if fault == "r_too_large" else ratios.min())
    for i in SENSOR_MODELS[kind].angular:
        if any(abs(np.log(ratios[i] / exact)) < NEAR for exact in IN_DEGREES):
            fault, factor = "degrees_for_radians", float(ratios[i])
    text = (
        f"{at.where}: {at.name} has the standard deviations {', '.join(f'{value:.3g}' for value in own)}, and {sensor} "
        f"states {', '.join(f'{value:.3g}' for value in np.sqrt(np.diag(stated)))}"
    )
    return _of_size(text, fault, sensor, factor)


def _of_size(text: str, fault: str, sensor: str, factor: float) -> Finding:
    """Report a noise that is wrong by a factor; one that is somewhat larger than stated does no harm."""
    confidence = 0.9 if fault == "r_too_large" and factor < CAUTIOUS else PROVEN
    return Finding(fault, confidence, text, sensor=sensor, factor=factor)


def _of_multiple(sensor: str, factor: float, *, is_noise: bool, is_stated: bool) -> Finding:
    """Report a multiple of the right gain, or the gain for a multiple of the stated noise."""
    text = f"measurements of {sensor} move the mean by {factor:.4g} times the gain of the covariance that is kept"
    if not is_noise:
        return Finding("gain_inconsistent", 0.96, text, sensor=sensor, factor=factor)
    times, fault = 1.0 / factor, "r_too_large" if factor < 1.0 else "r_too_small"
    count = next((count for count in TIMES_ADDED if abs(times / count - 1.0) < USED), None)
    if count is not None and is_stated:
        text = f"a line has the R that {sensor} states, and the gains are those of {count} times it: R is added "
        return Finding(fault, PROVEN, f"{text}{count} times", sensor=sensor, factor=float(count))
    text = f"the gains of {sensor} are those of {times:.4g} times the variances that it states"
    return _of_size(text, fault, sensor, times)


def _of_covariance(sensor: str, wide: UpdateAnswers) -> Finding | None:
    """Report a covariance after a measurement that does not follow from the gain."""
    error = _covariance_error(wide, _joseph(wide))
    if error < WRONG_AFTER:
        return None
    text = (
        f"measurements of {sensor} move the mean by the right gain of the covariance that is kept, and the covariance "
        f"after them is off by {error:.0%} of its right change"
    )
    return Finding("covariance_update_wrong", 0.95, text, sensor=sensor)


def _covariance_error(answers: UpdateAnswers, right: Array) -> float:
    """Return the difference of the covariance after a measurement from another, relative to the change to that."""
    spread = np.sqrt(np.outer(np.diag(answers.covariance), np.diag(answers.covariance)))
    change = float(np.abs((right - answers.covariance) / spread).max())
    # A memory may fade on purpose.
    faded = [max(1.0, best_multiple(after, right)) * right for after in answers.after]
    off = [np.abs((one - after) / spread).max() for one, after in zip(faded, answers.after, strict=True)]
    return float(min(off)) / change if change > 0.0 else 0.0


def _not_redrawn(own: OwnFilter, scan: Scan) -> Finding | None:
    """Report a gain that is right at once, and after a time leaves out the process noise."""
    exact, narrow = np.finfo(float).eps * own.covariance, NARROW * own.covariance
    noise = own.after(empty_scan(scan._replace(time=own.time + LATER)), covariance=exact)
    answers = _answers(own, scan, narrow, LATER)
    if noise is None or answers is None or answers.apart(answers.right_gain()) < WRONG:
        return None
    if answers.apart(answers.right_gain(covariance=answers.covariance - linalg.symmetrise(noise.covariance))) > WRONG:
        return None
    text = (
        f"{LATER:g} s after a measurement the gain of {scan.sensor} is that of a predicted covariance without the "
        "process noise, and right at once: the update goes on with points in which the noise is missing"
    )
    return Finding("sigma_points_not_redrawn", 0.96, text, sensor=scan.sensor)


def _joseph(answers: UpdateAnswers) -> Array:
    left = np.eye(len(answers.gain)) - answers.gain @ answers.jacobian
    return np.asarray(left @ answers.covariance @ left.T + answers.gain @ answers.noise @ answers.gain.T)
