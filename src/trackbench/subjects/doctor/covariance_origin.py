"""Where a covariance becomes asymmetric or indefinite: at the start, in a prediction or in an update."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from trackbench.base.types import COMMON_STATE, Array, Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.exhibits import Matrices, Panel, state_matrices
from trackbench.subjects.doctor.output_checks import asymmetry, least_eigenvalue, scaled_covariances
from trackbench.subjects.doctor.session import StepFailed, TrackerSession, finite
from trackbench.trackers.answers import Tracker

#: Asymmetry, and negative eigenvalue, that rounding does not explain, of a covariance scaled to unit variances.
ROUNDING = 1e-6
#: Predictions whose mirrored entries have one ratio, if it is made where the estimate is returned, s; a process noise
#: has another share of each.
AHEAD = (0.02, 0.1, 0.5)

Make = Callable[[], Tracker]
Measure = Callable[[Array], Array]
Blame = Callable[[Array, Array, Array | None], bool]
"""Of the covariances before a step, predicted and after it: whether the prediction is to blame."""


class FaultyStep(NamedTuple):
    """The first step of a track that makes its covariance wrong."""

    step: Literal["start", "prediction", "update", "output"]
    scan: Scan
    before: Array | None
    """``(4, 4)`` the covariance before that step: the estimate's, or the one predicted to the update."""
    after: Array
    """``(4, 4)`` the first wrong one."""
    ratio: float | None = None
    """Of mirrored entries, where it is the same in every estimate."""

    @property
    def words(self) -> str:
        """The step and its time."""
        if self.step == "output":
            return f"where the estimate is returned, first at {self.scan.time:.4g} s"
        if self.step == "start":
            return f"in the first estimate, at {self.scan.time:.4g} s"
        of = f" with {self.scan.sensor}" if self.step == "update" else ""
        # What was predicted to it is not known of a tracker that is given no scans without a detection.
        step = "step" if self.before is None else self.step
        return f"in the {step}{of} at {self.scan.time:.4g} s"


def asymmetric(make: Make, scans: Sequence[Scan]) -> FaultyStep | None:
    """The step after which the covariance is first not symmetric."""

    def adds_more(before: Array, predicted: Array, after: Array | None) -> bool:
        """Whether the prediction adds more to the asymmetry than the update does."""
        first, then = (asymmetry(scaled_covariances(p, like=predicted)) for p in (before, predicted))
        return bool(
            then > ROUNDING
            and (after is None or then - first >= asymmetry(scaled_covariances(after, like=predicted)) - then)
        )

    origin = _origin(make, scans, asymmetry, adds_more)
    if origin is None or origin.step != "prediction":
        return origin
    ratio = _ratio(make, scans, _mirrored(origin))
    return origin if ratio is None else FaultyStep("output", origin.scan, None, origin.after, ratio)


def _ratio(make: Make, scans: Sequence[Scan], entry: tuple[int, int]) -> float | None:
    """Of two mirrored entries, if it is the same after all scans and in predictions of several lengths."""
    session, last = TrackerSession(make), scans[-1]
    stated = [_covariance(session.step, scan)[0] for scan in scans]
    ahead = [_covariance(session.peek, empty_scan(last._replace(time=last.time + time)))[0] for time in AHEAD]
    i, j = entry
    wrong = [
        p
        for p in (*stated, *ahead)
        if p is not None and abs(scaled_covariances(p)[i, j] - scaled_covariances(p)[j, i]) > ROUNDING
    ]
    if len(wrong) < len(AHEAD) or any(p is None for p in ahead):
        return None
    ratios = [float(p[i, j] / p[j, i]) for p in wrong]
    return ratios[0] if np.ptp(ratios) < ROUNDING * abs(ratios[0]) else None


def indefinite(make: Make, scans: Sequence[Scan]) -> FaultyStep | None:
    """The step after which the covariance is first not positive definite."""

    def is_wrong(_before: Array, predicted: Array, _after: Array | None) -> bool:
        """An update is right only of a positive definite covariance."""
        return bool(least_eigenvalue(scaled_covariances(predicted)) < -ROUNDING)

    return _origin(make, scans, lambda relative: -least_eigenvalue(relative), is_wrong)


def fault_of_step(fault: str, of: FaultyStep | None) -> str:
    """The fault of an update, or the same of a prediction where it arises there."""
    return f"predicted_{fault}" if of is not None and of.step == "prediction" else fault


def mirrored_entries(of: FaultyStep) -> str:
    """The two mirrored entries that differ most, and what they were before."""
    i, j = _mirrored(of)
    row, column = COMMON_STATE[i], COMMON_STATE[j]
    text = f"row {row}, column {column} is {of.after[i, j]:.6g} and row {column}, column {row} {of.after[j, i]:.6g}"
    if of.ratio is not None:
        return f"{text}, with the ratio {of.ratio:.4g} in every estimate, after measurements and without"
    return text if of.before is None else f"{text} ({of.before[i, j]:.6g} and {of.before[j, i]:.6g} before it)"


def indefinite_entries(of: FaultyStep) -> str:
    """The negative variance or the correlation beyond one, if there is one, and the smallest eigenvalues."""
    variances = np.diag(of.after)
    relative = scaled_covariances(of.after)
    i, j = _correlated(of)
    text = f"the smallest eigenvalue, scaled to unit variances, is {least_eigenvalue(relative):.3g}"
    if of.before is not None:
        text += f" ({least_eigenvalue(scaled_covariances(of.before)):.3g} before it)"
    if variances.min() < 0.0:
        worst = int(np.argmin(variances))
        return f"{text}; the variance of {COMMON_STATE[worst]} is {variances[worst]:.3g}"
    if abs(relative[i, j]) > 1.0:
        return f"{text}; the correlation of {COMMON_STATE[i]} and {COMMON_STATE[j]} is {relative[i, j]:.4g}"
    return text


def asymmetry_shown(of: FaultyStep) -> Matrices:
    """The covariance before and after the step, and the latter minus its transpose, with the mirrored entries."""
    i, j = _mirrored(of)
    panels = (*_before_and_after(of), Panel("after, minus its transpose", of.after - of.after.T))
    return state_matrices(f"Covariance {of.words}", panels, ((i, j), (j, i)))


def indefinite_shown(of: FaultyStep) -> Matrices:
    """The covariance before and after the step, with the negative variance or the correlation beyond one."""
    variances, relative = np.diag(of.after), np.abs(scaled_covariances(of.after))
    i, j = _correlated(of)
    marked: tuple[tuple[int, int], ...] = ((i, j), (j, i)) if relative[i, j] > 1.0 else ()
    if variances.min() < 0.0:
        marked = tuple((int(k), int(k)) for k in np.flatnonzero(variances < 0.0))
    return state_matrices(f"Covariance {of.words}", _before_and_after(of), marked)


def _before_and_after(of: FaultyStep) -> tuple[Panel, ...]:
    titles = {"start": "first", "output": "returned"}
    after = Panel(titles.get(of.step, f"after the {of.step}"), of.after)
    return (after,) if of.before is None else (Panel(f"before the {of.step}", of.before, "before"), after)


def _mirrored(of: FaultyStep) -> tuple[int, int]:
    relative = scaled_covariances(of.after)
    i, j = np.unravel_index(int(np.argmax(np.triu(np.abs(relative - relative.T)))), (4, 4))
    return int(i), int(j)


def _correlated(of: FaultyStep) -> tuple[int, int]:
    i, j = np.unravel_index(int(np.argmax(np.triu(np.abs(scaled_covariances(of.after)), 1))), (4, 4))
    return int(i), int(j)


def _origin(make: Make, scans: Sequence[Scan], size: Measure, in_prediction: Blame) -> FaultyStep | None:
    """Give scans to a fresh tracker until a covariance is wrong or the step fails; then predict alone to that scan."""
    session, before = TrackerSession(make), None
    for k, scan in enumerate(scans):
        after, failed = _covariance(session.step, scan)
        if not failed and (after is None or size(scaled_covariances(after)) <= ROUNDING):
            before = after
            continue
        if before is None:
            return None if after is None else FaultyStep("start", scan, None, after)
        predicted = after
        if scan.valid:
            session = TrackerSession(make)
            session.follow(scans[:k])
            predicted = _covariance(session.peek, empty_scan(scan))[0]
        if predicted is not None and in_prediction(before, predicted, after):
            return FaultyStep("prediction", scan, before, predicted)
        return None if after is None else FaultyStep("update", scan, predicted, after)
    return None


def _covariance(step: Callable[[Scan], Estimate | None], scan: Scan) -> tuple[Array | None, bool]:
    """The covariance, if there is a finite one, and whether the step failed."""
    try:
        estimate = step(scan)
    except StepFailed:
        return None, True
    return (estimate.covariance if estimate is not None and finite(estimate) else None), False
