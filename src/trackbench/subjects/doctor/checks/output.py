"""Is the estimate px, py, vx, vy of the target in the fixed frame?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.exhibits import STATE, Matrices, Panel
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.session import finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Largest error after following a target without noise, m and m/s.
NEAR = 1.0


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


def output(tracker: TrackerUnderTest) -> PartResult:
    """Follow targets without noise, and compare the estimates with the true states."""
    pairs = []
    for probe in tracker.probes.general:
        session, name = tracker.session_of_most(probe), next(iter(tracker.sensors))
        scan = probe.scan(name, tracker.sensors[name], 0.0)
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
    panels = (Panel("tracker", mean[:, None]), Panel("true", truth[:, None], "right"))
    marked = tuple((int(i), 0) for i in np.flatnonzero(np.abs(mean - truth) > NEAR))
    probe = tracker.probes.general[0]
    exhibit = Matrices(f"Estimate of {probe.description}", STATE, ("value",), panels, marked)
    finding = Finding(wrong.fault, 0.98, evidence, shown_by=probe.name, exhibit=exhibit)
    return PartResult().add("output", False, text, finding)


def _numbers(state: Array) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in state) + ")"


OUTPUT_CHECK = DoctorCheck(
    output,
    place=20,
    questions=(Question("output", "Is the estimate px, py, vx, vy in the fixed frame?"),),
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
