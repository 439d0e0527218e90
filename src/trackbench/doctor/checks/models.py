"""Are the Jacobians of a tracker that shows its models the derivatives of those models?

A tracker shows them by methods of these names, each of its own state ``(n,)`` (that of ``Estimate.state``):
``measurement(x, scan)`` with ``measurement_jacobian(x, scan)``, and ``transition(x, dt)`` with
``transition_jacobian(x, dt)``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.session import blind
from trackbench.types import Array

MODELS = ("measurement", "transition")
#: Difference of an entry from that by finite differences, relative to the largest of its row and column scale.
TOLERANCE = 1e-3
STEP = 1e-5


class Entry(NamedTuple):
    """The entry of a Jacobian that is furthest off."""

    size: float
    words: str
    sensor: str | None
    station: str


def models(bench: Bench) -> Outcome:
    """Compare every Jacobian that the tracker shows with finite differences of the model that it shows."""
    shown = [name for name in MODELS if _has(bench, name) and _has(bench, f"{name}_jacobian")]
    if not shown:
        return Outcome()
    entries = [entry for name in shown for entry in _entries(bench, name)]
    question = f"Are the Jacobians of the {' and the '.join(shown)} that it shows right?"
    if not entries:
        return Outcome([Check("models", question, None, "its estimates carry no state")])
    worst = max(entries, key=lambda entry: entry.size)
    passed = worst.size < TOLERANCE
    text = f"against finite differences the worst of {len(entries)} Jacobians has {worst.words}"
    findings = [] if passed else [Finding("jacobian_wrong", 0.98, text, sensor=worst.sensor, station=worst.station)]
    return Outcome([Check("models", question, passed, text)], findings)


def _has(bench: Bench, name: str) -> bool:
    return callable(getattr(bench.make(), name, None))


def _entries(bench: Bench, name: str) -> Iterator[Entry]:
    tracker = bench.make()
    model, jacobian = getattr(tracker, name), getattr(tracker, f"{name}_jacobian")
    for station in bench.stations.ordinary:
        session = bench.followed(station, bench.kinds()[-1])
        for sensor in bench.sensors if name == "measurement" else list(bench.sensors)[:1]:
            scan = station.scan(sensor, bench.sensors[sensor], 0.0)
            answer = None if session is None else session.peek(blind(scan))
            if answer is None or answer.state is None:
                continue
            given: Any = scan if name == "measurement" else 0.1
            shown, found = (
                np.asarray(jacobian(answer.state, given), dtype=float),
                _differences(partial(_called, model, given), answer.state),
            )
            scale = np.maximum(np.abs(found).max(axis=1, keepdims=True), 1e-9)
            apart = np.abs(shown - found) / scale
            i, j = np.unravel_index(int(np.argmax(apart)), apart.shape)
            words = (
                f"d {name}[{i}] / d x[{j}] = {shown[i, j]:.4g}, where {found[i, j]:.4g} is right ({station.purpose})"
            )
            yield Entry(float(apart[i, j]), words, sensor if name == "measurement" else None, station.name)


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
