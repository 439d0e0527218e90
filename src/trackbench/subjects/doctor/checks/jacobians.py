"""Are the Jacobians that a tracker's lines write the derivatives of its models?

Of a filter whose mean and covariance are found in the tracker (`inside.own_filter`) the derivatives are taken by
differences of the filter itself: F of its prediction, and C of its estimate by its state. A line's matrix counts as the
Jacobian that was used where covariances move, or gains come, as by it: by F D F^T a difference D of covariances, and as
P H^T (H P H^T + R)^-1 the gain (Bar-Shalom, Li and Kirubarajan 2001, section 10.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.findings import PROVEN, Finding, PartResult, Question, doctor_check
from trackbench.subjects.doctor.inside.own_filter import INSTANT, NARROW, OwnFilter, covariances_apart, own_filter
from trackbench.subjects.doctor.inside.values import Assigned
from trackbench.subjects.doctor.matrices import largest_entry
from trackbench.subjects.doctor.session import StepFailed
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Time of the prediction, s.
OVER = 0.1
#: Error of a covariance or gain relative to the right one from which on it is wrong: Jacobians that are taken elsewhere
#: than at the mean, or cut off, have 0.03.
WRONG = 0.1
#: The same up to which it is that of a line's matrix, and of its transpose: both are near to no motion.
USED, EXACT = 0.01, 1e-6
#: Difference of an entry, over the sum of both values, from which on it is marked.
OFF = 0.1
#: Change of a measurement for a derivative, and innovation that is none, in its standard deviations.
STEP, NONE = 0.1, 0.01
#: Difference of a transition's derivative from the identity that is rounding.
STANDS = 1e-6
#: Share of the largest gain that is none.
NO_GAIN = 1e-6
#: Times over which the process noise is compared, s, and share by which it falls from one to the next.
TIMES, FALLS = (0.05, 0.1, 0.2, 0.4), 0.2
#: Targets that are tried.
TARGETS = 3


@doctor_check(
    Question("written_jacobians", "Are the Jacobians that lines write the derivatives, and does noise grow with time?"),
    place=104,
    of_filters=True,
)
def written_jacobians(tracker: TrackerUnderTest) -> PartResult:
    """Look into predictions and updates; nothing of a filter whose mean and covariance are not found."""
    looked, finding = tracker.once(wrong_line)
    if not looked:
        return PartResult()
    rule = f"covariances and gains are those of the right ones at {looked} targets"
    return PartResult().add_evidence("written_jacobians", finding, rule)


def wrong_line(tracker: TrackerUnderTest) -> tuple[int, Finding | None]:
    """How many targets were looked at, up to the first wrong line, and what is wrong there."""
    looked = 0
    for probe in () if tracker.random else tracker.probes.general[:TARGETS]:
        session = tracker.session_of_most(probe)
        own = None if session is None else own_filter(session)
        if own is None:
            continue
        looked += 1
        scans = [probe.scan(name, sensor, 0.0)._replace(time=own.time) for name, sensor in tracker.sensors.items()]
        with suppress(StepFailed):
            of_sensors = (_of_sensor(own, scan) for scan in scans)
            finding = _of_motion(own) or _of_noise(own) or next(filter(None, of_sensors), None)
            if finding is not None:
                return looked, finding
    return looked, None


def _of_motion(own: OwnFilter) -> Finding | None:
    """A transition's Jacobian that moves covariances otherwise than the mean moves."""
    scan = empty_scan(own.session.given[-1]._replace(time=own.time + OVER))
    narrow = NARROW * own.covariance
    right = own.derivative(scan, lambda after: after.mean, narrow)
    less, more = (own.after(scan, covariance=size * narrow, trace=True) for size in (1.0, 2.0))
    if right is None or less is None or more is None:
        return None
    if np.allclose(right, np.eye(len(right)), atol=STANDS):
        # The mean is not predicted at all.
        return None
    moved = more.covariance - less.covariance
    if covariances_apart(right @ narrow @ right.T, moved) < WRONG:
        return None
    for at in _last_values(less.assigned, right.shape):
        if covariances_apart(at.value @ narrow @ at.value.T, moved) < USED:
            return _wrong_entry(less.assigned, at, right, None, f"differences of the prediction over {OVER:g} s")
        if _same(at.value, right) and covariances_apart(right.T @ narrow @ right, moved) < EXACT:
            text = f"{at.where}: with the Jacobian F = {at.name} covariances become F^T P F, and F P F^T is right"
            return Finding("predicted_covariance_wrong", PROVEN, text)
    return None


def _of_noise(own: OwnFilter) -> Finding | None:
    """A process noise of some part of the state that is the smaller, the longer the time."""
    stamps = [own.session.given[-1]._replace(time=own.time + time) for time in TIMES]
    exact = np.finfo(float).eps * own.covariance
    longer = [own.after(empty_scan(stamp), covariance=exact) for stamp in stamps]
    added = np.array([np.diag(after.covariance) for after in longer if after is not None])
    if len(added) < len(TIMES):
        return None
    falling = np.flatnonzero((np.diff(added, axis=0) < -FALLS * added[:-1]).all(axis=0))
    if not len(falling):
        return None
    k, times = int(falling[0]), ", ".join(f"{time:g}" for time in TIMES)
    text = (
        f"the variance that a prediction over {times} s adds to entry {k} of the state is "
        f"{', '.join(f'{value:.3g}' for value in added[:, k])}: the less, the longer"
    )
    return Finding("q_wrong_power_of_dt", PROVEN, text)


def _of_sensor(own: OwnFilter, scan: Scan) -> Finding | None:
    """A sensor's Jacobian that gives the gain and is not that of what the sensor measures."""
    scan = scan._replace(time=own.time + INSTANT)
    model, missed, narrow = SENSOR_MODELS[scan.kind], empty_scan(scan), NARROW * own.covariance
    before, outputs = own.after(missed, covariance=narrow), own.outputs(missed)
    if before is None or before.estimate is None or outputs is None:
        return None
    where = before.estimate.mean, scan.sensor_pose, scan.sensor_velocity
    expected, right = model.measure(*where), model.jacobian(*where) @ outputs
    sigma = np.sqrt(np.diag(scan.noise_covariance))
    centre = own.after(scan._replace(measurement=expected), covariance=narrow, trace=True)
    columns = []
    for step in np.diag(STEP * sigma):
        ahead, behind = (
            own.after(scan._replace(measurement=expected + side * step), covariance=narrow) for side in (1, -1)
        )
        if ahead is None or behind is None:
            return None
        columns.append((ahead.mean - behind.mean) / (2 * STEP))
    gain = np.stack(columns, axis=1)
    used = np.abs(gain).max(axis=0) > NO_GAIN * np.abs(gain).max()
    # What is predicted otherwise than measured has another name.
    if centre is None or not used.any() or np.abs(centre.mean - before.mean).max() > NONE * np.abs(gain).max():
        return None
    gain, right, noise = (gain / sigma)[:, used], right[used], scan.noise_covariance[np.ix_(used, used)]
    if _gain_apart(_gain(narrow, right, noise), gain, narrow, noise) < WRONG:
        return None
    for at in _last_values(centre.assigned, right.shape):
        if _gain_apart(_gain(narrow, at.value, noise), gain, narrow, noise) < USED and not _same(at.value, right):
            return _wrong_entry(centre.assigned, at, right, scan.sensor, f"differences of what {scan.sensor} measures")
    return None


def _gain(covariance: Array, jacobian: Array, noise: Array) -> Array:
    return np.asarray(np.linalg.solve(jacobian @ covariance @ jacobian.T + noise, jacobian @ covariance).T)


def _gain_apart(gain: Array, other: Array, covariance: Array, noise: Array) -> float:
    """In standard deviations, relative to the largest entry."""
    scale = np.sqrt(np.diag(noise)) / np.sqrt(np.diag(covariance))[:, None]
    return float(np.abs((gain - other) * scale).max() / np.abs(other * scale).max())


def _wrong_entry(assigned: Sequence[Assigned], at: Assigned, right: Array, sensor: str | None, by: str) -> Finding:
    """The entry that is off most, and the line that has made it."""
    off = np.abs(at.value - right) / (np.abs(at.value) + np.abs(right) + 1e-6 * np.abs(right).max())
    i, j = largest_entry(off)
    of_name = [entry for entry in assigned if (entry.file, entry.name) == (at.file, at.name)]
    values = [entry for entry in of_name if entry.value.shape == right.shape]
    made = next(entry for entry in values if entry.value[i, j] == at.value[i, j])
    # What no line has set was missed by the last one.
    where = at.where if made is values[0] else made.where
    marked = [(int(row), int(column)) for row, column in np.argwhere(off > OFF)]
    others = f" ({len(marked)} of its entries differ)" if len(marked) > 1 else ""
    text = f"{where}: {at.name}[{i}, {j}] is {at.value[i, j]:.4g}, and {by} give {right[i, j]:.4g}{others}"
    return Finding("jacobian_wrong", PROVEN, text, sensor=sensor)


def _last_values(assigned: Sequence[Assigned], shape: tuple[int, ...]) -> list[Assigned]:
    """Of the variables with matrices of a shape the last values."""
    return list({(entry.file, entry.name): entry for entry in assigned if entry.value.shape == shape}.values())


def _same(value: Array, other: Array) -> bool:
    return bool(np.abs(value - other).max() < 1e-4 * np.abs(other).max())
