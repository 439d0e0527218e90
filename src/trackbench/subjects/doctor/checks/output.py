"""Is the estimate px, py, vx, vy of the target in the fixed frame, in numbers that are not whole?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import with_measurement_noise
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Largest error after following a target without noise, m and m/s.
NEAR = 1.0
#: Number of measurements of a track.
LENGTH = 12
#: Number of estimates that are drawn.
SHOWN = 4


class WrongOutput(NamedTuple):
    """An estimate with its components in another order or with other signs."""

    fault: str
    description: str
    matrix: Array
    """``(4, 4)`` from the true state to the estimate."""


def _signed(order: str, signs: tuple[int, ...] = (1, 1, 1, 1)) -> Array:
    names = ("px", "py", "vx", "vy")
    return np.array(
        [[sign * (name == item) for name in names] for sign, item in zip(signs, order.split(), strict=True)]
    )


WRONG_OUTPUTS = (
    WrongOutput("axis_swapped", "the estimate is px, vx, py, vy", _signed("px vx py vy")),
    WrongOutput("axis_swapped", "the estimate is py, px, vy, vx", _signed("py px vy vx")),
    WrongOutput("axis_swapped", "the estimate is px, py, vy, vx", _signed("px py vy vx")),
    WrongOutput("axis_swapped", "the estimate is py, px, vx, vy", _signed("py px vx vy")),
    WrongOutput("axis_swapped", "the estimate has the velocity before the position", _signed("vx vy px py")),
    WrongOutput("axis_mirrored", "y has the other sign in the estimate", _signed("px py vx vy", (1, -1, 1, -1))),
    WrongOutput("axis_mirrored", "x has the other sign in the estimate", _signed("px py vx vy", (-1, 1, -1, 1))),
)


@doctor_check(
    Question("output", "Is the estimate px, py, vx, vy in the fixed frame?"),
    place=20,
    asks_at_misses=True,
    faults={
        "axis_swapped": KnownFault(
            "two axes are swapped",
            "Where measurements are read and where the estimate is returned (px, py, vx, vy).",
            "x is along the boresight and y to its left; the azimuth starts at x; the estimate's order is px, py, vx, "
            "vy.",
            Role("exact", rank=7, causes="axes", drive="tangential_pass"),
        ),
        "axis_mirrored": KnownFault(
            "an axis points the wrong way",
            "Where the measurements of this sensor are read.",
            "y is to the left of the boresight, and azimuths are counter-clockwise.",
            Role("exact", rank=8, causes="axes", drive="azimuth_crossing"),
        ),
    },
)
def output(tracker: TrackerUnderTest) -> PartResult:
    """Follow targets without noise, and compare the estimates with the true states."""
    pairs = []
    for probe in tracker.probes.general:
        session, name = tracker.session_of_most(probe), next(iter(tracker.sensors))
        scan = tracker.scan(probe, name, 0.0)
        estimate = tracker.predict(session, scan, probe.name)
        if estimate is not None and finite(estimate):
            pairs.append((estimate.mean, probe.truth(0.0)))
    if not pairs:
        return PartResult().add("output", None, "there was no estimate")

    def worst(matrix: Array) -> float:
        return max(float(np.abs(mean - matrix @ truth).max()) for mean, truth in pairs)

    error = worst(np.eye(4))
    wrong = None if error < NEAR else next((output for output in WRONG_OUTPUTS if worst(output.matrix) < NEAR), None)
    text = f"the largest error after following {len(pairs)} targets without noise is {error:.3g} m or m/s"
    if wrong is None:
        return PartResult().add("output", True, text)
    mean, truth = pairs[0]
    evidence = f"{wrong.description}: the target is at {_numbers(truth)} and the estimate is {_numbers(mean)}, "
    evidence += f"and likewise for all {len(pairs)} targets"
    probe = tracker.probes.general[0]
    finding = Finding(wrong.fault, 0.98, evidence, shown_by=probe.name)
    return PartResult().add("output", False, text, finding)


def _numbers(state: Array) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in state) + ")"


@doctor_check(
    Question("integers", "Are the estimates fractions, as the measurements are?"),
    place=60,
    faults={
        "integer_state_matrix": KnownFault(
            "the state or the covariance is in an array of integers",
            "Where these arrays are made, as by np.array([0, 0, 0, 0]) or dtype=int.",
            "Make them of floats: np.zeros(4), np.array([0.0, ...]); assigning to an array of integers truncates.",
            Role("exact", rank=2, causes="stepped wrong_dt", always="measurement_ignored", drive="own_model"),
        )
    },
)
def integers(tracker: TrackerUnderTest) -> PartResult:
    """Start tracks with noise, and look for whole numbers in all of their estimates."""
    random = np.random.default_rng([tracker.seed, 2])
    means: list[Array] = []
    covariances: list[Array] = []
    first: list[Array] = []
    for probe in tracker.probes.general:
        session, started = TrackerSession(tracker.make), False
        with tracker.recording_failures(probe.name):
            for scan in tracker.approach(probe, tracker.sensor_sets()[-1])[:LENGTH]:
                estimate = session.step(with_measurement_noise(scan, random))
                if estimate is None:
                    continue
                (means if started else first).append(estimate.mean)
                if started:
                    covariances.append(estimate.covariance)
                started = True
    if not means:
        return PartResult().add("integers", None, "there was no estimate")
    whole = None
    if _whole([mean[:2] for mean in means]):
        whole = f"the positions of all {len(means)} estimates are whole numbers, such as {_plain(means[-1][:2])} m"
    elif _whole([covariance[:2, :2] for covariance in covariances]) and not _constant(covariances):
        variances = _plain(np.diag(covariances[-1])[:2])
        whole = (
            f"the covariances of all {len(means)} estimates are whole numbers, such as {variances} m^2 of the position"
        )
    elif len(first) > 1 and _whole([mean[:2] for mean in first]):
        whole = f"the first positions of all {len(first)} tracks are whole numbers, such as {_plain(first[-1][:2])} m"
    if whole is None:
        text = f"the positions and covariances of {len(means)} estimates are not whole numbers"
        return PartResult().add("integers", True, text)
    shown_by = tracker.probes.general[0].name
    finding = Finding("integer_state_matrix", 0.98, f"{whole}: truncated", shown_by=shown_by)
    return PartResult().add("integers", False, whole, finding)


def _whole(values: Sequence[Array]) -> bool:
    return all(bool(np.all(np.isfinite(one)) and np.all(one == np.round(one))) for one in values)


def _constant(values: Sequence[Array]) -> bool:
    """As a stated constant is, which may be whole."""
    return all(np.array_equal(one, values[0]) for one in values) and bool(np.diag(values[0]).min() > 0.0)


def _plain(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)
