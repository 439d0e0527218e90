"""Do the equations of a filter hold for the mean and the covariance that its tracker holds?

Mean and covariance are found in the tracker by what they do (`inside.own_filter`). Chosen beliefs are put in their
places, and each equation is checked on the answers (Bar-Shalom, Li and Kirubarajan 2001, sections 5.2.3, 6.2.2, 6.3.2
and 10.3). A difference D of covariances is predicted to ``F D F^T``, a covariance of nearly zero to Q. A gain is
``P H^T (H P H^T + R)^-1``, and the covariance after it ``(I - K H) P (I - K H)^T + K R K^T``. F and K are differences
of the tracker's own answers. Where an equation does not hold, the lines of the step are searched for the matrix that
explains the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import COMMON_STATE, Array
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.checks.updates import TIMES_ADDED, update_finding
from trackbench.subjects.doctor.findings import PROVEN, Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.inside.own_filter import NARROW, OwnFilter, covariance_difference, own_filter
from trackbench.subjects.doctor.inside.values import Assigned
from trackbench.subjects.doctor.inside.written import last_values, same_matrix, wrong_entry
from trackbench.subjects.doctor.matrices import best_multiple, largest_entry
from trackbench.subjects.doctor.session import StepFailed
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Times of predictions, s, each twice the one before; and the time over which covariances are moved, s.
TIMES, OVER = (0.05, 0.1, 0.2, 0.4), 0.1
#: Least error of a covariance, relative to the right one, that is a fault. Jacobians that are cut off, or taken
#: elsewhere than at the mean, have 0.03.
WRONG = 0.1
#: Largest error with which another matrix explains a covariance; and with which its transpose, or no motion, does.
USED, EXACT = 0.01, 1e-6
#: Difference of a transition's derivative from the identity that is only rounding.
STANDS = 1e-6
#: Share of a motion outside the column space of a noise below which the motion counts as within.
OUTSIDE = 0.1
#: Least share by which a falling noise falls from one time to the next.
FALLS = 0.2
#: Largest distance of an exponent from a whole number that is only rounding; a sum of two powers is farther away.
WHOLE = 0.02
#: Correlation of two entries of a noise above which they share an acceleration, and below which they share none.
TIED, UNTIED = 0.7, 0.1
#: Least growth of a covariance, relative to the square of its mean's motion, that is no process noise.
SQUARED = 0.9
#: Faults that are a way of filtering where the drives show no harm.
HARMLESS = ("gain_inconsistent", "r_too_large")
#: Number of targets that are tried.
TARGETS = 3


@doctor_check(
    Question(
        "equations",
        "Do the equations of prediction and update hold for the mean and the covariance that the tracker keeps?",
        misses=True,
    ),
    place=102,
    of_filters=True,
    faults={
        "predicted_covariance_wrong": KnownFault(
            "the predicted covariance does not follow from the previous one",
            "Where the covariance is predicted and stored.",
            "P = F P F^T + Q, or the spread of the moved points about their own mean plus Q, at every scan, missed "
            "ones too.",
            Role(rank=13, drive="long_gap"),
        ),
        "q_wrong_power_of_dt": KnownFault(
            "an entry of the process noise has a wrong power of the time step",
            "Where Q is written out.",
            "Position, position and velocity, velocity: dt^4 / 4, dt^3 / 2, dt^2 for G G^T sigma^2; dt^3 / 3, dt^2 / "
            "2, dt for a continuous white noise.",
            Role("motion", rank=21, drive="uneven_steps"),
        ),
        "gain_inconsistent": KnownFault(
            "the gain does not follow from the tracker's own covariance and the stated models",
            "Where the gain is computed and applied to the mean, and where its covariances are summed over sigma "
            "points or samples.",
            "K = P H^T S^-1 (P_xz S^-1 with the same points, weights and means in both sums), S with R once; move the "
            "mean by K y once.",
            Role(rank=40, drive="tangential_pass"),
        ),
        "covariance_update_wrong": KnownFault(
            "the updated covariance does not follow from the applied gain",
            "Where the covariance is updated after a measurement.",
            "P = (I - K H) P, or (I - K H) P (I - K H)^T + K R K^T, once for each measurement, with the gain that "
            "moves the mean.",
            Role(rank=28, drive="own_model"),
        ),
        "update_not_kept": KnownFault(
            "the next prediction does not start from the returned estimate",
            "Where the updated mean and covariance are stored.",
            "Store the returned mean and covariance; a local x or P, or a changed copy, is not the tracker's.",
            Role(rank=14, drive="own_model"),
        ),
        "sigma_points_not_redrawn": KnownFault(
            "the update uses sigma points without the process noise",
            "Between the prediction and the update, where the moved points are used again.",
            "Draw new points from the predicted mean and covariance, or let the noise be part of the points (augmented "
            "state).",
            Role(rank=37, drive="uneven_steps"),
        ),
        "process_noise_twice": KnownFault(
            "the process noise is added more than once",
            "Where the covariance is predicted.",
            "P = F P F^T + Q, with Q once for each prediction.",
            Role("motion", rank=20, drive="own_model"),
        ),
    },
)
def equations(tracker: TrackerUnderTest) -> PartResult:
    """Put chosen means and covariances into the filter in place of its own, and check each equation on its answers."""
    answers = tracker.once(equation_answers)
    if not answers.targets:
        return PartResult()
    findings = list(answers.findings)
    if findings and all(finding.fault in HARMLESS and finding.confidence < PROVEN for finding in findings):
        harm = tracker.once(harmless)
        if harm is not None:
            return PartResult().add(
                "equations", True, f"not with the stated covariance, but harmless: {harm}; {findings[0].evidence}"
            )
    text = findings[0].evidence if findings else f"they hold at {answers.targets} targets"
    return PartResult().add("equations", not findings, text, *findings)


class EquationAnswers(NamedTuple):
    """Equations of a filter that do not hold, and the sensors whose gains are right."""

    targets: int
    """Number of targets tried, up to the first with a wrong equation; 0 where no mean and covariance are found."""
    findings: tuple[Finding, ...]
    """Faults of the equations that do not hold at the last target tried."""
    right: frozenset[str]
    """Names of the sensors whose gains follow from the covariance that the tracker holds, at all targets tried."""


def equation_answers(tracker: TrackerUnderTest) -> EquationAnswers:
    """Return the filter's equations that do not hold at the first target with any, of three targets at most."""
    target_count, right = 0, set(tracker.sensors)
    for probe in () if tracker.random or tracker.repeats > 1 else tracker.probes.general[:TARGETS]:
        session = tracker.session_of_most(probe)
        held = None if session is None else own_filter(session)
        if held is None:
            continue
        target_count += 1
        scans = [probe.scan(name, sensor, 0.0)._replace(time=held.time) for name, sensor in tracker.sensors.items()]
        of_updates = {scan.sensor: update_finding(held, scan) for scan in scans}
        right -= {name for name, (_, is_right) in of_updates.items() if not is_right}
        findings = [_prediction_fault(held), *(finding for finding, _ in of_updates.values())]
        wrong = [replace(finding, shown_by=probe.name) for finding in findings if finding is not None]
        if wrong:
            return EquationAnswers(target_count, tuple(wrong), frozenset(right))
    return EquationAnswers(target_count, (), frozenset(right if target_count else ()))


def _prediction_fault(held: OwnFilter) -> Finding | None:
    with suppress(StepFailed):
        return _motion_fault(held) or _noise_fault(held)
    return None


def _motion_fault(held: OwnFilter) -> Finding | None:
    """Report a prediction whose covariance is not moved by the motion that moves the mean."""
    scan = empty_scan(held.session.scans[-1]._replace(time=held.time + OVER))
    narrow = NARROW * held.covariance
    right = held.derivative(scan, lambda after: after.mean, narrow)
    less, more = (held.after(scan, covariance=size * narrow, trace=True) for size in (1.0, 2.0))
    if right is None or less is None or more is None:
        return None
    if np.allclose(right, np.eye(len(right)), atol=STANDS):
        # The mean is not predicted, or is kept at an earlier time.
        return None
    moved, expected = linalg.symmetrise(more.covariance - less.covariance), linalg.symmetrise(right @ narrow @ right.T)
    # A filter with a fading memory adds to the covariance on purpose.
    expected *= max(1.0, best_multiple(moved, expected))
    if covariance_difference(expected, moved) < WRONG:
        return None
    for matrix in last_values(less.assigned, right.shape):
        explained = covariance_difference(matrix.value @ narrow @ matrix.value.T, moved) < USED
        if explained and not same_matrix(matrix.value, right):
            return wrong_entry(less.assigned, matrix, right, None, f"differences of the prediction over {OVER:g} s")
    i, j = largest_entry(np.abs(moved - expected) / np.sqrt(np.outer(np.diag(expected), np.diag(expected))))
    by = f"a covariance D that is added before a prediction over {OVER:g} s"
    if covariance_difference(right.T @ narrow @ right, moved) < EXACT:
        text = f"{by} becomes F^T D F, and F D F^T is right"
    elif covariance_difference(narrow, moved) < EXACT:
        text = f"{by} stays as it is"
    elif np.abs(moved).max() < EXACT * np.abs(expected).max():
        text = f"{by} makes no difference: the predicted covariance is the same whatever it was before"
    else:
        text = (
            f"{by} becomes another than F D F^T with the F that moves the mean: its entry {i}, {j} becomes "
            f"{moved[i, j]:.3g}, and {expected[i, j]:.3g} is right"
        )
    return Finding("predicted_covariance_wrong", 0.96, text)


def _noise_fault(held: OwnFilter) -> Finding | None:
    """Report a process noise that no acceleration explains: by its growth over time, or by its matrix."""
    stamps = [empty_scan(held.session.scans[-1]._replace(time=held.time + time)) for time in TIMES]
    exact = np.finfo(float).eps * held.covariance
    longer = [after for stamp in stamps if (after := held.after(stamp, covariance=exact, trace=True)) is not None]
    outputs = held.outputs(stamps[0])
    if len(longer) < len(TIMES) or outputs is None:
        return None
    noises = np.array([linalg.symmetrise(after.covariance) for after in longer])
    return (
        _spread_about_old_mean(held, noises, longer[0].mean, longer[-1].mean)
        or _falling_noise(noises)
        or _noise_added_twice(longer[0].assigned, noises[0])
        or _noise_of_another_order(outputs @ noises[-1] @ outputs.T)
        or _noise_of_another_power(np.array([outputs @ noise @ outputs.T for noise in noises]))
    )


def _spread_about_old_mean(held: OwnFilter, noises: Array, *means: Array) -> Finding | None:
    """Report that a covariance of zero grows by the square of the predicted motion, over a short and a long time."""
    shares = []
    for noise, mean in zip((noises[0], noises[-1]), means, strict=True):
        moved = mean - held.mean
        precision = float(moved @ np.linalg.pinv(noise, rcond=1e-12, hermitian=True) @ moved)
        within = np.linalg.norm(noise @ np.linalg.pinv(noise, rcond=1e-12, hermitian=True) @ moved - moved)
        shares.append(1.0 / precision if precision > 0.0 and within < OUTSIDE * np.linalg.norm(moved) else 0.0)
    if min(shares) < SQUARED:
        return None
    text = (
        f"a prediction of a covariance of zero adds the square of the motion itself, {shares[0]:.3g} times over "
        f"{TIMES[0]:g} s and {shares[1]:.3g} times over {TIMES[-1]:g} s: the spread is about the unpredicted mean"
    )
    return Finding("predicted_covariance_wrong", 0.95, text)


def _falling_noise(noises: Array) -> Finding | None:
    """Report a state whose variance grows less the longer a prediction is."""
    added = np.diagonal(noises, axis1=1, axis2=2)
    falling = np.flatnonzero((np.diff(added, axis=0) < -FALLS * added[:-1]).all(axis=0))
    if not len(falling):
        return None
    k, times = int(falling[0]), ", ".join(f"{time:g}" for time in TIMES)
    text = (
        f"the variance that a prediction over {times} s adds to entry {k} of the state is "
        f"{', '.join(f'{value:.3g}' for value in added[:, k])}: the less, the longer"
    )
    return Finding("q_wrong_power_of_dt", PROVEN, text)


def _noise_added_twice(assigned: Sequence[Assigned], noise: Array) -> Finding | None:
    for matrix in last_values(assigned, noise.shape):
        for count in TIMES_ADDED:
            if np.abs(matrix.value).max() > 0.0 and same_matrix(count * matrix.value, noise):
                text = f"{matrix.where}: a prediction adds {matrix.name} {count} times to the covariance"
                return Finding("process_noise_twice", PROVEN, text, factor=float(count))
    return None


def _noise_of_another_order(noise: Array) -> Finding | None:
    """Report a process noise that correlates px with py, and neither of them with its own velocity."""
    spread = np.sqrt(np.maximum(np.diag(noise), np.finfo(float).tiny))
    correlation = np.abs(noise) / np.outer(spread, spread)
    if min(correlation[0, 1], correlation[2, 3]) < TIED or max(correlation[0, 2], correlation[1, 3]) > UNTIED:
        return None
    text = (
        f"the process noise of px is that of py (correlation {correlation[0, 1]:.2g}), and not that of vx "
        f"({correlation[0, 2]:.2g}): it is laid out for another order of the state"
    )
    return Finding("q_wrong_power_of_dt", 0.96, text)


def _noise_of_another_power(noises: Array) -> Finding | None:
    """Report an entry of Q whose power of the time step does not fit that of the two other entries of its axis."""
    for axis in (0, 1):
        entries = ((axis, axis), (axis, axis + 2), (axis + 2, axis + 2))
        values = np.abs([[noise[entry] for entry in entries] for noise in noises])
        exponents = np.diff(np.log2(np.maximum(values, np.finfo(float).tiny)), axis=0)
        powers = np.round(exponents[0])
        if np.abs(exponents - powers).max() > WHOLE or powers.min() < 1:
            continue
        orders = powers - (2, 1, 0)
        wrong = [k for k in range(3) if orders[k] != np.median(orders)]
        if len(wrong) != 1:
            continue
        (k,) = wrong
        i, j = entries[k]
        name = COMMON_STATE[i] if i == j else f"{COMMON_STATE[i]} and {COMMON_STATE[j]}"
        text = (
            f"the process noise of {name} grows with dt^{powers[k]:g} ({values[0, k]:.3g} over {TIMES[0]:g} s and "
            f"{values[-1, k]:.3g} over {TIMES[-1]:g} s), where dt^{powers[k] - orders[k] + np.median(orders):g} goes "
            "with the two other entries of the axis"
        )
        return Finding("q_wrong_power_of_dt", 0.96, text)
    return None
