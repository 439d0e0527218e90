"""Is the estimate px, py, vx, vy of the target in the fixed frame?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.exhibits import STATE, Matrices, Panel
from trackbench.subjects.doctor.findings import CheckResult, DoctorCheck, Finding, KnownFault, PartResult, Question
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
    question = "Is the estimate px, py, vx, vy in the fixed frame?"
    pairs = []
    for probe in tracker.probes.general:
        session, name = tracker.session_of_most(probe), next(iter(tracker.sensors))
        scan = probe.scan(name, tracker.sensors[name], 0.0)
        estimate = tracker.predict(session, scan, probe.name)
        if estimate is not None and finite(estimate):
            pairs.append((estimate.mean, probe.truth(0.0)))
    if not pairs:
        return PartResult([CheckResult("output", question, None, "there was no estimate")])

    def worst(matrix: Array) -> float:
        return max(float(np.abs(mean - matrix @ truth).max()) for mean, truth in pairs)

    error = worst(np.eye(4))
    found = None if error < NEAR else next((one for one in WRONG_OUTPUTS if worst(one.matrix) < NEAR), None)
    text = f"the largest error after following {len(pairs)} targets without noise is {error:.3g} m or m/s"
    result = PartResult([CheckResult("output", question, found is None, text)])
    if found is not None:
        mean, truth = pairs[0]
        text = f"{found.description}: the target is at {_numbers(truth)} and the estimate is {_numbers(mean)}, "
        text += f"and likewise for all {len(pairs)} targets"
        panels = (Panel("tracker", mean[:, None]), Panel("true", truth[:, None], "right"))
        marked = tuple((int(i), 0) for i in np.flatnonzero(np.abs(mean - truth) > NEAR))
        exhibit = Matrices(f"Estimate of {tracker.probes.general[0].description}", STATE, ("value",), panels, marked)
        shown_by = tracker.probes.general[0].name
        result.findings.append(Finding(found.fault, 0.98, text, shown_by=shown_by, exhibit=exhibit))
    return result


def _numbers(state: Array) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in state) + ")"


CHECKS = (
    DoctorCheck(
        output,
        place=20,
        questions=(Question("output", "Is the estimate px, py, vx, vy in the fixed frame?"),),
        asks_at_misses=True,
        faults={
            "axis_swapped": KnownFault(
                "two axes are swapped",
                "Where measurements are read and where the estimate is returned (px, py, vx, vy).",
                "x is along the boresight and y to its left; the azimuth starts at x; the estimate's order is px, py, "
                "vx, vy.",
                kinds=("exact",),
                rank=7,
                consequences=("axes",),
                drive="tangential_pass",
            ),
            "axis_mirrored": KnownFault(
                "an axis points the wrong way",
                "Where the measurements of this sensor are read.",
                "y is to the left of the boresight, and azimuths are counter-clockwise.",
                kinds=("exact",),
                rank=8,
                consequences=("axes",),
                drive="azimuth_crossing",
            ),
        },
    ),
)
