"""Does each entry of the process noise grow with the power of the time step that goes with the others?"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from trackbench.base.types import COMMON_STATE, Array
from trackbench.subjects.doctor.exhibits import Course, OverTime
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.right_answers import straight
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Steps over which the process noise is compared, s: each twice the one before.
STEPS = (0.1, 0.2, 0.4)
#: Difference of the process noises at different probes that is rounding, relative to it: that of a filter with constant
#: velocity depends on the step alone. An entry below this, relative to its variances, is zero.
SAME = 1e-6
#: Distance of an exponent from a whole number that is rounding. A sum of two powers has none.
WHOLE = 0.02
#: By how much the exponents of position, of position and velocity, and of velocity exceed the last one.
ABOVE = (2, 1, 0)


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


def noise_powers(tracker: TrackerUnderTest) -> PartResult:
    """Compare the powers of the step with those of a white acceleration or its integrals.

    They are ``dt^(n + 2), dt^(n + 1), dt^n``, with n = 2 for an acceleration that is constant over a step, and n = 1
    for a continuous one (Bar-Shalom, Li and Kirubarajan 2001, sections 6.2.2 and 6.3.2).
    """
    noises = _noises(tracker)
    if noises is None:
        text = "the process noise depends on more than the time step, or none is added"
        return PartResult().add("noise_powers", None, text)
    axes = [_exponents(noises, axis) for axis in (0, 1)]
    if all(axis is None for axis in axes):
        text = "position, velocity and both together do not each have one power of the time step"
        return PartResult().add("noise_powers", None, text)
    wrong = [power for number, axis in enumerate(axes) if axis and (power := _wrong(noises, number, axis))]
    if not wrong:
        found = next(axis for axis in axes if axis is not None)
        words = ", ".join(f"dt^{exponent}" for exponent in found)
        text = f"position, position and velocity, and velocity grow with {words} over {STEPS[0]:g} to {STEPS[-1]:g} s"
        return PartResult().add("noise_powers", True, text)
    text = "; ".join(map(_words, wrong))
    shown_by, exhibit = tracker.probes.general[0].name, _shown(wrong[0])
    finding = Finding("q_wrong_power_of_dt", 0.96, text, shown_by=shown_by, exhibit=exhibit)
    return PartResult().add("noise_powers", False, text, finding)


def _noises(tracker: TrackerUnderTest) -> Array | None:
    """``(steps, 4, 4)``; None where they are not the same at all probes."""
    found = []
    for probe in tracker.probes.general[:3]:
        of_probe = []
        for step in STEPS:
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
        f"{STEPS[0]:g} s and {power.values[-1]:.3g} over {STEPS[-1]:g} s), where dt^{power.right} goes with the "
        f"{power.others}"
    )


def _shown(power: Power) -> OverTime:
    steps = np.array(STEPS)
    right = power.values[0] * (steps / steps[0]) ** power.right
    course = Course(f"process noise of {_named(power.entry)}", power.values, right)
    return OverTime(
        "Process noise of a step", "length of the step, s", steps, (course,), right_name=f"with dt^{power.right}"
    )


NOISE_POWERS_CHECK = DoctorCheck(
    noise_powers,
    place=120,
    questions=(
        Question(
            "noise_powers",
            "Do the entries of the process noise go with the same powers of the time step?",
            misses=True,
        ),
    ),
    of_filters=True,
    of_own_covariance=True,
    faults={
        "q_wrong_power_of_dt": KnownFault(
            "an entry of the process noise has a wrong power of the time step",
            "Where Q is written out.",
            "Position, position and velocity, velocity: dt^4 / 4, dt^3 / 2, dt^2 for G G^T sigma^2; dt^3 / 3, dt^2 / "
            "2, dt for a continuous white noise.",
            Role(
                "motion growth",
                rank=21,
                causes="gain noise growth overconfident_start",
                always="numerical",
                drive="uneven_steps",
            ),
        ),
    },
)
