"""Are the Jacobians that a tracker provides the derivatives of its models?

A tracker may provide these methods, each of its own state ``(n,)`` (that of ``Estimate.state``):
``measurement(x, scan)`` with ``measurement_jacobian(x, scan)``, and ``transition(x, dt)`` with
``transition_jacobian(x, dt)``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.exhibits import Matrices, Panel, components_of
from trackbench.subjects.doctor.findings import Finding, PartResult, Question, doctor_check
from trackbench.subjects.doctor.session import StepFailed
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.units_ratio import conversion

MODELS = ("measurement", "transition")
#: Difference of an entry from the finite difference, relative to the largest entry of its row.
TOLERANCE = 1e-3
STEP = 1e-5


@doctor_check(Question("models", "Are the Jacobians that the tracker provides right?"), place=180)
def provided_jacobians(tracker: TrackerUnderTest) -> PartResult:
    """Compare each Jacobian that the tracker provides with finite differences of its model."""
    provided = [name for name in MODELS if _has(tracker, name) and _has(tracker, f"{name}_jacobian")]
    if not provided:
        return PartResult()
    entries = [entry for name in provided for entry in _entries(tracker, name)]
    question = f"Are the Jacobians of the {' and the '.join(provided)} that the tracker provides right?"
    if not entries:
        return PartResult().add("models", None, "its estimates have no state", question=question)
    size, worst = max(entries, key=lambda entry: entry[0])
    text = f"the largest difference from finite differences in {len(entries)} Jacobians: {worst.evidence}"
    finding = None if size < TOLERANCE else replace(worst, evidence=text)
    return PartResult().add("models", finding is None, text, finding, question=question)


def _has(tracker: TrackerUnderTest, name: str) -> bool:
    return callable(getattr(tracker.make(), name, None))


def _entries(tracker: TrackerUnderTest, name: str) -> Iterator[tuple[float, Finding]]:
    """The largest error of each Jacobian, as a finding."""
    fresh = tracker.make()
    model, jacobian = getattr(fresh, name), getattr(fresh, f"{name}_jacobian")
    for probe in tracker.probes.regular:
        session = tracker.session_at(probe, tracker.sensor_sets()[-1])
        for sensor in tracker.sensors if name == "measurement" else list(tracker.sensors)[:1]:
            scan = probe.scan(sensor, tracker.sensors[sensor], 0.0)
            estimate = tracker.predict(session, scan, probe.name)
            if estimate is None or estimate.state is None:
                continue
            given: Any = scan if name == "measurement" else 0.1
            try:
                provided = np.asarray(jacobian(estimate.state, given), dtype=float)
                found = _differences(partial(_called, model, given), estimate.state)
            except Exception as error:
                raise StepFailed(error, scan) from error
            scale = np.maximum(np.abs(found).max(axis=1, keepdims=True), 1e-9)
            apart = np.abs(provided - found) / scale
            i, j = np.unravel_index(int(np.argmax(apart)), apart.shape)
            text = f"d {name}[{i}] / d x[{j}] = {provided[i, j]:.4g}, where {found[i, j]:.4g} is right "
            text += f"({probe.description})" + _unit(provided[i], found[i])
            exhibit = Matrices(
                f"Jacobian of the {name}: {probe.description}",
                components_of(scan.kind)
                if name == "measurement"
                else tuple(f"{name}[{k}]" for k in range(len(provided))),
                tuple(f"x[{k}]" for k in range(provided.shape[1])),
                (Panel("provided", provided), Panel("finite differences", found, "right")),
                ((int(i), int(j)),),
            )
            fault, of = "jacobian_wrong", sensor if name == "measurement" else None
            yield float(apart[i, j]), Finding(fault, 0.98, text, sensor=of, shown_by=probe.name, exhibit=exhibit)


def _unit(provided: Array, found: Array) -> str:
    """That a row or one of its entries is off by a unit, if it is."""
    used = np.abs(found) > 1e-6 * np.abs(found).max()
    off = used & (np.abs(provided - found) > TOLERANCE * np.abs(found).max())
    with np.errstate(divide="ignore", invalid="ignore"):
        units = {conversion(float(ratio)) for ratio in (provided / found)[off]}
    unit = units.pop() if len(units) == 1 else None
    return "" if unit is None else f", off by a unit: {unit.words}"


def _called(model: Callable[..., Any], given: Any, x: Array) -> Array:
    return np.asarray(model(x, given), dtype=float)


def _differences(model: Callable[[Array], Array], x: Array) -> Array:
    """Central differences ``(m, n)``."""
    columns = []
    for j in range(len(x)):
        step = np.zeros(len(x))
        step[j] = STEP * max(1.0, abs(float(x[j])))
        columns.append((model(x + step) - model(x - step)) / (2 * step[j]))
    return np.stack(columns, axis=1)
