"""How much change of the velocity does the process noise allow, and how does it grow with the time step?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import COMMON_STATE, Array, Estimate
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.matrices import straight
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Growth of the standard deviation of a road vehicle's speed in 1 s without measurements, at 20 steps a second, m/s.
#: White accelerations of 0.5 and 18 m/s^2 cause these: the rule of half to all of the largest acceleration (Bar-Shalom,
#: Li and Kirubarajan 2001, section 6.3.2) with 1 to 9 m/s^2 lies well within.
BAND = (0.115, 4.0)
#: The same of the reference, a white acceleration of 3 m/s^2.
REFERENCE = 3.0 * np.sqrt(0.05)
#: A growth below this is the rounding of the difference of two variances, m/s.
NONE = 1e-6
#: s
STEP = 0.05
#: Two steps whose process noises are compared, s, and the share of the long one's that the short one's may have.
STEPS, CONSTANT = (0.002, 0.2), 0.3
#: Growth of the variance of the velocity over the long step that is one, relative to it.
LEAST_GROWTH = 1e-6
#: Share of the growth over the short step that is not in proportion to the covariance, with a fading memory: none with
#: constant velocity, and what other motions add in so short a step.
ONLY = 0.2
#: Steps over which the process noise is compared, s: each twice the one before.
TIMES = (0.1, 0.2, 0.4)
#: Difference of the process noises at different probes that is rounding, relative to it: that of a filter with constant
#: velocity depends on the step alone. An entry below this, relative to its variances, is zero.
SAME = 1e-6
#: Distance of an exponent from a whole number that is rounding. A sum of two powers has none.
WHOLE = 0.02
#: Correlation of two entries of the process noise from which on one acceleration is in both, and up to which none is.
TIED, UNTIED = 0.7, 0.1
#: By how much the exponents of position, of position and velocity, and of velocity exceed the last one.
ABOVE = (2, 1, 0)


@doctor_check(
    Question(
        "process_noise",
        "Is the process noise that of a road vehicle?",
        "Does the process noise fit a road vehicle?",
        misses=True,
        finds=("q_too_small", "q_too_large", "process_noise_omitted"),
    ),
    Question(
        "noise_per_step",
        "Does the process noise of a step depend on its length?",
        misses=True,
        finds=("q_constant_per_step",),
    ),
    place=110,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "q_too_small": KnownFault(
            "the process noise is too small",
            "Where Q is computed.",
            "For G G^T sigma^2, set sigma to half to all of the largest acceleration of the targets (1 to 9 m/s^2 for "
            "cars).",
            Role("motion", rank=48, drive="manoeuvre"),
        ),
        "q_too_large": KnownFault(
            "the process noise is too large",
            "Where Q is computed; check the powers of dt too.",
            "For G G^T sigma^2, set sigma to half to all of the largest acceleration of the targets (1 to 9 m/s^2 for "
            "cars).",
            Role("motion", rank=22, drive="own_model"),
        ),
        "q_constant_per_step": KnownFault(
            "the process noise does not depend on the time step",
            "Where Q is computed, or set once.",
            "Compute Q from the dt of every step: G G^T sigma^2 with G = (dt^2 / 2, dt)^T for each axis; it is zero "
            "for dt = 0.",
            Role("motion", rank=25, drive="uneven_steps"),
        ),
        "process_noise_omitted": KnownFault(
            "the process noise is missing from the predicted covariance",
            "Where the covariance is predicted.",
            "P = F P F^T + Q, or the sum over the moved points plus Q.",
            Role("motion", rank=33, drive="manoeuvre"),
        ),
    },
)
def growth_by_noise(tracker: TrackerUnderTest) -> PartResult:
    """Predict for 1 s without measurements, and measure the growth of the speed's standard deviation."""
    # A tracker may leave a sensor out; one that starts from a sensor alone reads it.
    alone = [(name,) for name in tracker.sensors]
    found = _growths(tracker, alone) or _growths(tracker, [tuple(tracker.sensors)])
    if not found:
        why = "there was no estimate to predict"
        return PartResult().add("process_noise", None, why).add("noise_per_step", None, why)
    growth = float(np.median(found))
    shown_by = tracker.probes.general[0].name
    if growth < NONE:
        text = (
            "in 1 s without a measurement the variance of the speed does not grow (its root by at most "
            f"{max(found):.2g} m/s)"
        )
        finding = Finding("process_noise_omitted", 0.97, text, shown_by=shown_by)
        return PartResult().add("process_noise", False, text, finding)
    equal = growth / np.sqrt(STEP)
    text = (
        f"in 1 s without a measurement the standard deviation of the speed grows by {growth:.3g} m/s (root of the "
        f"difference of the squares), as with a white acceleration of {equal:.3g} m/s^2 at 20 steps a second; "
        f"{BAND[0]:g} to {BAND[1]:g} m/s fit road vehicles"
    )
    fits = BAND[0] <= growth <= BAND[1]
    result = PartResult().add("process_noise", fits, text)
    _per_step(tracker, result)
    if not fits:
        fault = "q_too_small" if growth < BAND[0] else "q_too_large"
        excess = BAND[0] / max(growth, 1e-9) if growth < BAND[0] else growth / BAND[1]
        confidence, factor = min(0.97, 0.8 + 0.1 * np.log(excess)), (growth / REFERENCE) ** 2
        finding = Finding(fault, confidence, text, factor=factor, shown_by=shown_by)
        result.findings.append(finding)
    return result


def _per_step(tracker: TrackerUnderTest, result: PartResult) -> None:
    """Predict over a short and over a long step: with any white noise the variance grows with the step."""
    pairs = []
    for probe in tracker.probes.general[:3]:
        over = [tracker.predicted(probe, step) for step in STEPS]
        if over[0] is None or over[1] is None:
            continue
        now, short, long = over[0][0], over[0][1], over[1][1]
        variances = [float(np.trace(estimate.covariance[2:, 2:])) for estimate in (now, short, long)]
        if variances[2] - variances[0] > LEAST_GROWTH * variances[0] and not _faded(now, short, STEPS[0]):
            pairs.append((variances[1] - variances[0], variances[2] - variances[0]))
    if not pairs:
        result.add("noise_per_step", None, "no process noise is added to the variance of the velocity")
        return
    share = float(np.median([short / long for short, long in pairs]))
    text = (
        f"over {STEPS[0] * 1e3:g} ms the variance of the velocity grows {share:.3g} times as much as over "
        f"{STEPS[1]:g} s ({pairs[0][0]:.3g} and {pairs[0][1]:.3g} m^2/s^2); in proportion to the "
        f"step it would be {STEPS[0] / STEPS[1]:g} times"
    )
    finding = Finding("q_constant_per_step", 0.96, text, shown_by="uneven_steps")
    result.add("noise_per_step", share < CONSTANT, text, finding if share >= CONSTANT else None)


def _faded(before: Estimate, after: Estimate, step: float) -> bool:
    """Whether the covariance, moved with the estimate, has only been multiplied, as with a fading memory.

    Entries count by their standard deviations: the velocity's growth alone can be in proportion to its variances.
    """
    motion = straight(step)
    moved = motion @ before.covariance @ motion.T
    spread = np.sqrt(np.abs(np.diag(moved)))
    p, grown = (matrix / np.outer(spread, spread) for matrix in (moved, after.covariance - moved))
    share = float(np.trace(grown) / np.trace(p))
    return float(np.linalg.norm(grown - share * p)) < ONLY * float(np.linalg.norm(grown))


def _growths(tracker: TrackerUnderTest, sensor_sets: Sequence[tuple[str, ...]]) -> list[float]:
    return [
        one
        for probe in tracker.probes.general[:3]
        for sensor_set in sensor_sets
        if (one := _growth(tracker, probe, sensor_set)) is not None
    ]


def _growth(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> float | None:
    """Growth of the standard deviation of the speed in 1 s, m/s."""
    session = tracker.session_at(probe, sensor_set)
    if session is None:
        return None
    with tracker.recording_failures(probe.name):
        scans = [tracker.missed(probe, sensor_set[0], STEP * k) for k in range(21)]
        first, *_, last = session.copy().follow(scans)
        if first is not None and last is not None and finite(first) and finite(last):
            return float(np.sqrt(max(0.0, _variance_of_speed(last) - _variance_of_speed(first))))
    return None


def _variance_of_speed(estimate: Estimate) -> float:
    speed = float(np.hypot(*estimate.mean[2:]))
    direction = estimate.mean[2:] / speed if speed > 0.0 else np.array([1.0, 0.0])
    return float(direction @ estimate.covariance[2:, 2:] @ direction)


class Power(NamedTuple):
    """An entry that does not go with the two others of its axis."""

    entry: tuple[int, int]
    found: int
    """Its exponent."""
    right: int
    others: str
    """What the two others grow with."""
    values: Array
    """``(steps,)``"""


@doctor_check(
    Question(
        "noise_powers", "Do the entries of the process noise go with the same powers of the time step?", misses=True
    ),
    place=120,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "q_wrong_power_of_dt": KnownFault(
            "an entry of the process noise has a wrong power of the time step",
            "Where Q is written out.",
            "Position, position and velocity, velocity: dt^4 / 4, dt^3 / 2, dt^2 for G G^T sigma^2; dt^3 / 3, dt^2 / "
            "2, dt for a continuous white noise.",
            Role("motion", rank=21, drive="uneven_steps"),
        )
    },
)
def noise_powers(tracker: TrackerUnderTest) -> PartResult:
    """Compare the powers of the step with those of a white acceleration or its integrals.

    They are ``dt^(n + 2), dt^(n + 1), dt^n``, with n = 2 for an acceleration that is constant over a step, and n = 1
    for a continuous one (Bar-Shalom, Li and Kirubarajan 2001, sections 6.2.2 and 6.3.2).
    """
    noises = _noises(tracker)
    if noises is None:
        text = "the process noise depends on more than the time step, or none is added"
        return PartResult().add("noise_powers", None, text)
    if (mixed := _of_another_order(noises, tracker)) is not None:
        return PartResult().add("noise_powers", False, mixed.evidence, mixed)
    axes = [_exponents(noises, axis) for axis in (0, 1)]
    if all(axis is None for axis in axes):
        text = "position, velocity and both together do not each have one power of the time step"
        return PartResult().add("noise_powers", None, text)
    wrong = [power for number, axis in enumerate(axes) if axis and (power := _wrong(noises, number, axis))]
    if not wrong:
        found = next(axis for axis in axes if axis is not None)
        words = ", ".join(f"dt^{exponent}" for exponent in found)
        text = f"position, position and velocity, and velocity grow with {words} over {TIMES[0]:g} to {TIMES[-1]:g} s"
        return PartResult().add("noise_powers", True, text)
    text = "; ".join(map(_words, wrong))
    shown_by = tracker.probes.general[0].name
    finding = Finding("q_wrong_power_of_dt", 0.96, text, shown_by=shown_by)
    return PartResult().add("noise_powers", False, text, finding)


def _of_another_order(noises: Array, tracker: TrackerUnderTest) -> Finding | None:
    """That an acceleration along one axis moves the positions of both alike, and the velocity of none with them."""
    spread = np.sqrt(np.abs(np.diagonal(noises[-1])))
    correlation = np.abs(noises[-1]) / np.maximum(np.outer(spread, spread), np.finfo(float).tiny)
    if min(correlation[0, 1], correlation[2, 3]) < TIED or max(correlation[0, 2], correlation[1, 3]) > UNTIED:
        return None
    text = (
        f"the process noise of px is that of py (correlation {correlation[0, 1]:.2g}), and not that of vx "
        f"({correlation[0, 2]:.2g}): it is laid out for another order of the state"
    )
    return Finding("q_wrong_power_of_dt", 0.96, text, shown_by=tracker.probes.general[0].name)


def _noises(tracker: TrackerUnderTest) -> Array | None:
    """``(steps, 4, 4)``; None where they are not the same at all probes."""
    found = []
    for probe in tracker.probes.general[:3]:
        of_probe = []
        for step in TIMES:
            over = tracker.predicted(probe, step)
            if over is None:
                return None
            motion = straight(step)
            of_probe.append(over[1].covariance - motion @ over[0].covariance @ motion.T)
        found.append(of_probe)
    noises = np.array(found)
    sizes = np.linalg.norm(noises[0], axis=(1, 2))
    same = np.abs(noises - noises[0]).max(axis=(0, 2, 3)) < SAME * sizes
    return noises[0] if np.all(same) and np.all(sizes > 0.0) else None


def _entries(axis: int) -> tuple[tuple[int, int], ...]:
    return ((axis, axis), (axis, axis + 2), (axis + 2, axis + 2))


def _exponents(noises: Array, axis: int) -> tuple[int, ...] | None:
    """Of position, position and velocity, and velocity; None where one is zero or no power."""
    spread = np.sqrt(np.abs(noises[:, axis, axis] * noises[:, axis + 2, axis + 2]))
    if np.any(np.abs(noises[:, axis, axis + 2]) <= SAME * spread) or np.any(spread == 0.0):
        return None
    found = []
    for i, j in _entries(axis):
        exponents = np.diff(np.log2(np.abs(noises[:, i, j])))
        if np.any(np.abs(exponents - round(float(exponents[0]))) > WHOLE):
            return None
        found.append(round(float(exponents[0])))
    return tuple(found)


def _wrong(noises: Array, axis: int, exponents: tuple[int, ...]) -> Power | None:
    """The one entry that does not go with the two others; one that is constant has another name."""
    votes = Counter(exponent - above for exponent, above in zip(exponents, ABOVE, strict=True))
    power, count = votes.most_common(1)[0]
    if count != len(ABOVE) - 1 or power < 1:
        return None
    k = next(k for k, above in enumerate(ABOVE) if exponents[k] - above != power)
    if exponents[k] < 1:
        return None
    entries = _entries(axis)
    others = " and ".join(f"dt^{exponents[m]} of {_named(entries[m])}" for m in range(len(ABOVE)) if m != k)
    i, j = entries[k]
    return Power(entries[k], exponents[k], power + ABOVE[k], others, noises[:, i, j])


def _named(entry: tuple[int, int]) -> str:
    i, j = entry
    return COMMON_STATE[i] if i == j else f"{COMMON_STATE[i]} and {COMMON_STATE[j]}"


def _words(power: Power) -> str:
    return (
        f"the process noise of {_named(power.entry)} grows with dt^{power.found} ({power.values[0]:.3g} over "
        f"{TIMES[0]:g} s and {power.values[-1]:.3g} over {TIMES[-1]:g} s), where dt^{power.right} goes with the "
        f"{power.others}"
    )
