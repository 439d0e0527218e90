"""Are the numbers of the estimates whole, as in arrays of integers?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.exhibits import STATE, Matrices, Panel, state_matrices
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.probes import with_noise
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Number of measurements of a track.
LENGTH = 12
#: Number of estimates that are drawn.
SHOWN = 4


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
                estimate = session.step(with_noise(scan, random))
                if estimate is None:
                    continue
                (means if started else first).append(estimate.mean)
                if started:
                    covariances.append(estimate.covariance)
                started = True
    if not means:
        return PartResult().add("integers", None, "there was no estimate")
    whole, exhibit = None, None
    if _whole([mean[:2] for mean in means]):
        whole = f"the positions of all {len(means)} estimates are whole numbers, such as {_numbers(means[-1][:2])} m"
        exhibit = _means_shown("Last estimates", means)
    elif _whole([covariance[:2, :2] for covariance in covariances]) and not _constant(covariances):
        variances = _numbers(np.diag(covariances[-1])[:2])
        whole = (
            f"the covariances of all {len(means)} estimates are whole numbers, such as {variances} m^2 of the position"
        )
        marked = tuple((i, j) for i in (0, 1) for j in (0, 1))
        exhibit = state_matrices("Covariance of an estimate", (Panel("tracker", covariances[-1]),), marked)
    elif len(first) > 1 and _whole([mean[:2] for mean in first]):
        whole = f"the first positions of all {len(first)} tracks are whole numbers, such as {_numbers(first[-1][:2])} m"
        exhibit = _means_shown("First estimates of tracks", first)
    if whole is None:
        text = f"the positions and covariances of {len(means)} estimates are not whole numbers"
        return PartResult().add("integers", True, text)
    shown_by = tracker.probes.general[0].name
    finding = Finding("integer_state_matrix", 0.98, f"{whole}: truncated", shown_by=shown_by, exhibit=exhibit)
    return PartResult().add("integers", False, whole, finding)


def _means_shown(title: str, means: Sequence[Array]) -> Matrices:
    shown = np.array(means[-SHOWN:]).T
    columns = tuple(f"no. {len(means) - shown.shape[1] + k + 1}" for k in range(shown.shape[1]))
    marked = tuple((i, k) for i in (0, 1) for k in range(shown.shape[1]))
    return Matrices(title, STATE, columns, (Panel("tracker", shown),), marked)


def _whole(values: Sequence[Array]) -> bool:
    return all(bool(np.all(np.isfinite(one)) and np.all(one == np.round(one))) for one in values)


def _constant(values: Sequence[Array]) -> bool:
    """As a stated constant is, which may be whole."""
    return all(np.array_equal(one, values[0]) for one in values) and bool(np.diag(values[0]).min() > 0.0)


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)


INTEGERS_CHECK = DoctorCheck(
    integers,
    place=60,
    questions=(Question("integers", "Are the estimates fractions, as the measurements are?"),),
    faults={
        "integer_state_matrix": KnownFault(
            "the state or the covariance is in an array of integers",
            "Where these arrays are made, as by np.array([0, 0, 0, 0]) or dtype=int.",
            "Make them of floats: np.zeros(4), np.array([0.0, ...]); assigning to an array of integers truncates.",
            Role("exact", rank=2, causes="stepped wrong_dt", always="measurement_ignored", drive="own_model"),
        ),
    },
)
