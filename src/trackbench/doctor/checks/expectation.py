"""Which measurement does the tracker expect of the target that it believes in?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.doctor.bench import Bench, Reply
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.misreadings import Misreading, misreadings
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array

#: An innovation where there should be none, in standard deviations of the measurement: a sigma-point filter's own
#: second order stays below a third of one.
MET = 0.75
#: Share of the stations at which an expectation must be met.
MOST = 0.85
#: Standard deviations by which a constant offset may differ between stations.
CONSTANT = 0.5


def expectation(bench: Bench) -> Outcome:
    """Meet each expectation that a right or a faulty model leads to, and see whether the estimate stays."""
    outcome = Outcome()
    for sensor, replies in bench.replies.items():
        if not replies:
            outcome.checks.append(Check(f"expectation.{sensor}", _question(sensor), None, "there was no estimate"))
            continue
        _examine(sensor, replies, outcome)
    return outcome


def _examine(sensor: str, replies: Sequence[Reply], outcome: Outcome) -> None:
    kind = replies[0].scan.kind
    if not any(_moves(reply, kind) for reply in replies):
        text = f"no measurement of {sensor} moves the estimate, at any of {len(replies)} stations"
        outcome.findings.append(Finding("measurement_ignored", 0.99, text, sensor=sensor))
        outcome.checks.append(Check(f"expectation.{sensor}", _question(sensor), False, text))
        return
    surprises = np.array([_surprise(reply, reply.expected) for reply in replies])
    right = float(np.mean(surprises < MET))
    if right >= MOST:
        text = "the measurement of the predicted target leaves the estimate where it is, to "
        text += f"{np.nanmax(surprises):.2f} sigma"
        outcome.checks.append(Check(f"expectation.{sensor}", _question(sensor), True, text))
        return
    found = _misread(sensor, kind, replies) or _offset(sensor, replies)
    worst = replies[int(np.nanargmax(np.where(np.isfinite(surprises), surprises, -1.0)))]
    text = (
        f"at {np.sum(~(surprises < MET))} of {len(replies)} stations the measurement of the predicted target itself is "
        f"a surprise, of {np.nanmedian(surprises):.3g} sigma in the median"
    )
    outcome.checks.append(
        Check(f"expectation.{sensor}", _question(sensor), False, f"{text} (worst: {worst.station.purpose})")
    )
    if found is not None:
        outcome.findings.append(found)


def _misread(sensor: str, kind: str, replies: Sequence[Reply]) -> Finding | None:
    best: tuple[float, Misreading] | None = None
    for misreading in misreadings(kind):
        met = np.mean(
            [_surprise(reply, misreading.expect(reply.predicted.mean, reply.scan)) < MET for reply in replies]
        )
        if best is None or met > best[0] + 1e-9:
            best = (float(met), misreading)
    assert best is not None
    share, misreading = best
    if share < MOST:
        return None
    telling = max(replies, key=lambda reply: _apart(reply, misreading))
    expects = misreading.expect(telling.predicted.mean, telling.scan)
    names = SENSOR_MODELS[kind].components
    shown = [i for i in range(len(expects)) if abs(expects[i] - telling.expected[i]) > 0.5 * telling.sigma[i]] or [0]
    numbers = ", ".join(
        f"{names[i].replace('_', ' ')} {telling.expected[i]:.4g} is right and {expects[i]:.4g} is what it expects"
        for i in shown
    )
    text = (
        f"{misreading.words}: of {telling.station.purpose}, {numbers}; that measurement leaves its estimate where it "
        f"is at {share:.0%} of {len(replies)} stations, and the right one does not"
    )
    return Finding(misreading.fault, 0.6 + 0.39 * share, text, sensor=sensor, station=telling.station.name)


def _offset(sensor: str, replies: Sequence[Reply]) -> Finding | None:
    """A constant error of the measurements."""
    offsets = np.array([offset for reply in replies if (offset := _null(reply)) is not None])
    if len(offsets) < MOST * len(replies):
        return None
    sigma = replies[0].sigma
    middle = np.median(offsets, axis=0)
    spread = np.median(np.abs(offsets - middle), axis=0) / sigma
    biased = np.abs(middle) > MET * sigma
    if not biased.any() or np.any(spread > CONSTANT + 0.1 * np.abs(middle) / sigma):
        return None
    model = SENSOR_MODELS[replies[0].scan.kind]
    parts = [
        f"{model.components[i].replace('_', ' ')} {middle[i]:+.3g} {'rad' if i in model.angular else 'm or m/s'}"
        for i in np.flatnonzero(biased)
    ]
    text = (
        f"the measurement that it expects is off by the same at every station: {', '.join(parts)} "
        f"(spread {np.max(spread[biased]):.2g} sigma over {len(offsets)} questions)"
    )
    return Finding("sensor_bias", 0.9, text, sensor=sensor, station=replies[0].station.name)


def _null(reply: Reply) -> Array | None:
    """``(m,)`` from the expected measurement to the one that leaves the estimate where it is."""
    measurement = reply.expected.copy()
    for _ in range(6):
        effect = reply.effect(measurement)
        if effect is None or not effect.used.any():
            return None
        step = np.nan_to_num(effect.surprise) * reply.sigma
        measurement = measurement - step
        if np.max(np.abs(step) / reply.sigma) < 0.02:
            return measurement - reply.expected
    return None


def _surprise(reply: Reply, measurement: Array) -> float:
    """How far a measurement is from what the tracker expects, in sigma; infinite where it says nothing."""
    effect = reply.effect(measurement)
    if effect is None or not effect.used.any():
        return np.inf
    size = float(np.nanmax(np.abs(effect.surprise)))
    return size if np.isfinite(size) else np.inf


def _apart(reply: Reply, misreading: Misreading) -> float:
    expects = misreading.expect(reply.predicted.mean, reply.scan)
    return float(np.max(np.abs(expects - reply.expected) / reply.sigma))


def _moves(reply: Reply, kind: str) -> bool:
    tried = [reply.expected, reply.scan.measurement]
    tried += [misreading.expect(reply.predicted.mean, reply.scan) for misreading in misreadings(kind)]
    effects = (reply.effect(measurement) for measurement in tried)
    return any(
        effect is not None and effect.used.any() and np.abs(effect.relative_gain).max() > 1e-9 for effect in effects
    )


def _question(sensor: str) -> str:
    return f"Does the tracker expect of {sensor} what the target it believes in would give?"
